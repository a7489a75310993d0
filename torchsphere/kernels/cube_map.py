"""Map of cubic B-splines on the faces of a cube, for one direction: `torchsphere.sphere_map.cube_map` in loops.

The loops serve single and double precision: their constants are whole numbers, exact in both.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from torchsphere.kernels.jit import ONE, TWO, ZERO, compiled

Array = NDArray[Any]

_THREE, _FOUR, _FIVE, _SIX = (np.float32(value) for value in (3, 4, 5, 6))


def to_nodes(values: Tensor, width: int) -> Tensor:
    """`map_fit.to_nodes` of values (m, ...), by elimination along the lines of ``width`` coefficients of each face."""
    return _along_both(_solve_lines, values, width)


def from_nodes(values: Tensor, width: int) -> Tensor:
    """The inverse of `to_nodes`."""
    return _along_both(_sum_lines, values, width)


def roughness_gradient(coefficients: Tensor, width: int) -> Tensor:
    """Half the gradient (m,) of the squared second differences of a map at its nodes, along both axes of a face."""
    nodes = from_nodes(coefficients, width).view(6, width, width)
    across, along = nodes.clone(), _turned(nodes)
    _take_fourth_differences(across.numpy())
    _take_fourth_differences(along.numpy())
    return from_nodes((across + along.mT).flatten(), width)


def _along_both(change: Callable[[Array], None], values: Tensor, width: int) -> Tensor:
    """Values (m, ...) after the ``change`` along the columns of the faces, then along their rows."""
    faces = values.reshape(6, width, -1).clone(memory_format=torch.contiguous_format)
    change(faces.numpy())
    if values.ndim > 1:
        change(faces.view(6 * width, width, -1).numpy())
        return faces.view(values.shape)
    # Neighbouring lines are worked on together: those of one value each are turned for that.
    turned = _turned(faces)
    change(turned.numpy())
    return _turned(turned).flatten()


def _turned(faces: Tensor) -> Tensor:
    """The faces (6, w, w, ...) with rows for columns."""
    return faces.transpose(1, 2).contiguous()


@compiled
def _sum_lines(lines: Array) -> None:
    """Values of splines at the nodes from their coefficients, along the second axis of (n, w, k)."""
    n, width, columns = lines.shape
    side, middle, end = ONE / _SIX, _FOUR / _SIX, _FIVE / _SIX
    before = np.empty(columns, lines.dtype)
    for face in range(n):
        before[:] = lines[face, 0]
        for k in range(columns):
            lines[face, 0, k] = end * before[k] + side * lines[face, 1, k]
        for i in range(1, width - 1):
            for k in range(columns):
                here = lines[face, i, k]
                lines[face, i, k] = side * (before[k] + lines[face, i + 1, k]) + middle * here
                before[k] = here
        for k in range(columns):
            lines[face, width - 1, k] = side * before[k] + end * lines[face, width - 1, k]


@compiled
def _take_fourth_differences(lines: Array) -> None:
    """Half the gradient of the squared second differences along the second axis of (n, w, k), in their place."""
    n, width, columns = lines.shape
    second = np.zeros((width, columns), lines.dtype)
    for face in range(n):
        for i in range(1, width - 1):
            for k in range(columns):
                second[i, k] = lines[face, i - 1, k] - TWO * lines[face, i, k] + lines[face, i + 1, k]
        for k in range(columns):
            lines[face, 0, k] = second[1, k]
            lines[face, width - 1, k] = second[width - 2, k]
        for i in range(1, width - 1):
            for k in range(columns):
                lines[face, i, k] = second[i - 1, k] - TWO * second[i, k] + second[i + 1, k]


@compiled
def _solve_lines(lines: Array) -> None:
    """Solve for the coefficients of splines with these values at the nodes, along the second axis of (n, w, k)."""
    n, width, columns = lines.shape
    side = ONE / _SIX
    # The outermost splines are folded back.
    pivots = np.empty(width, np.float32)
    pivots[0] = _FIVE / _SIX
    for i in range(1, width):
        middle = _FIVE / _SIX if i == width - 1 else _FOUR / _SIX
        pivots[i] = middle - side * side / pivots[i - 1]
    for face in range(n):
        for i in range(1, width):
            share = side / pivots[i - 1]
            for k in range(columns):
                lines[face, i, k] -= share * lines[face, i - 1, k]
        over = ONE / pivots[width - 1]
        for k in range(columns):
            lines[face, width - 1, k] *= over
        for i in range(width - 2, -1, -1):
            over = ONE / pivots[i]
            for k in range(columns):
                lines[face, i, k] = (lines[face, i, k] - side * lines[face, i + 1, k]) * over


@compiled
def place(x: Any, y: Any, z: Any, cells: int) -> tuple[Any, ...]:
    """Where the direction (x, y, z) meets the map.

    Number of the first of sixteen coefficients; axis across the face; one over the component along that axis; place in
    the cell, along the rows and across them; tangents of the direction on the face.
    """
    along, across, inwards = abs(x), abs(y), abs(z)
    by_x = along >= across and along >= inwards
    by_y = not by_x and across >= inwards
    axis = np.int32(0) if by_x else np.int32(1) if by_y else np.int32(2)
    ahead = x if by_x else y if by_y else z
    nearer = ONE / ahead
    size = abs(nearer)
    t, r = (y if by_x else z if by_y else x) * size, (z if by_x else x if by_y else y) * size
    half, last = np.float32(cells) / TWO, np.float32(cells - 1)
    u, v = (t * (_FIVE - t * t) / _FOUR + ONE) * half, (r * (_FIVE - r * r) / _FOUR + ONE) * half
    # NaN goes to the first cell.
    column, row = np.floor(u), np.floor(v)
    column, row = column if column > ZERO else ZERO, row if row > ZERO else ZERO
    column, row = column if column < last else last, row if row < last else last
    face, width = axis + (np.int32(0) if ahead > ZERO else np.int32(3)), np.int32(cells + 3)
    return (face * width + np.int32(row)) * width + np.int32(column), axis, nearer, u - column, v - row, t, r


@compiled
def weights(t: Any) -> tuple[Any, ...]:
    """`interpolation.spline_weights` of the B-spline."""
    squared, rest = t * t, ONE - t
    first, last = rest * rest * rest / _SIX, squared * t / _SIX
    second = (_FOUR - _SIX * squared + _THREE * squared * t) / _SIX
    return first, second, ONE - first - second - last, last
