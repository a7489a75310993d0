"""What all steps of a flight are off by alike: an error that no scatter shows, stated by the tracker.

Two causes were found on rendered balls (radii of 25 to 80 px, spots of 3 to 6 px), and neither depends on the images'
noise. What is finer than two pixels, at the limb above all, aliases: a shift by d px is off by a multiple of
``sin(2 pi d)``, alike in all frames where d is. And a ball that turns shows its texture in another view: the step is
off along the motion of its front, the more the finer the texture. Both hardly move the front itself but the weak
combination of step and rotation, so that the rotation about the other axis errs by the step's error over the radius.
"""

from __future__ import annotations

import math

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from torchsphere import criterion, crop, interpolate
from torchsphere.circle import Circle
from torchsphere.reference import Filtered, build_reference

#: Error of a step by d px over ``sin(2 pi d)``, px: root mean square of 16 (0.0003 to 0.0027), 4 kinds of rendered
#: balls of two patterns each that only move.
ALIASED_PX = 0.0015

#: Error of a step per turn about the axis across it, px per rad, over the square of the `fineness`; and the turn up to
#: which it grows, rad: beyond, `torchsphere.symmetric` cancels most of it. Measured per deg, at 0.2 to 0.8 deg per
#: frame: 0.0078 px where the fineness is 0.50 (spots of 3.2 px), 0.0048 and 0.0042 at 0.41 (4 px), 0.0022 at 0.26 (6
#: px).
TURNED_PX, GROWS_UP_TO = 0.029 / math.radians(1.0), math.radians(1.0)

#: What is left where neither moves the ball, times the radius, px: 0.0007 px at 50 px; and about z, rad.
LEFT_PX, LEFT_ABOUT_Z = 0.0007 * 50.0, math.radians(0.001)

#: On a map of the ball, which averages over all places of the spots between the pixels, as a share of it. Four rendered
#: oblique impacts on maps erred by 0.86 of what is stated so (root mean square over x, y, wx, wy), by 1.4 about y;
#: where no plate took light from one side, one of them erred by a fifth.
SHARE_ON_MAP = 0.5

#: Part of the ball that the fineness is taken from, of the radius: the limb's texture is foreshortened.
INNER = 0.8

#: Fineness of speckle of 4 px; and of noise, which no texture exceeds.
TYPICAL, FINEST = 0.41, 1.0

Array = NDArray[np.float64]


def fineness(image: Tensor, circle: Circle, ignore: Tensor | None = None) -> float:
    """How fine a ball's texture is, 1/px^2: mean square of the gradient over the variance, of the pre-blurred image.

    About ``5 / d^2`` to ``9 / d^2`` for sharp spots of d = 3 to 6 px. ``image`` (h, w); ``ignore`` (h, w), where it is
    not to be used.
    """
    circles = torch.tensor([[circle.x, circle.y, circle.radius]], dtype=torch.float64)
    blur = interpolate.PRE_BLUR_PX
    crops = crop.cut(image[None], circles[:, :2], crop.half_size(circle.radius, 4 * blur), ignore)
    reference = build_reference(Filtered.of(crops, blur), circles, INNER, blur)
    weights = reference.weights
    variance = (weights * criterion.centred(reference.values, weights).square()).sum()
    slope = (weights * reference.gradient.square().sum(1)).sum()
    return min(float(slope / variance.clamp_min(1e-12)), FINEST)


def sd_steady(increment: Array, radius: float, fine: float = TYPICAL, *, on_map: bool) -> Array:
    """Standard deviation (5,) of what all steps of a flight are off by alike, px and rad.

    Parameters
    ----------
    increment : ndarray
        The steps (n, 5), px and rad, NaN where they were not measured.
    radius : float
        Of the ball, px.
    fine : float
        `fineness` of its texture.
    on_map : bool
        Whether the steps come from a map of the ball.
    """
    known = np.isfinite(increment)
    steps = np.where(known, increment, 0.0)
    aliased = ALIASED_PX * np.sin(2 * np.pi * steps[:, :2])
    turned = TURNED_PX * fine**2 * np.minimum(np.abs(steps[:, [3, 2]]), GROWS_UP_TO)
    squares = (aliased**2 + turned**2).sum(0) / max(known[:, 0].sum(), 1)
    step = np.sqrt(squares + (LEFT_PX / radius) ** 2)
    return (SHARE_ON_MAP if on_map else 1.0) * np.concatenate((step, step[::-1] / radius, [LEFT_ABOUT_Z]))
