"""Absolute poses without drift: when a map of the ball is made, and how its poses enter the track."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import torch
from kornia.geometry.liegroup import So3
from numpy.typing import NDArray
from torch import Tensor

from torchsphere.correlation.options import Options
from torchsphere.geometry import orientation
from torchsphere.geometry.circle import Circle
from torchsphere.imaging.interpolation import noise_gains
from torchsphere.recording.frame_source import Source
from torchsphere.sphere_map import poses
from torchsphere.sphere_map.poses import MapPoses
from torchsphere.tracking.follow import Progress
from torchsphere.tracking.record import Record

Array = NDArray[np.float64]

#: Turn of a ball in the whole recording, rad, from which a map is made without being asked for: an error of 0.1 px in a
#: radius of 50 px alone is then 0.4 deg.
MAP_FROM = np.radians(90.0)

#: Effect of an uncertain radius on a step, px, from which a map is made without being asked for; and the step per px of
#: error and rad of rotation (docs/constants.md).
RADIUS_MATTERS_PX, STEP_PER_RADIUS = 0.01, 3.0

#: Share of the steps with light that changes unevenly over the ball, from which no map is made unless asked for
#: (docs/constants.md).
MOST_UNEVEN = 0.25

#: Models of a rigid motion in an orthographic view, which a map replaces.
ON_MAP = ("rigid", "finite")


@dataclass(frozen=True)
class AbsoluteMotion:
    """Positions, increments and orientations of a track; the fields are those of `torchsphere.tracking.track.Track`."""

    position: Array
    increment: Array
    covariance: Array
    orientation: Array
    circle: Circle
    about_map: dict[str, Any]


def absolute_motion(
    source: Source,
    measured: Record,
    circle: Circle,
    ignore: Tensor | None,
    asked: bool | None,
    options: Options,
    *,
    progress: Progress | None = None,
) -> AbsoluteMotion:
    """The ``measured`` motion, on a map of the ball where a map is ``asked`` for or, by None, needed."""
    known = np.isfinite(measured.position[:, 0])
    chained = orientation.chain(measured.rotation, known)
    turns = np.linalg.norm(measured.rotation, axis=1)
    reason = _reason_without_map(turns, circle, asked, options.model) or _reason_by_light(measured, asked)
    about = {"used": False, "reason": reason}
    plain = AbsoluteMotion(measured.position, measured.increment, measured.covariance, chained, circle, about)
    if reason:
        return plain
    noise = _noise_share(measured.zncc, options.pre_blur)
    try:
        found = poses.poses_on_map(source, measured.position, chained, noise, circle, ignore, progress)
    except (np.linalg.LinAlgError, torch.linalg.LinAlgError):  # type: ignore[attr-defined]
        # The increments must not be lost with the map.
        found = "the equations of the map have no solution"
    if isinstance(found, str):
        plain.about_map["reason"] = found
        return plain
    return _merged(measured, chained, found)


def _noise_share(zncc: Array, pre_blur: float) -> float:
    """Variance of the images' noise over that of their grey levels, from the pairs' coefficients (n,)."""
    known = zncc[np.isfinite(zncc)]
    lack = float(np.median(1 - known)) if len(known) else 0.0
    value_gain, _ = noise_gains(pre_blur)
    return lack / value_gain


def _reason_without_map(turns: Array, circle: Circle, asked: bool | None, model: str) -> str:
    """Why no map is made of a ball that turns by ``turns`` (n,), rad, in words; empty where a map is made."""
    if asked is False:
        return "not needed: it was not asked for"
    prefix = "" if asked else "not needed: "
    if model not in ON_MAP:
        return f"{prefix}a map of the ball takes a rigid motion in an orthographic view, which {model!r} is not"
    if not np.isfinite(turns).any():
        return f"{prefix}no rotation was measured, so no map of the ball can be made"
    of_radius = STEP_PER_RADIUS * float(np.nanmedian(turns)) * np.nan_to_num(circle.sd_radius)
    if asked is None and np.nansum(turns) < MAP_FROM and of_radius < RADIUS_MATTERS_PX:
        return f"not needed: the ball turns by {np.degrees(np.nansum(turns)):.0f} deg in all, and its radius is known"
    return ""


def _reason_by_light(measured: Record, asked: bool | None) -> str:
    """Why the light makes the steps better than a map that was not asked for, in words; empty where it does not."""
    steps, uneven = int(np.isfinite(measured.increment[:, 0]).sum()), int(measured.uneven_light.sum())
    if asked is None and uneven > MOST_UNEVEN * steps:
        return (
            f"no map of the ball was made, as something near it takes light from one side of it in {uneven} of {steps} "
            "steps, which steps allow for and a map does not; ask for a map to have one all the same"
        )
    return ""


def _merged(measured: Record, chained: Array, found: MapPoses) -> AbsoluteMotion:
    """Poses of the map; a frame that is not on the map follows from its neighbour by the step between them."""
    position, turned = found.position.copy(), found.orientation.copy()
    on_map = np.isfinite(position[:, 0])
    for i in np.flatnonzero(np.isfinite(measured.position[:, 0]) & ~on_map):
        near = _nearest(on_map, int(i))
        position[i] = position[near] + measured.position[i] - measured.position[near]
        turned[i] = chained[i] @ chained[near].T @ turned[near]
    steps: NDArray[np.bool_] = np.isfinite(measured.increment)
    between = np.swapaxes(turned[:-1], 1, 2)
    whole = np.asarray(steps.all(axis=1))
    relative = np.where(whole[:, None, None], turned[1:] @ between, np.eye(3))
    turns = So3.from_matrix(torch.from_numpy(relative)).log().numpy()
    increment = np.where(steps, np.concatenate((np.diff(position, axis=0), turns), 1), np.nan)
    both = on_map[:-1] & on_map[1:] & whole
    covariance = np.where(both[:, None, None], found.step_covariance, measured.covariance)
    about = {
        "used": True,
        "keyframes": found.keyframes,
        "frames": int(on_map.sum()),
        "edge_blur_px": found.edge_blur,
        "residual_over_noise": found.misfit**0.5,
    }
    return AbsoluteMotion(position, increment, covariance, turned, found.circle, about)


def _nearest(on_map: NDArray[np.bool_], frame: int) -> int:
    frames = np.flatnonzero(on_map)
    return int(frames[np.abs(frames - frame).argmin()])
