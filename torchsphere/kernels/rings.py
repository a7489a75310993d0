"""Rings around the ball's centre in compiled loops: `torchsphere.sphere_map.pixel_weights` on the CPU."""

from __future__ import annotations

import numpy as np
import torch
from torch import Tensor

from torchsphere.kernels.jit import ONE, ZERO, Doubles, Floats, arrays, compiled

_HALF = np.float32(0.5)


def along_ramps(squares: Tensor, limits: Tensor, slopes: Tensor, variances: Tensor) -> Tensor:
    """`pixel_weights._along_ramps`."""
    found = torch.empty(squares.shape)
    _along_ramps(*arrays(squares, limits, slopes, variances), found.numpy())
    return found


def sums(squares: Tensor, limits: Tensor, visibility: Tensor, residual: Tensor, leverage: Tensor) -> Tensor:
    """`pixel_weights._sums`."""
    found = torch.zeros(2, len(limits) + 1, dtype=torch.float64)
    _sums(*arrays(squares, limits, visibility, residual, leverage), found.numpy())
    return found


@compiled
def _along_ramps(squares: Floats, limits: Floats, slopes: Floats, variances: Floats, found: Floats) -> None:
    for i in range(len(squares)):
        for row in range(squares.shape[1]):
            put_ramps(squares[i, row], limits, slopes, variances, found[i, row])


@compiled
def put_ramps(squares: Floats, limits: Floats, slopes: Floats, variances: Floats, found: Floats) -> None:
    """Variances of a row of pixels at distances with these ``squares``."""
    for column in range(len(found)):
        found[column] = variances[0]
    for k in range(len(limits)):
        limit, slope, step = limits[k], slopes[k], variances[k + 1] - variances[k]
        for column in range(len(found)):
            found[column] += step * min(max((squares[column] - limit) * slope + _HALF, ZERO), ONE)


@compiled
def _sums(
    squares: Floats, limits: Floats, visibility: Floats, residual: Floats, leverage: Floats, found: Doubles
) -> None:
    n, height, width = squares.shape
    for i in range(n):
        for row in range(height):
            for column in range(width):
                ring, shown = 0, visibility[i, row, column]
                while ring < len(limits) and limits[ring] < squares[i, row, column]:
                    ring += 1
                found[0, ring] += shown * residual[i, row, column] * residual[i, row, column]
                found[1, ring] += shown * (ONE - leverage[i, row, column])
