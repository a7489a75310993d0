"""Light gates and accelerometers, to compare a track with."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import ArrayLike
from scipy.interpolate import CubicHermiteSpline, CubicSpline
from scipy.ndimage import gaussian_filter1d

from torchsphere.instruments.clipping import clipping_warnings
from torchsphere.instruments.delay import (
    MIN_SAMPLES,
    best_fit,
    fit_delay,
    sd_by_raw_noise,
    sd_by_sampling,
    smoothing_width,
    whole_sample_delay,
)
from torchsphere.instruments.sample_times import even_interval
from torchsphere.instruments.units import STANDARD_GRAVITY_M_S2
from torchsphere.runtime.arrays import Array
from torchsphere.runtime.warning_levels import severe

#: Largest ratio, up or down, of two measurements of one acceleration (docs/constants.toml).
MAX_RATIO = 2.0

#: Ratios of sensor and track that a wrong unit makes.
UNIT_RATIOS = {
    1 / STANDARD_GRAVITY_M_S2: "its signal were in g, and taken as in m/s^2",
    STANDARD_GRAVITY_M_S2: "its signal were in m/s^2, and taken as in g",
    1e-3: "its signal were in a unit a thousand times as large",
    1e3: "its signal were in a unit a thousand times as small",
}

#: Relative difference from such a ratio up to which the unit is named (docs/constants.toml).
LIKE_UNIT = 0.1


class Motion(Protocol):
    """Motion of a track: `torchsphere.dynamics.kinematics.Kinematics`, or as a result folder has it."""

    @property
    def time_s(self) -> Array:
        """Times (n,) of the frames."""

    @property
    def velocity_m_s(self) -> Array:
        """Velocity (n, 2)."""

    @property
    def sd_velocity_m_s(self) -> Array:
        """Its standard deviation (n, 2)."""

    @property
    def acceleration_m_s2(self) -> Array:
        """Acceleration (n, 2)."""


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
    """An accelerometer aligned with the track.

    Attributes
    ----------
    delay_s, sd_delay_s : float
        Time of the sensor's clock at time 0 of the track, and its standard deviation.
    correlation : float
        Of both signals, once aligned.
    gain, sd_gain : float
        Sensor over track.
    time_s, track_m_s2, sensor_m_s2 : ndarray
        Both (n,) at the track's times, as means over a frame interval, the sensor's without its offset.
    peak_track_m_s2, peak_sensor_m_s2 : float
        Values of largest size of these.
    change_track_m_s, change_sensor_m_s : float
        Changes of velocity over the frames, which are impulses per mass; the sensor's is the integral of its signal.
    rms_difference_m_s2 : float
        Root mean square difference.
    warnings : tuple of str
        On a clipped signal, and on a gain as of a wrong unit.
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
    warnings: tuple[str, ...]


def light_gate(
    time_s: Array, first: Array, second: Array, *, spacing_m: float, sd_spacing_m: float = 0.0
) -> GateVelocity:
    """Velocity from the signals (n,) of two barriers at a distance ``spacing_m``, passed in this order.

    Raises
    ------
    ValueError
        If a signal is too short, not finite or constant, the times are not even, the spacing is not positive, the
        signals are not of one shape, or the second does not come after the first.
    """
    if not (math.isfinite(spacing_m) and spacing_m > 0):
        raise ValueError(f"spacing_m = {spacing_m!r}: expected a finite, positive length in m")
    if not (math.isfinite(sd_spacing_m) and sd_spacing_m >= 0):
        raise ValueError(f"sd_spacing_m = {sd_spacing_m!r}: expected a finite length in m, 0 or more")
    interval = even_interval(time_s, "time_s")
    # In units of their heights, of which the delay is independent: squares of any signal remain numbers.
    first, second = (
        values / np.ptp(values)
        for values in (checked(first, len(time_s), "first"), checked(second, len(time_s), "second"))
    )
    width = smoothing_width(first, second)
    smooth = gaussian_filter1d(first, width), gaussian_filter1d(second, width)
    # From the slopes as well: with barriers that stay dark, or one that is cut, many delays put dark over dark.
    slopes = np.gradient(smooth[0]), np.gradient(smooth[1])
    starts = whole_sample_delay(first, second), whole_sample_delay(*slopes)
    fit = best_fit(*smooth, starts)
    delay = fit.delay * interval
    sd = interval * math.hypot(sd_by_raw_noise(first, second, fit, width), sd_by_sampling(first, second, width))
    if delay <= 0:
        raise ValueError(f"light_gate: the second barrier comes {-delay:g} s before the first; swap the signals")
    if delay < 2 * sd:
        raise ValueError(
            f"light_gate: a delay of {delay:g} s with {sd:g} s of uncertainty gives no velocity; both signals seem to "
            "be of one barrier"
        )
    velocity = spacing_m / delay
    sd_velocity = velocity * math.hypot(sd / delay, sd_spacing_m / spacing_m)
    return GateVelocity(velocity, sd_velocity, delay, sd, fit.correlation)


