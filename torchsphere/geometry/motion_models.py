"""Motion models: displacement of a pixel of the ball in the image when the ball moves.

Frames and signs, stated once for the whole package
---------------------------------------------------
Image: ``x`` to the right, ``y`` down, px; the centre of the top-left pixel is (0, 0).
Camera frame: right-handed, ``x`` right, ``y`` down, ``z`` away from the camera. Rotations are rotation vectors in this
frame, rad. The pixel at ``(x, y)`` from the ball's centre shows the surface point ``P = (x, y, -s)`` with
``s = sqrt(R^2 - x^2 - y^2)``. ``+w_y`` moves the front of the ball to the left, ``+w_x`` moves it down, ``+w_z`` turns
the displayed image clockwise.

A model is a pure function ``displacement(q, points, geometry)`` of the increment ``q`` (k,), the points (p, 2) in px
from the ball's centre in the reference image, and the geometry. It returns the displacement (p, 2) in px, NaN where a
point turns out of sight. The modes are its derivative with respect to ``q``: by automatic differentiation, or in closed
form.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import torch
import torch.nn.functional as F  # noqa: N812  (torch's own custom)
from torch import Tensor

from torchsphere.geometry import perspective_motion
from torchsphere.geometry.camera import View, distorted, undistorted


class Geometry(NamedTuple):
    """Ball and view; a batch has one more axis in front."""

    radius: Tensor  # of the outline, under perspective of the true size at the centre's depth, a scalar, px
    view: View | None = None  # for the models that need a camera


Displacement = Callable[[Tensor, Tensor, Geometry], Tensor]


def depth(points: Tensor, radius: Tensor) -> Tensor:
    """Height ``s`` (..., p) of the surface above the plane of the outline, px; 0 beyond the outline."""
    return (radius**2 - points.square().sum(-1)).clamp_min(0.0).sqrt()


def translation(q: Tensor, points: Tensor, geometry: Geometry) -> Tensor:
    """Two translations (dx, dy): the standard correlation in the paper's comparison."""
    return q[:2].expand_as(points)


def published(q: Tensor, points: Tensor, geometry: Geometry) -> Tensor:
    """The five modes as printed in the paper's section 2.2, with amplitudes (dx, dy, wx, wy, wz).

    The printed modes 3 and 4 lack the factor ``sqrt(R^2 - y^2) / R`` of a rigid rotation; for comparison only.
    """
    x, y = points.unbind(-1)
    squared = geometry.radius**2
    # At the poles of a meridian, on the outline, the printed quotient is 0/0 and the mode 0.
    phi3 = (1 - x**2 / (squared - y**2).clamp_min(1e-6)).clamp_min(0.0).sqrt()
    phi4 = (1 - y**2 / (squared - x**2).clamp_min(1e-6)).clamp_min(0.0).sqrt()
    dx, dy, wx, wy, wz = q
    radius = geometry.radius
    return torch.stack((dx - radius * phi3 * wy - y * wz, dy + radius * phi4 * wx + x * wz), -1)


def rigid(q: Tensor, points: Tensor, geometry: Geometry) -> Tensor:
    """Linearised rigid rotation under orthographic projection: ``(dx - s wy - y wz, dy + s wx + x wz)``."""
    x, y = points.unbind(-1)
    s = depth(points, geometry.radius)
    dx, dy, wx, wy, wz = q
    return torch.stack((dx - s * wy - y * wz, dy + s * wx + x * wz), -1)


def rotation_matrix(vector: Tensor) -> Tensor:
    """Rotation matrix (3, 3) of a rotation vector (3,), rad, by Rodrigues' formula; differentiable at 0, too.

    `torch.linalg.matrix_exp` errs by 2e-10 near 0.05 rad.
    """
    x, y, z = vector
    none = torch.zeros_like(x)
    cross = torch.stack((none, -z, y, z, none, -x, -y, x, none)).reshape(3, 3)
    squared = vector.square().sum()
    is_small = squared < 1e-3
    angle = torch.where(is_small, torch.ones_like(squared), squared).sqrt()
    # Series where the quotients have no derivative: the next terms are below 1e-17.
    sine = torch.where(is_small, 1 - squared / 6 + squared**2 / 120 - squared**3 / 5040, angle.sin() / angle)
    quotient = 2 * ((angle / 2).sin() / angle) ** 2
    versine = torch.where(is_small, 1 / 2 - squared / 24 + squared**2 / 720 - squared**3 / 40320, quotient)
    return torch.eye(3, dtype=vector.dtype, device=vector.device) + sine * cross + versine * cross @ cross


def finite(q: Tensor, points: Tensor, geometry: Geometry) -> Tensor:
    """Exact rotation under orthographic projection; points that turn out of sight are NaN."""
    surface = torch.cat((points, -depth(points, geometry.radius)[:, None]), -1)
    turned = surface @ rotation_matrix(q[2:]).T
    moved = q[:2] + (turned - surface)[:, :2]
    return torch.where(turned[:, 2:] > 0, torch.nan, moved)


