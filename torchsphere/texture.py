"""Map of the ball's texture: cubic B-splines on the six faces of a cube around it, without pole or seam.

A direction from the ball's centre belongs to the face that it leaves the cube through. Two angles are its place on the
face (the equiangular cube of C. Ronchi et al., J. Comput. Phys. 124 (1996) 93, doi:10.1006/jcph.1996.0047), so that all
cells are about as large. Each face carries its own coefficients up to its border: what a seam shows is measured from
both sides rather than imposed.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import torch
from torch import Tensor

#: Cells along a face at most: memory and time go with the fourth power of what they resolve. A ball of 64 px has them.
MOST_CELLS = 100


@dataclass(frozen=True)
class Stencil:
    """Which coefficients make the map's value in given directions, and with what weights.

    Attributes
    ----------
    index : Tensor
        Numbers of the coefficients (..., 16).
    weight : Tensor
        Their weights (..., 16); the value is ``(coefficients[index] * weight).sum(-1)``.
    """

    index: Tensor
    weight: Tensor

    def value(self, coefficients: Tensor) -> Tensor:
        """Values (...) of the map with the ``coefficients`` (m,)."""
        return torch.linalg.vecdot(coefficients[self.index], self.weight)


def cells_for(radius: float, spacing_px: float) -> int:
    """Cells along the side of a face, so that a cell is ``spacing_px`` wide where the camera looks straight at it;
    `MOST_CELLS` at most.
    """
    return min(max(4, round(math.pi / 2 * radius / spacing_px)), MOST_CELLS)


def size(cells: int) -> int:
    """Number of coefficients of a map with ``cells`` along the side of a face."""
    return 6 * (cells + 3) ** 2


def stencil(directions: Tensor, cells: int) -> Stencil:
    """Coefficients and weights of the map's values in the ``directions`` (..., 3), of any length."""
    face, place, _ = _place(directions, cells)
    index, t = _corner(face, place, cells)
    x, y = _spline(t).unbind(-2)
    return Stencil(index, (y[..., :, None] * x[..., None, :]).flatten(-2))


def stencil_and_gradient(coefficients: Tensor, directions: Tensor, cells: int) -> tuple[Stencil, Tensor]:
    """The `stencil`, and the derivative (..., 3) of the map's value by the direction."""
    face, place, parts = _place(directions, cells)
    index, t = _corner(face, place, cells)
    x, y = _spline(t).unbind(-2)
    slope_x, slope_y = _spline_slope(t).unbind(-2)
    levels = coefficients[index].unflatten(-1, (4, 4))
    by_u = torch.linalg.vecdot(torch.linalg.vecdot(levels, slope_x[..., None, :]), y)
    by_v = torch.linalg.vecdot(torch.linalg.vecdot(levels, x[..., None, :]), slope_y)
    look = Stencil(index, (y[..., :, None] * x[..., None, :]).flatten(-2))
    return look, _chain(by_u, by_v, face, parts, cells)


def roughness(coefficients: Tensor, cells: int) -> Tensor:
    """Second differences (m,) of the coefficients along both axes of every face."""
    faces = coefficients.reshape(6, cells + 3, cells + 3)
    return torch.cat([torch.diff(faces, n=2, dim=axis).flatten() for axis in (1, 2)])


def _place(directions: Tensor, cells: int) -> tuple[Tensor, Tensor, tuple[Tensor, Tensor, Tensor]]:
    """Face (...), place on it (..., 2) in cells, and the three components (forwards, right, up) that gave them."""
    axis = directions.abs().argmax(-1)
    forwards, right, up = (directions.gather(-1, ((axis + i) % 3)[..., None])[..., 0] for i in range(3))
    face = axis + 3 * (forwards < 0)
    angles = torch.stack((torch.atan2(right, forwards.abs()), torch.atan2(up, forwards.abs())), -1)
    return face, (angles * (4 / math.pi) + 1) * (0.5 * cells), (forwards, right, up)


def _corner(face: Tensor, place: Tensor, cells: int) -> tuple[Tensor, Tensor]:
    """Numbers (..., 16) of the coefficients around a place, and the place's offset (..., 2) in its cell."""
    base = place.floor().clamp(0, cells - 1)
    column, row = base.long().unbind(-1)
    width = cells + 3
    steps = torch.arange(4, device=place.device)
    within = (steps[:, None] * width + steps).flatten()
    return ((face * width + row) * width + column)[..., None] + within, place - base


def _spline(t: Tensor) -> Tensor:
    """Weights (..., 4) of the cubic B-spline at the offset ``t`` (...)."""
    return torch.stack(((1 - t) ** 3, 4 + t**2 * (3 * t - 6), 1 + 3 * t * (1 + t * (1 - t)), t**3), -1) / 6


def _spline_slope(t: Tensor) -> Tensor:
    return torch.stack((-((1 - t) ** 2), t * (3 * t - 4), 1 + t * (2 - 3 * t), t**2), -1) / 2


def _chain(by_u: Tensor, by_v: Tensor, face: Tensor, parts: tuple[Tensor, Tensor, Tensor], cells: int) -> Tensor:
    """Derivative by the direction (..., 3) from the derivatives by the place on the face."""
    forwards, right, up = parts
    height = forwards.abs()
    rate = 2 * cells / math.pi
    of_right = rate * by_u / (right.square() + height.square())
    of_up = rate * by_v / (up.square() + height.square())
    of_forwards = -(of_right * right + of_up * up) * forwards.sign()
    by_parts = torch.stack((of_forwards, of_right * height, of_up * height), -1)
    # Component i of (forwards, right, up) is component (axis + i) mod 3 of the direction.
    back = (torch.arange(3, device=face.device) - (face % 3)[..., None]) % 3
    return by_parts.gather(-1, back)
