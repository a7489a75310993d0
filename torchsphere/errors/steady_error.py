"""The error that all steps of a flight have in common: no scatter shows this error, so that the tracker states it.

Two causes do not depend on noise. Texture finer than two pixels aliases, and the interpolation adds its own images: a
shift by d px errs by a multiple of ``sin(2 pi d)``. A ball that turns out of the image's plane shows its texture in
another view: the step errs along the motion of the front, the more the finer the texture. Both act on the weak
combination of step and rotation. Uneven light near a target and leakage over the outline (`edge_leakage`) add to this.
"""

from __future__ import annotations

import dataclasses
import math

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from torchsphere.correlation import znssd
from torchsphere.correlation.reference import Filtered, build_reference
from torchsphere.errors.evidence import Evidence
from torchsphere.geometry.circle import Circle
from torchsphere.imaging import crop, interpolation
from torchsphere.motion.findings import Findings
from torchsphere.motion.track import Track
from torchsphere.runtime.arrays import Array
from torchsphere.sphere_map.decision import MadeMap

#: Error of a step by d px over ``sin(2 pi d)``, times the radius, px^2 (docs/constants.toml).
ALIASED_PX2 = 0.0005 * 50.0

#: Error of a step per turn about the axis across it, px/rad, over the squared fineness (docs/constants.toml).
SLOW_TURN_PX = 0.0115 / math.radians(1.0)

#: Turn per frame, rad, up to which that error grows; `FAST_TURN_PX3` continues from there (docs/constants.toml).
SLOW_TURN_RAD = math.radians(1.0)

#: Error along the front's motion per turn out of the plane, times the squared radius, px^3/rad (docs/constants.toml).
FAST_TURN_PX3 = 0.0010 * 50.0**2 / math.radians(1.0)

#: Turn per frame, rad, up to which the error by fast turns grows (docs/constants.toml).
FAST_TURN_RAD = math.radians(8.0)

#: Errors by fast turns across that motion, and about z times the radius, as shares (docs/constants.toml).
FAST_ACROSS, FAST_ABOUT_Z = 0.3, 0.2

#: Error of a ball at rest, times the radius, px^2; and about z, times its square, rad px^2 (docs/constants.toml).
REST_PX2, REST_Z_PX2 = 0.00035 * 50.0, math.radians(0.37)

#: Error of the shift of each point of a ball that turns about z, over the sine of that shift, px (docs/constants.toml).
ALIASED_Z_PX = 0.00017

#: Errors by leakage across the motion of the front, and about z times the radius, as shares (docs/constants.toml).
LEAKAGE_ACROSS, LEAKAGE_ABOUT_Z = 0.3, 0.08

#: Error of a rotation about x or y times the radius, over that of the step along the other axis (docs/constants.toml).
ROTATION_PER_STEP = 1.2

#: Error of steps with uneven light, px, and px over the radius for a turn about z (docs/constants.toml).
UNEVEN_LIGHT_PX, UNEVEN_LIGHT_Z_PX = 0.0021, 0.0003

#: Error of a turn about x, y and z per turn and nearness: radius over distance (docs/constants.toml).
NEARER_FRONT = (0.7, 0.7, 0.1)

#: Error of a step on a map of the ball, px (docs/constants.toml).
ON_MAP_PX = 0.0002

#: Error of a step in images drawn from pixels that are not square, over their ratio of sides less 1, px
#: (docs/constants.toml).
STRETCHED_PX = 0.005

#: Error of a step of a ball that is darker in the image's corner, over the share by which it is, px
#: (docs/constants.toml).
FALLOFF_PX = 0.015

#: Error of a step where a tone curve bends the outline, over the bend, px (docs/constants.toml).
BENT_PX = 0.005

#: Positions across the ball, radii, and the share of the ball's area at each.
POSITIONS = (np.arange(32) + 0.5) / 16 - 1
AREA_SHARES = np.sqrt(1 - POSITIONS**2) / np.sqrt(1 - POSITIONS**2).sum()

#: Share of the radius within which the fineness is taken: the limb's texture is foreshortened (docs/constants.toml).
INNER = 0.8

