"""Map and poses of the keyframes, then the exposure, then the camera's nearness, each settled from the one before."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

from torchsphere.runtime.threads import RowRunner
from torchsphere.sphere_map import bundle_adjustment, exposure, exposure_share
from torchsphere.sphere_map.ball import Poses
from torchsphere.sphere_map.bundle_adjustment import Adjustment
from torchsphere.sphere_map.known_frames import KnownFrames
from torchsphere.sphere_map.nearness import seen_alike
from torchsphere.sphere_map.perspective import Optics, orthographic
from torchsphere.sphere_map.window import Windows


@dataclass(frozen=True)
class Settled:
    """What all images share, and what they are seen with."""

    adjustment: Adjustment
    frames: KnownFrames  # with the exposure and the camera that were found
    initial: Poses  # of the keyframes, as that camera shows the same sides of the ball
    open_share: float  # exposure over the time between frames
    settled_afar: bool  # whether the poses settled with the camera they began with, before a nearer one was tried


def settle(
    frames: KnownFrames,
    windows: Windows,
    initial: Poses,
    radius: float,
    noise_variance: float,
    cell_px: float,
    blur: exposure.Blur,
    shared: RowRunner,
    progress: Callable[[float], None],
    *,
    is_distance_known: bool,
    grows: bool,
) -> Settled:
    """Adjust the keyframes' ``windows`` from their ``initial`` poses; other arguments as `bundle_adjustment.adjust`.

    The exposure stays where it ``is_share_known``, and the camera where ``is_distance_known``.
    """
    adjustment = bundle_adjustment.adjust(
        windows,
        initial,
        radius,
        noise_variance,
        cell_px,
        shared,
        progress,
        optics_px=blur.optics_px,
        least_variance=frames.source.rounding_variance,
        is_exposure_known=blur.is_share_known or windows.moments is None,
        grows=grows,
    )
    open_share = blur.open_share
    if frames.moments is not None:
        longer = exposure_share.factor_between(windows, adjustment.state.windows)
        frames, open_share = replace(frames, moments=longer * frames.moments), longer * open_share
    settled_afar = adjustment.settled
    if not is_distance_known:
        far = orthographic(tuple(frames.background.shape), windows.levels.device)
        adjustment = bundle_adjustment.find_nearness(adjustment, far, shared)
        frames, initial = _seen_alike(frames, initial, adjustment.state.windows.optics)
    return Settled(adjustment, frames, initial, open_share, settled_afar)


def _seen_alike(frames: KnownFrames, initial: Poses, optics: Optics | None) -> tuple[KnownFrames, Poses]:
    """Frames and initial poses, so far orthographic, as the camera that was found shows the same sides of the ball."""
    if optics is None:
        return frames, initial
    seen = replace(frames, optics=optics, orientation=seen_alike(frames.poses(), None, optics).orientation)
    return seen, seen_alike(initial, None, optics)
