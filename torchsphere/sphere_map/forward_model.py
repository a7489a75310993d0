"""The forward model: poses, texture map, light, outline and still background -> grey levels and their derivatives.

A pixel shows the ball over the share of its area that the disc covers, and the background over the rest. The map holds
the texture as a pixel in front of it sees it, blurred by the optics and by the pixel's own width. Further out the
surface is tilted away, and this footprint grows on it along the radius of the disc alone: the ball's part is the mean
over two rays, displaced along the radius, which have the variance of the footprint beyond that of the map, and over
more rays near the limb. The footprint on the curved surface is what a correlation of two images lacks.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import torch
from torch import Tensor

from torchsphere.kernels import forward_model as loops
from torchsphere.kernels import layout, map_design
from torchsphere.kernels.jit import suits
from torchsphere.sphere_map import cube_map
from torchsphere.sphere_map.ball import Poses, TexturedBall
from torchsphere.sphere_map.cube_map import Places
from torchsphere.sphere_map.design import Design
from torchsphere.sphere_map.rays import Rays, bent, coverage, rays_of, rule
from torchsphere.sphere_map.window import Windows

#: Least blur of the edge by the optics, px (docs/constants.toml).
MIN_BLUR_PX = 0.05

#: Columns of `Linearisation.jacobian`: the motion, what all images share, and the brightness of each image.
MOTION, SHARED = slice(layout.DX, layout.WZ + 1), slice(layout.BY_RADIUS, layout.BY_BLUR + 1)
BRIGHTNESS = slice(layout.BY_GAIN, layout.BY_OFFSET + 1)


@dataclass(frozen=True)
class Linearisation:
    """The model's grey levels in n images with their derivatives, p = s * s pixels each."""

    levels: Tensor  # grey levels (n, s, s)
    # Derivatives (n, p, 9) by dx, dy, rotations times the image's radius, radius and edge blur, px, and by gain and
    # offset.
    jacobian: Tensor

    def rows(self, start: int, stop: int) -> Linearisation:
        """Images ``start`` to ``stop - 1``."""
        return Linearisation(self.levels[start:stop], self.jacobian[start:stop])

    def normal(self, weights: Tensor, residual: Tensor) -> tuple[Tensor, Tensor]:
        """Normal matrices (n, 9, 9) and gradients (n, 9), float64, for ``weights`` and ``residual`` (n, s, s)."""
        if suits(self.jacobian, weights, residual):
            return map_design.normal(self.jacobian, weights, residual)
        weighted = self.jacobian * weights.flatten(1).unsqueeze(2)
        gradient = torch.bmm(weighted.mT, residual.flatten(1).unsqueeze(2))[..., 0]
        return torch.bmm(weighted.mT, self.jacobian).double(), gradient.double()

    @classmethod
    def joined(cls, parts: list[Linearisation]) -> Linearisation:
        """The images of all parts, one after the other."""
        if len(parts) == 1:
            return parts[0]
        return cls(torch.cat([part.levels for part in parts]), torch.cat([part.jacobian for part in parts]))


@dataclass(frozen=True)
class _Projection:
    """The ball projected into n images, without the map's values."""

    x: Tensor  # offsets of the pixels from the centre, px, by `Windows.offsets`
    y: Tensor
    rays: Rays
    points: Tensor  # points (3, n, s, s, k) of the rays on the unit sphere, in the axes of the view
    shrink: Tensor  # distance (n, s, s, k) of the points from the axis of the view over that of their rays
    height: Tensor  # height (n, s, s, k) of a point that a parallel ray at this distance would meet, radii
    steepness: Tensor  # change (n, s, s, k) of a point's angle from the axis by the distance of its ray, rad per radius
    nearness: Tensor  # radius over distance (n, 1, 1, 1) of the ball
    orientation: Tensor  # rotations (n, 3, 3) from body axes to those of the view
    source: Tensor  # terms (n, 4) of the light, in the axes of the view
    places: Places
    light: Tensor  # light (n, s, s, k) at the points
    share: Tensor  # share (n, s, s) of each pixel that the disc covers
    share_by_radius: Tensor
    share_by_blur: Tensor


