"""The forward model: pose, texture map, light and still background -> grey levels, and their derivatives.

A pixel shows the ball over the share of its area that the disc covers, and the background over the rest. The ball's
part is the mean over the rays of `torchsphere.sphere_map.window`: the pixel's footprint on the curved surface, which a
correlation of two images does not model.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import torch
from kornia.geometry.liegroup import So3
from numpy.typing import NDArray
from torch import Tensor

from torchsphere.kernels import sphere_projection
from torchsphere.sphere_map import cube_map
from torchsphere.sphere_map.cube_map import Stencil
from torchsphere.sphere_map.window import Window

#: Distance from the centre, radii, to which all rays further out are drawn (docs/constants.md).
MAX_RAY_DISTANCE = 0.998

#: Least blur of the edge by the optics, px (docs/constants.md).
MIN_BLUR_PX = 0.05

#: Standard deviation of the transition between rays that meet the ball and rays that miss it, px (docs/constants.md).
RAY_TRANSITION_PX = 0.1

#: Standard deviations beyond which a Gaussian is zero (its tail is 1e-15), and bound of a pixel's half diagonal, px.
BLUR_CUTOFF_SD, HALF_DIAGONAL_PX = 8.0, 0.75

#: Number of functions in `shading_basis`.
SHADING_TERMS = 4

#: Depth of the surface, radii, below which a ray follows the limb (docs/constants.md).
MIN_DEPTH = 0.1

#: Step of the difference quotient by the edge's blur, px.
BLUR_STEP_PX = 0.01


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

    Rays that miss the ball have no weight. The weight changes over `RAY_TRANSITION_PX`: the model is continuous.
    """
    rays = window.rays, centre, window.ray_weights, window.ray_pixels, len(window.pixels)
    return sphere_projection.surface_points(*rays, radius, MAX_RAY_DISTANCE, RAY_TRANSITION_PX)


def shading_basis(normals: Tensor) -> Tensor:
    """A constant and the components of the ``normals``: (3, q) -> (4, q).

    This is a matt ball under light from one side and from all around. Terms of second order, for attached shadows
    (R. Basri and D. Jacobs, IEEE Trans. Pattern Anal. Mach. Intell. 25 (2003) 218, doi:10.1109/TPAMI.2003.1177153),
    cannot be separated from the texture where the ball turns by less than a radian.
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
        return window.to_rays(pose.gain * self.coverage, self.light)


def project(window: Window, pose: Pose, ball: TexturedBall) -> Projection:
    """Project the ball at ``pose`` into the ``window``."""
    points, weights = surface_points(window, pose.centre, ball.radius)
    stencil = cube_map.stencil(pose.orientation.T.to(points) @ points, ball.cells)
    light = sphere_projection.ray_light(points, weights, ball.shading)
    return Projection(points, stencil, light, *coverage(window, pose.centre, ball.radius, ball.edge_blur))


def grey_levels(window: Window, projected: Projection, pose: Pose, coefficients: Tensor) -> Tensor:
    """Grey levels (p,) of the model with the map's ``coefficients`` (m,)."""
    values = projected.stencil.value(coefficients.to(projected.light))
    return _blend(window, projected, pose, window.sum_rays(projected.light * values))


def _blend(window: Window, projected: Projection, pose: Pose, ball_levels: Tensor) -> Tensor:
    """Grey levels (p,) of ball and background together, under the image's gain and offset."""
    share = projected.coverage
    return pose.gain * (share * ball_levels + (1 - share) * window.background) + pose.offset


def predict(window: Window, pose: Pose, ball: TexturedBall) -> Tensor:
    """Grey levels (p,) of the model."""
    return grey_levels(window, project(window, pose, ball), pose, ball.coefficients)


@dataclass(frozen=True)
class Linearisation:
    """The model's grey levels with their derivatives."""

    levels: Tensor  # grey levels (p,)
    # Derivatives (p, 7) by dx, dy, rotations times radius, radius and edge blur, px; (p, 5) without the last two.
    jacobian: Tensor
    stencil: Stencil  # position of each ray on the map
    map_slopes: Tensor  # derivative (q,) of the grey level of each ray's pixel by the map's value at the ray

    def with_brightness(self, before: Pose, after: Pose) -> Linearisation:
        """The linearisation with the gain and offset of ``after`` in place of those of ``before``."""
        change = after.gain / before.gain
        levels = (self.levels - before.offset) * change + after.offset
        return replace(self, levels=levels, jacobian=change * self.jacobian, map_slopes=change * self.map_slopes)


def linearise(
    window: Window, pose: Pose, ball: TexturedBall, projected: Projection | None = None, *, by_ball: bool = True
) -> Linearisation:
    """Linearise the model at a pose.

    A known projection ``projected`` at this pose saves half of the time. Without ``by_ball`` the derivatives by radius
    and edge blur are left out, which saves a tenth.
    """
    projected = projected or project(window, pose, ball)
    points, share, share_slope = projected.points, projected.coverage, projected.coverage_slope
    values = projected.stencil.value_and_gradient(ball.coefficients.to(points))
    orientation = pose.orientation.to(points)
    rays = sphere_projection.pose_derivatives(points, *values, projected.light, orientation, MIN_DEPTH, ball.radius)
    sums = sphere_projection.pixel_sums(rays, window.ray_pixels, len(window.pixels))
    ball_levels = sums[:, 0]
    contrast = ball_levels - window.background
    offsets = window.offsets_from(pose.centre)
    normals = offsets / offsets.norm(dim=-1, keepdim=True).clamp_min(1e-9)
    jacobian = share[:, None] * sums[:, 1:]
    jacobian[:, :2] += (share_slope * contrast)[:, None] * normals
    if by_ball:
        jacobian[:, 5] += share_slope * contrast
        blurred, _ = coverage(window, pose.centre, ball.radius, ball.edge_blur + BLUR_STEP_PX)
        jacobian = torch.cat((jacobian, ((blurred - share) / BLUR_STEP_PX * contrast)[:, None]), 1)
    else:
        jacobian = jacobian[:, :5]
    return Linearisation(
        levels=_blend(window, projected, pose, ball_levels),
        jacobian=pose.gain * jacobian,
        stencil=projected.stencil,
        map_slopes=projected.map_slopes(window, pose),
    )


def shading_jacobian(window: Window, pose: Pose, ball: TexturedBall) -> Tensor:
    """Derivative (p, 4) of the grey levels by the shading."""
    projected = project(window, pose, replace(ball, shading=uniform_light()))
    values = projected.light * projected.stencil.value(ball.coefficients.to(projected.light))
    by_terms = window.sum_rays((values * shading_basis(projected.points)).T)
    return (pose.gain * projected.coverage)[:, None] * by_terms


def move_pose(pose: Pose, step: Tensor, radius: float) -> Pose:
    """The pose after a ``step`` (5,) of (dx, dy, wx, wy, wz), px, rotations times the ``radius``."""
    step = step.double()
    rotation = So3.exp(step[None, 2:5] / radius).matrix()[0]
    return replace(pose, centre=pose.centre + step[:2], orientation=rotation @ pose.orientation)
