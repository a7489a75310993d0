"""What the pixels around the ball see of it: which share is the ball, where rays meet the surface, and in what light.

All that the forward model (`torchsphere.view`) needs of a pose, whatever the map of the ball.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import torch
from torch import Tensor

from torchsphere import parallel, texture
from torchsphere.texture import Stencil
from torchsphere.window import Window

#: Rays beyond this share of the radius are taken there: a pixel on the outline shows the limb.
LIMB = 0.998

#: Least blur of the optics that the edge is modelled with, px.
LEAST_BLUR_PX = 0.05

#: Width of the change from a ray that meets the ball to one that passes it, px.
TURN_PX = 0.1

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


@dataclass(frozen=True)
class Sight:
    """What the rays of a window meet, the ball being where it is: all of the model but map, gain and offset.

    Attributes
    ----------
    points : Tensor
        Of the unit sphere (3, q), camera axes.
    look : Stencil
        Where each ray meets the map.
    light : Tensor
        What a unit of the map there adds to what the ray's pixel sees of the ball (q,).
    share, edge : Tensor
        Share (p,) of each pixel that the disc covers, and its derivative by the distance to the outline, 1/px.
    """

    points: Tensor
    look: Stencil
    light: Tensor
    share: Tensor
    edge: Tensor

    def onto_pixels(self, window: Window, pose: Pose) -> Tensor:
        """What a unit of the map where a ray meets it adds to the grey level of its pixel (q,)."""
        return pose.gain * self.share[window.owner] * self.light


def sight(window: Window, pose: Pose, ball: Ball) -> Sight:
    """What the rays of a window meet."""
    points, part = met(window, pose.centre, ball.radius)
    look = texture.stencil(pose.orientation.T.to(points) @ points, ball.cells)
    light = part * (ball.shading.to(points) @ shading_basis(points))
    return Sight(points, look, light, *coverage(window, pose.centre, ball.radius, ball.edge_blur))


def sights(windows: list[Window], poses: list[Pose], ball: Ball) -> list[Sight]:
    """What the rays of each window meet."""
    return list(parallel.each(lambda window, pose: sight(window, pose, ball), windows, poses))
