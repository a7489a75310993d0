"""How a ball with a texture map looks: pose, map, light and still background -> grey levels, and their derivatives.

The forward model of `bundle_adjustment` and `registration`. A pixel shows the ball over the share of its area
that the disc covers, and the background over the rest; what it sees of the ball is the mean over the rays of
`torchsphere.sphere_map.window`. That footprint on the curved surface is what a correlation of two images cannot know.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import torch
from kornia.geometry.liegroup import So3
from torch import Tensor

from torchsphere.kernels import sphere_projection
from torchsphere.sphere_map import cube_map
from torchsphere.sphere_map.cube_map import Stencil
from torchsphere.sphere_map.projection import Ball, Pose, Sight, coverage, met, shading_basis, sight
from torchsphere.sphere_map.window import Window

#: Depth of the surface, in radii, below which the sensitivities take a ray for one on the limb.
DEEPEST = 0.1


def levels(window: Window, seen: Sight, pose: Pose, coefficients: Tensor) -> Tensor:
    """Grey levels (p,) that the model gives the pixels with the map's ``coefficients`` (m,)."""
    lit = window.gather(seen.light * seen.look.value(coefficients.to(seen.light)))
    return pose.gain * (seen.share * lit + (1 - seen.share) * window.behind) + pose.offset


def appearance(window: Window, pose: Pose, ball: Ball) -> Tensor:
    """Grey levels (p,) that the model gives the pixels."""
    return levels(window, sight(window, pose, ball), pose, ball.coefficients)


def relit(levels: Tensor, before: Pose, after: Pose) -> Tensor:
    """`appearance` (p,) with another gain and offset."""
    return (levels - before.offset) * (after.gain / before.gain) + after.offset


@dataclass(frozen=True)
class Linearised:
    """`appearance` with its derivatives.

    Attributes
    ----------
    levels : Tensor
        Grey levels (p,).
    slopes : Tensor
        Derivatives (p, 7) by dx, dy (px), by the rotations times the radius (px), by radius and edge blur; (p, 5) where
        the last two were not asked for.
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


def linearised(
    window: Window, pose: Pose, ball: Ball, seen: Sight | None = None, *, of_ball: bool = True
) -> Linearised:
    """The model at a pose, with its derivatives by all that an adjustment changes.

    ``seen`` is the `sight` at this pose, where that is known already: it is half of the work. Without ``of_ball`` the
    derivatives are those by the pose alone, which spares a tenth.
    """
    seen = seen or sight(window, pose, ball)
    points, share = seen.points, seen.share
    looked_up = seen.look.value_and_gradient(ball.coefficients.to(points))
    turn = pose.orientation.to(points)
    of_rays = sphere_projection.changes(points, *looked_up, seen.light, turn, DEEPEST, ball.radius)
    sums = sphere_projection.pixel_sums(of_rays, window.owner, len(window.pixels))
    lit = sums[:, 0]
    step = lit - window.behind
    away = window.around(pose.centre)
    outwards = away / away.norm(dim=-1, keepdim=True).clamp_min(1e-9)
    slopes = share[:, None] * sums[:, 1:]
    slopes[:, :2] += (seen.edge * step)[:, None] * outwards
    if of_ball:
        slopes[:, 5] += seen.edge * step
        wider, _ = coverage(window, pose.centre, ball.radius, ball.edge_blur + 0.01)
        slopes = torch.cat((slopes, ((wider - share) / 0.01 * step)[:, None]), 1)
    else:
        slopes = slopes[:, :5]
    return Linearised(
        levels=pose.gain * (share * lit + (1 - share) * window.behind) + pose.offset,
        slopes=pose.gain * slopes,
        look=seen.look,
        light=seen.onto_pixels(window, pose),
    )


def lights(window: Window, pose: Pose, ball: Ball) -> Tensor:
    """Derivative (p, 4) of `appearance` by the shading."""
    points, part = met(window, pose.centre, ball.radius)
    look = cube_map.stencil(pose.orientation.T.to(points) @ points, ball.cells)
    level = look.value(ball.coefficients.to(points))
    share, _ = coverage(window, pose.centre, ball.radius, ball.edge_blur)
    return (pose.gain * share)[:, None] * window.gather((part * level * shading_basis(points)).T)


def moved(pose: Pose, step: Tensor, radius: float) -> Pose:
    """The pose after a step (5,) in px, rotations times the radius."""
    step = step.double()
    turn = So3.exp(step[None, 2:5] / radius).matrix()[0]
    return replace(pose, centre=pose.centre + step[:2], orientation=turn @ pose.orientation)
