"""Rates by local polynomials: Savitzky and Golay's filter, of which plain central differences are the shortest.

Source: Savitzky and Golay, Analytical Chemistry 36 (1964) 1627, DOI 10.1021/ac60214a047; here also for uneven times.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
import torch
from kornia.geometry.liegroup import So3
from numpy.typing import NDArray

from torchsphere.geometry.orientation import chain
from torchsphere.settings.limits import require_window

Array = NDArray[np.float64]

#: Frames whose windows are fitted at once.
AT_ONCE = 2000


@dataclass(frozen=True)
class Rates:
    """First and second derivative of the pose at each frame, and their variances, all (n, 5); NaN where there are none.

    ``weights`` (2, w) are those of the poses around a frame amid even times, and ``offsets`` (w,) their times.
    """

    first: Array
    second: Array
    variance_first: Array
    variance_second: Array
    weights: Array
    offsets: Array


def rates(
    times: Array,
    increment: Array,
    joined: NDArray[np.bool_],
    variance: Array,
    *,
    window: int,
    order: int,
    shifted: bool,
) -> Rates:
    """Fit a polynomial to the poses of ``window`` frames around each frame.

    Parameters
    ----------
    times : ndarray
        (n,), rising.
    increment : ndarray
        (n - 1, 5), read where ``joined``.
    joined : ndarray
        (n - 1, 2), True where translation, and rotation, were measured. No fit reaches over a gap.
    variance : ndarray
        Of each pose's error (n, 5).
    window, order : int
        Odd number of frames, and order of the polynomial.
    shifted : bool
        Near the ends of a run, take the window that still fits instead of none.

    Raises
    ------
    ValueError
        If the window is even or not longer than the order, or the order below 2.
    """
    require_window(window, order)
    n = len(times)
    first, second, variance_first, variance_second = (np.full((n, 5), np.nan) for _ in range(4))
    for group, columns in enumerate((slice(0, 2), slice(2, 5))):
        for start, stop in runs(joined[:, group]):
            if stop - start < window:
                continue
            frames = np.arange(start, stop)
            low = np.clip(frames - window // 2, start, stop - window)
            if not shifted:
                frames, low = frames[window // 2 : len(frames) - window // 2], np.unique(low)
            chained = _chained(increment[start : stop - 1, columns])
            # All windows of 20,000 frames at once took 41 MB, by which a track's memory grew.
            for block in range(0, len(frames), AT_ONCE):
                at, around = frames[block : block + AT_ONCE], low[block : block + AT_ONCE, None] + np.arange(window)
                weights = _weights(times[around] - times[at, None], order)
                poses = _relative(chained, around - start, at - start)
                derivatives, variances = weights @ poses, weights**2 @ variance[around][..., columns]
                first[at, columns], second[at, columns] = derivatives[:, 0], derivatives[:, 1]
                variance_first[at, columns], variance_second[at, columns] = variances[:, 0], variances[:, 1]
    offsets: Array = (np.arange(float(window)) - window // 2) * float(np.median(np.diff(times)))
    return Rates(first, second, variance_first, variance_second, _weights(offsets[None], order)[0], offsets)


def runs(joined: NDArray[np.bool_]) -> list[tuple[int, int]]:
    """First frame and the one after the last of each run of frames without a gap."""
    edges = np.flatnonzero(np.diff(np.concatenate(([False], joined, [False])).astype(int)))
    return [(int(a), int(b) + 1) for a, b in zip(edges[::2], edges[1::2], strict=True)]


def _weights(times: Array, order: int) -> Array:
    """Weights (m, 2, w) of values at ``times`` (m, w) for the first and second derivative of their polynomial at 0."""
    size = np.abs(times).max(1)[:, None, None]
    inverse = np.linalg.pinv((times[..., None] / size) ** np.arange(order + 1))
    return np.concatenate([inverse[:, k : k + 1] * math.factorial(k) / size**k for k in (1, 2)], 1)


def _chained(steps: Array) -> Array:
    """Poses of a run from its first frame on, by the steps (r - 1, d): (r, 2) in px, or matrices (r, 3, 3)."""
    steps = np.concatenate((np.zeros((1, steps.shape[1])), steps))
    return steps.cumsum(0) if steps.shape[1] == 2 else chain(steps, np.ones(len(steps), dtype=bool))


def _relative(chained: Array, around: NDArray[np.int64], at: NDArray[np.int64]) -> Array:
    """Poses (m, w, d) of the frames ``around`` (m, w) relative to those ``at`` (m,) of a run of `_chained` poses.

    Rotations are in the tangent space of the latter.
    """
    if chained.ndim == 2:
        return chained[around] - chained[at, None]
    relative = chained[around] @ np.swapaxes(chained[at], 1, 2)[:, None]
    turned = So3.from_matrix(torch.from_numpy(relative.reshape(-1, 3, 3))).log().numpy()
    return turned.reshape(*around.shape, 3)
