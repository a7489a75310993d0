"""What the measurement is compared with: light gates and accelerometers, from CSV.

Two signals of the same shape are put over each other by least squares, ``b(t) = g a(t - d) + o``: their delay ``d``
from the peak of their correlation, then to a fraction of a sample on a smoothed spline through ``a``. The standard
deviation is that of the slope of the sum of squares by what remains between them, whatever the colour of that noise.
"""

from __future__ import annotations

import csv
import dataclasses
import math
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import CubicSpline
from scipy.ndimage import gaussian_filter1d, uniform_filter1d

from torchsphere.kinematics import Kinematics

Array = NDArray[np.float64]

#: Samples that a signal needs at least.
FEWEST = 8

#: Width of the smoothing of both signals, as a share of the half width of their correlation's peak. It takes the noise
#: beyond the signal's own frequencies away, and moves no symmetric peak.
SMOOTHING = 0.1

#: Steps of the search for the delay, and the share of a sample at which it stops.
STEPS, SETTLED = 50, 1e-6


@dataclass(frozen=True)
class Signals:
    """Columns of a file: time (n,), s, rising and even to 1 %, and values (n,) by their names."""

    time_s: Array
    values: dict[str, Array]


@dataclass(frozen=True)
class GateVelocity:
    """Velocity by a light gate, m/s, and the delay between its barriers, s, with standard deviations."""

    velocity_m_s: float
    sd_velocity_m_s: float
    delay_s: float
    sd_delay_s: float
    correlation: float


@dataclass(frozen=True)
class Alignment:
    """An accelerometer beside the track.

    Attributes
    ----------
    delay_s, sd_delay_s : float
        What the sensor's clock shows when the track's shows 0.
    correlation : float
        Of both, once aligned.
    gain, sd_gain : float
        Sensor over track.
    time_s, track_m_s2, sensor_m_s2 : ndarray
        Both (n,) at the track's times; the sensor as means over a frame interval, and without its offset.
    peak_track_m_s2, peak_sensor_m_s2 : float
        Of these.
    change_track_m_s, change_sensor_m_s : float
        Integrals: changes of velocity, the impulses per mass.
    rms_difference_m_s2 : float
        Root mean square difference.
    """

    delay_s: float
    sd_delay_s: float
    correlation: float
    gain: float
    sd_gain: float
    time_s: Array
    track_m_s2: Array
    sensor_m_s2: Array
    peak_track_m_s2: float
    peak_sensor_m_s2: float
    change_track_m_s: float
    change_sensor_m_s: float
    rms_difference_m_s2: float


def read_signals(path: Path, *, time: str = "time_s", time_unit_s: float = 1.0) -> Signals:
    """Read a CSV file with a line of names; all columns of numbers, with the times in ``time_unit_s``.

    Raises
    ------
    ValueError
        If there is no such column of times, a value is no number, or the times do not rise evenly.
    OSError
        If the file cannot be read.
    """
    with path.open(newline="", encoding="utf-8-sig") as stream:
        rows = [row for row in csv.reader(stream) if row and not row[0].startswith("#")]
    if not rows or time not in (names := [name.strip() for name in rows[0]]):
        raise ValueError(f"{path}: expected a first line of names with a column {time!r}; say which holds the times")
    try:
        table = np.array([[float(value) for value in row] for row in rows[1:]])
    except ValueError as error:
        raise ValueError(
            f"{path}: expected numbers below the names ({error}); use points, and commas between"
        ) from None
    if table.ndim != 2 or table.shape[1] != len(names) or len(table) < FEWEST:
        raise ValueError(f"{path}: expected {FEWEST} or more rows of {len(names)} numbers each, got {table.shape}")
    times = table[:, names.index(time)] * time_unit_s
    _interval(times, str(path))
    return Signals(times, {name: column for name, column in zip(names, table.T, strict=True) if name != time})


