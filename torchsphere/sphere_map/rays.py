"""The rays of each pixel to the ball, and the share of the pixel that the disc covers, with their derivatives."""

from __future__ import annotations

import functools
import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import torch
from torch import Tensor

from torchsphere.kernels.jit import Floats
from torchsphere.kernels.rays import LEAST_HEIGHT, LEAST_SQUARE, MOST_SKEW, NO_TOP, REACH, Rule
from torchsphere.sphere_map.ball import TexturedBall

#: Distance from the centre, radii, to which all rays further out are drawn (docs/constants.toml).
MAX_RAY_DISTANCE = 0.9998

#: Number of points of the Gauss rule along the radius at the limb, of sharp and of blurred pixels
#: (docs/constants.toml).
LIMB_RULE_POINTS, BLURRED_RULE_POINTS = 5, 8

#: Longest arc of the surface in a sharp pixel for that rule, px, and arc per point of the rule for longer arcs, px:
#: these pixels hold as much of the texture as they show (docs/constants.toml).
LONG_ARC_PX, ARC_PER_POINT_PX = 5.0, 1.0

#: Distance from the centre, radii, and distance from the outline, px, from which a sharp pixel is at the limb: there
#: the surface is so steep that two rays are not enough (docs/constants.toml).
LIMB_FROM, LEAST_LIMB_PX = 0.92, 1.5

#: Width of the ramps from one rule to the next: before the limb, px, and before a long arc, as a share of it. A level
#: that jumps as the ball moves would let rounding decide where an adjustment ends (docs/constants.toml).
LIMB_RAMP_PX, ARC_RAMP = 1.0, 0.25

#: Smallest component of an outline's normal, as the limit of an edge along the rows or columns of pixels.
LEAST_NORMAL = 0.03


def rim_points(radius: float) -> int:
    """Number of points for the longest arc in a pixel of a ball of that ``radius``, px: along its diagonal."""
    return math.ceil(math.sqrt(2 * math.sqrt(2) * radius) / ARC_PER_POINT_PX)


def rule(ball: TexturedBall) -> Rule:
    """Limits of the limb and Gauss rules of its pixels."""
    at_limb, longest, long_arc = LIMB_RULE_POINTS, ball.rim_points, LONG_ARC_PX
    if ball.footprint_blur:
        sd = math.sqrt(footprint_variance(ball.footprint_blur))
        # The map holds nothing finer than the blur. The footprint reaches further than half the diagonal of a pixel.
        per_point, wider = max(ARC_PER_POINT_PX, sd), REACH * sd * math.sqrt(2)
        at_limb, long_arc = BLURRED_RULE_POINTS, BLURRED_RULE_POINTS * per_point
        longest = math.ceil(math.sqrt(wider) * ball.rim_points / per_point)
    counts = at_limb, max(at_limb, longest)
    points, shares = _gauss_rules(counts)
    limb = np.float32(LIMB_FROM), np.float32(LEAST_LIMB_PX), np.float32(LIMB_RAMP_PX)
    arcs = np.float32((1 - ARC_RAMP) * long_arc), np.float32(long_arc)
    return Rule(*limb, np.float32(MAX_RAY_DISTANCE), *arcs, points, shares, np.array(counts))


@functools.lru_cache(maxsize=8)
def _gauss_rules(counts: tuple[int, int]) -> tuple[Floats, Floats]:
    """Points (2, k) of both rules, and their weights."""
    rules = np.zeros((2, 2, counts[1]), np.float32)
    for number, count in enumerate(counts):
        rules[:, number, :count] = np.polynomial.legendre.leggauss(count)
    return rules[0], rules[1]


def footprint_variance(blur: float) -> float:
    """Variance of the footprint of a pixel with the ``blur``, px, along any line in the image, px^2."""
    return blur**2 + 1 / 12


@dataclass(frozen=True)
class Rays:
    """Rays of each pixel, and how they move; (n, s, s, k) each."""

    scale: Tensor  # distance of the ray from the centre over that of the pixel
    by_distance: Tensor  # derivative of ``scale`` by the pixel's distance from the centre, 1/px
    by_radius: Tensor  # derivative of ``scale`` by the radius, 1/px
    weight: Tensor  # weight of the ray in its pixel
    weight_by_distance: Tensor  # its derivatives, 1/px
    weight_by_radius: Tensor


