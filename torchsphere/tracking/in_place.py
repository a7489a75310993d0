"""A ball that turns without leaving its place: one position for the recording, from the limbs of many frames.

A wrong radius or a near camera turns a part of the rotation into steps that all have one sign. They add up to a path
that the limb of the ball does not follow, and by that a ball in its place is told from one that flies.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import torch
from kornia.geometry.liegroup import So3
from numpy.typing import NDArray

from torchsphere.detection import limbs
from torchsphere.detection.limbs import SIGNIFICANT_SD, STAY_SD
from torchsphere.errors.steps_without_map import extent_beside_surface
from torchsphere.geometry.circle import Circle
from torchsphere.recording.frame_range import spread
from torchsphere.runtime import steps
from torchsphere.runtime.arrays import Array
from torchsphere.sphere_map.decision import MadeMap
from torchsphere.tracking.absolute_motion import AbsoluteMotion
from torchsphere.tracking.start import Start
from torchsphere.tracking.task import Task

#: Fewest frames whose limbs show a place (docs/constants.toml).
MIN_FRAMES = 6

#: Share of the frames in which it is looked for that must show the limb (docs/constants.toml).
MIN_SHARE = 0.8

#: Largest standard deviation of a limb's centre that shows a place, px (docs/constants.toml).
MAX_SD_PX = 1.0

#: Share of the measured frames that a ball held in its place must keep (docs/constants.toml).
MIN_KEPT_SHARE = 0.8


@dataclass(frozen=True)
class CommonLimb:
    """The limb of a ball in frames that are spread over the recording, all around one circle."""

    frames: NDArray[np.int64]  # numbers (k,)
    circle: Array  # median (3,) of the fits, px
    sd: Array  # of the fit of one frame (3,), px: its systematic part does not average out
    stays: bool  # whether the centres lie within their standard deviation of one place


def common_limb(task: Task, start: Start) -> CommonLimb | None:
    """The limb of a ball that stays at about the circle of the start; None where too few frames show one there."""
    source, circle, camera = task.source, start.circle, start.options.camera
    chosen = spread(np.arange(source.count), limbs.MAX_FRAMES)
    steps.tell("looking at the outlines of the ball in %d frames", len(chosen))
    guess = np.array([circle.x, circle.y, circle.radius])
    found = limbs.fit_around(source.images_of(chosen), chosen, guess, task.ignore, camera)
    found = found.rows(np.asarray((found.sd[:, :2] < MAX_SD_PX).all(1)))
    if len(found.frames) < max(MIN_FRAMES, MIN_SHARE * len(chosen)):
        return None
    middle, typical = np.median(found.circles, axis=0), np.median(found.sd, axis=0)
    slope = np.abs(_trend(found.frames, found.circles[:, :2]))
    # Where most limbs stay, a frame in which something hides the ball is no motion.
    stays = np.mean((np.abs(found.circles - middle) < STAY_SD * typical).all(1)) >= MIN_SHARE and bool(
        (slope < STAY_SD * _trend_sd(len(found.frames)) * typical[:2]).all()
    )
    return CommonLimb(found.frames, middle, typical, bool(stays))


def limb_of_turning(motion: AbsoluteMotion, look: Callable[[], CommonLimb | None]) -> CommonLimb | None:
    """The limb of a ball that turns without leaving its place, although its ``motion`` leaves it; else None.

    Only where the surface turns so much further than the ball moves that its path may be an error, the limb is looked
    at, by ``look``.
    """
    known = np.flatnonzero(np.isfinite(motion.position[:, 0]))
    _, is_surface = extent_beside_surface(motion.position, motion.increment, motion.circle.radius)
    if len(known) < MIN_FRAMES or not is_surface:
        return None
    limb = look()
    if limb is None or not limb.stays:
        return None
    # A path that left its ball early is known in few of the limb's frames; its place is that of all frames.
    off = _trend(known, motion.position[known] - limb.circle[:2])
    return limb if (np.abs(off) > SIGNIFICANT_SD * limb.sd[:2]).any() else None


def circle_in_place(circle: Circle, limb: CommonLimb | None) -> Circle:
    """The ``circle`` at the place of the limb; with its radius, too, where that differs significantly."""
    if limb is None or not limb.stays:
        return circle
    x, y, radius = limb.circle.tolist()
    sd_x, sd_y, sd_radius = limb.sd.tolist()
    placed = dataclasses.replace(circle, x=x, y=y, sd_x=sd_x, sd_y=sd_y)
    own = float(np.nan_to_num(circle.sd_radius))
    if abs(radius - circle.radius) < SIGNIFICANT_SD * float(np.hypot(sd_radius, own)):
        return placed
    return dataclasses.replace(placed, radius=radius, sd_radius=sd_radius)


def sd_unseen_step(limb: CommonLimb) -> Array:
    """Standard deviation (2,) of a steady step that the limb does not show, px per frame."""
    return np.asarray(_trend_sd(len(limb.frames)) * limb.sd[:2] / (limb.frames[-1] - limb.frames[0]))


def held(motion: AbsoluteMotion) -> tuple[AbsoluteMotion, Array]:
    """The ``motion`` with one position for all frames, and the sum (2,) of the steps that this takes away, px.

    Each pose is the likeliest one at that position: what the step loses, the rotation gains by their covariance. The
    variances of the steps stay as the bound up to which the images show that the ball stays.
    """
    known = np.isfinite(motion.position[:, 0])
    if not known.any():
        return motion, np.zeros(2)
    place = np.median(motion.position[known], axis=0)
    gain = _rotation_per_step(motion.covariance)
    steps = motion.increment[:, :2]
    on_map = isinstance(motion.map, MadeMap)
    drift = _trend(np.flatnonzero(known), motion.position[known]) if on_map else np.nansum(steps, axis=0)
    if on_map:
        # The poses are absolute: a pose off the place is turned by its own error.
        pose_gain = np.concatenate((gain[:1], gain))
        off = np.where(known[:, None], motion.position - place, 0.0)
        turned = _turn(-np.einsum("nij,nj->ni", pose_gain, off)) @ motion.orientation
        turned = turned @ np.swapaxes(turned[np.flatnonzero(np.isfinite(turned[:, 0, 0]))[:1]], 1, 2)
        whole = np.isfinite(motion.increment[:, 2])
        relative = np.where(whole[:, None, None], turned[1:] @ np.swapaxes(turned[:-1], 1, 2), np.eye(3))
        rotation = np.where(whole[:, None], So3.from_matrix(torch.from_numpy(relative)).log().numpy(), np.nan)
    else:
        rotation = motion.increment[:, 2:] - np.einsum("nij,nj->ni", gain, np.nan_to_num(steps))
        turned = _rechained(motion, rotation)
    increment = np.concatenate((np.where(np.isfinite(steps), 0.0, np.nan), rotation), 1)
    covariance = motion.covariance.copy()
    covariance[:, 2:, 2:] -= gain @ motion.covariance[:, :2, 2:]
    covariance[:, :2, 2:] = np.where(np.isfinite(covariance[:, :2, 2:]), 0.0, np.nan)
    covariance[:, 2:, :2] = np.swapaxes(covariance[:, :2, 2:], 1, 2)
    circle = dataclasses.replace(motion.circle, x=float(place[0]), y=float(place[1]))
    position = np.where(known[:, None], place, np.nan)
    motion = dataclasses.replace(motion, position=position, increment=increment, covariance=covariance)
    return dataclasses.replace(motion, orientation=turned, circle=circle), drift


def _rotation_per_step(covariance: Array) -> Array:
    """Change (m, 3, 2) of the likeliest rotation per change of the step, rad/px; 0 where it is not known."""
    finite = np.asarray(np.isfinite(covariance).all((1, 2)))
    own = np.where(finite[:, None, None], covariance[:, :2, :2], np.eye(2))
    across = np.where(finite[:, None, None], covariance[:, 2:, :2], 0.0)
    return np.asarray(across @ np.linalg.inv(own))


def _rechained(motion: AbsoluteMotion, rotation: Array) -> Array:
    """Orientations (n, 3, 3) with the ``rotation`` (n - 1, 3) in place of the steps of the ``motion``."""
    turned = motion.orientation.copy()
    for i in range(1, len(turned)):
        before = motion.orientation[i - 1]
        if np.isfinite(before).all() and np.isfinite(rotation[i - 1]).all():
            turned[i] = _turn(rotation[i - 1 : i])[0] @ turned[i - 1]
        elif i > 1 and np.isfinite(turned[i]).all():
            # After a gap the frame was measured against the last one that shows the ball.
            known = np.flatnonzero(np.isfinite(turned[:i, 0, 0]))
            if len(known):
                last = known[-1]
                turned[i] = motion.orientation[i] @ motion.orientation[last].T @ turned[last]
    return turned


def _turn(vectors: Array) -> Array:
    """Rotation matrices (n, 3, 3) of rotation vectors (n, 3)."""
    return np.asarray(So3.exp(torch.from_numpy(vectors)).matrix().numpy())


def _trend(frames: NDArray[np.int64], values: Array) -> Array:
    """Change (2,) of the values (k, 2) from the first to the last frame by a straight line."""
    return np.asarray(np.polyfit(frames, values, 1)[0] * (frames[-1] - frames[0]))


def _trend_sd(count: int) -> float:
    """Standard deviation of the trend of ``count`` values with a standard deviation of 1."""
    return float(np.sqrt(12 * (count - 1) / (count * (count + 1))))
