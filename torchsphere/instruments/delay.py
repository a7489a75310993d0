"""Delay between two signals of the same shape, by least squares.

``b(t) = g a(t - d) + o``: the delay ``d`` comes from the peak of their correlation, then to a fraction of a sample from
a smoothed spline through ``a``. Its standard deviation is that of the gradient of the sum of squares by the residual of
the fit, for noise of any colour.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.interpolate import CubicSpline
from scipy.ndimage import gaussian_filter1d, uniform_filter1d

from torchsphere.runtime import steps
from torchsphere.runtime.arrays import Array

#: Fewest samples of a signal (docs/constants.toml).
MIN_SAMPLES = 8

#: Smoothing of both signals, as a share of the half width of their correlation's peak (docs/constants.toml).
SMOOTHING = 0.1

#: Least correlation of two aligned signals of the same event (docs/constants.toml).
MIN_CORRELATION = 0.7

#: Fewest neighbouring frequencies of a noise that tell its power (docs/constants.toml).
MIN_FREQUENCIES = 50

#: Most steps of the search for the delay, and the step at which it has converged, samples.
MAX_STEPS, CONVERGED = 50, 1e-6

#: Median of the square of a standard normal number.
CHI2_MEDIAN = 0.4549

#: Relative precision of a double.
RESOLUTION = float(np.finfo(np.float64).eps)

_ADVICE = (
    "give the part of both that holds the whole event, and invert one signal (or its direction) if it falls where the "
    "other rises"
)


@dataclass(frozen=True)
class DelayFit:
    """Delay and its standard deviation in samples, gain, offset and correlation."""

    delay: float
    sd: float
    gain: float
    sd_gain: float
    offset: float
    correlation: float


def fit_delay(a: Array, b: Array, start: float) -> DelayFit:
    """Least squares of ``b(t) = g a(t - d) + o`` over all samples (n,) that both have, from a first ``d``.

    Raises ValueError if no delay puts the one signal over the other.
    """
    spline, times = CubicSpline(np.arange(len(a)), a), np.arange(float(len(b)))
    delay, gain, offset, chosen_for = start, 1.0, 0.0, math.inf
    inside = np.zeros(len(b), dtype=bool)
    for _ in range(MAX_STEPS):
        moved = times - delay
        if abs(delay - chosen_for) > 1:
            # Held for a sample: at a delay of whole samples the last one would come and go, and no step would be small.
            chosen_for, inside = delay, (moved >= 1) & (moved <= len(a) - 2)
        if inside.sum() < MIN_SAMPLES:
            raise ValueError("The signals do not overlap once they are aligned; give longer parts of them")
        value, slope = spline(moved[inside]), spline(moved[inside], 1)
        columns = np.stack((value, np.ones_like(value)), 1)
        (gain, offset), *_ = np.linalg.lstsq(columns, b[inside], rcond=None)
        residual = b[inside] - gain * value - offset
        # The slopes of the two signals have independent noise, so that their product is free of its square.
        rise = np.gradient(b[inside])
        curvature = -gain * float(slope @ rise)
        # A signal that is flat where both overlap has no delay: the quotient would be of rounding alone.
        least = RESOLUTION * abs(gain) * float(np.linalg.norm(slope) * np.linalg.norm(rise))
        if not abs(curvature) > least or not np.ptp(value) > 0 or not np.ptp(b[inside]) > 0:
            raise ValueError(f"No delay puts one signal over the other; {_ADVICE}")
        step = float(np.clip((slope * gain) @ residual / curvature, -1.0, 1.0))
        delay += step
        if abs(step) < CONVERGED:
            break
    else:
        raise ValueError(f"No delay puts one signal over the other; {_ADVICE}")
    correlation = float(np.corrcoef(value, b[inside])[0, 1])
    if not correlation >= MIN_CORRELATION:
        raise ValueError(
            f"The signals are not of one shape: at best their correlation is {correlation:.2f}, expected "
            f"{MIN_CORRELATION} or more; {_ADVICE}"
        )
    centred = value - value.mean()
    sd = _sd_of_sum(gain * (slope - slope.mean()), residual) / abs(curvature)
    sd_gain = _sd_of_sum(centred, residual) / float(centred @ centred)
    return DelayFit(delay, sd, float(gain), sd_gain, float(offset), correlation)


def best_fit(a: Array, b: Array, starts: Sequence[float]) -> DelayFit:
    """The `fit_delay` with the highest correlation among those from several first delays; raises if all fail."""
    fits: list[DelayFit] = []
    refusal = None
    for start in dict.fromkeys(starts):
        try:
            fits.append(fit_delay(a, b, start))
        except ValueError as error:
            refusal = error
    if refusal is not None and not fits:
        raise refusal
    return max(fits, key=lambda fit: fit.correlation)


def _sd_of_sum(weights: Array, noise: Array) -> float:
    """Standard deviation of the sum of weights times noise, both (n,), by their spectra: for noise of any colour."""
    return math.sqrt(_total(_power(weights) * _power(noise)) / (2 * len(weights)) / len(weights))


def _power(signal: Array) -> Array:
    """One side of the power spectrum of a signal (n,), padded so that nothing wraps."""
    return np.abs(np.fft.rfft(signal, 2 * len(signal))) ** 2


def _total(power: Array) -> float:
    """Sum over both sides of a spectrum of which one side is given."""
    sides = np.full(len(power), 2.0)
    sides[[0, -1]] = 1.0
    return float((sides * power).sum())


def sd_by_raw_noise(a: Array, b: Array, fit: DelayFit, width: float) -> float:
    """Standard deviation of a delay in samples by the noise of the raw signals, which were smoothed for the fit.

    The residual of the smoothed signals lacks the part of the noise that moved the delay, so that it states too little
    (docs/constants.toml). The raw noise's spectrum is taken as smooth over a twentieth of the frequencies instead. The
    fit of gain, offset and delay takes a share of the noise at these frequencies, which is added again.
    """
    moved = np.arange(float(len(b))) - fit.delay
    inside = (moved >= 0) & (moved <= len(a) - 1)
    samples = np.arange(len(a))
    value = CubicSpline(samples, a)(moved[inside])
    residual = b[inside] - fit.gain * value - fit.offset
    slope_a = gaussian_filter1d(np.gradient(a), width)
    slope = fit.gain * CubicSpline(samples, slope_a)(moved[inside])
    slope_b = gaussian_filter1d(np.gradient(b), width)[inside]
    count = len(residual)
    weights = _power(gaussian_filter1d(slope, width))

    def weighed(noise: Array) -> float:
        return _total(uniform_filter1d(_power(noise) / count, max(count // 20, MIN_FREQUENCIES)) * weights)

    fitted, _ = np.linalg.qr(np.stack((np.ones(count), gaussian_filter1d(value, width), slope), 1))
    kept = max(1 - sum(map(weighed, fitted.T)) / _total(weights), RESOLUTION)
    return math.sqrt(weighed(residual) / kept / (2 * count)) / abs(float(slope @ slope_b))


def sd_by_sampling(a: Array, b: Array, width: float) -> float:
    """Standard deviation of a delay in samples by what lies between the samples of two signals, which were smoothed.

    The part of a rise that its neighbours do not tell may lie anywhere in its interval, so that its time has a standard
    deviation of ``1 / sqrt(12)``. This part is the second difference of the rises, scaled so that a step keeps its
    height, less the noise that most samples show. A rise that moves by ``t`` moves the fit by ``t`` times the smoothed
    slope there over the sum of its squares.
    """
    variance = 0.0
    for signal in (a, b):
        untold = (np.diff(signal, 3) / math.sqrt(6)) ** 2
        slope = np.diff(gaussian_filter1d(signal, width))
        weights = (gaussian_filter1d(slope, width)[1:-1] / float(slope @ slope)) ** 2
        by_noise = np.median(untold) / CHI2_MEDIAN
        variance += max(float((untold - by_noise) @ weights), 0.0) / 12
    return math.sqrt(variance)


def whole_sample_delay(a: Array, b: Array) -> float:
    """Delay in whole samples at the peak of the correlation."""
    steps.tell("looking for the delay of two signals of %d samples", len(a))
    correlation = _correlation(a, b)
    lags = np.concatenate((np.arange(len(b)), np.arange(-len(a) + 1, 0)))
    return float(lags[correlation[lags].argmax()])


def _correlation(a: Array, b: Array) -> Array:
    """Circular correlation of two signals about their medians, padded so that nothing wraps."""
    size = len(a) + len(b)
    return np.fft.irfft(np.conj(np.fft.rfft(a - np.median(a), size)) * np.fft.rfft(b - np.median(b), size), size)


def smoothing_width(a: Array, b: Array) -> float:
    """Width of the smoothing, samples, from the half width of the correlation's peak.

    It is a sample or more, as no spline follows an edge between two samples.
    """
    correlation = _correlation(a, b)
    peak = int(correlation.argmax())
    below_half = np.flatnonzero(np.roll(correlation, -peak)[: len(a)] < 0.5 * correlation[peak])
    return max(SMOOTHING * float(below_half[0] if len(below_half) else len(a)), 1.0)
