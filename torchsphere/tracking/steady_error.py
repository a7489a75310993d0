"""What all steps of a flight are off by alike: an error that no scatter shows, stated by the tracker.

Two causes were found on rendered balls (radii of 25 to 80 px, spots of 3 to 6 px), and neither depends on the images'
noise. What is finer than two pixels aliases, and the interpolation adds images of what is just coarser: a shift by d px
is off by a multiple of ``sin(2 pi d)``, alike in all frames where d is. `interpolation` has a kernel that
balances both on average over textures, so that what is left is each texture's own and falls with the radius. A turn
about the line of sight shifts each place of the ball by its own part of a pixel, and is off by what these average out
to. And a ball that turns out of the image's plane shows its texture in another view: the step is off along the motion
of its front, the more the finer the texture; beyond a degree per frame all five components are off. Both hardly
move the front itself but the weak combination of step and rotation, so that the rotation about the other axis errs by
the step's error over the radius, and by a fifth more.

A target near the ball adds to it what the light that it takes does to the steps, allowed for as it is; and what is
behind a small ball adds what of it is carried over the outline (`torchsphere.tracking.edge_leakage`).
"""

from __future__ import annotations

import math

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from torchsphere.correlation import znssd
from torchsphere.correlation.reference import Filtered, build_reference
from torchsphere.geometry.circle import Circle
from torchsphere.imaging import crop, interpolation

#: Error of a step by d px over ``sin(2 pi d)``, times the radius, px^2. This and the constants down to
#: `ROTATION_PER_STEP` are root mean squares over 222 rendered flights of 8 or 16 steps without noise: radii of 25, 40,
#: 50, 60 and 80 px, spots of 3.2 to 6 px, three or four patterns each. By kind of ball the error over what is stated
#: with them is 0.8 to 1.1 in x and y, 0.7 to 1.2 about z.
ALIASED_PX2 = 0.0005 * 50.0

#: Error of a step per turn about the axis across it, px per rad, over the square of the `fineness`; and the turn up to
#: which it grows, rad: beyond, `FAST_PX3` goes on. Mean per deg, at 0.3 to 0.7 deg per frame: 0.0028 px where the
#: fineness is 0.50 (spots of 3.2 px), 0.0023 at 0.41 (4 px), none to be seen at 0.26 (6 px).
TURNED_PX, GROWS_UP_TO = 0.0115 / math.radians(1.0), math.radians(1.0)

#: Error along the motion of the front for what a ball turns out of the image's plane beyond `GROWS_UP_TO`, times the
#: square of the radius, px^3 per rad, and the turn up to which it grows, rad. Measured without noise on 416 flights of
#: 8 steps at 0.5 to 15 deg per frame, 13 patterns with radii of 25 to 80 px and spots of 3 to 6 px: root mean squares,
#: taken to 50 px, of 0.0024 px at 2 deg, 0.0029 at 3, 0.0049 at 5, 0.0058 at 7, 0.0073 at 10 and 0.0081 at 15. The sign
#: changes with turn and texture. Both directions of a pair err alike, so that their mean errs as well.
FAST_PX3, FAST_UP_TO = 0.0010 * 50.0**2 / math.radians(1.0), math.radians(8.0)

#: The error across that motion, and the one about z times the radius, as shares of it: 0.3 to 0.5 and 0.15 to 0.2
#: from 3 deg on.
FAST_ACROSS, FAST_ABOUT_Z = 0.3, 0.2

#: What is left where neither moves the ball, times the radius, px^2; and about z, times its square, rad px^2. It comes
#: from the single spots: there are as many as the square of the radius, and a turn has their distance as a lever.
LEFT_PX2, LEFT_Z_PX2 = 0.00035 * 50.0, math.radians(0.37)

#: Error of the shift of each place of a ball that turns about z, over the sine of its own, px: 0.0001 to 0.0004. With
#: the B-spline it is 0.001 px, and a turn by 0.3 deg about z is off by 0.0017 deg at a radius of 40 px.
ALIASED_Z_PX = 0.00017

#: What leaks in over the outline moves the step across the motion of the front and turns about z besides: shares of the
#: error along it, the latter times the radius; 0.1 to 0.9, and 0.02 to 0.1.
LEAKED_ACROSS, LEAKED_ABOUT_Z = 0.3, 0.08

#: Error of a rotation about x or y times the radius over that of the step along the other axis: 0.7 to 1.5.
ROTATION_PER_STEP = 1.2

#: What steps with light that changes unevenly over the ball are off by besides: px, and px over the radius for a turn
#: about z. Measured on eight rendered frontal and oblique impacts of 40 and 50 px, other ones than those that test the
#: bands: from one half of a flight to the other the steps change by 0.0003 to 0.0016 px more than by noise and other
#: causes; `shared_errors` makes 0.0015 px of this. The mean over a flight is off by a third of it; about z
#: by 0.0006 deg after the frontal impacts, where 0.0003 deg have other causes.
LIT_PX, LIT_Z_PX = 0.0021, 0.0003

#: On a map of the ball, as a share of it: a map has an error of its own, and none of the interpolation. Four rendered
#: oblique impacts on maps erred by 0.8 of what is stated so (root mean square over x, y, wx, wy), by 1.2 about y; where
#: no plate took light from one side, one of them erred by a fifth.
SHARE_ON_MAP = 1.2

