"""Absolute poses without drift: the cases in which a map of the ball is made, and its poses in the track."""

from __future__ import annotations

from dataclasses import dataclass, replace
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
from torchsphere.runtime import steps
from torchsphere.sphere_map import poses
from torchsphere.sphere_map.bundle_adjustment import NO_SOLUTION
from torchsphere.sphere_map.poses import MapPoses
from torchsphere.tracking.follow import Progress
from torchsphere.tracking.image_blur import image_blur
from torchsphere.tracking.record import Record

Array = NDArray[np.float64]

#: Squared difference of a step on the map and by a pair of images in uneven light, in their variances, from which one
#: of both is wrong (docs/constants.toml).
MAX_DISAGREEMENT = 12.5

#: Misfit of a frame on the map, in the median of all frames, from which the map is wrong there (docs/constants.toml).
SHADED_MISFIT = 1.5

#: Share of the known frames that are on the map of a ball whose path has not slipped (docs/constants.toml).
MIN_ON_MAP = 0.9

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
    on_map: NDArray[np.bool_]  # (n,), True for a frame whose pose is on a map

    @property
    def is_refused(self) -> bool:
        """Whether a map was needed, and the images did not allow it."""
        return not self.about_map["used"] and not self.about_map["reason"].startswith("not needed")

    @property
    def lacks_frames(self) -> bool:
        """Whether the map does not show a notable part of the frames whose position is known."""
        known = np.isfinite(self.position[:, 0]).sum()
        return bool(self.about_map["used"] and self.frames_on_map < MIN_ON_MAP * known)

    @property
    def frames_on_map(self) -> int:
        """Number of frames on the map."""
        return int(self.on_map.sum())

    def on_map_alone(self) -> AbsoluteMotion:
        """The motion without the frames that the map does not show."""
        between = (self.on_map[:-1] & self.on_map[1:])[:, None]
        return replace(
            self,
            position=np.where(self.on_map[:, None], self.position, np.nan),
            increment=np.where(between, self.increment, np.nan),
            covariance=np.where(between[..., None], self.covariance, np.nan),
            orientation=np.where(self.on_map[:, None, None], self.orientation, np.nan),
        )


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
    exposure: float | None = None,
    stated: float | None = None,
    progress: Progress | None = None,
) -> AbsoluteMotion:
    """The ``measured`` motion, on a map of the ball unless none is ``asked`` for (None: if there are frames enough).

    In a ``telecentric`` view the ball is seen from the same side wherever it is. ``exposure`` is that over the
    time between frames; where it is None, the one ``stated`` in the file counts, or the smear of the outline.
    """
    known = np.isfinite(measured.position[:, 0])
    chained = orientation.chain(measured.rotation, known)
    reason = _reason_without_map(measured, asked, options.model)
    about = {"used": False, "reason": reason}
    motion = measured.position, measured.increment, measured.covariance
    plain = AbsoluteMotion(*motion, chained, circle, about, np.zeros(len(known), dtype=bool))
    if reason:
        return plain
    steps.tell("making a map of the ball")
    known = measured.zncc[np.isfinite(measured.zncc)]
    lack = float(np.median(1 - known)) if len(known) else 0.0
    # Variance of the images' noise over that of their grey levels.
    noise = lack / noise_gains(options.pre_blur)[0]
    blur = image_blur(source, measured.position, circle, ignore, options.camera, stated)
    if exposure is not None:
        blur = replace(blur, open_share=exposure, is_share_known=True)
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
            blur,
        )
    except (np.linalg.LinAlgError, torch.linalg.LinAlgError):  # type: ignore[attr-defined]
        # The increments must not be lost with the map.
        found = NO_SOLUTION
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
    return ""


