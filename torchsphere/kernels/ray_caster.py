"""Pixels of a textured ball under parallel rays, in compiled loops: `torchsphere.synthetic.ray_caster` on the CPU."""

from __future__ import annotations

from typing import Any

import numpy as np
import torch
from torch import Tensor

from torchsphere.kernels.jit import ONE, ZERO, Floats, Integers, arrays, compiled

_HALF, _TINY, _NEXT = np.float32(0.5), np.float32(1e-6), np.uint64(1)
_NONE = np.float32(np.nan)


def mean_levels(
    volume: Tensor,
    pixels: Tensor,
    offsets: Tensor,
    centre: Tensor,
    turn: Tensor,
    still: Tensor,
    radius: float,
    half_width: float,
) -> Tensor:
    """`ray_caster._mean_of_parallel_rays`."""
    if len(set(volume.shape)) > 1 or len(volume) < 2:
        raise ValueError(f"expected a pattern of as many nodes along each axis, two or more, got {tuple(volume.shape)}")
    found = torch.empty(len(pixels))
    _mean_levels(
        *arrays(volume, pixels, offsets, centre, turn, still, found),
        np.float32(radius),
        np.float32(radius * half_width),
    )
    return found


@compiled
def _mean_levels(
    volume: Floats,
    pixels: Integers,
    offsets: Floats,
    centre: Floats,
    turn: Floats,
    still: Floats,
    found: Floats,
    radius: Any,
    half_cube: Any,
) -> None:
    square = radius * radius
    for n in range(len(pixels)):
        column, row = pixels[n, 0], pixels[n, 1]
        total = ZERO
        for k in range(len(offsets)):
            x = np.float32(column) + offsets[k, 0] - centre[0]
            y = np.float32(row) + offsets[k, 1] - centre[1]
            rest = square - x * x - y * y
            if rest > ZERO:
                x, y, z = x / half_cube, y / half_cube, -np.sqrt(max(rest, _TINY)) / half_cube
                total += _level_at(
                    volume,
                    x * turn[0, 0] + y * turn[1, 0] + z * turn[2, 0],
                    x * turn[0, 1] + y * turn[1, 1] + z * turn[2, 1],
                    x * turn[0, 2] + y * turn[1, 2] + z * turn[2, 2],
                )
            else:
                total += still[row, column]
        found[n] = total / np.float32(len(offsets))


@compiled
def _level_at(volume: Floats, x: Any, y: Any, z: Any) -> Any:
    """Level of the pattern's cube at a point, half its width as unit, between its eight nearest nodes; NaN outside."""
    if not (abs(x) <= ONE and abs(y) <= ONE and abs(z) <= ONE):
        return _NONE
    last = np.float32(len(volume) - 2)
    half = _HALF * (last + ONE)
    u, v, w = (x + ONE) * half, (y + ONE) * half, (z + ONE) * half
    i, j, k = np.uint64(min(u, last)), np.uint64(min(v, last)), np.uint64(min(w, last))
    u, v, w = u - np.float32(i), v - np.float32(j), w - np.float32(k)
    near = _in_face(volume[k], i, j, u, v)
    return near + w * (_in_face(volume[k + _NEXT], i, j, u, v) - near)


@compiled
def _in_face(face: Floats, i: Any, j: Any, u: Any, v: Any) -> Any:
    top = face[j, i] + u * (face[j, i + _NEXT] - face[j, i])
    bottom = face[j + _NEXT, i] + u * (face[j + _NEXT, i + _NEXT] - face[j + _NEXT, i])
    return top + v * (bottom - top)