#: Places across the ball, of its radius, and the share of its area at each.
ACROSS = (np.arange(32) + 0.5) / 16 - 1
SHARES = np.sqrt(1 - ACROSS**2) / np.sqrt(1 - ACROSS**2).sum()

#: Part of the ball that the fineness is taken from, of the radius: the limb's texture is foreshortened.
INNER = 0.8

#: Fineness of speckle of 4 px; and of noise, which no texture exceeds.
TYPICAL, FINEST = 0.41, 1.0

Array = NDArray[np.float64]


def fineness(image: Tensor, circle: Circle, ignore: Tensor | None = None) -> float:
    """How fine a ball's texture is, 1/px^2: mean square of the gradient over the variance, of the pre-blurred image.

    About ``5 / d^2`` to ``9 / d^2`` for sharp spots of d = 3 to 6 px. ``image`` (h, w); ``ignore`` (h, w), where it is
    not to be used. `TYPICAL` where the image holds no numbers.
    """
    circles = torch.tensor([[circle.x, circle.y, circle.radius]], dtype=torch.float64)
    blur = interpolation.PRE_BLUR_PX
    crops = crop.cut(image[None], circles[:, :2], crop.half_size(circle.radius, 4 * blur), ignore)
    reference = build_reference(Filtered.of(crops, blur), circles, INNER, blur)
    weights = reference.weights
    variance = (weights * znssd.centred(reference.values, weights).square()).sum()
    slope = (weights * reference.gradient.square().sum(1)).sum()
    found = float(slope / variance.clamp_min(1e-12))
    return min(found, FINEST) if math.isfinite(found) else TYPICAL


def sd_steady(
    increment: Array, radius: float, fine: float = TYPICAL, *, on_map: bool, lit: float = 0.0, leaked: float = 0.0
) -> Array:
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
    lit : float
        Share of the steps with light that changes unevenly over the ball; what it does to a map is in its share.
    leaked : float
        Share of the front's motion that steps are off by, by `edge_leakage`; a map knows what is behind the ball.
    """
    known = np.isfinite(increment)
    steps = np.where(known, increment, 0.0)
    aliased = ALIASED_PX2 / radius * np.sin(2 * np.pi * steps[:, :2])
    turned = TURNED_PX * fine**2 * np.minimum(np.abs(steps[:, [3, 2]]), GROWS_UP_TO)
    counted = max(known[:, 0].sum(), 1)
    squares = (aliased**2 + turned**2).sum(0) / counted
    light = 0.0 if on_map else lit
    fast = np.zeros(3) if on_map else (_of_fast_turns(steps, radius) ** 2).sum(0) / counted
    leak = np.zeros(3) if on_map else (_of_leak(steps, radius, leaked) ** 2).sum(0) / counted
    step = np.sqrt(squares + fast[:2] + leak[:2] + (LEFT_PX2 / radius) ** 2 + light * LIT_PX**2)
    local = (_aliased_about_z(steps, radius)[known[:, 0]] ** 2).sum() / counted
    about_z = np.sqrt(local + fast[2] + leak[2] + (LEFT_Z_PX2 / radius**2) ** 2 + light * (LIT_Z_PX / radius) ** 2)
    turn = ROTATION_PER_STEP / radius * step[::-1]
    return (SHARE_ON_MAP if on_map else 1.0) * np.concatenate((step, turn, [about_z]))


def _of_fast_turns(steps: Array, radius: float) -> Array:
    """Errors (n, 3) in x, y and about z, px and rad, of fast turns out of the image's plane; a map has none of them."""
    turn = np.hypot(steps[:, 2], steps[:, 3])
    beyond = np.clip(turn, GROWS_UP_TO, FAST_UP_TO) - GROWS_UP_TO
    along = FAST_PX3 / radius**2 * beyond
    # The front moves along x with a turn about y, and along y with one about x.
    share = np.abs(steps[:, [3, 2]]) / np.maximum(turn, GROWS_UP_TO)[:, None]
    step = along[:, None] * np.hypot(share, FAST_ACROSS * share[:, ::-1])
    return np.concatenate((step, FAST_ABOUT_Z / radius * along[:, None]), 1)


def _of_leak(steps: Array, radius: float, leaked: float) -> Array:
    """Errors (n, 3) in x, y and about z, px and rad, of what leaks in over the outline."""
    front = radius * np.abs(steps[:, [3, 2]])
    step = leaked * np.hypot(front, LEAKED_ACROSS * front[:, ::-1])
    about_z = leaked * LEAKED_ABOUT_Z / radius * np.hypot(front[:, :1], front[:, 1:])
    return np.concatenate((step, about_z), 1)


def _aliased_about_z(steps: Array, radius: float) -> Array:
    """Turn (n,), rad, that comes from what each place of the ball is off by for its own shift by the ``steps`` (n, 5).

    A ball that turns by w about z moves the places at the distance x from its axis by ``d + w x``. Of the errors
    ``sin 2 pi (d + w x)`` least squares take ``<x sin> / <x^2>`` for a turn, means over the ball: it grows with the
    turn, has the sign of ``cos 2 pi d``, and is gone once the limb moves by a pixel.
    """
    local = np.sin(2 * np.pi * (steps[:, :2, None] + steps[:, 4, None, None] * radius * ACROSS))
    turn = (SHARES * ACROSS * local).sum(-1) / (SHARES * ACROSS**2).sum()
    found: Array = ALIASED_Z_PX / radius * turn.mean(-1)
    return found
