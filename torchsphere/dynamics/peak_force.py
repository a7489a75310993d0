"""The largest force of an impact and when it acts, between the frames."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

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
