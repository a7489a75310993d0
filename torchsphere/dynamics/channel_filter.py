"""Channel frequency classes of ISO 6487 and SAE J211-1: the low-pass filter of crash and impact laboratories.

A Butterworth filter of two poles runs forward and backward, so that it delays nothing. Classes 60, 180, 600 and 1000
lose 3 dB at 100, 300, 1000 and 1650 Hz.

References: SAE J211-1, "Instrumentation for Impact Test - Part 1", appendix C; ISO 6487, annex A.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from torchsphere.runtime.arrays import Array
from torchsphere.settings.limits import SettingError, as_positive, require_channel_class

#: Frequency at which one pass loses 3 dB, Hz per unit of the class: SAE J211-1 (docs/constants.toml).
DESIGN_PER_CLASS = 2.0775

#: Least frame rate, 1/s per unit of the class: SAE J211-1 and ISO 6487 (docs/constants.toml).
MIN_RATE_PER_CLASS = 10.0

#: Length of the padding at each end, times one over the class in Hz (docs/constants.toml).
PADDING_PER_CLASS = 1.0

#: Errors whose responses are computed at once; chosen for the memory that they take.
_BLOCK = 256


def require_class(cfc: Any, rate_hz: float) -> None:
    """Raise SettingError unless ``cfc`` is 60, 180, 600 or 1000 and the frame rate is at least ten times as high."""
    require_channel_class("cfc", cfc)
    least = MIN_RATE_PER_CLASS * cfc
    if rate_hz < least:
        raise SettingError(
            f"`cfc` = {cfc}: the frame rate is {rate_hz:g} frames per second, and ISO 6487 and SAE J211 ask for at "
            f"least {least:g} for this class; give a lower class, or none"
        )


def coefficients(rate_hz: float, cfc: int) -> tuple[Array, Array]:
    """Coefficients (3,) of input and output of one pass: ``y[t] = sum a[k] x[t-k] - sum_{k>0} b[k] y[t-k]``, b[0] = 1.

    SAE J211-1, appendix C, with T one over the frame rate: ``wd = 2 pi 2.0775 CFC``, ``wa = tan(wd T / 2)``.
    """
    w = math.tan(math.pi * DESIGN_PER_CLASS * cfc / rate_hz)
    divisor = 1 + math.sqrt(2) * w + w**2
    own = w**2 / divisor * np.array([1.0, 2.0, 1.0])
    return own, np.array([1.0, 2 * (w**2 - 1) / divisor, (1 - math.sqrt(2) * w + w**2) / divisor])


def channel_filter(values: ArrayLike, rate_hz: float, cfc: int) -> Array:
    """Values at even times, filtered by a channel frequency class.

    Parameters
    ----------
    values : array_like
        (n,) or (n, k), at even times; NaN where not known. Each run without NaN is filtered on its own.
    rate_hz : float
        Values per second.
    cfc : int
        60, 180, 600 or 1000.

    Returns
    -------
    ndarray
        As ``values``; NaN where they are. At its ends a run is continued by its own reflection at the end's point
        (inverse mirror).

    Raises
    ------
    ValueError
        If the class is none of the four, or the rate is less than ten times the class.

    References
    ----------
    SAE J211-1, appendix C; ISO 6487, annex A.
    """
    rate_hz = as_positive("rate_hz", rate_hz)
    require_class(cfc, rate_hz)
    given = np.asarray(values, dtype=np.float64)
    columns = given.reshape(len(given), -1)
    filtered = np.full(columns.shape, np.nan)
    for column in range(columns.shape[1]):
        for start, stop in _known_runs(columns[:, column]):
            filtered[start:stop, column] = _passes(columns[start:stop, column : column + 1], rate_hz, cfc)[:, 0]
    return filtered.reshape(given.shape)


def channel_filter_sd(sd: ArrayLike, rate_hz: float, cfc: int, stencil: Sequence[float] = (1.0,)) -> Array:
    """Standard deviations of filtered values, from those of the independent errors that the values are made of.

    Parameters
    ----------
    sd : array_like
        (m,) or (m, k), standard deviations of independent errors e; NaN where a value is not known.
    rate_hz, cfc
        As `channel_filter`.
    stencil : sequence of float
        The error of value i before the filter is ``sum_j stencil[j] e[i + j]``: (1, -2, 1) for second differences. By
        default each value has an error of its own.

    Returns
    -------
    ndarray
        (m - s + 1,) or (m - s + 1, k) with s the length of the stencil; NaN where an error is not known.

    Raises
    ------
    ValueError
        As `channel_filter`.

    Notes
    -----
    The response of the filter to each error, squared and summed: exact but for shares below 1e-4 of the response.
    """
    rate_hz = as_positive("rate_hz", rate_hz)
    require_class(cfc, rate_hz)
    given = np.asarray(sd, dtype=np.float64)
    columns = given.reshape(len(given), -1)
    count = max(len(columns) - len(stencil) + 1, 0)
    found = np.full((count, columns.shape[1]), np.nan)
    for column in range(columns.shape[1]):
        for start, stop in _known_runs(columns[:, column]):
            if stop - start >= len(stencil):
                variance = _variance(columns[start:stop, column] ** 2, stencil, rate_hz, cfc)
                found[start : stop - len(stencil) + 1, column] = np.sqrt(variance)
    return found.reshape(count, *given.shape[1:])


def _variance(source: Array, stencil: Sequence[float], rate_hz: float, cfc: int) -> Array:
    """Variance (n,) of the filtered values of a run from that of its errors (n + s - 1,)."""
    count, reach = len(source) - len(stencil) + 1, _padding(rate_hz, cfc)
    variance = np.zeros(count)
    place, response = (0, 0, 0), np.zeros((0, 0))
    for first in range(0, len(source), _BLOCK):
        errors = np.arange(first, min(first + _BLOCK, len(source)))
        low, high = max(first - len(stencil) + 1 - reach, 0), min(first + len(errors) + reach, count)
        # Blocks at the same place within their window have the same response.
        if place != (first - low, high - first, len(errors)):
            place = first - low, high - first, len(errors)
            response = _passes(_impulses(errors - low, high - low, stencil), rate_hz, cfc) ** 2
        variance[low:high] += response @ source[errors]
    return variance


def _impulses(errors: NDArray[np.int64], count: int, stencil: Sequence[float]) -> Array:
    """What each of the errors adds to the values (count, e): error j is part of value j - k with ``stencil[k]``."""
    impulses = np.zeros((count, len(errors)))
    for k, weight in enumerate(stencil):
        values = errors - k
        inside = (values >= 0) & (values < count)
        impulses[values[inside], np.flatnonzero(inside)] += weight
    return impulses


def _passes(values: Array, rate_hz: float, cfc: int) -> Array:
    """Columns of (n, k), filtered forward and backward."""
    from scipy.signal import lfilter, lfilter_zi

    own, past = coefficients(rate_hz, cfc)
    padding, rest = _padding(rate_hz, cfc), lfilter_zi(own, past)[:, None]
    padded = np.pad(values, ((padding, padding), (0, 0)), mode="reflect", reflect_type="odd")
    for _ in range(2):
        # Each pass starts at rest at its first value.
        padded = lfilter(own, past, padded, axis=0, zi=rest * padded[:1])[0][::-1]
    return np.asarray(padded[padding : padding + len(values)])


def _padding(rate_hz: float, cfc: int) -> int:
    return math.ceil(PADDING_PER_CLASS * rate_hz / cfc)


def _known_runs(values: Array) -> NDArray[np.int64]:
    """Starts and ends (r, 2) of the runs without NaN."""
    known = np.concatenate(([False], np.isfinite(values), [False])).astype(np.int8)
    return np.flatnonzero(np.diff(known)).reshape(-1, 2)
