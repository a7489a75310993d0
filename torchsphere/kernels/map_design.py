"""The map's part of the grey levels, its adjoint, and the normal equations of the poses, in compiled loops.

The functions are those of `torchsphere.sphere_map.forward_model` on the CPU; pixels without weight are left out.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from torchsphere.kernels.cube_map import add_sixteen, sum_sixteen, weights
from torchsphere.kernels.jit import ZERO, Floats, compiled

Array = NDArray[Any]


def map_levels(corner: Tensor, offset: Tensor, factor: Tensor, coefficients: Tensor, cells: int) -> Tensor:
    """The map's part (n, s, s) of the grey levels."""
    found = factor.new_zeros(factor.shape[:3])
    given: Any = corner.numpy(), offset.numpy(), factor.numpy(), coefficients.contiguous().numpy(), cells + 3
    _map_levels(*given, found.numpy())
    return found


def adjoint(corner: Tensor, offset: Tensor, factor: Tensor, values: Tensor, cells: int, count: int) -> Tensor:
    """Sums (m,) of the pixels' ``values`` (n, s, s) over the ``count`` coefficients."""
    found = factor.new_zeros(count)
    given: Any = corner.numpy(), offset.numpy(), factor.numpy(), values.contiguous().numpy(), cells + 3
    _adjoint(*given, found.numpy())
    return found


def adjoint_columns(corner: Tensor, offset: Tensor, factor: Tensor, values: Tensor, cells: int, count: int) -> Tensor:
    """Sums (n, m, k) of the columns of ``values`` (n, s * s, k), for each image."""
    found = factor.new_zeros(len(factor), count, values.shape[-1])
    given: Any = corner.numpy(), offset.numpy(), factor.numpy(), values.contiguous().numpy(), cells + 3
    _adjoint_columns(*given, found.numpy())
    return found


def normal(jacobian: Tensor, weights: Tensor, residual: Tensor) -> tuple[Tensor, Tensor]:
    """Normal matrices (n, k, k) and gradients (n, k), float64; ``jacobian`` (n, s * s, k), the rest (n, s, s)."""
    n, _, columns = jacobian.shape
    found = torch.zeros(n, columns, columns, dtype=torch.float64), torch.zeros(n, columns, dtype=torch.float64)
    given: Any = jacobian.numpy(), weights.contiguous().numpy(), residual.contiguous().numpy()
    _normal(*given, *(part.numpy() for part in found), np.zeros((columns + 1, columns), np.float32))
    return found


@compiled
def _normal(jacobian: Floats, pixel: Floats, residual: Floats, found: Array, right: Array, sums: Floats) -> None:
    n, _, columns = jacobian.shape
    side = pixel.shape[1]
    for i in range(n):
        for row in range(side):
            # Sums of a row of pixels in single precision, of rows in double precision.
            sums[:] = ZERO
            for column in range(side):
                if pixel[i, row, column] == ZERO:
                    continue
                given = jacobian[i, row * side + column]
                for a in range(columns):
                    part = pixel[i, row, column] * given[a]
                    line = sums[a]
                    for b in range(columns):
                        line[b] += part * given[b]
                part = pixel[i, row, column] * residual[i, row, column]
                line = sums[columns]
                for b in range(columns):
                    line[b] += part * given[b]
            for a in range(columns):
                right[i, a] += sums[columns, a]
                for b in range(columns):
                    found[i, a, b] += sums[a, b]


@compiled
def _map_levels(corner: Array, offset: Array, factor: Array, coefficients: Floats, width: int, found: Floats) -> None:
    n, side, _, rays = factor.shape
    step = np.uint64(width)
    for i in range(n):
        for row in range(side):
            for column in range(side):
                total = ZERO
                for k in range(rays):
                    share = factor[i, row, column, k]
                    if share == ZERO:
                        break
                    at = np.uint64(np.uint32(corner[i, row, column, k]))
                    of_u, of_v = weights(offset[i, row, column, k, 0]), weights(offset[i, row, column, k, 1])
                    total += share * sum_sixteen(coefficients, at, step, of_u, of_v)
                found[i, row, column] = total


@compiled
def _adjoint(corner: Array, offset: Array, factor: Array, values: Floats, width: int, found: Floats) -> None:
    n, side, _, rays = factor.shape
    step = np.uint64(width)
    for i in range(n):
        for row in range(side):
            for column in range(side):
                if values[i, row, column] == ZERO:
                    continue
                for k in range(rays):
                    share = factor[i, row, column, k]
                    if share == ZERO:
                        break
                    at = np.uint64(np.uint32(corner[i, row, column, k]))
                    of_u, of_v = weights(offset[i, row, column, k, 0]), weights(offset[i, row, column, k, 1])
                    add_sixteen(share * values[i, row, column], at, step, of_u, of_v, found)


@compiled
def _adjoint_columns(corner: Array, offset: Array, factor: Array, values: Floats, width: int, found: Floats) -> None:
    n, side, _, rays = factor.shape
    columns = values.shape[2]
    for i in range(n):
        for row in range(side):
            for column in range(side):
                for k in range(rays):
                    share = factor[i, row, column, k]
                    if share == ZERO:
                        break
                    of_u, of_v = weights(offset[i, row, column, k, 0]), weights(offset[i, row, column, k, 1])
                    first = corner[i, row, column, k]
                    given = values[i, row * side + column]
                    for down in range(4):
                        for along in range(4):
                            part = share * of_v[down] * of_u[along]
                            place = found[i, first + down * width + along]
                            for c in range(columns):
                                place[c] += part * given[c]
