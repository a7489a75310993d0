"""What the pixels around the ball see of it: which share is the ball, where rays meet the surface, and in what light.

All that the forward model (`torchsphere.sphere_map.forward_model`) needs of a pose, whatever the map of the ball.
"""

from __future__ import annotations

from dataclasses import dataclass

import torch
from torch import Tensor

from torchsphere.kernels import sphere_projection
from torchsphere.runtime import threads
from torchsphere.sphere_map import cube_map
from torchsphere.sphere_map.cube_map import Stencil
from torchsphere.sphere_map.window import Window

#: Rays beyond this share of the radius are taken there: a pixel on the outline shows the limb.
LIMB = 0.998

#: Least blur of the optics that the edge is modelled with, px.
LEAST_BLUR_PX = 0.05

#: Width of the change from a ray that meets the ball to one that passes it, px.
TURN_PX = 0.1

#: Distance, in standard deviations, beyond which a Gaussian is nothing: 1e-15 of it is left. Most pixels are further
#: from the edge than that and half their diagonal, px.
REACH_OF_BLUR, HALF_DIAGONAL_PX = 8.0, 0.75

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
    reach = HALF_DIAGONAL_PX + REACH_OF_BLUR * blur
    return sphere_projection.coverage(window.pixels, centre, radius, blur, reach, window.levels)


def met(window: Window, centre: Tensor, radius: float) -> tuple[Tensor, Tensor]:
    """Points (3, q) of the unit sphere that the rays meet, camera axes, and the rays' weights (q,) in their pixels.

    Rays that pass the ball have none. A ray's turn comes within `TURN_PX`, about its share of a pixel, so that nothing
    jumps when the ball moves.
    """
    count = len(window.pixels)
    return sphere_projection.met(window.rays, centre, window.part, window.owner, count, radius, LIMB, TURN_PX)


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
        return window.spread(pose.gain * self.share, self.light)


def sight(window: Window, pose: Pose, ball: Ball) -> Sight:
    """What the rays of a window meet."""
    points, part = met(window, pose.centre, ball.radius)
    look = cube_map.stencil(pose.orientation.T.to(points) @ points, ball.cells)
    light = sphere_projection.lit(points, part, ball.shading)
    return Sight(points, look, light, *coverage(window, pose.centre, ball.radius, ball.edge_blur))


def sights(windows: list[Window], poses: list[Pose], ball: Ball) -> list[Sight]:
    """What the rays of each window meet."""
    return list(threads.each(lambda window, pose: sight(window, pose, ball), windows, poses))
