"""The forward model: pose, texture map, light and still background -> grey levels, and their derivatives.

A pixel shows the ball over the share of its area that the disc covers, and the background over the rest. The ball's
part is the mean over the rays of `torchsphere.sphere_map.window`: the pixel's footprint on the curved surface, which a
correlation of two images does not model.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import torch
from kornia.geometry.liegroup import So3
from torch import Tensor

from torchsphere.kernels import sphere_projection
from torchsphere.sphere_map import projection
from torchsphere.sphere_map.cube_map import Stencil
from torchsphere.sphere_map.projection import Pose, Projection, TexturedBall, project
from torchsphere.sphere_map.window import Window

#: Depth of the surface, radii, below which a ray does not move over the texture: the ray follows the limb.
MIN_DEPTH = 0.1

#: Step of the difference quotient by the edge's blur, px.
BLUR_STEP_PX = 0.01


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
    rays = sphere_projection.changes(points, *values, projected.light, orientation, MIN_DEPTH, ball.radius)
    sums = sphere_projection.pixel_sums(rays, window.ray_pixels, len(window.pixels))
    ball_levels = sums[:, 0]
    contrast = ball_levels - window.background
    offsets = window.offsets_from(pose.centre)
    normals = offsets / offsets.norm(dim=-1, keepdim=True).clamp_min(1e-9)
    jacobian = share[:, None] * sums[:, 1:]
    jacobian[:, :2] += (share_slope * contrast)[:, None] * normals
    if by_ball:
        jacobian[:, 5] += share_slope * contrast
        blurred, _ = projection.coverage(window, pose.centre, ball.radius, ball.edge_blur + BLUR_STEP_PX)
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
    projected = project(window, pose, replace(ball, shading=projection.uniform_light()))
    values = projected.light * projected.stencil.value(ball.coefficients.to(projected.light))
    by_terms = window.sum_rays((values * projection.shading_basis(projected.points)).T)
    return (pose.gain * projected.coverage)[:, None] * by_terms


def move_pose(pose: Pose, step: Tensor, radius: float) -> Pose:
    """The pose after a ``step`` (5,) of (dx, dy, wx, wy, wz), px, rotations times the ``radius``."""
    step = step.double()
    rotation = So3.exp(step[None, 2:5] / radius).matrix()[0]
    return replace(pose, centre=pose.centre + step[:2], orientation=rotation @ pose.orientation)
