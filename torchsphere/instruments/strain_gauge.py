"""Force at the struck end of a long bar by its strain gauges, beside the force of a track.

A bar that is hit at its end carries the force away as a wave of compression. By one-dimensional theory the force is
``F(t) = E A e(t + d / c)``, with Young's modulus ``E``, cross-section ``A``, strain ``e`` (compression positive) at a
distance ``d`` from the struck end, and wave speed ``c = sqrt(E / rho)``. The reflection from the far end of a bar of
length ``L`` arrives ``2 (L - d) / c`` after the wave: from there on the gauge shows the sum of both. H. Kolsky, Proc.
Phys. Soc. B 62 (1949) 676, DOI 10.1088/0370-1301/62/11/302. The theory holds for waves much longer than the bar is
thick.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple, Protocol

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.interpolate import CubicSpline
from scipy.ndimage import gaussian_filter1d

from torchsphere.instruments.bar import Bar
from torchsphere.instruments.clipping import clipping_warnings
from torchsphere.instruments.delay import MIN_CORRELATION, MIN_SAMPLES, DelayFit, fit_delay, whole_sample_delay
from torchsphere.instruments.sample_times import even_interval
from torchsphere.instruments.signals import Motion, along, checked
from torchsphere.runtime.arrays import Array
from torchsphere.settings.limits import SettingError, as_positive

#: Largest strain of an elastic bar (docs/constants.toml).
MAX_STRAIN = 0.05

#: Largest ratio of both forces, above which a unit is wrong (docs/constants.toml).
MAX_RATIO = 10.0

#: Fewest frames in contact that are compared (docs/constants.toml).
MIN_FRAMES = 3

_TURNED = "if compression is positive in the record, say so with `compression_positive`"


class ForceMotion(Motion, Protocol):
    """Motion of a track with the uncertainty of its acceleration."""

    @property
    def sd_acceleration_m_s2(self) -> Array:
        """Standard deviation (n, 2) of the acceleration."""


@dataclass(frozen=True)
class BarForce:
    """The force by a bar beside that of a track, N; forces on the ball, positive away from the target.

    Attributes
    ----------
    delay_s, sd_delay_s : float
        Time of the record's clock at time 0 of the track, without the wave's travel, and its standard deviation.
    travel_s : float
        Time of the wave from the struck end to the gauge.
    valid_until_s : float or None
        Time of the track at which the reflection arrives at the gauge, less that travel; None without a length.
    correlation, gain, sd_gain : float
        Of both forces in contact; bar over track.
    time_s, track_N, sd_track_N, bar_N, sd_bar_N : ndarray
        (n,) at the track's times that the record holds, both forces as means over a frame interval; the bar's are NaN
        from the reflection on.
    peak_track_N, sd_peak_track_N, peak_bar_N, sd_peak_bar_N : float
        Largest of these forces.
    impulse_track_N_s, sd_impulse_track_N_s, impulse_bar_N_s, sd_impulse_bar_N_s : float
        From the last frame before the contact to the first after it, or to the last before the reflection. The
        track's is the ball's change of momentum.
    rms_difference_N, sd_rms_difference_N, expected_rms_difference_N : float
        Root mean square difference in these frames, its standard deviation by the scatter of the frames, and the
        value that the standard deviations of both forces make expect.
    warnings : tuple of str
        On clipped gauges.
    """

    delay_s: float
    sd_delay_s: float
    travel_s: float
    valid_until_s: float | None
    correlation: float
    gain: float
    sd_gain: float
    time_s: Array
    track_N: Array  # noqa: N815  (N is newton)
    sd_track_N: Array  # noqa: N815
    bar_N: Array  # noqa: N815
    sd_bar_N: Array  # noqa: N815
    peak_track_N: float  # noqa: N815
    sd_peak_track_N: float  # noqa: N815
    peak_bar_N: float  # noqa: N815
    sd_peak_bar_N: float  # noqa: N815
    impulse_track_N_s: float  # noqa: N815
    sd_impulse_track_N_s: float  # noqa: N815
    impulse_bar_N_s: float  # noqa: N815
    sd_impulse_bar_N_s: float  # noqa: N815
    rms_difference_N: float  # noqa: N815
    sd_rms_difference_N: float  # noqa: N815
    expected_rms_difference_N: float  # noqa: N815
    warnings: tuple[str, ...]


class _Track(NamedTuple):
    """The track along the target's normal at the times (n,) of its frames: force, N, and velocity, m/s, with sd."""

    time_s: Array
    force: Array
    sd_force: Array
    speed: Array
    sd_speed: Array


