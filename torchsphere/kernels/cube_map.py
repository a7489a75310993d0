"""Map of cubic B-splines on the faces of a cube: where directions meet the map, its values, and their adjoint.

The loops serve single and double precision: their constants are whole numbers, exact in both.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from torchsphere.kernels import spline
from torchsphere.kernels.jit import ONE, TWO, ZERO, compiled

Array = NDArray[Any]
Numbers = NDArray[np.int32]

_THREE, _FOUR, _SIX = (np.float32(value) for value in (3, 4, 6))


def place(directions: Tensor, cells: int) -> tuple[Tensor, Tensor, Tensor, Tensor]:
    """Cell and face that ``directions`` (3, q) meet, on faces of ``cells`` by ``cells``: see `cube_map.Stencil`.

    Number of the first of sixteen coefficients (q,), int32; place in the cell (2, q); axis across the face (q,), int8;
    components (3, q) along that axis and the next two in turn.
    """
    count = directions.shape[1]
    axis, parts = torch.empty(count, dtype=torch.int8), torch.empty_like(directions)
    offset, corner = directions.new_empty(2, count), torch.empty(count, dtype=torch.int32)
    given: Any = *directions.contiguous().numpy(), axis.numpy(), *parts.numpy(), *offset.numpy()
    _faces(*given)
    scale = directions.new_tensor(4 / math.pi).numpy()[()]
    x, y = offset.atan_().numpy()
    _cells(cells, scale, axis.numpy(), parts[0].numpy(), x, y, corner.numpy())
    return corner, offset, axis, parts


def value(coefficients: Tensor, cells: int, corner: Tensor, offset: Tensor) -> Tensor:
    """Values (q,) of the map with the ``coefficients`` (m,)."""
    found = torch.empty_like(offset[0])
    x, y = offset.numpy()
    _value(coefficients.contiguous().numpy(), cells + 3, corner.numpy(), x, y, found.numpy())
    return found


def value_and_gradient(
    coefficients: Tensor, cells: int, corner: Tensor, offset: Tensor, axis: Tensor, parts: Tensor
) -> tuple[Tensor, Tensor]:
    """`value`, and its derivative (3, q) with respect to the direction."""
    found, gradient = torch.empty_like(offset[0]), torch.empty_like(parts)
    (x, y), (gx, gy, gz) = offset.numpy(), gradient.numpy()
    _value_and_slopes(coefficients.contiguous().numpy(), cells + 3, corner.numpy(), x, y, found.numpy(), gx, gy)
    rate = parts.new_tensor(2 * cells / math.pi).numpy()[()]
    forwards, right, up = parts.numpy()
    _chain(rate, axis.numpy(), forwards, right, up, gx, gy, gz)
    return found, gradient


def add(values: Tensor, cells: int, corner: Tensor, offset: Tensor) -> Tensor:
    """Sums (m,) of the ``values`` (q,) over their coefficients: the adjoint of `value`."""
    total = values.new_zeros(6 * (cells + 3) ** 2)
    x, y = offset.numpy()
    _add(values.contiguous().numpy(), cells + 3, corner.numpy(), x, y, total.numpy())
    return total


@compiled
def _faces(
    x: Array, y: Array, z: Array, axis: Array, forwards: Array, right: Array, up: Array, of_right: Array, of_up: Array
) -> None:
    """Axes, components, and the tangents of the two angles on the face."""
    for i in range(len(x)):
        along, across, inwards = abs(x[i]), abs(y[i]), abs(z[i])
        by_x = along >= across and along >= inwards
        by_y = not by_x and across >= inwards
        axis[i] = np.int8(0) if by_x else np.int8(1) if by_y else np.int8(2)
        ahead = x[i] if by_x else y[i] if by_y else z[i]
        first = y[i] if by_x else z[i] if by_y else x[i]
        second = z[i] if by_x else x[i] if by_y else y[i]
        forwards[i], right[i], up[i] = ahead, first, second
        of_right[i], of_up[i] = first / abs(ahead), second / abs(ahead)


@compiled
def _cells(cells: int, scale: Any, axis: Array, forwards: Array, x: Array, y: Array, corner: Numbers) -> None:
    """Numbers of the cells; the angles ``x`` and ``y`` (q,) become places in the cells."""
    half, last, width = np.float32(cells) / TWO, np.float32(cells - 1), np.int32(cells + 3)
    for i in range(len(x)):
        u, v = (x[i] * scale + ONE) * half, (y[i] * scale + ONE) * half
        # NaN goes to the first cell.
        column, row = np.floor(u), np.floor(v)
        column, row = column if column > ZERO else ZERO, row if row > ZERO else ZERO
        column, row = column if column < last else last, row if row < last else last
        face = np.int32(axis[i]) + (np.int32(0) if forwards[i] > ZERO else np.int32(3))
        corner[i] = (face * width + np.int32(row)) * width + np.int32(column)
        x[i], y[i] = u - column, v - row


@compiled
def weights(t: Any) -> tuple[Any, ...]:
    """`interpolation.spline_weights` of the B-spline."""
    squared, rest = t * t, ONE - t
    first, last = rest * rest * rest / _SIX, squared * t / _SIX
    second = (_FOUR - _SIX * squared + _THREE * squared * t) / _SIX
    return first, second, ONE - first - second - last, last


@compiled
def slopes(t: Any) -> tuple[Any, ...]:
    """`interpolation.slope_weights` of the B-spline."""
    rest = ONE - t
    first, last = -rest * rest / TWO, t * t / TWO
    second = _THREE * last - TWO * t
    return first, second, -first - second - last, last


@compiled
def _value(levels: Array, width: int, corner: Numbers, x: Array, y: Array, found: Array) -> None:
    step = np.uint64(width)
    for i in range(len(x)):
        found[i] = spline.around(levels, np.uint64(np.uint32(corner[i])), step, weights(x[i]), weights(y[i]))


@compiled
def _value_and_slopes(
    levels: Array, width: int, corner: Numbers, x: Array, y: Array, found: Array, by_x: Array, by_y: Array
) -> None:
    step = np.uint64(width)
    for i in range(len(x)):
        at, of_x, of_y = np.uint64(np.uint32(corner[i])), weights(x[i]), weights(y[i])
        found[i] = spline.around(levels, at, step, of_x, of_y)
        by_x[i] = spline.around(levels, at, step, slopes(x[i]), of_y)
        by_y[i] = spline.around(levels, at, step, of_x, slopes(y[i]))


@compiled
def _chain(rate: Any, axis: Array, forwards: Array, right: Array, up: Array, x: Array, y: Array, z: Array) -> None:
    """Derivatives on the face, in ``x`` and ``y``, become derivatives by the direction (``x``, ``y``, ``z``)."""
    for i in range(len(x)):
        squared, height = forwards[i] * forwards[i], abs(forwards[i])
        of_right = rate * x[i] / (right[i] * right[i] + squared)
        of_up = rate * y[i] / (up[i] * up[i] + squared)
        along = of_right * right[i] + of_up * up[i]
        first, second, third = -along if forwards[i] > ZERO else along, of_right * height, of_up * height
        by_x, by_y = axis[i] == 0, axis[i] == 1
        x[i] = first if by_x else third if by_y else second
        y[i] = second if by_x else first if by_y else third
        z[i] = third if by_x else second if by_y else first


@compiled
def _add(values: Array, width: int, corner: Numbers, x: Array, y: Array, total: Array) -> None:
    for i in range(len(values)):
        of_x, of_y = weights(x[i]), weights(y[i])
        at = np.uint64(np.uint32(corner[i]))
        for across in of_y:
            part = values[i] * across
            total[at] += part * of_x[0]
            total[at + np.uint64(1)] += part * of_x[1]
            total[at + np.uint64(2)] += part * of_x[2]
            total[at + np.uint64(3)] += part * of_x[3]
            at += np.uint64(width)