def _merged(measured: Record, chained: Array, found: MapPoses) -> AbsoluteMotion:
    """Poses of the map; frames that are not on the map, or shaded, follow from their neighbours by the steps."""
    on_map = np.isfinite(found.position[:, 0]) & ~shaded_frames(measured, found)
    position, turned = _bridged(measured.position, chained, found, on_map)
    steps: NDArray[np.bool_] = np.isfinite(measured.increment)
    whole = np.asarray(steps.all(axis=1))
    increment = np.where(steps, np.concatenate((np.diff(position, axis=0), _turns(turned, whole)), 1), np.nan)
    # After a rotation that is missing the orientation is not known, but the increments are.
    increment = np.where(steps & ~np.isfinite(increment), measured.increment, increment)
    # Rounding may leave a negative variance where the equations of the map are nearly singular.
    is_definite = np.diagonal(found.step_covariance, axis1=1, axis2=2).min(1) > 0
    both = on_map[:-1] & on_map[1:] & whole & is_definite
    covariance = np.where(both[:, None, None], found.step_covariance, measured.covariance)
    about = {
        "used": True,
        "keyframes": found.keyframes,
        "frames": int(on_map.sum()),
        "edge_blur_px": found.edge_blur,
        "open_share": found.open_share,
        "residual_over_noise": found.misfit**0.5,
        "widened": float(found.widening.max()),
        "radius_off_outline_px": found.off_outline,
        "radius_over_distance": found.nearness,
        "sd_radius_over_distance": found.sd_nearness,
    }
    return AbsoluteMotion(position, increment, covariance, turned, found.circle, about, on_map)


def _turns(orientation: Array, known: NDArray[np.bool_]) -> Array:
    """Rotation vectors (n - 1, 3) between successive ``orientation`` (n, 3, 3), rad; 0 where not ``known`` (n - 1,)."""
    relative = orientation[1:] @ np.swapaxes(orientation[:-1], 1, 2)
    return _vectors(np.where(known[:, None, None], relative, np.eye(3)))


def _vectors(rotation: Array) -> Array:
    """Rotation vectors (n, 3), rad, of the matrices (n, 3, 3)."""
    return So3.from_matrix(torch.from_numpy(rotation)).log().numpy()


def shaded_frames(measured: Record, found: MapPoses) -> NDArray[np.bool_]:
    """Frames (n,) in which an object near the ball changes the light so that the map errs: steps allow for such light.

    A step on the map contradicts the step between the images there, and the map explains the frames around it less well
    than the others. The steps are compared by the noise of single pixels: light that errs widens the covariance itself.
    """
    on_map = np.isfinite(found.position[:, 0])
    known = on_map[:-1] & on_map[1:] & np.isfinite(measured.increment).all(1) & measured.uneven_light[1:]
    by_map = np.concatenate((np.diff(found.position, axis=0), _turns(found.orientation, known)), 1)
    by_noise = found.step_covariance / np.outer(found.widening, found.widening)
    difference = np.where(known[:, None], by_map - measured.increment, 0.0)
    variance = np.where(known[:, None, None], by_noise + measured.covariance, np.eye(5))
    squares = (difference * np.linalg.solve(variance, difference[..., None])[..., 0]).sum(1)
    unexplained = on_map & (found.frame_misfit > SHADED_MISFIT * np.median(found.frame_misfit[on_map]))
    # Numbers of the runs of such frames.
    run = np.cumsum(np.diff(unexplained, prepend=False))
    contradicted = np.flatnonzero(squares > MAX_DISAGREEMENT)
    ends = np.concatenate((contradicted, contradicted + 1))
    return unexplained & np.isin(run, run[ends[unexplained[ends]]])


def _bridged(position: Array, chained: Array, found: MapPoses, on_map: NDArray[np.bool_]) -> tuple[Array, Array]:
    """Positions (n, 2) and orientations (n, 3, 3): those ``on_map``, and the ``position`` and ``chained`` ones between.

    The pairs' poses are moved to the map's at both ends of a gap: what both differ by is shared out among its frames.
    """
    mapped, rest = np.flatnonzero(on_map), np.flatnonzero(np.isfinite(position[:, 0]) & ~on_map)
    placed, turned = np.where(on_map[:, None], found.position, np.nan), found.orientation.copy()
    after = np.searchsorted(mapped, rest)
    a, b = mapped[(after - 1).clip(0)], mapped[after.clip(max=len(mapped) - 1)]
    share = ((rest - a) / (b - a).clip(1)).clip(0, 1)[:, None]
    shift = found.position - position
    placed[rest] = position[rest] + (1 - share) * shift[a] + share * shift[b]
    turn = found.orientation @ np.swapaxes(chained, 1, 2)
    between = So3.exp(torch.from_numpy(share * _vectors(turn[b] @ np.swapaxes(turn[a], 1, 2)))).matrix().numpy()
    turned[rest] = between @ turn[a] @ chained[rest]
    return placed, turned
