"""The rays of each pixel to the ball, and the share of the pixel that the disc covers, with their derivatives."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
import torch
from torch import Tensor

from torchsphere.kernels.rays import Rule
from torchsphere.sphere_map.ball import TexturedBall

#: Distance from the centre, radii, to which all rays further out are drawn (docs/constants.md).
MAX_RAY_DISTANCE = 0.9998

#: Half the width of a pixel, and share of it at which the two points of a Gauss rule lie.
HALF_PIXEL, GAUSS_POINT = 0.5, 1 / math.sqrt(3)

#: Number of points of the Gauss rule along the radius at the limb, of sharp and of blurred pixels (docs/constants.md).
LIMB_RULE_POINTS, BLURRED_RULE_POINTS = 5, 8

#: Longest arc of the surface in a pixel for that rule, px, and arc per point of the rule for longer arcs, px: these
#: pixels hold as much of the texture as they show (docs/constants.md).
LONG_ARC_PX, ARC_PER_POINT_PX = 5.0, 1.0

#: Distance from the centre, radii, and distance from the outline, px, from which a sharp pixel is at the limb: there
#: the surface is so steep that two rays are not enough (docs/constants.md).
LIMB_FROM, LEAST_LIMB_PX = 0.92, 1.5

#: Smallest component of an outline's normal, as the limit of an edge along the rows or columns of pixels.
LEAST_NORMAL = 0.03


def rim_points(radius: float) -> int:
    """Number of points for the longest arc in a pixel of a ball of that ``radius``, px: along its diagonal."""
    return math.ceil(math.sqrt(2 * math.sqrt(2) * radius) / ARC_PER_POINT_PX)


def rule(ball: TexturedBall) -> Rule:
    """Limits of the limb and Gauss rules of its pixels."""
    wider = math.sqrt(_width(ball.footprint_blur))
    at_limb = BLURRED_RULE_POINTS if ball.footprint_blur else LIMB_RULE_POINTS
    counts = at_limb, max(at_limb, math.ceil(wider * ball.rim_points))
    rules = np.zeros((2, 2, counts[1]), np.float32)
    for number, count in enumerate(counts):
        rules[:, number, :count] = np.polynomial.legendre.leggauss(count)
    limits = np.array((LIMB_FROM, LEAST_LIMB_PX, MAX_RAY_DISTANCE, LONG_ARC_PX * wider), np.float32)
    return Rule(limits, rules[0], rules[1], np.array(counts))


def _width(blur: float) -> float:
    """Width of a pixel with the ``blur``, px, over that of a sharp pixel."""
    return math.sqrt(1 + 12 * blur**2)


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
    """Rays of the pixels at ``x`` and ``y`` from the centre, px, which broadcast to (n, s, s), on that ``radius``.

    A blurred pixel is at the limb where the slope of the surface is as many times less as the pixel is wider.
    """
    distance = (x.square() + y.square()).sqrt().clamp_min(1e-6).unsqueeze(-1)
    given, blur = rule(ball), ball.footprint_blur
    wider = _width(blur)
    # Points and weights of both rules, (2, 2, k).
    rules = torch.from_numpy(np.stack((given.points, given.shares))).to(distance)
    inner = _inner_rays(distance, radius, wider, rules[0, 0])
    outer = _outer_rays(x, y, distance, radius, blur, rules, float(given.limits[3]))
    slope = LIMB_FROM / math.sqrt(1 - LIMB_FROM**2) / wider
    limb_from = slope / math.sqrt(1 + slope**2)
    is_inner = distance < torch.minimum(limb_from * radius, radius - LEAST_LIMB_PX * wider)
    at, by_distance, by_radius, *weights = (torch.where(is_inner, i, o) for i, o in zip(inner, outer, strict=True))
    limit = MAX_RAY_DISTANCE * radius
    drawn = at > limit
    at = torch.where(drawn, limit, at)
    by_distance = torch.where(drawn, 0.0, by_distance)
    by_radius = torch.where(drawn, MAX_RAY_DISTANCE, by_radius)
    scale = at / distance
    return Rays(scale, (by_distance - scale) / distance, by_radius / distance, *weights)


def _inner_rays(distance: Tensor, radius: Tensor, wider: float, like: Tensor) -> tuple[Tensor, ...]:
    """Distances (n, s, s, k) of two rays from the centre, their derivatives, and their weights with derivatives.

    Both hold the variance by which the footprint exceeds that in front: that of pixel and blur times ``(r / R)^2``.
    """
    sign = torch.zeros_like(like)
    sign[0], sign[1] = -HALF_PIXEL * GAUSS_POINT * wider, HALF_PIXEL * GAUSS_POINT * wider
    by_distance = 1 + sign / radius
    at, none = distance * by_distance, torch.zeros_like(distance * sign)
    return at, by_distance, -distance * sign / radius.square(), (sign != 0).to(at) / 2, none, none


def _outer_rays(
    x: Tensor, y: Tensor, distance: Tensor, radius: Tensor, blur: float, rules: Tensor, long_arc: float
) -> tuple[Tensor, ...]:
    """As `_inner_rays`, for pixels at the limb: a Gauss rule over the part of the pixel that the disc covers.

    Seen along the radius, a square pixel is a trapezium, whose height weighs the rays; the blur widens its foot and
    narrows its top. The rule's variable is the root of the distance from the outline, in which the surface is even. The
    derivatives are those of the mean itself: rays stay in their pixel while the ball moves, and the outline gives or
    takes what lies there.
    """
    normal = torch.stack((x.abs().expand(distance.shape[:-1]), y.abs().expand(distance.shape[:-1])), -1) / distance
    half, plateau = _trapezium(normal, blur)
    tilt = (distance / radius).clamp_max(1)
    half, plateau = tilt * half, tilt * plateau
    near, far = (distance - half).minimum(radius - 1e-3), distance + half
    deep, shallow = (radius - near).sqrt(), (radius - far).clamp_min(1e-12).sqrt()
    is_long = 2 * radius * (deep - shallow).square() > long_arc**2
    points, shares = (torch.where(is_long, long, short) for short, long in rules)
    root = shallow + (deep - shallow) * (1 + points) / 2
    at = radius - root.square()
    height = _height((at - distance).abs(), half, plateau)
    weight = shares * root * height
    # Part of the pixel per px at the outline: what a move of the outline adds to the part that the disc covers.
    edge = torch.where(far > radius, _height((radius - distance).abs(), half, plateau), 0.0)
    edge = edge / (weight * (deep - shallow)).sum(-1, keepdim=True).clamp_min(1e-6)
    weight = weight / weight.sum(-1, keepdim=True)
    # The first ray is the one nearest to the outline.
    first = (torch.arange(at.shape[-1], device=at.device) == 0).to(at)
    by_radius = edge * (first - weight)
    return at, torch.ones_like(at), torch.zeros_like(at), weight, -by_radius, by_radius


def _trapezium(normal: Tensor, blur: float) -> tuple[Tensor, Tensor]:
    """Half the widths (n, s, s, 1) at foot and top of a blurred pixel, seen along ``normal`` (n, s, s, 2).

    The variance is a sixth of the sum of their squares: a twelfth, and the square of the blur.
    """
    foot, top = normal.sum(-1, keepdim=True) / 2, (normal[..., :1] - normal[..., 1:]).abs() / 2
    narrow = foot - top
    beyond = ((narrow.square() + 12 * blur**2).sqrt() - narrow) / 2
    is_triangle = beyond > top
    triangle = math.sqrt(0.5 + 6 * blur**2)
    return torch.where(is_triangle, triangle, foot + beyond), torch.where(is_triangle, 0.0, top - beyond)


def _height(away: Tensor, half: Tensor, plateau: Tensor) -> Tensor:
    """Height of a pixel's trapezium ``away`` from its middle, as a share of that in the middle."""
    return ((half - away) / (half - plateau).clamp_min(1e-3)).clamp(1e-3, 1)


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
