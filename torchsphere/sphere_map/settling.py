"""Map and poses of the keyframes, with lens and exposure, and then the camera's nearness, settled from those before."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
import torch
from torch import Tensor

from torchsphere.runtime.threads import RowRunner
from torchsphere.sphere_map import bundle_adjustment, exposure, exposure_share, lens, nearness
from torchsphere.sphere_map.ball import Poses
from torchsphere.sphere_map.known_frames import KnownFrames
from torchsphere.sphere_map.lens import Lens, View
from torchsphere.sphere_map.level import Adjustment
from torchsphere.sphere_map.nearness_decision import check_nearness, find_nearness
from torchsphere.sphere_map.perspective import orthographic
from torchsphere.sphere_map.shared_unknown import SharedUnknowns
from torchsphere.sphere_map.tone_curve import find_tone_curve

#: Residual without a growth, over that with one, both as variances, up to which the ball does not grow before a camera
#: that was found near (docs/constants.toml).
AS_WELL = 1.02


@dataclass(frozen=True)
class Settled:
    """What all images share, and what they are seen with."""

    adjustment: Adjustment
    frames: KnownFrames  # with the exposure and the camera that were found
    initial: Poses  # of the keyframes, as that camera shows the same sides of the ball
    open_share: float  # exposure over the time between frames
    lens: Lens


def settle(
    frames: KnownFrames,
    keys: list[int],
    radius: float,
    noise_variance: float,
    cell_px: float,
    blur: exposure.Blur,
    shared: RowRunner,
    progress: Callable[[float], None],
    *,
    is_distance_known: bool,
    is_lens_known: bool,
    grows: bool,
    stays: bool,
) -> Settled:
    """Adjust the frames ``keys`` from their initial poses; other arguments as `bundle_adjustment.adjust`.

    The exposure stays where it ``is_share_known``, and camera and lens where they are known.
    """
    far = orthographic(tuple(frames.background.shape), frames.position.device)

    def adjusted(
        seen: KnownFrames, start: Poses, radius: float, view: View | None, lens_seen: SharedUnknowns, *, grows: bool
    ) -> Adjustment:
        windows = seen.windows(keys, start, radius)
        return bundle_adjustment.adjust(
            windows,
            start,
            radius,
            noise_variance,
            cell_px,
            shared,
            progress,
            optics_px=blur.optics_px,
            least_variance=seen.source.rounding_variance,
            is_exposure_known=blur.is_share_known or windows.moments is None,
            grows=grows,
            stays=stays,
            view=view,
            lens=lens_seen,
        )

    of_lens = () if is_lens_known or not _crosses(frames.position[keys], radius) else lens.unknowns(far)
    unknowns = of_lens if is_distance_known else (*of_lens, nearness.UNKNOWN)
    view = View(far, unknowns) if unknowns else None
    adjustment = adjusted(frames, frames.poses(np.array(keys)), radius, view, (), grows=grows)
    if adjustment.lens:
        state = adjustment.state
        frames = frames.seen_by(state.windows.optics)
        if not blur.is_share_known:
            # Outlines that a lens bends look smeared.
            frames, blur = replace(frames, moments=None), replace(blur, open_share=0.0)
        seen = float(state.ball.radius), None, adjustment.lens
        adjustment = adjusted(frames, state.poses, *seen, grows=grows)
        if grows:
            # The outlines before a near camera grow as well, and radii of their own hide it.
            steady = replace(frames, added_radius=torch.zeros_like(frames.added_radius))
            poses = replace(state.poses, added_radius=torch.zeros_like(state.poses.added_radius))
            without = adjusted(steady, poses, *seen, grows=False)
            if without.settled and without.residual_variance < AS_WELL * adjustment.residual_variance:
                frames, adjustment = steady, without
    open_share = blur.open_share
    if frames.moments is not None:
        longer = exposure_share.factor_between(frames.moments[keys], adjustment.state.windows.moments)
        frames, open_share = replace(frames, moments=longer * frames.moments), longer * open_share
    if adjustment.settled:
        adjustment = find_tone_curve(adjustment, shared, is_blurred=blur.optics_px > 0)
    about_distance = check_nearness if is_distance_known else find_nearness
    adjustment = about_distance(adjustment, far, shared)
    frames = frames.seen_by(adjustment.state.windows.optics)
    found = lens.found(of_lens, adjustment.state, adjustment.unknowns, adjustment.covariance)
    return Settled(adjustment, frames, frames.poses(np.array(keys)), open_share, found)


def _crosses(positions: Tensor, radius: float) -> bool:
    """Whether a ball at these ``positions`` (n, 2), px, is seen at places that are further apart than its ``radius``.

    A lens is told by what changes from place to place; at one place it looks like a near camera, or like a light.
    """
    return bool((positions.amax(0) - positions.amin(0)).max() > radius)