class _Record(NamedTuple):
    """Forces (m,) by the gauges, means over a frame, and the times of the record's clock when they were at the end."""

    time_s: Array
    force: Array
    interval_s: float
    frame_s: float

    @property
    def width(self) -> float:
        """Width of the average over a frame, samples: that of a Gaussian with the frame's standard deviation."""
        return self.frame_s / self.interval_s / math.sqrt(12)


class _AtFrames(NamedTuple):
    """The bar's force and its standard deviation (n,) at the track's frames, NaN where not seen, and its noise, N."""

    force: Array
    sd: Array
    seen: NDArray[np.bool_]  # the record holds the frame, and no reflection has arrived
    sd_noise: float
    sd_zero: float


def compare_bar(
    motion: ForceMotion,
    time_s: Array,
    strains: ArrayLike | Sequence[ArrayLike],
    bar: Bar,
    *,
    mass_kg: float,
    contact_s: Sequence[float],
    direction: ArrayLike,
    delay_s: float | None = None,
    sd_delay_s: float = 0.0,
    compression_positive: bool = False,
) -> BarForce:
    """Compare the force at a bar's end, by strain gauges, with mass times acceleration of the ball that hits it.

    Parameters
    ----------
    motion : ForceMotion
        Motion of the track, as `torchsphere.kinematics` gives.
    time_s : ndarray
        Times (m,) of the record, s; its clock may have another zero, not another rate.
    strains : array_like
        Strain (m,) of one gauge, or of several (k, m), whose mean is taken: bending cancels in opposite gauges.
    bar : Bar
        See `torchsphere.instruments.bar.bar`.
    mass_kg : float
        Of the ball.
    contact_s : sequence of float
        Start and end (2,) of the contact in the track.
    direction : array_like
        (2,), from the target to the ball, in the results' frame. A ball that flies to the right and hits the end of a
        bar has the direction (-1, 0): the force on the ball is then positive, and the bar is compressed.
    delay_s, sd_delay_s : float
        Time of the record's clock at time 0 of the track, if it is known, and its standard deviation. By default the
        delay is that at which both forces agree best.
    compression_positive : bool
        The record shows compression as positive; by default as negative, as a gauge's resistance does.

    Raises
    ------
    ValueError
        If a signal or a number is not valid, the strains are larger than those of an elastic bar, the record does not
        hold the contact and a part before it, or does not show what the track does.

    Notes
    -----
    Noise of the record is that before the wave arrives, taken as independent from frame to frame; zero is the mean
    of this part.
    """
    track, (start, end) = _track_along(motion, direction, mass_kg), _contact(contact_s)
    frame_s = float(np.median(np.diff(track.time_s)))
    gauges = np.atleast_2d(np.asarray(strains, dtype=np.float64))
    record = _record(time_s, gauges, bar, frame_s, 1.0 if compression_positive else -1.0)
    if delay_s is None:
        delay, sd_delay = _found_delay(record, track, bar, start)
    else:
        delay, sd_delay = _given_delay(delay_s, sd_delay_s)
    # The mean over a frame reaches half a frame beyond its middle.
    until = start + bar.clear_s - frame_s / 2
    clock = track.time_s + delay
    held = (clock >= record.time_s[0]) & (clock <= record.time_s[-1])
    seen = held & (track.time_s <= until)
    _require_contact(record, track.time_s[seen], delay, (start, end))
    track = _averaged(track, record)
    at_frames = _at_frames(record, clock, seen, (start + delay, sd_delay), bar.relative_sd)
    first, last = _bounds(track.time_s, at_frames.seen, start, end)
    return BarForce(
        delay_s=delay,
        sd_delay_s=sd_delay,
        travel_s=bar.travel_s,
        valid_until_s=None if bar.length_m is None else until,
        time_s=track.time_s[held],
        track_N=track.force[held],
        sd_track_N=track.sd_force[held],
        bar_N=at_frames.force[held],
        sd_bar_N=at_frames.sd[held],
        warnings=clipping_warnings({f"Strain gauge {k}": gauge for k, gauge in enumerate(gauges, start=1)}),
        **_compared(track, at_frames, slice(first, last + 1), mass_kg, bar.relative_sd),
    )


