"""How a ball with a texture map looks: pose, map, light and still background -> grey levels, and their derivatives.

The forward model of `torchsphere.bundle` and `torchsphere.register`. A pixel shows the ball over the share of its area
that the disc covers, and the background over the rest; what it sees of the ball is the mean over the rays of
`torchsphere.window`. That footprint on the curved surface is what a correlation of two images cannot know.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import torch
from kornia.geometry.liegroup import So3
from torch import Tensor

from torchsphere import texture
from torchsphere.texture import Stencil
from torchsphere.window import Window

#: Rays beyond this share of the radius are taken there: a pixel on the outline shows the limb.
LIMB = 0.998

#: Least blur of the optics that the edge is modelled with, px.
LEAST_BLUR_PX = 0.05

#: Width of the change from a ray that meets the ball to one that passes it, px.
TURN_PX = 0.1

#: Depth of the surface, in radii, below which the sensitivities take a ray for one on the limb.
DEEPEST = 0.1

#: Distance, in standard deviations, beyond which a Gaussian is nothing: 1e-15 of it is left.
REACH_OF_BLUR = 8.0

#: Functions of the shading, see `shading_basis`.
SHADES = 4


@dataclass(frozen=True)
class Pose:
    """Where the ball is in one image, and how bright.

    Attributes
    ----------
    centre : Tensor
        (2,), px, float64.
    orientation : Tensor
        (3, 3), from body to camera axes.
    gain, offset : float
        Brightness of this image against the others.
    """

    centre: Tensor
    orientation: Tensor
    gain: float = 1.0
    offset: float = 0.0


@dataclass(frozen=True)
class Ball:
    """What all images share.

    Attributes
    ----------
    radius : float
        Of the outline, px.
    edge_blur : float
        Standard deviation of the optics' blur at the outline, px; the pixel's own width comes on top.
    cells : int
        Cells along a face of the texture map.
    coefficients : Tensor
        Of the texture map, (m,), float64.
    shading : Tensor
        (4,) of `shading_basis`: light that stays in place while the ball turns.
    """

    radius: float
    edge_blur: float
    cells: int
    coefficients: Tensor
    shading: Tensor


def coverage(window: Window, centre: Tensor, radius: float, blur: float) -> tuple[Tensor, Tensor]:
    """Share (p,) of each pixel that the disc covers, and its derivative by the distance to the outline, 1/px.

    Exact for a straight edge through a square pixel, blurred by a Gaussian: the twofold integral of that Gaussian,
    taken at the four corners.
    """
    offset = window.around(centre)
    distance = offset.square().sum(-1).sqrt().clamp_min(1e-9)
    # A straight edge in place of the circle would make the disc larger by pi times the variance of blur and pixel.
    inwards = radius - (blur**2 + 1 / 12) / (2 * radius) - distance
    share, slope = (inwards > 0).to(inwards), torch.zeros_like(inwards)
    # Most pixels are further from the edge than half their diagonal and the Gaussian's reach.
    near = torch.nonzero(inwards.abs() < 0.75 + REACH_OF_BLUR * blur)[:, 0]
    # An edge along a row or column of pixels is the limit of a slightly tilted one.
    a, b = ((offset[near].abs() / distance[near, None]).clamp_min(0.03) / 2).unbind(-1)
    corners = ((a + b, 1), (a - b, -1), (b - a, -1), (-a - b, 1))
    each = [[sign * part for part in _integrals(inwards[near] + shift, blur)] for shift, sign in corners]
    share[near], slope[near] = (sum(parts) / (4 * a * b) for parts in zip(*each, strict=True))
    return share, slope


def _integrals(x: Tensor, blur: float) -> tuple[Tensor, Tensor]:
    """Twofold and single integral of a Gaussian's distribution function at ``x``."""
    z = x / blur
    below = 0.5 * torch.erfc(-z / math.sqrt(2))
    density = torch.exp(-0.5 * z.square()) / math.sqrt(2 * math.pi)
    return 0.5 * (x.square() + blur**2) * below + 0.5 * x * blur * density, x * below + blur * density


def met(window: Window, centre: Tensor, radius: float) -> tuple[Tensor, Tensor]:
    """Points (3, q) of the unit sphere that the rays meet, camera axes, and the rays' weights (q,) in their pixels.

    Rays that pass the ball have none. A ray's turn comes within `TURN_PX`, about its share of a pixel, so that nothing
    jumps when the ball moves.
    """
    across = window.rays_around(centre)
    squared = across.square().sum(0)
    met = window.part * (torch.special.ndtr((radius - squared.sqrt()) / TURN_PX) + 1e-9)
    # A ray beyond the limb is taken there.
    across = across * (LIMB * torch.rsqrt(squared.clamp_min((LIMB * radius) ** 2)))
    depth = (1 - across.square().sum(0)).sqrt()
    return torch.cat((across, -depth[None])), met / window.gather(met)[window.owner]


def shading_basis(normals: Tensor) -> Tensor:
    """One, and the normals' components: (3, q) -> (4, q).

    A matt ball under light from one side and from all around. Terms of second order would hold attached shadows too (R.
    Basri and D. Jacobs, IEEE Trans. Pattern Anal. Mach. Intell. 25 (2003) 218, doi:10.1109/TPAMI.2003.1177153), but
    recordings that turn the ball by less than a radian do not tell them from its texture.
    """
    return torch.cat((torch.ones_like(normals[:1]), normals))