def pinhole6(q: Tensor, points: Tensor, geometry: Geometry) -> Tensor:
    """Exact rotation and exact perspective, motion along the optical axis included; NaN where out of sight.

    ``q`` is (dx, dy, wx, wy, wz, growth): step of the projected centre, px, rotation, rad, and relative change of the
    ball's size in the image, which divides the distance by ``1 + growth``.
    """
    centre, focal, distortion = _view(geometry)
    distance = focal / geometry.radius
    towards = undistorted(centre / focal, distortion)
    surface = perspective_motion.front(undistorted((centre + points) / focal, distortion), towards, distance)
    turned = surface @ rotation_matrix(q[2:5]).T
    moved = undistorted((centre + q[:2]) / focal, distortion)
    away = distance / (1 + q[5])
    depth = away + turned[:, 2]
    # From the projected centre: from the camera, the difference of large numbers would lose digits for a far ball.
    from_centre = (turned[:, :2] - moved * turned[:, 2:]) / depth[:, None]
    seen = focal * distorted(moved + from_centre, distortion)
    # A point is visible where its normal points towards the camera.
    hidden = (turned[:, :2] * (away * moved + turned[:, :2])).sum(-1) + turned[:, 2] * depth > 0
    return torch.where(hidden[:, None], torch.nan, seen - centre - points)


def _view(geometry: Geometry) -> View:
    if geometry.view is None:
        raise ValueError("the pinhole models need a camera: its focal length, or the ball's distance")
    return geometry.view


def pinhole(q: Tensor, points: Tensor, geometry: Geometry) -> Tensor:
    """`pinhole6` at a constant distance: ``q`` is (dx, dy, wx, wy, wz)."""
    return pinhole6(torch.cat((q, torch.zeros_like(q[:1]))), points, geometry)


MODELS: dict[str, Displacement] = {
    "translation": translation,
    "published": published,
    "rigid": rigid,
    "finite": finite,
    "pinhole": pinhole,
    "pinhole6": pinhole6,
}

#: Models that need a camera.
PERSPECTIVE = (pinhole, pinhole6)

#: Models with the exact rotation, and models of a rigid ball.
EXACT = (finite, *PERSPECTIVE)
RIGID_BALL = (rigid, *EXACT)

#: Models whose displacement and modes `torchsphere.geometry.rotation` has in closed form; those of `PERSPECTIVE` are in
#: `torchsphere.geometry.perspective_motion`.
CLOSED_FORM = (rigid, finite)


def degrees_of_freedom(model: Displacement) -> int:
    """Length of ``q`` of a model: 2 for `translation`, 6 for `pinhole6`, otherwise 5."""
    return 2 if model is translation else 6 if model is pinhole6 else 5


def turn(q: Tensor) -> Tensor:
    """Angle (n,) of the rotation in unknowns (n, k), rad."""
    return torch.linalg.vector_norm(q[:, 2:5], dim=-1)


def as_unknowns(increments: Tensor, model: Displacement) -> Tensor:
    """Increments (n, 5) as a model's unknowns (n, k), cut or padded with 0."""
    k = degrees_of_freedom(model)
    return F.pad(increments, (0, max(k - increments.shape[-1], 0)))[:, :k]


def taken(geometry: Geometry, rows: Tensor) -> Geometry:
    """The given rows (m,) of a batch's geometry."""
    view = geometry.view
    if view is not None:
        distortion = None if view.distortion is None else view.distortion[rows]
        view = View(view.centre[rows], view.focal[rows], distortion)
    return Geometry(geometry.radius[rows], view)


def _stacked(geometry: Geometry) -> tuple[int, int | None]:
    """The axis of the pairs in each field of a batch's geometry, for `torch.vmap`; None for one value for all."""
    radius = 0 if geometry.radius.ndim else None
    view = None
    if geometry.view is not None and geometry.view.focal.ndim:
        view = View(0, 0, None if geometry.view.distortion is None else 0)  # type: ignore[arg-type]
    return Geometry(radius, view)  # type: ignore[arg-type,return-value]


def displacement(model: Displacement, q: Tensor, points: Tensor, geometry: Geometry) -> Tensor:
    """Displacement (n, p, 2) in px of the points (n, p, 2) of n pairs under the increments ``q`` (n, k)."""
    if model in PERSPECTIVE:
        return perspective_motion.displacement(q, points, geometry.radius, _view(geometry))
    return torch.vmap(model, in_dims=(0, 0, _stacked(geometry)))(q, points, geometry)


def modes(model: Displacement, q: Tensor, points: Tensor, geometry: Geometry) -> Tensor:
    """Derivative (n, p, 2, k) of the displacement at ``q`` (n, k): px per px, and px per rad; 0 where out of sight."""
    if model in PERSPECTIVE:
        return perspective_motion.modes(q, points, geometry.radius, _view(geometry))
    derivative = torch.vmap(torch.func.jacfwd(model), in_dims=(0, 0, _stacked(geometry)))(q, points, geometry)
    return derivative.nan_to_num(0.0)
