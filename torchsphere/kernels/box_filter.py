"""Sums over blocks of a region whose points lie on a square grid."""

from __future__ import annotations

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from torchsphere.kernels.jit import ZERO, Floats, Integers, arrays, compiled, require_one_size
from torchsphere.kernels.operator import dot

Places = NDArray[np.uint32]


def block_sums(values: Tensor, factors: Tensor, places: Tensor, side: int, belongs: Tensor) -> Tensor:
    """Sums (n, c, b b) of ``values`` (n, c, p) times ``factors`` (n, p): `residual_noise.block_sums`.

    ``places`` (p,) are the points' numbers on the grid of ``side`` by ``side``; ``belongs`` (b, side) is the share of
    each row, and of each column, in each row of blocks.
    """
    require_one_size(0, values, factors)
    require_one_size(-1, values, factors, places)
    blocks = len(belongs)
    found = torch.empty(*values.shape[:2], blocks * blocks)
    _block_sums(*arrays(values, factors, places, belongs, found), side)
    return found


@compiled
def _spread(values: Floats, factors: Floats, at: Places, found: Floats) -> None:
    """The products put to their places, whose numbers have no sign: one that has is checked at each."""
    for i in range(len(at)):
        found[at[i]] = values[i] * factors[i]


@compiled
def _block_sums(values: Floats, factors: Floats, places: Integers, belongs: Floats, found: Floats, side: int) -> None:
    grid = np.zeros((side, side), np.float32)
    at, row, blocks = places.astype(np.uint32), np.empty(side, np.float32), len(belongs)
    first, last = np.empty(blocks, np.int64), np.empty(blocks, np.int64)
    for a in range(blocks):
        first[a], last[a] = _ends(belongs[a])
    for n in range(len(values)):
        for k in range(values.shape[1]):
            _spread(values[n, k], factors[n], at, grid.reshape(side * side))
            for a in range(blocks):
                _weighted_rows(grid[first[a] : last[a]], belongs[a, first[a] : last[a]], row)
                for b in range(blocks):
                    part = row[first[b] : last[b]]
                    found[n, k, a * blocks + b] = dot(belongs[b, first[b] : last[b]], part)


@compiled
def _ends(shares: Floats) -> tuple[int, int]:
    """First place with a share, and the place behind the last."""
    first, last = 0, len(shares)
    while first < last and shares[first] == ZERO:
        first += 1
    while last > first and shares[last - 1] == ZERO:
        last -= 1
    return first, last


@compiled
def _weighted_rows(rows: Floats, shares: Floats, found: Floats) -> None:
    for x in range(len(found)):
        found[x] = ZERO
    for y in range(len(rows)):
        for x in range(len(found)):
            found[x] += shares[y] * rows[y, x]