def appearance(window: Window, pose: Pose, ball: Ball) -> Tensor:
    """Grey levels (p,) that the model gives the pixels."""
    return touched(window, pose, ball)[0]


def relit(levels: Tensor, before: Pose, after: Pose) -> Tensor:
    """`appearance` (p,) with another gain and offset."""
    return (levels - before.offset) * (after.gain / before.gain) + after.offset


def touched(window: Window, pose: Pose, ball: Ball) -> tuple[Tensor, Stencil, Tensor]:
    """`appearance` (p,), where each ray meets the map, and what a unit of the map there adds to its pixel (q,)."""
    points, part = met(window, pose.centre, ball.radius)
    look = texture.stencil(pose.orientation.T.to(points) @ points, ball.cells)
    light = part * (ball.shading.to(points) @ shading_basis(points))
    share, _ = coverage(window, pose.centre, ball.radius, ball.edge_blur)
    lit = window.gather(light * look.value(ball.coefficients.to(light)))
    levels = pose.gain * (share * lit + (1 - share) * window.behind) + pose.offset
    return levels, look, pose.gain * share[window.owner] * light


@dataclass(frozen=True)
class Linearised:
    """`appearance` with its derivatives.

    Attributes
    ----------
    levels : Tensor
        Grey levels (p,).
    slopes : Tensor
        Derivatives (p, 7) by dx, dy (px), by the rotations times the radius (px), by radius and edge blur.
    look : Stencil
        Where each ray meets the map.
    light : Tensor
        What a unit of the map there adds to the ray's pixel (q,).
    """

    levels: Tensor
    slopes: Tensor
    look: Stencil
    light: Tensor

    def relit(self, before: Pose, after: Pose) -> Linearised:
        """The same with another gain and offset."""
        change, levels = after.gain / before.gain, relit(self.levels, before, after)
        return replace(self, levels=levels, slopes=change * self.slopes, light=change * self.light)


def linearised(window: Window, pose: Pose, ball: Ball) -> Linearised:
    """The model at a pose, with its derivatives by all that an adjustment changes."""
    points, part = met(window, pose.centre, ball.radius)
    orientation = pose.orientation.to(points)
    look = texture.stencil(orientation.T @ points, ball.cells)
    value, gradient = look.value_and_gradient(ball.coefficients.to(points))
    light = part * (ball.shading.to(points) @ shading_basis(points))
    share, edge = coverage(window, pose.centre, ball.radius, ball.edge_blur)
    lit = window.gather(light * value)
    step = lit - window.behind
    away = window.around(pose.centre)
    outwards = away / away.norm(dim=-1, keepdim=True).clamp_min(1e-9)
    of_texture = _of_texture(points, orientation @ (gradient * (light / ball.radius)))
    slopes = step.new_zeros(len(step), 7)
    for unknown, change in enumerate(of_texture):
        slopes[:, unknown] = share * window.gather(change)
    slopes[:, :2] += (edge * step)[:, None] * outwards
    slopes[:, 5] += edge * step
    wider, _ = coverage(window, pose.centre, ball.radius, ball.edge_blur + 0.01)
    slopes[:, 6] = (wider - share) / 0.01 * step
    return Linearised(
        levels=pose.gain * (share * lit + (1 - share) * window.behind) + pose.offset,
        slopes=pose.gain * slopes,
        look=look,
        light=pose.gain * share[window.owner] * light,
    )


def lights(window: Window, pose: Pose, ball: Ball) -> Tensor:
    """Derivative (p, 4) of `appearance` by the shading."""
    points, part = met(window, pose.centre, ball.radius)
    look = texture.stencil(pose.orientation.T.to(points) @ points, ball.cells)
    level = look.value(ball.coefficients.to(points))
    share, _ = coverage(window, pose.centre, ball.radius, ball.edge_blur)
    return (pose.gain * share)[:, None] * window.gather((part * level * shading_basis(points)).T)


def _of_texture(points: Tensor, slope: Tensor) -> list[Tensor]:
    """Changes (q,) of the map's value along each ray by dx, dy, wx, wy, wz and the radius, px.

    ``points`` (3, q) of the unit sphere and ``slope`` (3, q) of the value there, per px, both in camera axes. What a
    pixel sees of the surface moves against the ball: by -(1, 0, -x / z) for dx, by -w x P for a rotation; and for a
    larger radius the surface comes nearer by R / s and shrinks with respect to the ball.
    """
    x, y, z = points.unbind(0)
    # Rays that were drawn back to the limb follow the ball, and so near to it depth is no linear function any more.
    sx, sy, sz = (slope * (-z > DEEPEST)).unbind(0)
    return [
        sz * x / z - sx,
        sz * y / z - sy,
        sy * z - sz * y,
        sz * x - sx * z,
        sx * y - sy * x,
        sz / z - (sx * x + sy * y + sz * z),
    ]


def moved(pose: Pose, step: Tensor, radius: float) -> Pose:
    """The pose after a step (5,) in px, rotations times the radius."""
    step = step.double()
    turn = So3.exp(step[None, 2:5] / radius).matrix()[0]
    return replace(pose, centre=pose.centre + step[:2], orientation=turn @ pose.orientation)
