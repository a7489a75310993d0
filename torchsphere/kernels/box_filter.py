"""Sums over windows and blocks of a region, whose points lie on a square grid."""

from __future__ import annotations

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from torchsphere.kernels.jit import arrays, compiled, require_one_size
from torchsphere.kernels.operator import dot

Array = NDArray[np.float32]
Whole = NDArray[np.int64]
Places = NDArray[np.uint32]

_ZERO, _LEAST = np.float32(0), np.float32(1e-6)


def local_mean(values: Tensor, weights: Tensor, places: Tensor, side: int, window: int) -> Tensor:
    """Weighted mean (n, p) of ``values`` (n, p) over a square window of so many points: `residual_noise.local_mean`.

    ``places`` (p,) are the points' numbers on the grid of ``side`` by ``side``.
    """
    require_one_size(0, values, weights)
    require_one_size(-1, values, weights, places)
    found = torch.empty(values.shape)
    _local_mean(*arrays(values, weights, places, found), side, window)
    return found


def block_sums(values: Tensor, factors: Tensor, places: Tensor, side: int, belongs: Tensor) -> Tensor:
    """Sums (n, c, b b) over blocks of ``values`` (n, c, p) times ``factors`` (n, p).

    ``places`` and ``side`` as in `local_mean`; ``belongs`` (b, side) is the share of each row, and of each column, of
    the grid in each row of blocks.
    """
    require_one_size(0, values, factors)
    require_one_size(-1, values, factors, places)
    blocks = len(belongs)
    found = torch.empty(*values.shape[:2], blocks * blocks)
    _block_sums(*arrays(values, factors, places, belongs, found), side)
    return found


@compiled
def _local_mean(values: Array, weights: Array, places: Whole, found: Array, side: int, window: int) -> None:
    reach = window // 2
    wide = side + 2 * reach
    total, count = np.zeros((wide, wide), np.float32), np.zeros((wide, wide), np.float32)
    sums, counts = np.empty((side, side), np.float32), np.empty((side, side), np.float32)
    at, back = np.empty(len(places), np.uint32), np.empty(len(places), np.uint32)
    for i in range(len(places)):
        back[i] = places[i]
        at[i] = (places[i] // side + reach) * wide + places[i] % side + reach
    for n in range(len(values)):
        _spread(values[n], weights[n], at, total.reshape(wide * wide))
        _put(weights[n], at, count.reshape(wide * wide))
        _window_sums(total, window, sums)
        _window_sums(count, window, counts)
        _quotients(sums.reshape(side * side), counts.reshape(side * side), back, found[n])


@compiled
def _spread(values: Array, factors: Array, at: Places, found: Array) -> None:
    """The products put to their places, whose numbers have no sign: one that has is checked at each."""
    for i in range(len(at)):
        found[at[i]] = values[i] * factors[i]


@compiled
def _put(values: Array, at: Places, found: Array) -> None:
    for i in range(len(at)):
        found[at[i]] = values[i]


@compiled
def _quotients(sums: Array, counts: Array, at: Places, found: Array) -> None:
    for i in range(len(at)):
        points = counts[at[i]]
        found[i] = sums[at[i]] / (points if points > _LEAST else _LEAST)


@compiled
def _window_sums(wide: Array, window: int, found: Array) -> None:
    """Sums over a square window that begins at each of the first places of ``wide``, as many as ``found`` has."""
    side = len(found)
    row = np.empty(wide.shape[1], np.float32)
    for y in range(side):
        _add_rows(wide[y : y + window], row)
        for x in range(side):
            found[y, x] = row[x]
        for step in range(1, window):
            for x in range(side):
                found[y, x] += row[x + step]


@compiled
def _add_rows(rows: Array, found: Array) -> None:
    for x in range(len(found)):
        found[x] = rows[0, x]
    for y in range(1, len(rows)):
        for x in range(len(found)):
            found[x] += rows[y, x]


@compiled
def _block_sums(values: Array, factors: Array, places: Whole, belongs: Array, found: Array, side: int) -> None:
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
def _ends(shares: Array) -> tuple[int, int]:
    """The first place that has a share, and the one behind the last."""
    first, last = 0, len(shares)
    while first < last and shares[first] == _ZERO:
        first += 1
    while last > first and shares[last - 1] == _ZERO:
        last -= 1
    return first, last


@compiled
def _weighted_rows(rows: Array, shares: Array, found: Array) -> None:
    for x in range(len(found)):
        found[x] = _ZERO
    for y in range(len(rows)):
        for x in range(len(found)):
            found[x] += shares[y] * rows[y, x]