class _Seen(NamedTuple):
    """Ball and light in the axes of the view."""

    orientation: Tensor  # rotations (n, 3, 3) from body axes
    light: Tensor  # terms (n, 4)
    nearness: Tensor  # radius over distance (n,); 0 in an orthographic view


def _seen(windows: Windows, poses: Poses, ball: TexturedBall) -> _Seen:
    light = ball.light.double().expand(len(poses), -1)
    if windows.optics is None:
        return _Seen(poses.orientation, light, torch.zeros_like(poses.gain))
    view = windows.optics.view(poses.centre)
    turned = (view.turn.mT @ light[:, 1:].unsqueeze(-1))[..., 0]
    nearness = view.nearness(poses.radii(ball.radius))
    return _Seen(view.along(poses.orientation), torch.cat((light[:, :1], turned), 1), nearness)


def _project(windows: Windows, poses: Poses, ball: TexturedBall) -> _Projection:
    x, y = windows.offsets(poses.centre)
    radius, blur = _column(poses.radii(ball.radius), x), ball.edge_blur.to(x)
    rays = rays_of(x, y, radius, ball)
    along = radius.unsqueeze(-1)
    seen = _seen(windows, poses, ball)
    near = seen.nearness.to(x).reshape(-1, 1, 1, 1)
    across, down = rays.scale * x.unsqueeze(-1) / along, rays.scale * y.unsqueeze(-1) / along
    squared = across.square() + down.square()
    # A ray that is tilted by the angle asin(k b) meets the ball nearer to the axis than a parallel one.
    height, upright = (1 - squared).sqrt(), (1 - near.square() * squared).sqrt()
    shrink = upright - near * height
    points = torch.stack((shrink * across, shrink * down, -(height * upright + near * squared)))
    steepness = 1 / height - near / upright
    orientation, source = seen.orientation.to(x), seen.light.to(x)
    turned = torch.einsum("nij,inabk->jnabk", orientation, points)
    light = source.T.reshape(4, -1, 1, 1, 1)
    lit = light[0] + (light[1:] * points).sum(0)
    places = cube_map.places(turned, ball.cells)
    outline = bent(coverage(x, y, radius, blur), ball.edge_bend)
    return _Projection(x, y, rays, points, shrink, height, steepness, near, orientation, source, places, lit, *outline)


def _column(values: Tensor, like: Tensor) -> Tensor:
    """Values (n,) of the images as (n, 1, 1), in the type of the grey levels."""
    return values.to(like).reshape(-1, 1, 1)


def inputs_of_loops(windows: Windows, poses: Poses, ball: TexturedBall) -> layout.Images:
    """The images, poses and ball for the loops."""
    brightness, seen = torch.stack((poses.gain, poses.offset), 1), _seen(windows, poses, ball)
    numbers = seen.light.new_empty(len(poses), layout.BALL_COLUMNS)
    numbers[:, layout.RADIUS], numbers[:, layout.BLUR] = poses.radii(ball.radius), ball.edge_blur
    numbers[:, layout.NEARNESS], numbers[:, layout.FOOTPRINT_BLUR] = seen.nearness, ball.footprint_blur
    numbers[:, layout.EDGE_BEND] = ball.edge_bend
    numbers[:, layout.EVEN_LIGHT : layout.LIGHT_Z + 1] = seen.light
    first, places = windows.origin - poses.centre, windows.levels.new_zeros(0, 0, 0, 2)
    if windows.optics is not None:
        places = torch.stack(windows.offsets(poses.centre), -1)
    return layout.Images(first, places, seen.orientation, brightness, windows.visibility, windows.background, numbers)


