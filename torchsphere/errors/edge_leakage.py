"""Light of the background that blur carries over the outline into the region of interest of a small ball.

The border of this light moves with the ball and does not turn with it. Next to a texture of little contrast the
rotation and the step along the motion of the front come out too large.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Container

import numpy as np
import torch
from torch import Tensor

from torchsphere.correlation.options import Options, adapt_pre_blur
from torchsphere.errors import steady_error
from torchsphere.errors.evidence import Evidence
from torchsphere.geometry.circle import Circle
from torchsphere.imaging import crop
from torchsphere.motion.findings import Findings
from torchsphere.motion.track import Track

#: Error of a step over the motion of the front, per squared leakage in contrasts of the texture (docs/constants.toml).
ERROR_PER_LEAKAGE = 0.4

#: Blur of a pixel and of the spline, px, in addition to the pre-blur (docs/constants.toml).
PIXEL_BLUR_PX = 0.5

#: Largest share that is stated (docs/constants.toml).
MAX_SHARE = 0.6

#: Radius of the texture, radii, and distances of the background from the outline, px (docs/constants.toml).
TEXTURE_RADIUS, BACKGROUND_PX = 0.9, (2.0, 5.0)

#: Leakage from which the region is made smaller, and distance of its border from the outline, px (docs/constants.toml).
NOTABLE_SHARE, BORDER_DISTANCE_PX = 0.02, 2.5

#: Smallest region of interest by default, share of the radius (docs/constants.toml).
MIN_ROI = 0.7

widen = steady_error.widen


def background_contrast(image: Tensor, circle: Circle, ignore: Tensor | None = None) -> float:
    """Root mean square of background minus mean of the ball, over the contrast of the ball's texture.

    ``image`` and ``ignore`` (h, w). 0 where ball or background are not visible.
    """
    centre = torch.tensor([[circle.x, circle.y]], dtype=torch.float64)
    crops = crop.cut(image[None], centre, crop.half_size(circle.radius, BACKGROUND_PX[1]), ignore)
    across = torch.arange(crops.images.shape[-1])
    x, y = (across + float(crops.origin[0, k]) - float(centre[0, k]) for k in range(2))
    distance = torch.hypot(x[None, :], y[:, None]).to(image.device)
    usable = torch.isfinite(crops.images[0])
    if crops.usable is not None:
        usable = usable & crops.usable[0]
    ball = crops.images[0][usable & (distance < TEXTURE_RADIUS * circle.radius)].double()
    inner, outer = (circle.radius + away for away in BACKGROUND_PX)
    background = crops.images[0][usable & (distance > inner) & (distance < outer)].double()
    if min(len(ball), len(background)) < 2:
        return 0.0
    texture = ball.std().clamp_min(1e-6)
    return float((background - ball.mean()).square().mean().sqrt() / texture)


def leakage_share(contrast: float, radius: float, options: Options) -> float:
    """Error of a step as a share of the front's motion, for a ball with that `background_contrast`."""
    room = (1 - options.roi) * radius / math.hypot(options.pre_blur, PIXEL_BLUR_PX)
    tail = 0.5 * math.erfc(room / math.sqrt(2))
    return min(ERROR_PER_LEAKAGE * (contrast * tail) ** 2, MAX_SHARE)


def adapt_options(options: Options, given: Container[str], radius: float, contrast: float) -> Options:
    """The options with pre-blur and, under strong leakage, region adapted to the ball; ``given`` options stay."""
    found = options if "pre_blur" in given else adapt_pre_blur(options, radius)
    if "roi" in given or leakage_share(contrast, radius, found) < NOTABLE_SHARE:
        return found
    smaller = dataclasses.replace(options, roi=min(options.roi, roi_without_leakage(radius)))
    return smaller if "pre_blur" in given else adapt_pre_blur(smaller, radius)


def roi_without_leakage(radius: float) -> float:
    """Region of interest, share of the radius, px, that no background light reaches; `MIN_ROI` at least."""
    return max(math.floor(100 * (1 - BORDER_DISTANCE_PX / radius)) / 100, MIN_ROI)


def detect(track: Track, evidence: Evidence) -> Findings:
    """The share of a rotation by which the background makes it too large."""
    leaked = leakage_share(evidence.contrast, track.circle.radius, evidence.options)
    return dataclasses.replace(track.findings, leaked=leaked)


def sentences(track: Track, evidence: Evidence) -> list[str]:
    """Whether the background leaks into the region of interest."""
    share, radius = track.findings.leaked, track.circle.radius
    turns = bool(np.isfinite(track.increment[:, 2:]).any())
    if share < NOTABLE_SHARE or track.findings.is_on_map or not turns:
        return []
    percent, advice = 100 * steady_error.ROTATION_PER_STEP * share, "film the ball larger"
    if "roi" in evidence.given:
        advice = f"leave `roi` out, or give {roi_without_leakage(radius):g}"
    return [
        "The ball is much brighter or darker than the background, which reaches over the outline of so small a ball "
        f"into the region of interest: rotations about x and y may be {percent:.0f} % too "
        f"large, which their standard deviations include; {advice}."
    ]
