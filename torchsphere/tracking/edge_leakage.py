"""What is carried over the outline into a small ball's region of interest, where ball and background differ much.

The border of what leaks in moves with the ball and does not turn with it. Beside a texture of little contrast it draws
the steps along the weak combination of step and rotation: the rotation comes out too large, and so does the step along
the motion of the front.
"""

from __future__ import annotations

import math
from collections.abc import Container
from dataclasses import replace

import torch
from torch import Tensor

from torchsphere.correlation.options import Options, suited
from torchsphere.geometry.circle import Circle
from torchsphere.imaging import crop

#: Error of a step over the motion of the front, over the square of what leaks in, in contrasts of the texture. Mean of
#: 56 rendered flights of 15 steps: radii of 16 to 50 px, bright balls before a dark background and dark ones before a
#: bright one, four patterns each; by radius and kind 0.24 to 0.7. It does not depend on the turn.
LEAKED = 0.4

#: Blur of a pixel and of the spline, px, beside the pre-blur.
SHARP_PX = 0.5

#: Largest share that is stated: that of dark balls of 12 px before a bright background.
MOST = 0.6

#: The texture within so many radii, and what is behind the ball this far from its outline, px.
INNER, BEHIND_PX = 0.9, (2.0, 5.0)

#: Share from which the region is made smaller by itself: the distance of its border from the outline, px, where a share
#: of 0.06 to 0.6 came down to 0.004 to 0.05, noise included; and the smallest region.
NOTABLE, ROOM_PX, LEAST_ROI = 0.02, 2.5, 0.7


def difference(image: Tensor, circle: Circle, ignore: Tensor | None = None) -> float:
    """How far the levels behind a ball are from its mean, root mean square over the contrast of its texture.

    ``image`` (h, w); ``ignore`` (h, w), where it is not to be used. 0 where nothing is seen of either.
    """
    centre = torch.tensor([[circle.x, circle.y]], dtype=torch.float64)
    crops = crop.cut(image[None], centre, crop.half_size(circle.radius, BEHIND_PX[1]), ignore)
    across = torch.arange(crops.images.shape[-1])
    x, y = (across + float(crops.origin[0, k]) - float(centre[0, k]) for k in range(2))
    distance = torch.hypot(x[None, :], y[:, None]).to(image.device)
    usable = torch.isfinite(crops.images[0])
    if crops.usable is not None:
        usable = usable & crops.usable[0]
    within = crops.images[0][usable & (distance < INNER * circle.radius)].double()
    near, far = (circle.radius + away for away in BEHIND_PX)
    behind = crops.images[0][usable & (distance > near) & (distance < far)].double()
    if min(len(within), len(behind)) < 2:
        return 0.0
    contrast = within.std().clamp_min(1e-6)
    return float((behind - within.mean()).square().mean().sqrt() / contrast)


def leaked(apart: float, radius: float, options: Options) -> float:
    """Share of the front's motion that a step is off by, of a ball ``apart`` from what is behind it by `difference`."""
    room = (1 - options.roi) * radius / math.hypot(options.pre_blur, SHARP_PX)
    tail = 0.5 * math.erfc(room / math.sqrt(2))
    return min(LEAKED * (apart * tail) ** 2, MOST)


def fitted(options: Options, given: Container[str], radius: float, apart: float) -> Options:
    """The options with the pre-blur, and where much leaks in the region, that suit a ball; what was ``given`` stays."""
    found = options if "pre_blur" in given else suited(options, radius)
    if "roi" in given or leaked(apart, radius, found) < NOTABLE:
        return found
    smaller = replace(options, roi=min(options.roi, roomy(radius)))
    return smaller if "pre_blur" in given else suited(smaller, radius)


def roomy(radius: float) -> float:
    """Region of interest, share of the radius, px, that nothing leaks into, if that is large enough."""
    return max(math.floor(100 * (1 - ROOM_PX / radius)) / 100, LEAST_ROI)