def design(windows: Windows, poses: Poses, ball: TexturedBall) -> Design:
    """The model at ``poses`` as a linear function of the map."""
    if suits(windows.levels):
        found, fixed = loops.design(ball.cells, rule(ball), inputs_of_loops(windows, poses, ball))
        return Design(*found, fixed, ball.cells)
    seen = _project(windows, poses, ball)
    gain, offset = _column(poses.gain, seen.share), _column(poses.offset, seen.share)
    factor = (gain * seen.share).unsqueeze(-1) * seen.light * seen.rays.weight
    fixed = gain * (1 - seen.share) * windows.background + offset
    corner, offset = seen.places.corner.int(), seen.places.offset.movedim(0, -1)
    pixel = torch.arange(fixed[0].numel(), dtype=torch.int32, device=fixed.device).repeat_interleave(factor.shape[-1])
    rays = corner.flatten(1), offset.flatten(1, 3), factor.flatten(1), pixel.expand(len(fixed), -1)
    return Design(*rays, fixed, ball.cells)


def linearise(windows: Windows, poses: Poses, ball: TexturedBall) -> Linearisation:
    """Linearise the model at ``poses``."""
    if suits(windows.levels, ball.coefficients):
        model = loops.Model(ball.coefficients, ball.cells, rule(ball))
        levels, jacobian = loops.linearise(model, inputs_of_loops(windows, poses, ball))
        return Linearisation(levels, _in_image(jacobian, windows, poses, ball))
    seen = _project(windows, poses, ball)
    radius = _column(poses.radii(ball.radius), seen.x).unsqueeze(-1)
    value, by_place = seen.places.value_and_gradient(ball.coefficients.to(seen.x))
    # In the axes of the view: of the lit texture, which turns with the ball, and of the light, which does not.
    slope = seen.light * torch.einsum("nij,jnabk->inabk", seen.orientation, by_place)
    turn = torch.linalg.cross(slope, seen.points, dim=0) / radius
    whole = slope + value * seen.source.T[1:].reshape(3, -1, 1, 1, 1)
    # Along the image: the third component of a point of the sphere follows from the first two.
    flat = (whole[:2] * seen.points[:2]).sum(0) * seen.nearness / seen.shrink.square()
    tilt = seen.steepness * (whole[2] + flat)
    tx, ty = (whole[:2] * seen.shrink + tilt * seen.points[:2]) / radius
    rays, lit = seen.rays, seen.light * value
    x, y = seen.x.unsqueeze(-1), seen.y.unsqueeze(-1)
    radial = tx * x + ty * y
    distance = (seen.x.square() + seen.y.square()).sqrt().clamp_min(1e-6)
    outwards = (rays.weight * rays.by_distance * radial + rays.weight_by_distance * lit) / distance.unsqueeze(-1)
    along = rays.weight * rays.scale
    # With its radius the ball's nearness grows: points move inwards by more than their share of the radius.
    inwards = rays.scale / (radius * seen.height * seen.steepness)
    by_radius = rays.weight * radial * (rays.by_radius - inwards) + rays.weight_by_radius * lit
    parts = (-along * tx - outwards * x, -along * ty - outwards * y, *(rays.weight * turn), by_radius)
    means = torch.stack(parts).sum(-1) * seen.share
    ball_levels = (rays.weight * lit).sum(-1)
    contrast = ball_levels - windows.background
    edge = seen.share_by_radius * contrast
    gain, offset = _column(poses.gain, value), _column(poses.offset, value)
    unit = seen.share * contrast + windows.background
    columns = (
        gain * (means[0] + edge * seen.x / distance),
        gain * (means[1] + edge * seen.y / distance),
        *(gain * means[2:5]),
        gain * (means[5] + edge),
        gain * seen.share_by_blur * contrast,
        unit,
        torch.ones_like(unit),
    )
    jacobian = torch.stack([c.flatten(1) for c in columns], -1)
    return Linearisation(gain * unit + offset, _in_image(jacobian, windows, poses, ball))


def _in_image(jacobian: Tensor, windows: Windows, poses: Poses, ball: TexturedBall) -> Tensor:
    """The ``jacobian`` (n, p, 9) by the motion in the image, from that by the motion in the view."""
    if windows.optics is None:
        return jacobian
    view, radii = windows.optics.view(poses.centre), poses.radii(ball.radius)
    jacobian[..., MOTION] = jacobian[..., MOTION] @ view.motion(radii).to(jacobian)
    jacobian[..., :2] += jacobian[..., SHARED][..., :1] * view.shrinking(radii).to(jacobian).unsqueeze(1)
    return jacobian
