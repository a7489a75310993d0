"""Sums over windows and blocks of a region, whose points lie on a square grid."""

from __future__ import annotations

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from torchsphere.compiled.function import arrays, compiled, require_one_size

Array = NDArray[np.float32]
Whole = NDArray[np.int64]

_ZERO, _LEAST = np.float32(0), np.float32(1e-6)


def local_mean(values: Tensor, weights: Tensor, places: Tensor, side: int, window: int) -> Tensor:
    """Weighted mean (n, p) of ``values`` (n, p) over a square window of so many points: `misfit.local_mean`.

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
    total, count = np.zeros((side, side), np.float32), np.zeros((side, side), np.float32)
    products = np.empty(values.shape[1], np.float32)
    for n in range(len(values)):
        for i in range(len(places)):
            products[i] = weights[n, i] * values[n, i]
        _window_sums(products, places, window, total)
        _window_sums(weights[n], places, window, count)
        sums, counts, row = total.reshape(side * side), count.reshape(side * side), found[n]
        for i in range(len(places)):
            points = counts[places[i]]
            row[i] = sums[places[i]] / (points if points > _LEAST else _LEAST)


@compiled
def _window_sums(values: Array, places: Whole, window: int, found: Array) -> None:
    """Sums over a square window around each place of the grid ``found`` (side, side), on which the values lie."""
    side, reach = len(found), window // 2
    wide = np.zeros((side + 2 * reach, side + 2 * reach), np.float32)
    for i in range(len(places)):
        wide[places[i] // side + reach, places[i] % side + reach] = values[i]
    row = np.empty(side + 2 * reach, np.float32)
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
    flat, row = grid.reshape(side * side), np.empty(side, np.float32)
    blocks = len(belongs)
    for n in range(len(values)):
        for k in range(values.shape[1]):
            for i in range(len(places)):
                flat[places[i]] = values[n, k, i] * factors[n, i]
            for a in range(blocks):
                _weighted_rows(grid, belongs[a], row)
                for b in range(blocks):
                    total = _ZERO
                    for x in range(side):
                        total += belongs[b, x] * row[x]
                    found[n, k, a * blocks + b] = total


@compiled
def _weighted_rows(grid: Array, shares: Array, found: Array) -> None:
    """Sum of the rows of ``grid`` (side, side), those of no share left out."""
    for x in range(len(found)):
        found[x] = _ZERO
    for y in range(len(grid)):
        if shares[y] != _ZERO:
            for x in range(len(found)):
                found[x] += shares[y] * grid[y, x]