#: Fineness of speckle of 4 px, and of noise, which no texture exceeds (docs/constants.toml).
TYPICAL_FINENESS, MAX_FINENESS = 0.41, 1.0


def texture_fineness(image: Tensor, circle: Circle, ignore: Tensor | None = None) -> float:
    """Mean square of the gradient over the variance of the pre-blurred ball, 1/px^2; `TYPICAL_FINENESS` if not finite.

    About ``5 / d^2`` to ``9 / d^2`` for sharp spots of d = 3 to 6 px. ``image`` and ``ignore`` (h, w).
    """
    circles = torch.tensor([[circle.x, circle.y, circle.radius]], dtype=torch.float64)
    blur = interpolation.PRE_BLUR_PX
    crops = crop.cut(image[None], circles[:, :2], crop.half_size(circle.radius, 4 * blur), ignore)
    reference = build_reference(Filtered.of(crops, blur), circles, INNER, blur)
    weights = reference.weights
    variance = (weights * znssd.centred(reference.values, weights).square()).sum()
    slope = (weights * reference.gradient.square().sum(1)).sum()
    found = float(slope / variance.clamp_min(1e-12))
    return min(found, MAX_FINENESS) if math.isfinite(found) else TYPICAL_FINENESS


def sd_steady(
    increment: Array,
    radius: float,
    fineness: float = TYPICAL_FINENESS,
    *,
    on_map: bool,
    uneven_light: float = 0.0,
    leakage: float = 0.0,
    sd_nearness: float = 0.0,
    stretch: float = 1.0,
    falloff: float = 0.0,
    bend: float = 0.0,
) -> Array:
    """Standard deviation (5,) of the error that all steps of a flight have in common, px and rad.

    ``increment`` (n, 5), px and rad, NaN where not measured; ``radius``, px; ``fineness`` by `texture_fineness`.
    ``uneven_light`` is the share of steps with uneven light, ``leakage`` a share of the front's motion. A map of the
    ball (``on_map``) holds footprints, outline and background, so that only uneven light counts there. ``sd_nearness``
    is the standard deviation of the ball's radius over the camera's distance: see `sd_of_apparent_turn`. ``stretch`` is
    the ratio of the sides of the pixels that the images were drawn from, and ``falloff`` the share by which the ball is
    darker in the image's corner; ``bend`` that of the outline by a tone curve.
    """
    light = uneven_light * np.array([UNEVEN_LIGHT_PX, UNEVEN_LIGHT_PX, UNEVEN_LIGHT_Z_PX / radius]) ** 2
    if on_map:
        squares = light + np.array([ON_MAP_PX, ON_MAP_PX, ON_MAP_PX / radius]) ** 2
    else:
        squares = light + _pair_squares(increment, radius, fineness, leakage)
    squares += math.hypot(STRETCHED_PX * (stretch - 1), FALLOFF_PX * falloff, BENT_PX * bend) ** 2 * np.array(
        [1.0, 1.0, 0.0]
    )
    step, about_z = np.sqrt(squares[:2]), np.sqrt(squares[2:])
    turn = np.concatenate((ROTATION_PER_STEP / radius * step[::-1], about_z))
    return np.concatenate((step, np.hypot(turn, sd_of_apparent_turn(increment, radius, sd_nearness))))


def sd_of_apparent_turn(increment: Array, radius: float, sd_nearness: float) -> Array:
    """Error (3,) of the turns, rad per frame, by a ball's nearness with that standard deviation.

    A ball that moves to the right by d px shows its left side as if it had turned by ``-nearness d / R`` about y. The
    front of a near ball is larger than its outline tells, and so seems to turn faster. Away from the middle of its path
    it is seen from the side, and its axis seems to be tilted.
    """
    known: NDArray[np.bool_] = np.asarray(np.isfinite(increment).all(1))
    steps = np.where(known[:, None], increment, 0.0)
    across = np.stack((steps[:, 1], -steps[:, 0], np.zeros(len(steps))), 1) / radius
    path = across.cumsum(0)
    tilted = np.cross(path - path.sum(0) / max(len(path), 1), steps[:, 2:])
    squares = (across + np.array(NEARER_FRONT) * steps[:, 2:]) ** 2 + tilted**2
    apparent: Array = sd_nearness * np.sqrt(squares.sum(0) / max(known.sum(), 1))
    return apparent