def mean_speed(motion: Motion, until_s: float, direction: Array | None = None) -> tuple[float, float]:
    """Mean speed of the track before a time, m/s, and its standard deviation, which all frames may share.

    Where a ``direction`` (2,) is given, the velocity along it: a gate does not see what goes along its barriers.

    Raises ValueError if no frame has a velocity then.
    """
    chosen = np.isfinite(motion.velocity_m_s).all(1) & (motion.time_s < until_s)
    if not chosen.any():
        raise ValueError("No frame before the contact has a velocity; there is nothing to compare the gate with")
    mean = motion.velocity_m_s[chosen].mean(0)
    path = mean if mean.any() else np.array([1.0, 0.0])
    axis = path / np.linalg.norm(path) if direction is None else direction / np.linalg.norm(direction)
    return float(mean @ axis), float(np.linalg.norm(axis * motion.sd_velocity_m_s[chosen].mean(0)))


def align(motion: Motion, time_s: Array, sensor_m_s2: Array, *, direction: Array) -> Alignment:
    """Align an accelerometer's signal with the track's acceleration along ``direction`` (2,), in the results' frame.

    Parameters
    ----------
    motion : Motion
        Motion of the track.
    time_s, sensor_m_s2 : ndarray
        Times and signal (n,) of the sensor; its clock may have another zero, not another rate.
    direction : ndarray
        Direction in which the sensor measures.

    Raises
    ------
    ValueError
        If a signal is too short, not finite or constant, the times are not even, the sensor's rate is below the
        camera's, or the sensor does not show what the track does.
    """
    interval = even_interval(time_s, "time_s")
    signal = checked(sensor_m_s2, len(time_s), "sensor_m_s2")
    frames, track = along(motion.time_s, motion.acceleration_m_s2, direction)
    if float(np.ptp(track)) == 0:
        raise ValueError("align: the track's acceleration is constant; give a recording of the event")
    frame_s = float(np.median(np.diff(frames)))
    if interval > frame_s:
        raise ValueError(f"align: the sensor's interval of {interval:g} s is longer than the camera's of {frame_s:g} s")
    # Means over a frame are compared, as frames show no faster change, on a grid of the sensor's interval. Both are in
    # units of their heights, so that squares of any signal remain numbers.
    height, unit, width = float(np.ptp(signal)), float(np.ptp(track)), frame_s / interval / math.sqrt(12)
    smooth = gaussian_filter1d(signal / height, width)
    count = int((frames[-1] - frames[0]) / interval) + 1
    grid = frames[0] + interval * np.arange(count)
    velocity = np.interp(frames, *along(motion.time_s, motion.velocity_m_s, direction))
    # Between frames the acceleration that has the velocities of both: a force may set in there.
    course = CubicHermiteSpline(frames, velocity / unit, track / unit).derivative()
    resampled = gaussian_filter1d(course(grid), width)
    track = unit * CubicSpline(grid, resampled)(np.clip(frames, grid[0], grid[-1]))
    reference = np.pad(resampled, (0, max(len(smooth) - count, 0)), mode="edge")
    padded = np.pad(smooth, (0, max(count - len(smooth), 0)), mode="edge")
    fit = fit_delay(reference, padded, whole_sample_delay(reference, padded))
    delay = fit.delay * interval + float(time_s[0]) - float(frames[0])
    shared = (frames + delay >= time_s[0]) & (frames + delay <= time_s[-1])
    if shared.sum() < 2:
        raise ValueError("The signals do not overlap once they are aligned; give longer parts of them")
    frames, track, velocity = frames[shared], track[shared], velocity[shared]
    mean = CubicSpline(time_s, height * (smooth - fit.offset))
    sensor = mean(frames + delay)
    gain = fit.gain * height / unit
    return Alignment(
        delay_s=delay,
        sd_delay_s=fit.sd * interval,
        correlation=fit.correlation,
        gain=gain,
        sd_gain=fit.sd_gain * height / unit,
        time_s=frames,
        track_m_s2=track,
        sensor_m_s2=sensor,
        peak_track_m_s2=float(track[np.abs(track).argmax()]),
        peak_sensor_m_s2=float(sensor[np.abs(sensor).argmax()]),
        change_track_m_s=float(velocity[-1] - velocity[0]),
        change_sensor_m_s=float(mean.integrate(frames[0] + delay, frames[-1] + delay)),
        rms_difference_m_s2=float(np.sqrt(((sensor - track) ** 2).mean())),
        warnings=(*clipping_warnings({"The accelerometer's signal": signal}, "m/s^2"), *gain_warnings(gain)),
    )