def _given_delay(delay_s: float, sd_delay_s: float) -> tuple[float, float]:
    """The delay that is known, and its standard deviation."""
    if not (math.isfinite(delay_s) and math.isfinite(sd_delay_s) and sd_delay_s >= 0):
        raise ValueError(f"delay_s = {delay_s!r}, sd_delay_s = {sd_delay_s!r}: expected finite times in s")
    return delay_s, sd_delay_s


def _require_contact(record: _Record, seen_s: Array, delay: float, contact: tuple[float, float]) -> None:
    """Raise ValueError if too few of the frames that the record shows, at the times ``seen_s``, lie in the contact."""
    start, end = contact
    count = int(((seen_s >= start) & (seen_s <= end)).sum())
    if count < MIN_FRAMES:
        raise ValueError(
            f"the record shows {count} frames of the contact before any reflection, expected {MIN_FRAMES} or more: it "
            f"holds {record.time_s[0] - delay:.6g} to {record.time_s[-1] - delay:.6g} s of the track's time, the "
            f"contact lasts from {start:.6g} to {end:.6g} s"
        )


def _averaged(track: _Track, record: _Record) -> _Track:
    """The track with its force averaged as the record's is, so that both round the corners of the force off alike."""
    times, force = _resampled(track, record.interval_s)
    smooth = gaussian_filter1d(force, record.width)
    return track._replace(force=np.interp(track.time_s, times, smooth))


def _resampled(track: _Track, interval_s: float) -> tuple[Array, Array]:
    """Times (k,) and force of the track at the record's interval."""
    count = int((track.time_s[-1] - track.time_s[0]) / interval_s) + 1
    times = track.time_s[0] + interval_s * np.arange(count)
    return times, CubicSpline(track.time_s, track.force)(times)


def _at_frames(
    record: _Record, clock: Array, seen: NDArray[np.bool_], arrival: tuple[float, float], relative_sd: float
) -> _AtFrames:
    """The bar's force at the times ``clock`` (n,) of the record's clock; ``arrival`` of the wave with its sd."""
    zero, sd_noise, sd_zero = _zero(record, arrival[0])
    spline, times = CubicSpline(record.time_s, record.force), np.clip(clock, *record.time_s[[0, -1]])
    force = np.where(seen, spline(times) - zero, np.nan)
    slope = np.where(seen, spline(times, 1), np.nan)
    sd = np.sqrt(sd_noise**2 + sd_zero**2 + (relative_sd * force) ** 2 + (slope * arrival[1]) ** 2)
    return _AtFrames(force, sd, seen, sd_noise, sd_zero)