def _pair_squares(increment: Array, radius: float, fineness: float, leakage: float) -> Array:
    """Squared errors (3,) in x, y and about z, px and rad, of steps from frame to frame."""
    known = np.isfinite(increment)
    steps = np.where(known, increment, 0.0)
    counted = max(known[:, 0].sum(), 1)
    aliased = ALIASED_PX2 / radius * np.sin(2 * np.pi * steps[:, :2])
    turned = SLOW_TURN_PX * fineness**2 * np.minimum(np.abs(steps[:, [3, 2]]), SLOW_TURN_RAD)
    aliased_z = (_aliased_about_z(steps, radius)[known[:, 0]] ** 2).sum()
    slow = np.concatenate(((aliased**2 + turned**2).sum(0), [aliased_z]))
    fast = (_fast_turn_errors(steps, radius) ** 2).sum(0) + (_leakage_errors(steps, radius, leakage) ** 2).sum(0)
    at_rest = np.array([REST_PX2 / radius, REST_PX2 / radius, REST_Z_PX2 / radius**2]) ** 2
    return np.asarray((slow + fast) / counted + at_rest)


def _fast_turn_errors(steps: Array, radius: float) -> Array:
    """Errors (n, 3) in x, y and about z, px and rad, by fast turns out of the image's plane."""
    turn = np.hypot(steps[:, 2], steps[:, 3])
    beyond = np.clip(turn, SLOW_TURN_RAD, FAST_TURN_RAD) - SLOW_TURN_RAD
    along = FAST_TURN_PX3 / radius**2 * beyond
    # The front moves along x with a turn about y, and along y with one about x.
    share = np.abs(steps[:, [3, 2]]) / np.maximum(turn, SLOW_TURN_RAD)[:, None]
    step = along[:, None] * np.hypot(share, FAST_ACROSS * share[:, ::-1])
    return np.concatenate((step, FAST_ABOUT_Z / radius * along[:, None]), 1)


def _leakage_errors(steps: Array, radius: float, leakage: float) -> Array:
    """Errors (n, 3) in x, y and about z, px and rad, by background light that leaks over the outline."""
    front = radius * np.abs(steps[:, [3, 2]])
    step = leakage * np.hypot(front, LEAKAGE_ACROSS * front[:, ::-1])
    about_z = leakage * LEAKAGE_ABOUT_Z / radius * np.hypot(front[:, :1], front[:, 1:])
    return np.concatenate((step, about_z), 1)


def _aliased_about_z(steps: Array, radius: float) -> Array:
    """Turn (n,), rad, that least squares find in the aliasing of each point's own shift by the ``steps`` (n, 5).

    A turn by w about z moves the points at distance x from the axis by ``d + w x``. The errors ``sin 2 pi (d + w x)``
    pass for a turn by ``<x sin> / <x^2>``, means over the ball, which vanishes once the limb moves by a pixel.
    """
    local = np.sin(2 * np.pi * (steps[:, :2, None] + steps[:, 4, None, None] * radius * POSITIONS))
    turn = (AREA_SHARES * POSITIONS * local).sum(-1) / (AREA_SHARES * POSITIONS**2).sum()
    found: Array = ALIASED_Z_PX / radius * turn.mean(-1)
    return found


def detect(track: Track, evidence: Evidence) -> Findings:
    """How fine the texture is, which aliases."""
    return dataclasses.replace(
        track.findings, texture_fineness=texture_fineness(evidence.image, evidence.circle, evidence.ignore)
    )


def widen(track: Track, evidence: Evidence) -> Track:
    """The error that all steps have in common, by all that was found out so far."""
    known = track.findings
    made = known.map if isinstance(known.map, MadeMap) else MadeMap()
    return dataclasses.replace(
        track,
        sd_steady=sd_steady(
            track.increment,
            track.circle.radius,
            known.texture_fineness,
            on_map=known.is_on_map,
            uneven_light=known.uneven_light,
            falloff=made.falloff,
            bend=made.edge_bend,
            leakage=known.leaked,
            sd_nearness=known.sd_radius_over_distance,
            stretch=known.stretch,
        ),
    )