def rays_of(x: Tensor, y: Tensor, radius: Tensor, ball: TexturedBall) -> Rays:
    """Rays of the pixels at ``x`` and ``y`` from the centre, px, which broadcast to (n, s, s) with the ``radius``.

    A blurred pixel is at the limb where the slope of the surface is as many times less as the pixel is wider.
    """
    distance, radius = (x.square() + y.square()).sqrt().clamp_min(1e-6).unsqueeze(-1), radius.unsqueeze(-1)
    given, blur = rule(ball), ball.footprint_blur
    part = _limb_part(x, y, distance, radius, blur)
    gauss = (
        [torch.from_numpy(of_rule[number, :count]).to(distance) for of_rule in (given.points, given.shares)]
        for number, count in enumerate(given.counts)
    )
    rules = _inner_rays(distance, radius, blur), *(_outer_rays(distance, radius, part, *points) for points in gauss)
    shares = _shares_of_rules(distance, radius, blur, part, given)
    of_pixel = [_shared(*both) for both in zip(rules, shares, strict=True)]
    at, by_distance, by_radius, *weights = (torch.cat(kind, -1) for kind in zip(*of_pixel, strict=True))
    limit = MAX_RAY_DISTANCE * radius
    drawn = at > limit
    at = torch.where(drawn, limit, at)
    by_distance = torch.where(drawn, 0.0, by_distance)
    by_radius = torch.where(drawn, MAX_RAY_DISTANCE, by_radius)
    scale = at / distance
    return Rays(scale, (by_distance - scale) / distance, by_radius / distance, *weights)


def _shares_of_rules(
    distance: Tensor, radius: Tensor, blur: float, part: _LimbPart, given: Rule
) -> tuple[Tensor, Tensor, Tensor]:
    """Shares (n, s, s, 1) of each pixel that its two rays and the rays of both Gauss rules have."""
    # As many times is the footprint wider than a sharp pixel.
    wider = math.sqrt(12 * footprint_variance(blur))
    slope = LIMB_FROM / math.sqrt(1 - LIMB_FROM**2) / wider
    limb = torch.minimum(slope / math.sqrt(1 + slope**2) * radius, radius - LEAST_LIMB_PX * wider)
    at_limb = (1 - (limb - distance) / (LIMB_RAMP_PX * wider)).clamp(0, 1)
    arc = (2 * radius).sqrt() * (part.deep - part.shallow)
    longer = ((arc - float(given.short_arc_px)) / float(given.long_arc_px - given.short_arc_px)).clamp(0, 1)
    return 1 - at_limb, at_limb * (1 - longer), at_limb * longer


def _shared(rays: tuple[Tensor, ...], share: Tensor) -> tuple[Tensor, ...]:
    """The ``rays`` of a rule with that ``share`` (n, s, s, 1) of their pixels, as if it stayed while the ball moves.

    What both rules draw there differs by less than what the map lacks.
    """
    at, by_distance, by_radius, *weights = torch.broadcast_tensors(*rays)
    return at, by_distance, by_radius, *(share * weight for weight in weights)


def _inner_rays(distance: Tensor, radius: Tensor, blur: float) -> tuple[Tensor, ...]:
    """Distances (n, s, s, 2) of two rays from the centre, their derivatives, and their weights with derivatives.

    Both hold the variance by which the footprint exceeds that in front, which the map has: ``(r / R)^2`` of the whole.
    On the curved surface the map's footprint has its mean further inwards than the pixel, by the share variance over
    ``R^2``: the rays are further out by as much.
    """
    variance = footprint_variance(blur)
    side = 2 * torch.arange(2, device=distance.device).to(distance) - 1
    sign, out = math.sqrt(variance) * side, 1 + variance / radius.square()
    nearer, none = 1 + sign / radius, torch.zeros_like(distance * sign)
    by_radius = (2 * (1 - out) * nearer - out * sign / radius) / radius
    at = distance * out * nearer
    return at, out * nearer, distance * by_radius, none + 0.5, none, none


