"""Largest force of an impact and its time, between the frames; neither is stated for a contact of too few frames."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from torchsphere.dynamics.impact_estimate import Estimate, Impact
from torchsphere.dynamics.kinematics import Draws, Kinematics
from torchsphere.dynamics.rebound import norm

#: Least duration of a contact whose force is resolved, frames (docs/constants.md).
MIN_RESOLVED_FRAMES = 2.5

#: Standard deviation of an edge of a shorter contact, frames (docs/constants.md).
SHORT_CONTACT_SD = 0.5

Array = NDArray[np.float64]


def peak_force(motion: Kinematics, draws: Draws, mass: float) -> tuple[Estimate, Estimate]:
    """Largest force and its time, between the frames by a parabola through three of them.

    To first order the largest force has the error of its frame alone. The largest force of each drawn motion would
    also be larger, because noise raises every maximum.
    """
    assert motion.contact_s is not None
    start, end = motion.contact_s
    time_s, acceleration = motion.time_s[draws.span], motion.acceleration_m_s2[draws.span]
    force = mass * np.where(np.isfinite(acceleration).all(1), norm(acceleration), -np.inf)
    outside = (time_s < start) | (time_s > end)
    frame = int((force if outside.all() else np.where(outside, -np.inf, force)).argmax())
    direction = acceleration[frame] / norm(acceleration[frame])
    drawn = mass * draws.acceleration_m_s2 @ direction
    peak, peak_time = float(force[frame]), float(time_s[frame])
    if 0 < frame < len(force) - 1 and np.isfinite(force[[frame - 1, frame + 1]]).all():
        three = slice(frame - 1, frame + 2)
        vertex_time, vertex = _vertex(time_s[three], force[three])
        peak, peak_time = max(peak, float(vertex)), float(vertex_time)
    # Between the frames as well, since all drawn motions may have their largest force in the same frame.
    drawn_frames = np.where(outside, -np.inf, drawn).argmax(1).clip(1, len(force) - 2)
    threes = drawn_frames[:, None] + np.arange(-1, 2)
    drawn_times, _ = _vertex(time_s[threes], np.take_along_axis(drawn, threes, 1))
    sd, sd_time = float(np.std(drawn[:, frame])), float(np.nanstd(drawn_times))
    return (
        Estimate(np.asarray(peak), np.asarray(sd), "N"),
        Estimate(np.asarray(peak_time), np.asarray(sd_time), "s"),
    )


def _vertex(time: Array, value: Array) -> tuple[Array, Array]:
    """Time and value of the vertex of parabolas through three points (..., 3), or of the highest point if outside."""
    slopes = np.diff(value) / np.diff(time)
    curvature = (slopes[..., 1] - slopes[..., 0]) / (time[..., 2] - time[..., 0])
    highest = value.argmax(-1)[..., None]
    with np.errstate(divide="ignore", invalid="ignore"):
        vertex = 0.5 * (time[..., 0] + time[..., 1]) - 0.5 * slopes[..., 0] / curvature
    is_inside = (curvature < 0) & (vertex > time[..., 0]) & (vertex < time[..., 2])
    found = np.where(is_inside, vertex, np.take_along_axis(time, highest, -1)[..., 0])
    passed = found - time[..., 0]
    return found, value[..., 0] + slopes[..., 0] * passed + curvature * passed * (found - time[..., 1])


def contact_frames(impact: Impact, time_s: Array) -> float:
    """Frames that the contact lasts."""
    return float(impact.duration.value) / float(np.diff(time_s).min())


def without_unresolved_force(impact: Impact, time_s: Array) -> Impact:
    """The impact without its force if the contact is too short to resolve it; ``time_s`` (n,) are the frames' times.

    Impulse, speeds and spin stay: they follow from the flights before and after.
    """
    if contact_frames(impact, time_s) >= MIN_RESOLVED_FRAMES:
        return impact
    sd_edge = SHORT_CONTACT_SD * float(np.diff(time_s).min())
    return replace(
        impact,
        contact_start=_widened(impact.contact_start, sd_edge),
        contact_end=_widened(impact.contact_end, sd_edge),
        duration=_widened(impact.duration, sd_edge * np.sqrt(2)),
        peak_force=_unknown(impact.peak_force),
        mean_force=_unknown(impact.mean_force),
        peak_time=impact.peak_time and _widened(impact.peak_time, sd_edge),
    )


def _widened(estimate: Estimate, sd: float) -> Estimate:
    return replace(estimate, sd=np.hypot(estimate.sd, sd))


def _unknown(estimate: Estimate | None) -> Estimate | None:
    return estimate and replace(estimate, value=np.asarray(np.nan), sd=np.asarray(np.nan))
