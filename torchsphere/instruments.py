"""What the measurement is compared with: light gates and accelerometers, from CSV."""

from __future__ import annotations

import csv
import dataclasses
import math
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import CubicSpline
from scipy.ndimage import gaussian_filter1d

from torchsphere.delay import FEWEST, coarse, fit_delay, sd_by_raw_noise, smoothing
from torchsphere.kinematics import Kinematics

Array = NDArray[np.float64]


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
    width = smoothing(first, second)
    fit = fit_delay(gaussian_filter1d(first, width), gaussian_filter1d(second, width), coarse(first, second))
    fit = dataclasses.replace(fit, sd=sd_by_raw_noise(first, second, fit, width))
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
    fit = fit_delay(reference, other, coarse(reference, other))
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
