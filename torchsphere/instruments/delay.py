"""Delay between two signals of the same shape, by least squares.

One is put over the other, ``b(t) = g a(t - d) + o``: their delay ``d`` from the peak of their correlation, then to a
fraction of a sample on a smoothed spline through ``a``. The standard deviation is that of the slope of the sum of
squares by what remains between them, whatever the colour of that noise.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import CubicSpline
from scipy.ndimage import gaussian_filter1d, uniform_filter1d

Array = NDArray[np.float64]

#: Samples that a signal needs at least.
FEWEST = 8

#: Width of the smoothing of both signals, as a share of the half width of their correlation's peak. It takes the noise
#: beyond the signal's own frequencies away, and moves no symmetric peak.
SMOOTHING = 0.1

#: Correlation of the signals, once aligned, below which they are not the same event: less than half of the one follows
#: from the other. Of the tests' pulses it is 0.86 and more with noise of half their height, of noise alone below 0.45.
LEAST_CORRELATION = 0.7

#: Steps of the search for the delay, and the share of a sample at which it stops.
STEPS, SETTLED = 50, 1e-6


_ADVICE = (
    "give the part of both that holds the whole event, and turn one over (or its direction) where it falls as the "
    "other rises"
)


@dataclass(frozen=True)
class Fit:
    """Delay and its standard deviation in samples, gain, offset and correlation."""

    delay: float
    sd: float
    gain: float
    sd_gain: float
    offset: float
    correlation: float


def fit_delay(a: Array, b: Array, start: float) -> Fit:
    """Least squares of ``b(t) = g a(t - d) + o`` over all samples (n,) that both have, from a first ``d``.

    Raises
    ------
    ValueError
        If no delay puts the one signal over the other.
    """
    spline, places = CubicSpline(np.arange(len(a)), a), np.arange(float(len(b)))
    delay, gain, offset = start, 1.0, 0.0
    for _ in range(STEPS):
        at = places - delay
        inside = (at >= 0) & (at <= len(a) - 1)
        if inside.sum() < FEWEST:
            raise ValueError("The signals do not overlap once they are aligned; give longer parts of them")
        value, slope = spline(at[inside]), spline(at[inside], 1)
        columns = np.stack((value, np.ones_like(value)), 1)
        (gain, offset), *_ = np.linalg.lstsq(columns, b[inside], rcond=None)
        remains = b[inside] - gain * value - offset
        # Both slopes have noise of their own: their product is what signal and signal share.
        slope_b = np.gradient(b[inside])
        curvature = -gain * float(slope @ slope_b)
        move = float(np.clip((slope * gain) @ remains / curvature, -1.0, 1.0))
        delay += move
        if abs(move) < SETTLED:
            break
    else:
        raise ValueError(f"No delay puts one signal over the other; {_ADVICE}")
    moved, centred = gain * (slope - slope.mean()), value - value.mean()
    correlation = float(np.corrcoef(value, b[inside])[0, 1])
    if not correlation >= LEAST_CORRELATION:
        raise ValueError(
            f"The signals are not of one shape: at best their correlation is {correlation:.2f}, expected "
            f"{LEAST_CORRELATION} or more; {_ADVICE}"
        )
    sd, sd_gain = _sd_of_sum(moved, remains) / abs(curvature), _sd_of_sum(centred, remains) / float(centred @ centred)
    return Fit(delay, sd, float(gain), sd_gain, float(offset), correlation)


def best_fit(a: Array, b: Array, starts: Sequence[float]) -> Fit:
    """The `fit_delay` from one of several first delays that leaves the highest correlation; raises where none does."""
    fits: list[Fit] = []
    refused = None
    for start in dict.fromkeys(starts):
        try:
            fits.append(fit_delay(a, b, start))
        except ValueError as error:
            refused = error
    if refused is not None and not fits:
        raise refused
    return max(fits, key=lambda fit: fit.correlation)


def _sd_of_sum(weights: Array, noise: Array) -> float:
    """Standard deviation of the sum of weights times noise, both (n,), by their spectra: for noise of any colour."""
    size = 2 * len(weights)
    spectrum = np.abs(np.fft.rfft(weights, size)) ** 2 * np.abs(np.fft.rfft(noise, size)) ** 2
    each = np.full(len(spectrum), 2.0)
    each[[0, -1]] = 1.0
    return math.sqrt(float((each * spectrum).sum()) / size / len(weights))


def sd_by_raw_noise(a: Array, b: Array, fit: Fit, width: float) -> float:
    """Standard deviation of a delay in samples by the noise of the raw signals, which were smoothed to find it.

    What remains of the smoothed ones lacks the part of the noise that moved the delay (measured: 0.8 of the true one).
    The raw noise's spectrum is taken as smooth over a twentieth of the frequencies instead.
    """
    places = np.arange(float(len(b))) - fit.delay
    inside = (places >= 0) & (places <= len(a) - 1)
    remains = b[inside] - fit.gain * CubicSpline(np.arange(len(a)), a)(places[inside]) - fit.offset
    slope_a = gaussian_filter1d(np.gradient(a), width)
    slope = fit.gain * CubicSpline(np.arange(len(a)), slope_a)(places[inside])
    slope_b = gaussian_filter1d(np.gradient(b), width)[inside]
    count = len(remains)
    spectrum = uniform_filter1d(np.abs(np.fft.rfft(remains, 2 * count)) ** 2 / count, max(count // 20, 1))
    moved = np.abs(np.fft.rfft(gaussian_filter1d(slope, width), 2 * count)) ** 2
    weight = np.full(len(moved), 2.0)
    weight[[0, -1]] = 1.0
    return math.sqrt(float((weight * spectrum * moved).sum()) / (2 * count)) / abs(float(slope @ slope_b))


def coarse(a: Array, b: Array) -> float:
    """Delay in whole samples at the peak of the correlation."""
    correlation = _correlation(a, b)
    lags = np.concatenate((np.arange(len(b)), np.arange(-len(a) + 1, 0)))
    ranked = correlation[np.where(lags >= 0, lags, len(correlation) + lags)]
    return float(lags[ranked.argmax()])


def _correlation(a: Array, b: Array) -> Array:
    """Circular correlation, padded so that nothing wraps, of two signals about their medians."""
    size = len(a) + len(b)
    return np.fft.irfft(np.conj(np.fft.rfft(a - np.median(a), size)) * np.fft.rfft(b - np.median(b), size), size)


def smoothing(a: Array, b: Array) -> float:
    """Width of the smoothing, samples, from the half width of the correlation's peak."""
    correlation = _correlation(a, b)
    top = int(correlation.argmax())
    fallen = np.flatnonzero(np.roll(correlation, -top)[: len(a)] < 0.5 * correlation[top])
    return SMOOTHING * float(fallen[0] if len(fallen) else len(a))