class _LimbPart(NamedTuple):
    """The part of each pixel (n, s, s, 1) that the disc covers, along the radius."""

    variance: float  # of the footprint, px^2
    half: Tensor  # half the widths at the pixel's foot and at its top, px
    plateau: Tensor
    end: Tensor  # of the disc, px from the centre
    deep: Tensor  # roots of the distances of both ends from the outline
    shallow: Tensor


def _limb_part(x: Tensor, y: Tensor, distance: Tensor, radius: Tensor, blur: float) -> _LimbPart:
    variance = footprint_variance(blur)
    # Beside the radius through the pixel the outline is nearer to the centre: on the mean by this.
    end = radius - variance / (2 * radius)
    half, plateau = _footprint(x, y, distance, blur)
    near = (distance - half).minimum(end - 1e-3)
    return _LimbPart(variance, half, plateau, end, (end - near).sqrt(), (end - distance - half).clamp_min(1e-12).sqrt())


def _outer_rays(
    distance: Tensor, radius: Tensor, part: _LimbPart, points: Tensor, shares: Tensor
) -> tuple[Tensor, ...]:
    """As `_inner_rays`, for pixels at the limb: a Gauss rule over the ``part`` of the pixel that the disc covers.

    The rule's variable is the root of the distance from the outline, in which the surface is even; it has ``points``
    (k,) with ``shares`` (k,). The derivatives are those of the mean itself: rays stay in their pixel while the ball
    moves, and the outline gives or takes what lies there.
    """
    variance, half, plateau, end, deep, shallow = part
    root = shallow + (deep - shallow) * (1 + points) / 2
    height = _height((end - root.square() - distance).abs(), half, plateau)
    weight = shares * root * height
    # Part of the pixel per px at the outline: what a move of the outline adds to the part that the disc covers.
    edge = torch.where(distance + half > end, _height((end - distance).abs(), half, plateau), 0.0)
    edge = edge / (weight * (deep - shallow)).sum(-1, keepdim=True).clamp_min(1e-6)
    weight = weight / weight.sum(-1, keepdim=True)
    # The first ray is the one nearest to the outline.
    first = (torch.arange(root.shape[-1], device=root.device) == 0).to(root)
    by_radius = edge * (first - weight)
    mean = (weight * root).sum(-1, keepdim=True)
    of_mean = (weight / root).sum(-1, keepdim=True) + 2 * (by_radius * root).sum(-1, keepdim=True)
    off = root - mean
    moved, slope = _drawn_together(off, mean, weight, variance, radius)
    by_distance = moved * (slope / root + (1 - slope) * of_mean)
    out = radius / end
    at = out * (end - moved.square())
    return at, out * by_distance, 1 - by_distance, weight, -by_radius, by_radius


def _drawn_together(
    off: Tensor, mean: Tensor, weight: Tensor, variance: float, radius: Tensor
) -> tuple[Tensor, Tensor]:
    """Roots (n, s, s, k), so far ``off`` their ``mean``, drawn towards it; and the derivatives of the new by the old.

    The map holds the footprint in front already, with its ``variance`` in all directions. Rays and map together get
    the mean, variance and third moment that the footprint has along the arc: a root at the distance d from the mean
    moves to ``a d + b (d^2 - s^2)``, s^2 being the roots' variance. Without b, a texture that is blurred by 2 px of 35
    lies 0.1 px off where the surface is steep: the outer half of the footprint covers more of the arc than the inner.
    """
    spread = (weight * off.square()).sum(-1, keepdim=True).clamp_min(1e-6)
    third = (weight * off**3).sum(-1, keepdim=True)
    square_cosine = 1 - mean.square() / (2 * radius)  # of half the angle from the outline
    in_front = variance * square_cosine / (2 * radius)
    left = (1 - in_front / spread).clamp_min(LEAST_SQUARE)
    # The slope of the angle by the root grows by that share per unit: a wider spread has a more skewed angle.
    growth = mean / (2 * radius * square_cosine)
    wanted = third + 3 * growth * spread.square() * (1 - left.square())
    b = (wanted - left**1.5 * third) / (6 * left * spread.square())
    most = MOST_SKEW * (left / spread).sqrt()
    b = b.maximum(-most).minimum(most)
    skew = b * third / spread
    a = (left - 2 * b.square() * spread + skew.square()).sqrt() - skew
    # For the same reason the mean angle would move outwards.
    centre = mean * (1 + variance / (8 * radius.square()))
    return centre + a * off + b * (off.square() - spread), a + 2 * b * off


