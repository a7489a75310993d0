"""Texture map of the ball: cubic B-splines on the six faces of a cube around the ball, without pole or seam.

A direction belongs to the face through which the direction leaves the cube. Two angles are the coordinates there, so
that all cells are about equally large (C. Ronchi et al., J. Comput. Phys. 124 (1996) 93, doi:10.1006/jcph.1996.0047).
Each face has its own coefficients up to its border: at a seam, both faces are fitted to the images.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

from torch import Tensor

from torchsphere.kernels import cube_map

#: Largest number of cells along a face: memory and time grow with its fourth power (docs/constants.md).
MAX_CELLS = 100


@dataclass(frozen=True)
class Stencil:
    """The sixteen coefficients around each of q directions, and the coordinates between them."""

    corner: Tensor  # number (q,) of the first coefficient, int32; the sixteen lie in four rows of four
    offset: Tensor  # coordinates (2, q) within the cell, along the rows and across the rows, 0 to 1
    axis: Tensor  # axis (q,) normal to the face: 0 to 2, int8
    # Components (3, q) of the direction: along the face's axis, and along the two axes that follow in cyclic order.
    components: Tensor
    cells: int  # cells along a side of a face

    def value(self, coefficients: Tensor) -> Tensor:
        """Values (q,) of the map with the ``coefficients`` (m,)."""
        return cube_map.value(coefficients, self.cells, self.corner, self.offset)

    def value_and_gradient(self, coefficients: Tensor) -> tuple[Tensor, Tensor]:
        """`value`, and its derivative (3, q) by the direction."""
        place = self.corner, self.offset, self.axis, self.components
        return cube_map.value_and_gradient(coefficients, self.cells, *place)

    def adjoint(self, values: Tensor) -> Tensor:
        """Sums (m,) of the ``values`` (q,) over their coefficients: the adjoint of `value`."""
        return cube_map.add(values, self.cells, self.corner, self.offset)


def cells_per_face(radius: float, cell_px: float) -> int:
    """Cells along a side of a face, `MAX_CELLS` at most, that are ``cell_px`` wide where they face the camera."""
    return min(max(4, round(math.pi / 2 * radius / cell_px)), MAX_CELLS)


def coefficient_count(cells: int) -> int:
    """Number of coefficients of a map with ``cells`` along a side of a face."""
    return 6 * (cells + 3) ** 2


def stencil(directions: Tensor, cells: int) -> Stencil:
    """Stencil of the ``directions`` (3, q), of any length.

    Faces 0 to 2 are normal to the positive half axes, faces 3 to 5 to the negative ones.
    """
    return Stencil(*cube_map.place(directions, cells), cells)