def _compared(track: _Track, at_frames: _AtFrames, span: slice, mass_kg: float, relative_sd: float) -> dict[str, float]:
    """Ratio, peaks, impulses and difference in a span of frames, by their names in `BarForce`."""
    times, ours, theirs = track.time_s[span], track.force[span], at_frames.force[span]
    sd_ours, sd_theirs = track.sd_force[span], at_frames.sd[span]
    gain, sd_gain, correlation = _ratio(ours, theirs, relative_sd)
    duration = float(times[-1] - times[0])
    impulse = float(np.trapezoid(theirs, times))
    noise = at_frames.sd_noise * duration / math.sqrt(len(times))
    peak, peak_of_bar = int(ours.argmax()), int(theirs.argmax())
    squares = (theirs - ours) ** 2
    rms = math.sqrt(float(squares.mean()))
    return {
        "correlation": correlation,
        "gain": gain,
        "sd_gain": sd_gain,
        "peak_track_N": float(ours[peak]),
        "sd_peak_track_N": float(sd_ours[peak]),
        "peak_bar_N": float(theirs[peak_of_bar]),
        "sd_peak_bar_N": float(sd_theirs[peak_of_bar]),
        "impulse_track_N_s": mass_kg * float(track.speed[span][-1] - track.speed[span][0]),
        "sd_impulse_track_N_s": mass_kg * math.hypot(*track.sd_speed[span][[0, -1]]),
        "impulse_bar_N_s": impulse,
        "sd_impulse_bar_N_s": math.hypot(relative_sd * impulse, noise, at_frames.sd_zero * duration),
        "rms_difference_N": rms,
        "sd_rms_difference_N": float(squares.std(ddof=1)) / (2 * rms * math.sqrt(len(squares))) if rms else 0.0,
        "expected_rms_difference_N": math.sqrt(float((sd_ours**2 + sd_theirs**2).mean())),
    }


def _track_along(motion: ForceMotion, direction: ArrayLike, mass_kg: float) -> _Track:
    """The track along the direction, on straight lines across gaps."""
    mass = as_positive("mass_kg", mass_kg)
    frames, acceleration = along(motion.time_s, motion.acceleration_m_s2, direction)
    if float(np.ptp(acceleration)) == 0:
        raise ValueError("the track's acceleration is constant; give a recording of the impact")
    axis = np.asarray(direction, dtype=np.float64) / np.linalg.norm(np.asarray(direction, dtype=np.float64))
    known = np.isfinite(motion.acceleration_m_s2).all(1)

    def interpolated(values: Array) -> Array:
        return np.interp(frames, motion.time_s[known], values[known])

    sd_acceleration = np.linalg.norm(axis * motion.sd_acceleration_m_s2, axis=1)
    sd_speed = np.linalg.norm(axis * motion.sd_velocity_m_s, axis=1)
    speed = interpolated(motion.velocity_m_s @ axis)
    return _Track(frames, mass * acceleration, mass * interpolated(sd_acceleration), speed, interpolated(sd_speed))


def _contact(contact_s: Sequence[float]) -> tuple[float, float]:
    """Start and end of the contact."""
    times = [float(value) for value in contact_s]
    if len(times) != 2 or not all(map(math.isfinite, times)) or not times[0] < times[1]:
        raise ValueError(f"contact_s = {contact_s!r}: expected its start and its end, s, in this order")
    return times[0], times[1]


def _record(time_s: Array, gauges: Array, bar: Bar, frame_s: float, sign: float) -> _Record:
    """The record as forces at the struck end, as means over a frame."""
    interval = even_interval(time_s, "time_s")
    if interval > frame_s:
        raise ValueError(f"the record's interval of {interval:g} s is longer than the camera's of {frame_s:g} s")
    each = [checked(gauge, len(time_s), f"strain of gauge {k}") for k, gauge in enumerate(gauges, start=1)]
    largest = max(float(np.abs(gauge - np.median(gauge)).max()) for gauge in each)
    if largest > MAX_STRAIN:
        raise SettingError(
            f"a strain of {largest:.3g}, expected up to {MAX_STRAIN:g} in an elastic bar; check the `unit` of the "
            "strains (1 microstrain is 1e-6)"
        )
    force = sign * bar.modulus_pa * bar.area_m2 * np.mean(each, axis=0)
    times = np.asarray(time_s, dtype=np.float64) - bar.travel_s
    record = _Record(times, force, interval, frame_s)
    return record._replace(force=gaussian_filter1d(force, record.width))


