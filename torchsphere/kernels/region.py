"""Points of the region of interest: on the ball's front, weights in a changed view, sums over blocks, a limit."""

from __future__ import annotations

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from torchsphere.kernels.jit import ONE, ZERO, Floats, Integers, arrays, compiled, require_one_size, require_same_points
from torchsphere.kernels.operator import dot

#: Least sum of weights in a window.
_MIN_COUNT = np.float32(1e-6)


def front(pixels: Tensor, nearest: Tensor, radius: Tensor, limit: Tensor) -> tuple[Tensor, Tensor]:
    """`reference_lookup.front`."""
    require_one_size(0, nearest, radius, limit)
    surface = torch.empty(len(nearest), 3, len(pixels))
    weights = torch.empty(len(nearest), len(pixels))
    _front(*arrays(pixels.T, nearest, radius, limit, surface, weights))
    return surface, weights


@compiled
def _front(pixels: Integers, nearest: Floats, radius: Floats, limit: Floats, surface: Floats, weights: Floats) -> None:
    columns, lines = pixels[0], pixels[1]
    for n in range(len(nearest)):
        left, top, weight = nearest[n, 0], nearest[n, 1], weights[n]
        xs, ys, zs = surface[n, 0], surface[n, 1], surface[n, 2]
        ball, inside = radius[n] * radius[n], limit[n] * limit[n]
        for i in range(len(columns)):
            x, y = np.float32(columns[i]) + left, np.float32(lines[i]) + top
            squared = x * x + y * y
            depth = ball - squared
            xs[i], ys[i] = x, y
            zs[i] = -np.sqrt(depth if depth > ZERO else ZERO)
            weight[i] = ONE if squared < inside else ZERO


def view_weights(surface: Tensor, weights: Tensor, turn: Tensor, radius: Tensor, share: Tensor, least: float) -> Tensor:
    """Weights (n, p) of `occlusion.weight_by_view`.

    ``share`` (n,) is the weight of a foreshortening of 1, ``least`` the least cosine of a view.
    """
    require_one_size(0, surface, weights, turn, radius, share)
    require_one_size(-1, surface, weights)
    found = torch.empty(weights.shape)
    _view_weights(*arrays(surface, weights, turn, radius, share, found), np.float32(least))
    return found


@compiled
def _view_weights(
    surface: Floats, weights: Floats, turn: Floats, radius: Floats, share: Floats, found: Floats, least: np.float32
) -> None:
    for n in range(len(weights)):
        x, y, z, weight, row = surface[n, 0], surface[n, 1], surface[n, 2], weights[n], found[n]
        a, b, c, lowest = turn[n, 2, 0], turn[n, 2, 1], turn[n, 2, 2], least * radius[n]
        for i in range(len(x)):
            before, after = -z[i], -(a * x[i] + b * y[i] + c * z[i])
            height = before if before < after else after
            height = lowest if height < lowest else height
            misplaced = share[n] * (radius[n] / height - ONE)
            row[i] = weight[i] / (ONE + misplaced * misplaced)


def local_mean(values: Tensor, weights: Tensor, places: Tensor, side: int, window: int) -> Tensor:
    """Weighted mean (n, p) of ``values`` (n, p) over ``window`` by ``window`` places: `residual_noise.local_mean`.

    ``places`` and ``side`` as in `block_sums`.
    """
    require_one_size(0, values, weights)
    require_one_size(-1, values, weights, places)
    found = torch.empty(values.shape)
    _local_mean(*arrays(values, weights, places, found), side, window)
    return found


def block_sums(values: Tensor, factors: Tensor, places: Tensor, side: int, belongs: Tensor) -> Tensor:
    """Sums (n, c, b b) of ``values`` (n, c, p) times ``factors`` (n, p): `residual_noise.block_sums`.

    ``places`` (p,) are the points' numbers on the grid of ``side`` by ``side``; ``belongs`` (b, side) is the share of
    each row, and of each column, in each row of blocks.
    """
    require_one_size(0, values, factors)
    require_one_size(-1, values, factors, places)
    found = torch.empty(*values.shape[:2], len(belongs) ** 2)
    _block_sums(*arrays(values, factors, places, belongs, found), side)
    return found


def exceeds(values: Tensor, limit: Tensor, weights: Tensor) -> Tensor:
    """True (n,) where one of the ``values`` (n, p) that have ``weights`` (n, p) exceeds the row's ``limit`` (n,)."""
    require_same_points(values, weights)
    require_one_size(0, values, limit)
    found = torch.empty(len(values), dtype=torch.bool)
    _exceeds(*arrays(values, limit, weights, found))
    return found


@compiled
def _exceeds(values: Floats, limit: Floats, weights: Floats, found: NDArray[np.bool_]) -> None:
    for n in range(len(values)):
        above = 0
        for i in range(values.shape[1]):
            above += (values[n, i] > limit[n]) & (weights[n, i] > ZERO)
        found[n] = above > 0


@compiled
def _spread(values: Floats, factors: Floats, at: NDArray[np.uint32], found: Floats) -> None:
    """Products at their places; unsigned, since a signed index is checked for counting from the end."""
    for i in range(len(at)):
        found[at[i]] = values[i] * factors[i]


@compiled
def _local_mean(values: Floats, weights: Floats, places: Integers, found: Floats, side: int, window: int) -> None:
    reach = window // 2
    wide = side + 2 * reach
    total, count = np.zeros((wide, wide), np.float32), np.zeros((wide, wide), np.float32)
    sums, counts = np.empty((side, side), np.float32), np.empty((side, side), np.float32)
    ones = np.ones(len(places), np.float32)
    at, back = np.empty(len(places), np.uint32), np.empty(len(places), np.uint32)
    for i in range(len(places)):
        back[i] = places[i]
        at[i] = (places[i] // side + reach) * wide + places[i] % side + reach
    for n in range(len(values)):
        _spread(values[n], weights[n], at, total.reshape(wide * wide))
        _spread(ones, weights[n], at, count.reshape(wide * wide))
        window_sums(total, window, sums)
        window_sums(count, window, counts)
        _quotients(sums.reshape(side * side), counts.reshape(side * side), back, found[n])


@compiled
def _quotients(sums: Floats, counts: Floats, at: NDArray[np.uint32], found: Floats) -> None:
    for i in range(len(at)):
        points = counts[at[i]]
        found[i] = sums[at[i]] / (points if points > _MIN_COUNT else _MIN_COUNT)


@compiled
def window_sums(wide: Floats, window: int, found: Floats) -> None:
    """Sums over a square window from each of the first places of ``wide`` on, as many as ``found`` has."""
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
def _add_rows(rows: Floats, found: Floats) -> None:
    for x in range(len(found)):
        found[x] = rows[0, x]
    for y in range(1, len(rows)):
        for x in range(len(found)):
            found[x] += rows[y, x]


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