def gain_warnings(gain: float) -> tuple[str, ...]:
    """A sentence on a ratio of sensor and track that a wrong unit explains, or nothing does."""
    if 1 / MAX_RATIO < gain < MAX_RATIO:
        return ()
    looks = next((words for ratio, words in UNIT_RATIOS.items() if abs(gain / ratio - 1) < LIKE_UNIT), None)
    why = f", as if {looks}" if looks else "; check its unit, its direction, and whether both moved alike"
    return (severe(f"The sensor measures {gain:.3g} times the acceleration of the track{why}"),)


def gate_warnings(gate_m_s: float, track_m_s: float) -> tuple[str, ...]:
    """A sentence on velocities of gate and track that cannot be those of one ball."""
    if track_m_s / MAX_RATIO < gate_m_s < track_m_s * MAX_RATIO:
        return ()
    sentence = (
        f"The light gate measures {gate_m_s:.4g} m/s, and the track {track_m_s:.4g}: check `spacing_mm`, `time_unit` "
        "and `direction_deg`, and the track's frame rate and scale"
    )
    return (severe(sentence),)


def along(time_s: Array, acceleration: Array, direction: ArrayLike) -> tuple[Array, Array]:
    """Times and acceleration (n,) along a direction, from the first to the last value of (m, 2) without gaps."""
    axis = np.asarray(direction, dtype=np.float64)
    if axis.shape != (2,) or not np.isfinite(axis).all() or not axis.any():
        raise ValueError(f"direction = {direction!r}: expected two numbers, not both 0")
    values = acceleration @ (axis / np.linalg.norm(axis))
    known = np.flatnonzero(np.isfinite(values))
    if len(known) < MIN_SAMPLES:
        raise ValueError(f"align: {len(known)} frames have an acceleration, expected {MIN_SAMPLES} or more")
    times = time_s[known[0] : known[-1] + 1]
    return times, np.interp(times, time_s[known], values[known])


def checked(signal: Array, count: int, name: str) -> Array:
    """The signal as an array (count,); raises unless it is finite and not constant."""
    values = np.asarray(signal, dtype=np.float64)
    if values.shape != (count,):
        raise ValueError(f"{name}: expected {count} numbers, one per time, got an array {values.shape}")
    wrong = np.flatnonzero(~np.isfinite(values))
    if len(wrong):
        raise ValueError(
            f"{name}: expected finite numbers, got {values[wrong[0]]:g} at {wrong[0]} and {len(wrong)} such in all; "
            "give a part without them, or fill them in"
        )
    if float(np.ptp(values)) == 0:
        raise ValueError(f"{name}: the signal is constant, so that it has no delay; give the signal of the event")
    return values