def light_gate(
    time_s: Array, first: Array, second: Array, *, spacing_m: float, sd_spacing_m: float = 0.0
) -> GateVelocity:
    """Velocity from the signals (n,) of two barriers ``spacing_m`` apart, the first to be passed first.

    Raises
    ------
    ValueError
        If a signal is too short, not finite or constant, the times are not even, the spacing is not positive, or the
        second signal does not come after the first.
    """
    if not (math.isfinite(spacing_m) and spacing_m > 0):
        raise ValueError(f"spacing_m = {spacing_m!r}: expected a finite, positive length in m")
    if not (math.isfinite(sd_spacing_m) and sd_spacing_m >= 0):
        raise ValueError(f"sd_spacing_m = {sd_spacing_m!r}: expected a finite length in m, 0 or more")
    interval = _interval(time_s, "time_s")
    first, second = _checked(first, len(time_s), "first"), _checked(second, len(time_s), "second")
    width = _smoothing(first, second)
    fit = _delay(gaussian_filter1d(first, width), gaussian_filter1d(second, width), _coarse(first, second))
    fit = dataclasses.replace(fit, sd=_sd(first, second, fit, width))
    delay, sd = fit.delay * interval, fit.sd * interval
    if delay <= 0:
        raise ValueError(f"light_gate: the second barrier comes {-delay:g} s before the first; swap the signals")
    velocity = spacing_m / delay
    spread = velocity * math.hypot(sd / delay, sd_spacing_m / spacing_m)
    return GateVelocity(velocity, spread, delay, sd, fit.correlation)


def align(motion: Kinematics, time_s: Array, sensor_m_s2: Array, *, direction: Array) -> Alignment:
    """Align an accelerometer's signal with the track's acceleration along ``direction`` (2,), in the results' frame.

    Parameters
    ----------
    motion : Kinematics
        The track.
    time_s, sensor_m_s2 : ndarray
        Of the sensor (n,); its clock may have another zero, not another rate.
    direction : ndarray
        That the sensor measures in.

    Raises
    ------
    ValueError
        If a signal is too short, not finite or constant, the times are not even, or the sensor's rate is below the
        camera's.
    """
    interval = _interval(time_s, "time_s")
    signal = _checked(sensor_m_s2, len(time_s), "sensor_m_s2")
    axis = np.asarray(direction, dtype=np.float64)
    if axis.shape != (2,) or not np.isfinite(axis).all() or not axis.any():
        raise ValueError(f"direction = {direction!r}: expected two numbers, not both 0")
    track = motion.acceleration_m_s2 @ (axis / np.linalg.norm(axis))
    known = np.flatnonzero(np.isfinite(track))
    if len(known) < FEWEST:
        raise ValueError(f"align: {len(known)} frames have an acceleration, expected {FEWEST} or more")
    part = slice(known[0], known[-1] + 1)
    frames, track = motion.time_s[part], np.interp(motion.time_s[part], motion.time_s[known], track[known])
    frame = float(np.median(np.diff(frames)))
    if interval > frame:
        raise ValueError(f"align: the sensor's interval of {interval:g} s is longer than the camera's of {frame:g} s")
    # A frame's acceleration is compared with the sensor's mean over a frame; the same on a grid of the sensor's times.
    smooth = gaussian_filter1d(signal, frame / interval / math.sqrt(12))
    count = int((frames[-1] - frames[0]) / interval) + 1
    grid = frames[0] + interval * np.arange(count)
    fine = CubicSpline(frames, track)(grid)
    reference = np.pad(fine, (0, max(len(smooth) - count, 0)), mode="edge")
    other = np.pad(smooth, (0, max(count - len(smooth), 0)), mode="edge")
    fit = _delay(reference, other, _coarse(reference, other))
    delay = fit.delay * interval + float(time_s[0]) - float(frames[0])
    sensor = CubicSpline(time_s, smooth)(np.clip(frames + delay, time_s[0], time_s[-1])) - fit.offset
    here = (frames + delay >= time_s[0]) & (frames + delay <= time_s[-1])
    frames, track, sensor = frames[here], track[here], sensor[here]
    return Alignment(
        delay_s=delay,
        sd_delay_s=fit.sd * interval,
        correlation=fit.correlation,
        gain=fit.gain,
        sd_gain=fit.sd_gain,
        time_s=frames,
        track_m_s2=track,
        sensor_m_s2=sensor,
        peak_track_m_s2=float(track[np.abs(track).argmax()]),
        peak_sensor_m_s2=float(sensor[np.abs(sensor).argmax()]),
        change_track_m_s=float(np.trapezoid(track, frames)),
        change_sensor_m_s=float(np.trapezoid(sensor, frames)),
        rms_difference_m_s2=float(np.sqrt(((sensor - track) ** 2).mean())),
    )


