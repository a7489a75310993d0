"""The map's part of the grey levels, its adjoint, and the normal equations of the poses, in compiled loops.

The functions are those of `torchsphere.sphere_map.design` on the CPU.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from torchsphere.kernels.cube_map import weights
from torchsphere.kernels.jit import ZERO, Floats, arrays, compiled
from torchsphere.kernels.layout import Rays
from torchsphere.kernels.sixteen import LANES, add_multiple, add_sixteen, join_fours, sum_sixteen

Array = NDArray[Any]


def map_levels(rays: Rays, coefficients: Tensor, cells: int, pixels: int) -> Tensor:
    """The map's part (n, p) of the grey levels of the ``pixels``."""
    found = coefficients.new_zeros(len(rays.corner), pixels)
    _map_levels(Rays(*arrays(*rays)), *arrays(coefficients), cells + 3, found.numpy())
    return found


def adjoint(rays: Rays, values: Tensor, cells: int, count: int) -> Tensor:
    """Sums (m,) of the pixels' ``values`` (n, p) over the ``count`` coefficients."""
    found, fours = values.new_zeros(count), values.new_zeros(count, 4)
    _adjoint(Rays(*arrays(*rays)), *arrays(values), cells + 3, fours.numpy())
    join_fours(fours.numpy(), found.numpy())
    return found


def coupling(rays: Rays, values: Tensor, own: int, cells: int, count: int) -> Tensor:
    """Sums (m, n k + c) of columns of ``values`` (n, p, k + c): the ``own`` k of each image, and those of all."""
    n, pixels, columns = values.shape
    found, lanes = values.new_empty(count, n * own + columns - own), -(-columns // LANES) * LANES
    # Of one image, whose sums are near each other in memory, as their places among those of all are not.
    memory = values.new_zeros(pixels, lanes), values.new_zeros(count, lanes)
    _coupling(Rays(*arrays(*rays)), *arrays(values), own, cells + 3, *arrays(*memory), found.numpy())
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
def _map_levels(rays: Rays, coefficients: Floats, width: int, found: Floats) -> None:
    corner, offset, factor, pixel = rays
    n, count = factor.shape
    step = np.uint64(width)
    for i in range(n):
        for k in range(count):
            at = np.uint64(np.uint32(corner[i, k]))
            shown = np.uint64(np.uint32(pixel[i, k]))
            found[i, shown] += factor[i, k] * sum_sixteen(coefficients, at, step, offset[i, k, 0], offset[i, k, 1])


@compiled
def _adjoint(rays: Rays, values: Floats, width: int, fours: Floats) -> None:
    corner, offset, factor, pixel = rays
    n, count = factor.shape
    step = np.uint64(width)
    for i in range(n):
        for k in range(count):
            value = factor[i, k] * values[i, np.uint64(np.uint32(pixel[i, k]))]
            if value == ZERO:
                continue
            add_sixteen(value, np.uint64(np.uint32(corner[i, k])), step, offset[i, k, 0], offset[i, k, 1], fours)


@compiled
def _coupling(rays: Rays, values: Floats, own: int, width: int, padded: Floats, sums: Floats, found: Floats) -> None:
    n, pixels, columns = values.shape
    for i in range(n):
        for shown in range(pixels):
            for c in range(columns):
                padded[shown, c] = values[i, shown, c]
        _add_columns(rays, i, padded, width, sums)
        for place in range(len(found)):
            for c in range(own):
                found[place, i * own + c] = sums[place, c]
                sums[place, c] = ZERO
    # Those of all images have been summed up.
    for place in range(len(found)):
        for c in range(own, columns):
            found[place, (n - 1) * own + c] = sums[place, c]


@compiled
def _add_columns(rays: Rays, i: int, values: Floats, width: int, sums: Floats) -> None:
    """Add the columns of ``values`` (p, k) of image ``i`` to the ``sums`` (m, k), `LANES` of them at a time."""
    corner, offset, factor, pixel = rays
    columns = np.uint64(values.shape[1])
    for k in range(factor.shape[1]):
        if factor[i, k] == ZERO:
            continue
        of_u, of_v = weights(offset[i, k, 0]), weights(offset[i, k, 1])
        first, shown = np.uint64(np.uint32(corner[i, k])), np.uint64(np.uint32(pixel[i, k]))
        for c in range(0, values.shape[1], LANES):
            for down in range(4):
                for along in range(4):
                    share, place = factor[i, k] * of_v[down] * of_u[along], first + np.uint64(down * width + along)
                    add_multiple(share, values, shown * columns + np.uint64(c), sums, place * columns + np.uint64(c))
