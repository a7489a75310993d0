"""Texture map of the ball: cubic B-splines on the six faces of a cube around the ball, without a pole.

A direction belongs to the face through which the direction leaves the cube. On a face, ``t (5 - t^2) / 4`` of the two
tangents ``t`` are the coordinates: cells are about equally large, as with angles (C. Ronchi et al., J. Comput. Phys.
124 (1996) 93, doi:10.1006/jcph.1996.0047), and no arctangent is needed. Each face has its own coefficients up to its
border. The nodes along an edge lie on the grids of both faces, and have one value: a map that jumps at its seams would
draw images that jump as the ball turns.
"""

from __future__ import annotations

import functools
from dataclasses import dataclass

import numpy as np
import torch
from torch import Tensor

from torchsphere.imaging.interpolation import slope_weights, spline_weights

#: Largest number of cells along a face, which limits the memory (docs/constants.toml).
MAX_CELLS = 320

#: Width of a map of one face in coefficients, beyond its cells.
BORDER = 3

#: Number of cells along a face times their width, over the radius: cells at the middle of a face are a tenth narrower
#: than the nominal width, cells at the middle of its edges a tenth wider.
CELLS_PER_RADIUS = 1.78


@dataclass(frozen=True)
class Places:
    """Where directions (...,) meet the map."""

    corner: Tensor  # number (...) of the first of sixteen coefficients, which lie in four rows of four; int64
    offset: Tensor  # coordinates (2, ...) within the cell, along the rows and across the rows, 0 to 1
    by_direction: Tensor  # derivative (2, 3, ...) of both coordinates, in cells, by the direction
    cells: int  # cells along a side of a face

    def value(self, coefficients: Tensor) -> Tensor:
        """Values (...) of the map with the ``coefficients`` (m,), or (..., k) with ``coefficients`` (m, k)."""
        if coefficients.ndim == 1:
            return _weighted(self._sixteen(coefficients), *self._weights())
        along, across = self._weights()
        return torch.einsum("...vuk,...u,...v->...k", self._sixteen(coefficients), along, across)

    def value_and_gradient(self, coefficients: Tensor) -> tuple[Tensor, Tensor]:
        """`value`, and its derivative (3, ...) by the direction."""
        sixteen = self._sixteen(coefficients)
        along, across = self._weights()
        slope_along, slope_across = torch.stack(slope_weights(self.offset), -1).unbind(0)
        slopes = torch.stack((_weighted(sixteen, slope_along, across), _weighted(sixteen, along, slope_across)))
        return _weighted(sixteen, along, across), (slopes.unsqueeze(1) * self.by_direction).sum(0)

    def adjoint(self, values: Tensor, count: int) -> Tensor:
        """Sums (m,) of the ``values`` (...) over their ``count`` coefficients: the adjoint of `value`.

        Sums (m, k) of ``values`` (..., k).
        """
        along, across = self._weights()
        rest = values.shape[along.ndim - 1 :]
        shares = torch.einsum("...v,...u->...vu", across, along)
        spread = values.reshape(*shares.shape[:-2], 1, 1, *rest)
        shares = shares.reshape(*shares.shape, *(1 for _ in rest)) * spread
        return values.new_zeros(count, *rest).index_add_(0, self._numbers().flatten(), shares.reshape(-1, *rest))

    def _weights(self) -> tuple[Tensor, ...]:
        """Weights (..., 4) of the coefficients along and across the rows."""
        return torch.stack(spline_weights(self.offset), -1).unbind(0)

    def _numbers(self) -> Tensor:
        """Numbers (..., 4, 4) of the coefficients."""
        steps = torch.arange(4, device=self.corner.device)
        block = steps.unsqueeze(1) * (self.cells + BORDER) + steps
        return self.corner[..., None, None] + block

    def _sixteen(self, coefficients: Tensor) -> Tensor:
        return coefficients[self._numbers()]