def _footprint(x: Tensor, y: Tensor, distance: Tensor, blur: float) -> tuple[Tensor, Tensor]:
    """Half the widths (n, s, s, 1) at foot and top of a pixel, seen along the radius; a blurred one has no top.

    A sharp pixel is a trapezium, a blurred one is normal.
    """
    if blur:
        half = torch.full_like(distance, REACH * math.sqrt(footprint_variance(blur)))
        return half, torch.full_like(half, NO_TOP)
    a, b = x.abs().unsqueeze(-1) / distance, y.abs().unsqueeze(-1) / distance
    return (a + b) / 2, (a - b).abs() / 2


def _height(away: Tensor, half: Tensor, plateau: Tensor) -> Tensor:
    """Height of a pixel's footprint ``away`` from its middle, as a share of that in the middle."""
    trapezium = (half - away) / (half - plateau).clamp_min(1e-3)
    normal = torch.exp(-0.5 * (REACH * away / half).square())
    return torch.where(plateau < 0, normal, trapezium).clamp(LEAST_HEIGHT, 1)


def coverage(x: Tensor, y: Tensor, radius: Tensor, blur: Tensor) -> tuple[Tensor, Tensor, Tensor]:
    """Share of each pixel that the disc covers, and its derivatives by the radius and by the ``blur``, 1/px.

    ``x`` and ``y`` from the centre broadcast. Exact for a straight edge through a square pixel with Gaussian ``blur``,
    px: the twofold integral of the Gaussian at the four corners.
    """
    distance = (x.square() + y.square()).sqrt().clamp_min(1e-6)
    # A straight edge in place of the circle enlarges the disc by pi times the variance of blur and pixel.
    bent = (blur.square() + 1 / 12) / (2 * radius)
    inwards = radius - bent - distance
    a, b = ((v.abs() / distance).clamp_min(LEAST_NORMAL) / 2 for v in (x, y))
    share, slope, spread = (torch.zeros_like(inwards) for _ in range(3))
    for corner, sign in ((a + b, 1.0), (a - b, -1.0), (b - a, -1.0), (-a - b, 1.0)):
        at = inwards + corner
        z = (at / blur).clamp(-30, 30)
        below = torch.special.ndtr(z)
        density = torch.exp(-0.5 * z.square()) * (blur / math.sqrt(2 * math.pi))
        share = share + sign * (0.5 * (at.square() + blur.square()) * below + 0.5 * at * density)
        slope = slope + sign * (at * below + density)
        spread = spread + sign * blur * below
    area = 4 * a * b
    by_distance = slope / area
    near = inwards.abs() < 1 + 8 * blur
    share = torch.where(near, share / area, (inwards > 0).to(distance))
    by_distance = torch.where(near, by_distance, 0.0)
    by_blur = torch.where(near, spread / area, 0.0) - by_distance * blur / radius
    return share, by_distance, by_blur


def bent(outline: tuple[Tensor, Tensor, Tensor], bend: Tensor | float) -> tuple[Tensor, Tensor, Tensor]:
    """The `coverage` as a camera shows it whose grey levels are not proportional to the light.

    A pixel that the disc covers by half has more than the mean of both levels where the tone curve brightens dark
    parts, as that of videos does. By the first two terms of such a curve a share s seems to be ``s + bend s (1 - s)``.
    """
    share, by_radius, by_blur = outline
    steeper = 1 + bend * (1 - 2 * share)
    return share + bend * share * (1 - share), steeper * by_radius, steeper * by_blur
