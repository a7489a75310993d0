"""Projection of the ball into one image: pixel coverage, surface points of the rays, and the light there.

These quantities depend on pose, radius and light, and on no value of the texture map.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from torchsphere.kernels import sphere_projection
from torchsphere.sphere_map import cube_map
from torchsphere.sphere_map.cube_map import Stencil
from torchsphere.sphere_map.window import Window

#: Distance from the centre, radii, to which all rays further out are drawn: the outline's pixels show the limb.
MAX_RAY_DISTANCE = 0.998

#: Least blur of the edge by the optics, px.
MIN_BLUR_PX = 0.05

#: Standard deviation of the transition between rays that meet the ball and rays that miss it, px.
RAY_TRANSITION_PX = 0.1

#: Standard deviations beyond which a Gaussian is zero (its tail is 1e-15), and bound of a pixel's half diagonal, px.
BLUR_CUTOFF_SD, HALF_DIAGONAL_PX = 8.0, 0.75

#: Number of functions in `shading_basis`.
SHADING_TERMS = 4


@dataclass(frozen=True)
class Pose:
    """Pose and brightness of the ball in one image."""

    centre: Tensor  # (2,), px, float64
    orientation: Tensor  # rotation (3, 3) from body to camera axes
    gain: float = 1.0  # brightness of this image relative to the others, with ``offset`` in grey levels
    offset: float = 0.0


@dataclass(frozen=True)
class TexturedBall:
    """Properties of the ball that all images share."""

    radius: float  # radius of the outline, px
    edge_blur: float  # standard deviation of the optics' blur at the outline, px, without the width of a pixel
    cells: int  # cells along a face of the texture map
    coefficients: Tensor  # coefficients (m,) of the texture map, float64
    shading: Tensor  # coefficients (4,) of `shading_basis`: light that does not turn with the ball

    def with_map_change(self, indices: NDArray[np.int64], change: NDArray[np.float64]) -> TexturedBall:
        """The ball with ``change`` (k,) added to the coefficients at ``indices`` (k,)."""
        coefficients = self.coefficients.numpy().copy()
        coefficients[indices] += change
        return replace(self, coefficients=torch.from_numpy(coefficients))


def coverage(window: Window, centre: Tensor, radius: float, blur: float) -> tuple[Tensor, Tensor]:
    """Share (p,) of each pixel that the disc covers, and its derivative by a shift of the outline, 1/px.

    Exact for a straight edge through a square pixel with Gaussian ``blur``, px: the twofold integral of the Gaussian
    at the four corners.
    """
    reach = HALF_DIAGONAL_PX + BLUR_CUTOFF_SD * blur
    return sphere_projection.coverage(window.pixels, centre, radius, blur, reach, window.levels)


def surface_points(window: Window, centre: Tensor, radius: float) -> tuple[Tensor, Tensor]:
    """Points (3, q) of the rays on the unit sphere, camera axes, and the rays' weights (q,) in their pixels.

    Rays that miss the ball have no weight. The weight changes over `RAY_TRANSITION_PX`, about a ray's share of a
    pixel, so that the model is continuous in the pose.
    """
    rays = window.rays, centre, window.ray_weights, window.ray_pixels, len(window.pixels)
    return sphere_projection.met(*rays, radius, MAX_RAY_DISTANCE, RAY_TRANSITION_PX)


def shading_basis(normals: Tensor) -> Tensor:
    """A constant and the components of the ``normals``: (3, q) -> (4, q).

    The basis holds a matt ball under light from one side and from all around. Terms of second order would hold
    attached shadows, too (R. Basri and D. Jacobs, IEEE Trans. Pattern Anal. Mach. Intell. 25 (2003) 218,
    doi:10.1109/TPAMI.2003.1177153). Recordings that turn the ball by less than a radian cannot separate these terms
    from the texture.
    """
    return torch.cat((torch.ones_like(normals[:1]), normals))


def uniform_light() -> Tensor:
    """Shading (4,) of a light that is the same from all sides."""
    return torch.eye(SHADING_TERMS, dtype=torch.float64)[0]


@dataclass(frozen=True)
class Projection:
    """The forward model at one pose, without map values, gain and offset."""

    points: Tensor  # points (3, q) of the rays on the unit sphere, camera axes
    stencil: Stencil  # position of the points on the map
    light: Tensor  # light (q,) at each point times the ray's weight in its pixel
    coverage: Tensor  # share (p,) of each pixel that the disc covers
    coverage_slope: Tensor  # its derivative by a shift of the outline, 1/px

    def map_slopes(self, window: Window, pose: Pose) -> Tensor:
        """Derivative (q,) of the grey level of each ray's pixel by the map's value at the ray."""
        return window.spread(pose.gain * self.coverage, self.light)


def project(window: Window, pose: Pose, ball: TexturedBall) -> Projection:
    """Project the ball at ``pose`` into the ``window``."""
    points, weights = surface_points(window, pose.centre, ball.radius)
    stencil = cube_map.stencil(pose.orientation.T.to(points) @ points, ball.cells)
    light = sphere_projection.lit(points, weights, ball.shading)
    return Projection(points, stencil, light, *coverage(window, pose.centre, ball.radius, ball.edge_blur))
