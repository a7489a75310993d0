"""The largest force of an impact and when it acts, between the frames.

A contact of too few frames: its edges are known to about half a frame, its force is not known.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from torchsphere.dynamics.impact_estimate import Estimate, Impact
from torchsphere.dynamics.kinematics import Draws, Kinematics
from torchsphere.dynamics.rebound import length

Array = NDArray[np.float64]


def peak(motion: Kinematics, draws: Draws, mass: float) -> tuple[tuple[Array, Array], tuple[Array, Array]]:
    """Largest force and its time, between the frames by a parabola through three of them.

    A largest value moves with its frame's error alone, to first order; the largest of each drawn motion would also be
    larger, by what noise adds to any largest value.
    """
    assert motion.contact_s is not None
    start, end = motion.contact_s
    time_s, acceleration = motion.time_s[draws.span], motion.acceleration_m_s2[draws.span]
    size = mass * np.where(np.isfinite(acceleration).all(1), length(acceleration), -np.inf)
    outside = (time_s < start) | (time_s > end)
    inside = size if outside.all() else np.where(outside, -np.inf, size)
    at = int(inside.argmax())
    direction = acceleration[at] / length(acceleration[at])
    drawn = mass * draws.acceleration_m_s2 @ direction
    value, moment = float(size[at]), float(time_s[at])
    if 0 < at < len(size) - 1 and np.isfinite(size[[at - 1, at + 1]]).all():
        near = slice(at - 1, at + 2)
        own, top = _vertex(time_s[near], size[near])
        value, moment = max(value, float(top)), float(own)
    # Between the frames as well: all motions may have their largest value in the same one.
    places = np.where(outside, -np.inf, drawn).argmax(1).clip(1, len(size) - 2)
    around = places[:, None] + np.arange(-1, 2)
    moments, _ = _vertex(time_s[around], np.take_along_axis(drawn, around, 1))
    spread, sd_moment = float(np.std(drawn[:, at])), float(np.nanstd(moments))
    return (
        (np.asarray(value), np.asarray(spread)),
        (np.asarray(moment), np.asarray(sd_moment)),
    )


def _vertex(time: Array, value: Array) -> tuple[Array, Array]:
    """Time and value at the top of parabolas through three points (..., 3): the highest point where there is no top."""
    slopes = np.diff(value) / np.diff(time)
    bend = (slopes[..., 1] - slopes[..., 0]) / (time[..., 2] - time[..., 0])
    highest = value.argmax(-1)[..., None]
    with np.errstate(divide="ignore", invalid="ignore"):
        top = 0.5 * (time[..., 0] + time[..., 1]) - 0.5 * slopes[..., 0] / bend
    is_top = (bend < 0) & (top > time[..., 0]) & (top < time[..., 2])
    moment = np.where(is_top, top, np.take_along_axis(time, highest, -1)[..., 0])
    off = moment - time[..., 0]
    return moment, value[..., 0] + slopes[..., 0] * off + bend * off * (moment - time[..., 1])


#: Frames that a contact has to last for its course to be seen. Of half-sines of force of 2.5 frames and more, peak and
#: duration were right to 1.5 standard deviations rms; of 2 frames the peak was 9 % too low and scattered by 6 %, where
#: 3 % were stated, of one frame 27 and 23 % (10 shots each, noise of 1.5 um).
SHORT = 2.5

#: Standard deviation of an edge of such a contact, frames: durations of half-sines of 0.5 to 2 frames were off by 0.3
#: to 0.9 rms, of which either edge has its share.
EDGE = 0.5


def frames_of(found: Impact, time_s: Array) -> float:
    """Frames that the contact lasts."""
    return float(found.duration.value) / float(np.diff(time_s).min())


def as_far_as_seen(found: Impact, time_s: Array) -> Impact:
    """The impact, without the force of a contact that is too short to show it; ``time_s`` (n,) are the frames' times.

    Impulse, speeds and spin follow from the flights before and after.
    """
    if frames_of(found, time_s) >= SHORT:
        return found
    edge = EDGE * float(np.diff(time_s).min())
    return replace(
        found,
        contact_start=_widened(found.contact_start, edge),
        contact_end=_widened(found.contact_end, edge),
        duration=_widened(found.duration, edge * np.sqrt(2)),
        peak_force=_unknown(found.peak_force),
        mean_force=_unknown(found.mean_force),
        peak_time=found.peak_time and _widened(found.peak_time, edge),
    )


def _widened(estimate: Estimate, sd: float) -> Estimate:
    return replace(estimate, sd=np.hypot(estimate.sd, sd))


def _unknown(estimate: Estimate | None) -> Estimate | None:
    return estimate and replace(estimate, value=np.asarray(np.nan), sd=np.asarray(np.nan))
