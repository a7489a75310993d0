"""Absolute poses without drift: the cases in which a map of the ball is made, and its poses in the track."""

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

#: Share of the steps with uneven light from which no map is made by default (docs/constants.md).
MAX_UNEVEN_SHARE = 0.5

#: Models of a rigid motion at a constant distance, which a map replaces.
MAP_MODELS = ("rigid", "finite", "pinhole")


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
    fineness: float,
    *,
    telecentric: bool = False,
    progress: Progress | None = None,
) -> AbsoluteMotion:
    """The ``measured`` motion, on a map of the ball unless none is ``asked`` for (None: if there are frames enough).

    In a ``telecentric`` view the ball is seen from the same side wherever it is.
    """
    known = np.isfinite(measured.position[:, 0])
    chained = orientation.chain(measured.rotation, known)
    reason = _reason_without_map(measured, asked, options.model)
    about = {"used": False, "reason": reason}
    plain = AbsoluteMotion(measured.position, measured.increment, measured.covariance, chained, circle, about)
    if reason:
        return plain
    known = measured.zncc[np.isfinite(measured.zncc)]
    lack = float(np.median(1 - known)) if len(known) else 0.0
    # Variance of the images' noise over that of their grey levels.
    noise = lack / noise_gains(options.pre_blur)[0]
    try:
        found = poses.poses_on_map(
            source,
            measured.position,
            chained,
            noise,
            circle,
            ignore,
            fineness,
            options.camera,
            telecentric,
            progress,
        )
    except (np.linalg.LinAlgError, torch.linalg.LinAlgError):  # type: ignore[attr-defined]
        # The increments must not be lost with the map.
        found = "the equations of the map have no solution"
    if isinstance(found, str):
        plain.about_map["reason"] = found
        return plain
    return _merged(measured, chained, found)


def _reason_without_map(measured: Record, asked: bool | None, model: str) -> str:
    """Why no map of the ball is made, in words; empty where a map is made."""
    if asked is False:
        return "not needed: it was not asked for"
    prefix = "" if asked else "not needed: "
    if model not in MAP_MODELS:
        return f"{prefix}a map of the ball takes a rigid motion at a constant distance, which {model!r} is not"
    if not np.isfinite(measured.rotation).any():
        return f"{prefix}no rotation was measured, so no map of the ball can be made"
    placed = int(np.isfinite(measured.position[:, 0]).sum())
    if placed < poses.MIN_FRAMES:
        return f"{prefix}a map of the ball needs {poses.MIN_FRAMES} frames with a known pose; there are {placed}"
    steps, uneven = int(np.isfinite(measured.increment[:, 0]).sum()), int(measured.uneven_light.sum())
    if asked is None and uneven > MAX_UNEVEN_SHARE * steps:
        return (
            f"no map of the ball was made, as something near it takes light from one side of it in {uneven} of {steps} "
            "steps, which steps allow for and a map does not; ask for a map to have one all the same"
        )
    return ""


def _merged(measured: Record, chained: Array, found: MapPoses) -> AbsoluteMotion:
    """Poses of the map; a frame that is not on the map follows from its neighbour by the step between them."""
    position, turned = found.position.copy(), found.orientation.copy()
    on_map = np.isfinite(position[:, 0])
    mapped = np.flatnonzero(on_map)
    for i in np.flatnonzero(np.isfinite(measured.position[:, 0]) & ~on_map):
        nearest = mapped[np.abs(mapped - i).argmin()]
        position[i] = position[nearest] + measured.position[i] - measured.position[nearest]
        turned[i] = chained[i] @ chained[nearest].T @ turned[nearest]
    steps: NDArray[np.bool_] = np.isfinite(measured.increment)
    between = np.swapaxes(turned[:-1], 1, 2)
    whole = np.asarray(steps.all(axis=1))
    relative = np.where(whole[:, None, None], turned[1:] @ between, np.eye(3))
    turns = So3.from_matrix(torch.from_numpy(relative)).log().numpy()
    increment = np.where(steps, np.concatenate((np.diff(position, axis=0), turns), 1), np.nan)
    # After a rotation that is missing the orientation is not known, but the increments are.
    increment = np.where(steps & ~np.isfinite(increment), measured.increment, increment)
    both = on_map[:-1] & on_map[1:] & whole
    covariance = np.where(both[:, None, None], found.step_covariance, measured.covariance)
    about = {
        "used": True,
        "keyframes": found.keyframes,
        "frames": int(on_map.sum()),
        "edge_blur_px": found.edge_blur,
        "residual_over_noise": found.misfit**0.5,
        "radius_over_distance": found.nearness,
        "sd_radius_over_distance": found.sd_nearness,
    }
    return AbsoluteMotion(position, increment, covariance, turned, found.circle, about)
