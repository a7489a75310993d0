"""Map of the ball's texture: cubic B-splines on the six faces of a cube around it, without pole or seam.

A direction from the ball's centre belongs to the face that it leaves the cube through. Two angles are its place on the
face (the equiangular cube of C. Ronchi et al., J. Comput. Phys. 124 (1996) 93, doi:10.1006/jcph.1996.0047), so that all
cells are about as large. Each face carries its own coefficients up to its border: what a seam shows is measured from
both sides rather than imposed.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass

import torch
from torch import Tensor

from torchsphere.interpolate import Weights, slope_weights, spline_weights, sum_of_products

#: Cells along a face at most: memory and time go with the fourth power of what they resolve. A ball of 64 px has them.
MOST_CELLS = 100


@dataclass(frozen=True)
class Stencil:
    """Where directions meet the map, and how much each of the sixteen coefficients around has to say there.

    Each of the sixteen is looked up for all directions at once: measured a tenth of the time of one look-up with all
    their numbers.

    Attributes
    ----------
    corner : Tensor
        Number (q,) of the first of the sixteen; they lie in four rows of four.
    offset : tuple of Tensor
        Place (q,) in the cell along the rows, and across them, 0 to 1.
    x, y : tuple of Tensor
        Spline weights (q,) along the rows, and across them: four each.
    axes : tuple of Tensor
        Whether (q,) the face is across the x axis, and whether across the y axis; bool.
    parts : tuple of Tensor
        Components (q,) of the direction: along the face's axis, and along the two that follow it in turn.
    cells : int
        Cells along the side of a face.
    """

    corner: Tensor
    offset: tuple[Tensor, Tensor]
    x: Weights
    y: Weights
    axes: tuple[Tensor, Tensor]
    parts: tuple[Tensor, Tensor, Tensor]
    cells: int

    @property
    def _width(self) -> int:
        return self.cells + 3

    @property
    def index(self) -> Tensor:
        """Numbers of the coefficients (q, 16)."""
        return torch.stack([self.corner + k for k in self._offsets()], -1)

    @property
    def weight(self) -> Tensor:
        """Their weights (q, 16); the value is ``(coefficients[index] * weight).sum(-1)``."""
        return torch.stack([across * along for across in self.y for along in self.x], -1)

    def _offsets(self) -> list[int]:
        return [row * self._width + column for row in range(4) for column in range(4)]

    def value(self, coefficients: Tensor) -> Tensor:
        """Values (q,) of the map with the ``coefficients`` (m,)."""
        rows = [sum_of_products(row, self.x) for row in self._rows(coefficients)]
        return sum_of_products(rows, self.y)

    def value_and_gradient(self, coefficients: Tensor) -> tuple[Tensor, Tensor]:
        """`value`, and its derivative (3, q) by the direction."""
        along, across = (slope_weights(t) for t in self.offset)
        rows, slopes = [], []
        for row in self._rows(coefficients):
            rows.append(sum_of_products(row, self.x))
            slopes.append(sum_of_products(row, along))
        by_u, by_v = sum_of_products(slopes, self.y), sum_of_products(rows, across)
        return sum_of_products(rows, self.y), _chain(by_u, by_v, self)

    def _rows(self, coefficients: Tensor) -> Iterator[list[Tensor]]:
        for row in range(4):
            yield [coefficients[row * self._width + k :].index_select(0, self.corner) for k in range(4)]

    def add(self, values: Tensor) -> Tensor:
        """Sums (m,) of the ``values`` (q,) over the coefficients that they come from: `value` backwards."""
        total = values.new_zeros(size(self.cells))
        offsets = iter(self._offsets())
        for across in self.y:
            row = values * across
            for along in self.x:
                total[next(offsets) :].index_add_(0, self.corner, row * along)
        return total


def cells_for(radius: float, spacing_px: float) -> int:
    """Cells along the side of a face, so that a cell is ``spacing_px`` wide where the camera looks straight at it;
    `MOST_CELLS` at most.
    """
    return min(max(4, round(math.pi / 2 * radius / spacing_px)), MOST_CELLS)


def size(cells: int) -> int:
    """Number of coefficients of a map with ``cells`` along the side of a face."""
    return 6 * (cells + 3) ** 2


def stencil(directions: Tensor, cells: int) -> Stencil:
    """Where the ``directions`` (3, q), of any length, meet the map.

    Faces 0 to 2 are those of the positive, 3 to 5 those of the negative half axes.
    """
    axes, parts = _face(directions)
    forwards, right, up = parts
    height = forwards.abs()
    u, v = ((torch.atan2(part, height) * (4 / math.pi) + 1) * (0.5 * cells) for part in (right, up))
    column, row = (t.floor().clamp_(0, cells - 1) for t in (u, v))
    # In floating point, where these whole numbers are exact: a whole-number operation takes four times as long.
    face = torch.where(axes[0], 0.0, torch.where(axes[1], 1.0, 2.0)).to(u) + (1.5 - 1.5 * forwards.sign())
    corner = ((face * (cells + 3) + row) * (cells + 3) + column).long()
    x, y = u - column, v - row
    return Stencil(corner, (x, y), spline_weights(x), spline_weights(y), axes, parts, cells)


def roughness(coefficients: Tensor, cells: int) -> Tensor:
    """Second differences (m,) of the coefficients along both axes of every face."""
    faces = coefficients.reshape(6, cells + 3, cells + 3)
    return torch.cat([torch.diff(faces, n=2, dim=axis).flatten() for axis in (1, 2)])


def _face(directions: Tensor) -> tuple[tuple[Tensor, Tensor], tuple[Tensor, Tensor, Tensor]]:
    """`Stencil.axes` and `Stencil.parts` of directions (3, q)."""
    x, y, z = directions.unbind(0)
    along, across, inwards = directions.abs().unbind(0)
    by_x = along >= torch.maximum(across, inwards)
    by_y = ~by_x & (across >= inwards)

    def chosen(if_x: Tensor, if_y: Tensor, if_z: Tensor) -> Tensor:
        return torch.where(by_x, if_x, torch.where(by_y, if_y, if_z))

    return (by_x, by_y), (chosen(x, y, z), chosen(y, z, x), chosen(z, x, y))


def _chain(by_u: Tensor, by_v: Tensor, look: Stencil) -> Tensor:
    """Derivative by the direction (3, q) from the derivatives (q,) by the place on the face."""
    forwards, right, up = look.parts
    squared = forwards.square()
    rate = 2 * look.cells / math.pi
    of_right = rate * by_u / (right.square() + squared)
    of_up = rate * by_v / (up.square() + squared)
    of_forwards = -(of_right * right + of_up * up) * forwards.sign()
    height = forwards.abs()
    first, second, third = of_forwards, of_right * height, of_up * height
    by_x, by_y = look.axes
    # Along the face's axis and the two that follow it in turn, back to x, y and z.
    return torch.stack(
        (
            torch.where(by_x, first, torch.where(by_y, third, second)),
            torch.where(by_x, second, torch.where(by_y, first, third)),
            torch.where(by_x, third, torch.where(by_y, second, first)),
        )
    )
