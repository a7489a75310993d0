"""Closed forms of the models `pinhole` and `pinhole6` and their modes for a whole batch.

Measured at 1,200 points and 8 pairs: 1.4 ms instead of 5.6 for the displacement, 2.6 ms instead of 36 for the modes.
"""

from __future__ import annotations

from typing import NamedTuple

import torch
from torch import Tensor

from torchsphere.geometry import rotation
from torchsphere.geometry.camera import View, distorted, distortion_slope, undistorted


def displacement(q: Tensor, points: Tensor, radius: Tensor, view: View) -> Tensor:
    """Displacement (n, p, 2), px, of ``points`` (n, p, 2) by ``q`` (n, 5 or 6); NaN where a point is out of sight."""
    view = _of_each(view, len(q))
    seen = _seen(q, points, radius, view)
    image = seen.focal * distorted(seen.rays, _per_point(view.distortion))
    return torch.where(seen.hidden[..., None], torch.nan, image - (view.centre[:, None] + points))


def modes(q: Tensor, points: Tensor, radius: Tensor, view: View) -> Tensor:
    """Derivative (n, p, 2, k) of the displacement at ``q`` (n, k): px per px, and px per rad; 0 where out of sight.

    A ray ``u`` to the point ``P`` of a ball in the direction ``m`` is ``(a m + P_xy) / (a + P_z)`` at the distance
    ``a``. A small rotation ``v`` moves ``P`` by ``v x P``.
    """
    view = _of_each(view, len(q))
    seen = _seen(q, points, radius, view)
    away, depth = seen.away[..., None], seen.depth[..., None]
    x, y, z = seen.turned.unbind(-1)
    ux, uy = seen.rays.unbind(-1)
    none = torch.zeros_like(x)
    # Rows x, y; columns for rotations about x, y, z: those of v x P less u times its z.
    by_turn = torch.stack((-ux * y, z + ux * x, -y, -z - uy * y, uy * x, x), -1).unflatten(-1, (2, 3))
    by_turn = by_turn @ rotation.tangents(q[:, 2:5])[:, None] / depth[..., None]
    by_step = (away / depth)[..., None] * _slope_of_inverse(seen.towards, view.distortion) / seen.focal[..., None]
    columns = [by_step.expand(*none.shape, 2, 2), by_turn]
    if q.shape[-1] > 5:
        # The distance D / (1 + growth) falls by its square over D.
        by_growth = (seen.rays - seen.towards) / depth * away / (1 + q[:, 5, None, None])
        columns.append(by_growth[..., None])
    found = seen.focal[..., None] * torch.cat(columns, -1)
    if view.distortion is not None:
        found = distortion_slope(seen.rays, view.distortion[:, None]) @ found
    return torch.where(seen.hidden[..., None, None], 0.0, found)


class _Seen(NamedTuple):
    """Points of n balls after the motion; lengths in radii."""

    rays: Tensor  # (n, p, 2), tangents of their angles
    towards: Tensor  # the same of the centre (n, 1, 2)
    turned: Tensor  # from the centre (n, p, 3)
    away: Tensor  # distance of the centre's plane (n, 1)
    depth: Tensor  # that of the points (n, p)
    focal: Tensor  # (n, 1, 1), px
    hidden: Tensor  # (n, p), bool


def _seen(q: Tensor, points: Tensor, radius: Tensor, view: View) -> _Seen:
    focal, distortion = view.focal[:, None, None], _per_point(view.distortion)
    centre, distance = view.centre[:, None], (view.focal / radius)[:, None]  # (n, 1, 2), (n, 1)
    before = undistorted(centre / focal, distortion)
    surface = front(undistorted((centre + points) / focal, distortion), before, distance[..., None])
    turned = surface @ rotation.rotations(q[:, 2:5]).mT
    towards = undistorted((centre + q[:, None, :2]) / focal, distortion)
    away = distance / (1 + q[:, 5:]) if q.shape[-1] > 5 else distance
    depth = away + turned[..., 2]
    # From the projected centre: from the camera, the difference of large numbers would lose digits for a far ball.
    from_centre = (turned[..., :2] - towards * turned[..., 2:]) / depth[..., None]
    # A point is visible where its normal points towards the camera.
    facing = (turned[..., :2] * (away[..., None] * towards + turned[..., :2])).sum(-1) + turned[..., 2] * depth
    return _Seen(towards + from_centre, towards, turned, away, depth, focal, facing > 0)


def front(rays: Tensor, towards: Tensor, distance: Tensor) -> Tensor:
    """Points (..., p, 3) of the unit sphere on ``rays`` (..., p, 2), from its centre.

    A ray that misses the sphere gives a point of the limb. The centre lies along ``towards`` (..., 2), at a depth of
    ``distance`` radii.
    """
    ray = torch.cat((rays, torch.ones_like(rays[..., :1])), -1)
    ray = ray / ray.norm(dim=-1, keepdim=True)
    offset = distance * (rays - towards)
    offset = torch.cat((offset, torch.zeros_like(offset[..., :1])), -1)
    # From the centre to the nearest point of the ray, in a form that loses no digits for a far ball.
    across = offset - (offset * ray).sum(-1, keepdim=True) * ray
    squared = across.square().sum(-1, keepdim=True)
    across = across / squared.clamp_min(1.0).sqrt()
    return across - (1 - squared).clamp_min(0.0).sqrt() * ray


def _of_each(view: View, n: int) -> View:
    """The views of n balls, from those or from one for all."""
    distortion = None if view.distortion is None else view.distortion.expand(n, 3)
    return View(view.centre.expand(n, 2), view.focal.expand(n), distortion)


def _per_point(distortion: Tensor | None) -> Tensor | None:
    return None if distortion is None else distortion[:, None]


def _slope_of_inverse(rays: Tensor, distortion: Tensor | None) -> Tensor:
    """Derivative (n, p, 2, 2) of `undistorted` where it gives ``rays`` (n, p, 2)."""
    if distortion is None:
        return torch.eye(2, dtype=rays.dtype, device=rays.device)
    return torch.linalg.inv(distortion_slope(rays, distortion[:, None]))