@dataclass(frozen=True)
class _Fit:
    """Delay and its standard deviation in samples, gain, offset and correlation."""

    delay: float
    sd: float
    gain: float
    sd_gain: float
    offset: float
    correlation: float


def _delay(a: Array, b: Array, start: float) -> _Fit:
    """Least squares of ``b(t) = g a(t - d) + o`` over all samples (n,) that both have, from a first ``d``."""
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
    moved = gain * (slope - slope.mean())
    # Variance of the sum of slope times residual, by their spectra: right for noise of any colour.
    spectrum = np.abs(np.fft.rfft(moved, 2 * len(moved))) ** 2 * np.abs(np.fft.rfft(remains, 2 * len(moved))) ** 2
    weight = np.full(len(spectrum), 2.0)
    weight[[0, -1]] = 1.0
    noise = float((weight * spectrum).sum()) / (2 * len(moved)) / len(moved)
    centred = value - value.mean()
    of_gain = np.abs(np.fft.rfft(centred, 2 * len(moved))) ** 2 * np.abs(np.fft.rfft(remains, 2 * len(moved))) ** 2
    noise_gain = float((weight * of_gain).sum()) / (2 * len(moved)) / len(moved)
    correlation = float(np.corrcoef(value, b[inside])[0, 1])
    sd, sd_gain = math.sqrt(noise) / abs(curvature), math.sqrt(noise_gain) / float(centred @ centred)
    return _Fit(delay, sd, float(gain), sd_gain, float(offset), correlation)


def _sd(a: Array, b: Array, fit: _Fit, width: float) -> float:
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


def _coarse(a: Array, b: Array) -> float:
    """Delay in whole samples at the peak of the correlation."""
    correlation = _correlation(a, b)
    lags = np.concatenate((np.arange(len(b)), np.arange(-len(a) + 1, 0)))
    ranked = correlation[np.where(lags >= 0, lags, len(correlation) + lags)]
    return float(lags[ranked.argmax()])


def _correlation(a: Array, b: Array) -> Array:
    """Circular correlation, padded so that nothing wraps, of two signals about their medians."""
    size = len(a) + len(b)
    return np.fft.irfft(np.conj(np.fft.rfft(a - np.median(a), size)) * np.fft.rfft(b - np.median(b), size), size)


def _smoothing(a: Array, b: Array) -> float:
    """Width of the smoothing, samples, from the half width of the correlation's peak."""
    correlation = _correlation(a, b)
    top = int(correlation.argmax())
    fallen = np.flatnonzero(np.roll(correlation, -top)[: len(a)] < 0.5 * correlation[top])
    return SMOOTHING * float(fallen[0] if len(fallen) else len(a))


def _interval(times: Array, name: str) -> float:
    """The even interval of times (n,)."""
    steps = np.diff(np.asarray(times, dtype=np.float64))
    if len(steps) < FEWEST - 1 or not np.isfinite(steps).all() or (steps <= 0).any():
        raise ValueError(f"{name}: expected {FEWEST} or more finite, rising times")
    middle = float(np.median(steps))
    if np.abs(steps - middle).max() > 0.01 * middle:
        raise ValueError(f"{name}: expected even intervals, got {steps.min():g} to {steps.max():g} s; resample them")
    return float((times[-1] - times[0]) / len(steps))


def _checked(signal: Array, count: int, name: str) -> Array:
    values = np.asarray(signal, dtype=np.float64)
    if values.shape != (count,) or not np.isfinite(values).all():
        raise ValueError(f"{name}: expected {count} finite numbers, one per time, got an array {values.shape}")
    if float(np.ptp(values)) == 0:
        raise ValueError(
            f"{name}: the signal is constant, so that it has no time of its own; give the one of the event"
        )
    return values