def _found_delay(record: _Record, track: _Track, bar: Bar, start: float) -> tuple[float, float]:
    """Time of the record's clock at time 0 of the track, and its standard deviation, where both forces agree best.

    A wave that runs to and fro in the bar passes the gauge several times: the first passage is taken. Each fit ends
    where the reflection arrives.
    """
    interval, frames = record.interval_s, track.time_s
    force = _resampled(track, interval)[1] / np.ptp(track.force)
    height = float(np.ptp(record.force))
    if height == 0:
        raise ValueError("the record is constant once it is averaged over a frame; give the record of the impact")
    signal = record.force / height
    size = max(len(force), len(signal))
    lag = whole_sample_delay(*(np.pad(part, (0, size - len(part)), mode="edge") for part in (force, signal)))
    fits: list[DelayFit] = []
    refusal: ValueError | None = None
    for passage in _passages(lag, len(force), bar.echo_s / interval):
        # Samples up to the reflection of the wave that arrives at the contact's start.
        arrival = passage + (start - frames[0]) / interval
        clear = min(len(signal), arrival + (bar.clear_s - record.frame_s) / interval)
        try:
            fits.append(fit_delay(force, signal[: max(int(clear), 0)], passage))
        except ValueError as error:
            refusal = error
    if not fits:
        raise SettingError(f"{refusal}; {_TURNED}")
    fit = fits[-1]
    return float(fit.delay * interval + record.time_s[0] - frames[0]), float(fit.sd * interval)


def _passages(lag: float, count: int, echo: float) -> list[float]:
    """Delays, samples, of the best agreement and of earlier passages of the wave, down to the start of the record."""
    passages = [lag]
    while math.isfinite(echo) and passages[-1] - echo > -count:
        passages.append(passages[-1] - echo)
    return passages


def _zero(record: _Record, arrival_s: float) -> tuple[float, float, float]:
    """Zero of the record before the wave arrives, N, noise of a frame, and the zero's standard deviation."""
    before = record.force[record.time_s < arrival_s - record.frame_s]
    if len(before) < max(MIN_SAMPLES, record.frame_s / record.interval_s):
        raise ValueError(
            f"the record has {len(before)} samples before the wave arrives, expected {MIN_SAMPLES} or more, and one "
            "frame or more, which show its zero; give a record that begins earlier, or check the delay"
        )
    noise = float(before.std(ddof=1))
    return float(before.mean()), noise, noise / math.sqrt(len(before) * record.interval_s / record.frame_s)


def _bounds(frames: Array, seen: NDArray[np.bool_], start: float, end: float) -> tuple[int, int]:
    """The last frame before the contact and the first after it, among those seen."""
    known = np.flatnonzero(seen)
    before, after = known[frames[known] <= start], known[frames[known] >= end]
    return int(before[-1] if len(before) else known[0]), int(after[0] if len(after) else known[-1])


def _ratio(track: Array, by_bar: Array, relative_sd: float) -> tuple[float, float, float]:
    """Bar over track (n,) by least squares, its standard deviation, and the correlation of both."""
    squares = float(track @ track)
    if not squares > 0 or not np.ptp(track) > 0 or not np.ptp(by_bar) > 0:
        raise ValueError("one of both forces is constant during the contact; give a record of the impact")
    gain = float(track @ by_bar) / squares
    correlation = float(np.corrcoef(track, by_bar)[0, 1])
    if gain < 0 or correlation < MIN_CORRELATION:
        raise SettingError(
            f"the record does not show the force of the track: their correlation is {correlation:.2f}, expected "
            f"{MIN_CORRELATION} or more; check the delay, and {_TURNED}"
        )
    if not 1 / MAX_RATIO < gain < MAX_RATIO:
        raise ValueError(
            f"the bar's force is {gain:.3g} times that of the track; check the units of strain, modulus, cross-section "
            "and mass"
        )
    residual = by_bar - gain * track
    sd = math.hypot(relative_sd * gain, math.sqrt(float(residual @ residual) / max(len(track) - 1, 1) / squares))
    return gain, sd, correlation