def _weighted(sixteen: Tensor, along: Tensor, across: Tensor) -> Tensor:
    """Sum (...) of the ``sixteen`` (..., 4, 4) coefficients with weights (..., 4) along and across the rows."""
    return ((sixteen * along.unsqueeze(-2)).sum(-1) * across).sum(-1)


def places(directions: Tensor, cells: int) -> Places:
    """Places of the ``directions`` (3, ...), of any length.

    Faces 0 to 2 are normal to the positive half axes, faces 3 to 5 to the negative ones.
    """
    axis = directions.abs().argmax(0, keepdim=True)
    forwards, right, up = (directions.gather(0, (axis + k) % 3) for k in range(3))
    height = forwards.abs()
    tangents = torch.cat((right, up)) / height
    coordinates = (tangents * (5 - tangents.square()) / 4 + 1) * (cells / 2)
    cell = coordinates.detach().nan_to_num().floor().clamp(0, cells - 1)
    face = torch.where(forwards > 0, axis, axis + 3)[0]
    column, row = cell.long().unbind(0)
    corner = (face * (cells + BORDER) + row) * (cells + BORDER) + column
    # Derivatives by (forwards, right, up), then in the order of the axes.
    steep = (5 - 3 * tangents.square()) * (cells / 8)
    by_forwards = -steep * tangents / forwards
    by_right = torch.cat((steep[:1] / height, torch.zeros_like(height)))
    by_up = torch.cat((torch.zeros_like(height), steep[1:] / height))
    turned = torch.stack((by_forwards, by_right, by_up), 1)
    order = torch.stack([(k - axis[0]) % 3 for k in range(3)]).expand_as(turned)
    return Places(corner, coordinates - cell, turned.gather(1, order), cells)


def cells_per_face(radius: float, cell_px: float) -> int:
    """Cells along a side of a face, `MAX_CELLS` at most, that are ``cell_px`` wide where they face the camera."""
    return min(max(4, round(CELLS_PER_RADIUS * radius / cell_px)), MAX_CELLS)


def coefficient_count(cells: int) -> int:
    """Number of coefficients of a map with ``cells`` along a side of a face."""
    return 6 * (cells + BORDER) ** 2


@functools.lru_cache(maxsize=8)
def _seam_nodes(cells: int, device: torch.device) -> tuple[Tensor, Tensor, int]:
    """Numbers (k,) of the nodes that lie on the line of an edge of the cube, those of their places, and how many."""
    face, row, column = (part.ravel() for part in np.indices((6, cells + BORDER, cells + BORDER)))
    # On the cube, whose edges are 2 ``cells`` long; a face has its right and its up along the next two axes.
    right, up = 2 * (column - 1) - cells, 2 * (row - 1) - cells
    on_cube = np.stack((np.where(face < 3, cells, -cells), right, up), 1)
    on_axes = np.take_along_axis(on_cube, (np.arange(3) - face[:, None] % 3) % 3, 1)
    # Those beyond a corner as well: they lie on the line of the edge, and what it shows hangs on them.
    nodes = np.flatnonzero((np.abs(right) == cells) | (np.abs(up) == cells))
    places, of_place = np.unique(on_axes[nodes], axis=0, return_inverse=True)
    return torch.from_numpy(nodes).to(device), torch.from_numpy(of_place.reshape(-1)).to(device), len(places)


def joined_at_seams(values: Tensor, cells: int) -> Tensor:
    """The ``values`` (m, ...) at the nodes; at a node on an edge, the sum over all faces that share it."""
    nodes, of_place, count = _seam_nodes(cells, values.device)
    sums = values.new_zeros(count, *values.shape[1:]).index_add_(0, of_place, values[nodes])
    return values.index_copy(0, nodes, sums[of_place])


def faces_of_nodes(like: Tensor, cells: int) -> Tensor:
    """Number (m,) of the faces that share each node, in the type of ``like``."""
    return joined_at_seams(like.new_ones(coefficient_count(cells)), cells)
