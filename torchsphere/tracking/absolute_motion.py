"""Which frames take their poses from a map of the ball, and the poses of all: between them lie the steps of pairs."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np
import torch
from kornia.geometry.liegroup import So3
from numpy.typing import NDArray

from torchsphere.correlation.options import Options
from torchsphere.geometry import orientation
from torchsphere.geometry.camera import Camera
from torchsphere.geometry.circle import Circle
from torchsphere.imaging.interpolation import noise_gains
from torchsphere.runtime import steps
from torchsphere.runtime.arrays import Array
from torchsphere.sphere_map.decision import (
    GROWING_MODELS,
    NO_SOLUTION,
    MadeMap,
    NoMap,
    lacks_frames,
    not_needed,
    shaded_frames,
)
from torchsphere.sphere_map.poses import MapPoses, MapRequest, poses_on_map
from torchsphere.tracking.blur_estimate import estimate_blur
from torchsphere.tracking.record import Record
from torchsphere.tracking.task import Task


@dataclass(frozen=True)
class AbsoluteMotion:
    """Positions, increments and orientations of a track; the fields are those of `torchsphere.tracking.track.Track`."""

    position: Array
    increment: Array
    covariance: Array
    orientation: Array
    radius: Array
    sd_growth: Array
    circle: Circle
    map: MadeMap | NoMap
    on_map: NDArray[np.bool_]  # (n,), True for a frame whose pose is on a map
    # (n - 1, 5), in the standard deviations of the steps by residuals that are alike over many pixels
    residual_factors: Array

    @property
    def is_refused(self) -> bool:
        """Whether a map was needed, and the images did not allow it."""
        return isinstance(self.map, NoMap) and self.map.is_needed

    @property
    def lacks_frames(self) -> bool:
        """Whether the map does not show a notable part of the frames whose position is known."""
        return isinstance(self.map, MadeMap) and lacks_frames(np.isfinite(self.position[:, 0]), self.on_map)

    def only(self, kept: NDArray[np.bool_]) -> AbsoluteMotion:
        """The motion of the ``kept`` frames (n,) and the steps between these."""
        between = (kept[:-1] & kept[1:])[:, None]
        return replace(
            self,
            position=np.where(kept[:, None], self.position, np.nan),
            increment=np.where(between, self.increment, np.nan),
            covariance=np.where(between[..., None], self.covariance, np.nan),
            orientation=np.where(kept[:, None, None], self.orientation, np.nan),
        )


def absolute_motion(
    task: Task, measured: Record, circle: Circle, options: Options, fineness: float, camera: Camera | None
) -> AbsoluteMotion:
    """The ``measured`` motion, on a map of the ball unless none is asked for (None: if there are frames enough).

    The exposure is the one asked for, or else the one that the file states, or the smear of the outline. Without
    a ``camera`` that is known, its distance is found with the map.
    """
    known = np.isfinite(measured.position[:, 0])
    chained = orientation.chain(measured.rotation, known)
    without = not_needed(task.sphere_map, options.model, measured.position, measured.rotation)
    if without is None:
        found = _on_map(task, measured, chained, circle, options, fineness, camera)
        if isinstance(found, MapPoses):
            return _merged(measured, chained, found)
        without = found
    motion = measured.position, measured.increment, measured.covariance, chained, measured.size, measured.sd_growth
    on_map = np.zeros(len(known), dtype=bool)
    return AbsoluteMotion(*motion, circle, without, on_map, np.ones_like(measured.increment))


def _on_map(
    task: Task,
    measured: Record,
    chained: Array,
    circle: Circle,
    options: Options,
    fineness: float,
    camera: Camera | None,
) -> MapPoses | NoMap:
    """The poses on a map of the ball, or why there is none."""
    steps.tell("making a map of the ball")
    known = measured.zncc[np.isfinite(measured.zncc)]
    lack = float(np.median(1 - known)) if len(known) else 0.0
    # Variance of the images' noise over that of their grey levels.
    noise = lack / noise_gains(options.pre_blur)[0]
    blur = estimate_blur(task.source, measured.position, circle, task.ignore, camera, task.stated_exposure)
    if task.exposure is not None:
        blur = replace(blur, open_share=task.exposure, is_share_known=True)
    asked = MapRequest(
        task.source,
        measured.position,
        chained,
        measured.size,
        noise,
        circle,
        task.ignore,
        fineness,
        camera,
        task.telecentric,
        options.model in GROWING_MODELS,
        task.in_place,
        task.progress,
        blur,
    )
    try:
        return poses_on_map(asked)
    except (np.linalg.LinAlgError, torch.linalg.LinAlgError):  # type: ignore[attr-defined]
        # The increments must not be lost with the map.
        return NO_SOLUTION


def _merged(measured: Record, chained: Array, found: MapPoses) -> AbsoluteMotion:
    """Poses of the map; frames that are not on the map, or shaded, follow from their neighbours by the steps."""
    on_map = np.isfinite(found.position[:, 0]) & ~_shaded(measured, found)
    position, turned, radius = _bridged(measured, chained, found, on_map)
    steps: NDArray[np.bool_] = np.isfinite(measured.increment)
    whole = np.asarray(steps.all(axis=1))
    increment = np.where(steps, np.concatenate((np.diff(position, axis=0), _turns(turned, whole)), 1), np.nan)
    # After a rotation that is missing the orientation is not known, but the increments are.
    increment = np.where(steps & ~np.isfinite(increment), measured.increment, increment)
    # Rounding may leave a negative variance where the equations of the map are nearly singular.
    is_definite = np.diagonal(found.step_covariance, axis1=1, axis2=2).min(1) > 0
    both = on_map[:-1] & on_map[1:] & whole & is_definite
    covariance = np.where(both[:, None, None], found.step_covariance, measured.covariance)
    made = MadeMap(
        keyframes=found.keyframes,
        frames=int(on_map.sum()),
        edge_blur_px=found.edge_blur,
        edge_bend=found.edge_bend,
        open_share=found.open_share,
        falloff=found.falloff,
        residual_over_noise=found.misfit**0.5,
        widened=float(found.widening.max()),
        radius_off_outline_px=found.off_outline,
        radius_over_distance=found.nearness,
        sd_radius_over_distance=found.sd_nearness,
        lens_distortion=found.lens.distortion,
        sd_lens_distortion=found.lens.sd_distortion,
        pixel_ratio=math.exp(found.lens.stretch),
        sd_pixel_ratio=found.lens.sd_stretch,
        lens_middle_px=found.lens.middle,
    )
    sd_growth = np.where(both, found.sd_growth, measured.sd_growth)
    factors = np.where(both[:, None], found.widening, 1.0)
    motion = position, increment, covariance, turned, radius, sd_growth
    return AbsoluteMotion(*motion, found.circle, made, on_map, factors)


def _turns(orientation: Array, known: NDArray[np.bool_]) -> Array:
    """Rotation vectors (n - 1, 3) between successive ``orientation`` (n, 3, 3), rad; 0 where not ``known`` (n - 1,)."""
    relative = orientation[1:] @ np.swapaxes(orientation[:-1], 1, 2)
    return _vectors(np.where(known[:, None, None], relative, np.eye(3)))


def _vectors(rotation: Array) -> Array:
    """Rotation vectors (n, 3), rad, of the matrices (n, 3, 3)."""
    return So3.from_matrix(torch.from_numpy(rotation)).log().numpy()


def _shaded(measured: Record, found: MapPoses) -> NDArray[np.bool_]:
    """Frames (n,) of `shaded_frames`: the steps by pairs of images allow for uneven light.

    The steps are compared by the noise of single pixels: light that errs widens the covariance itself.
    """
    on_map = np.isfinite(found.position[:, 0])
    known = on_map[:-1] & on_map[1:] & np.isfinite(measured.increment).all(1) & measured.uneven_light[1:]
    by_map = np.concatenate((np.diff(found.position, axis=0), _turns(found.orientation, known)), 1)
    by_noise = found.step_covariance / np.outer(found.widening, found.widening)
    return shaded_frames(by_map - measured.increment, by_noise + measured.covariance, known, found.frame_misfit, on_map)


def _bridged(
    measured: Record, chained: Array, found: MapPoses, on_map: NDArray[np.bool_]
) -> tuple[Array, Array, Array]:
    """Positions (n, 2), orientations (n, 3, 3) and radii (n,): those ``on_map``, between them the ``measured`` ones.

    The pairs' poses, with the ``chained`` orientations, are moved to the map's at both ends of a gap: what both differ
    by is shared out among its frames.
    """
    position, size = measured.position, measured.size
    mapped, rest = np.flatnonzero(on_map), np.flatnonzero(np.isfinite(position[:, 0]) & ~on_map)
    placed, turned = np.where(on_map[:, None], found.position, np.nan), found.orientation.copy()
    after = np.searchsorted(mapped, rest)
    a, b = mapped[(after - 1).clip(0)], mapped[after.clip(max=len(mapped) - 1)]
    share = ((rest - a) / (b - a).clip(1)).clip(0, 1)[:, None]
    shift = found.position - position
    placed[rest] = position[rest] + (1 - share) * shift[a] + share * shift[b]
    larger, weight = found.radius / size, share[:, 0]
    radius = np.where(on_map, found.radius, np.nan)
    radius[rest] = size[rest] * ((1 - weight) * larger[a] + weight * larger[b])
    turn = found.orientation @ np.swapaxes(chained, 1, 2)
    between = So3.exp(torch.from_numpy(share * _vectors(turn[b] @ np.swapaxes(turn[a], 1, 2)))).matrix().numpy()
    turned[rest] = between @ turn[a] @ chained[rest]
    return placed, turned, radius
