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

from torchsphere.imaging.interpolation import spline_weights
from torchsphere.kernels import cube_map

#: Cells along a face at most: memory and time go with the fourth power of what they resolve. A ball of 64 px has them.
MOST_CELLS = 100


@dataclass(frozen=True)
class Stencil:
    """Where directions meet the map, and how much each of the sixteen coefficients around has to say there.

    Attributes
    ----------
    corner : Tensor
        Number (q,) of the first of the sixteen, int32; they lie in four rows of four.
    offset : Tensor
        Place (2, q) in the cell along the rows, and across them, 0 to 1.
    axis : Tensor
        Axis (q,) that the face is across: 0 to 2, int8.
    parts : Tensor
        Components (3, q) of the direction: along the face's axis, and along the two that follow it in turn.
    cells : int
        Cells along the side of a face.
    """

    corner: Tensor
    offset: Tensor
    axis: Tensor
    parts: Tensor
    cells: int

    @property
    def index(self) -> Tensor:
        """Numbers of the coefficients (q, 16)."""
        width = self.cells + 3
        return torch.stack([self.corner.long() + row * width + column for row in range(4) for column in range(4)], -1)

    @property
    def weight(self) -> Tensor:
        """Their weights (q, 16); the value is ``(coefficients[index] * weight).sum(-1)``."""
        x, y = (spline_weights(t) for t in self.offset)
        return torch.stack([across * along for across in y for along in x], -1)

    def value(self, coefficients: Tensor) -> Tensor:
        """Values (q,) of the map with the ``coefficients`` (m,)."""
        return cube_map.value(coefficients, self.cells, self.corner, self.offset)

    def value_and_gradient(self, coefficients: Tensor) -> tuple[Tensor, Tensor]:
        """`value`, and its derivative (3, q) by the direction."""
        return cube_map.value_and_gradient(coefficients, self.cells, self.corner, self.offset, self.axis, self.parts)

    def add(self, values: Tensor) -> Tensor:
        """Sums (m,) of the ``values`` (q,) over the coefficients that they come from: `value` backwards."""
        return cube_map.add(values, self.cells, self.corner, self.offset)


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
    return Stencil(*cube_map.place(directions, cells), cells)


def roughness(coefficients: Tensor, cells: int) -> Tensor:
    """Second differences (m,) of the coefficients along both axes of every face."""
    faces = coefficients.reshape(6, cells + 3, cells + 3)
    return torch.cat([torch.diff(faces, n=2, dim=axis).flatten() for axis in (1, 2)])
