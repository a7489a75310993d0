"""The points of a region of interest on the ball's front, and how alike a turn leaves them to be seen."""

from __future__ import annotations

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from torchsphere.kernels.jit import arrays, compiled, require_one_size

Array = NDArray[np.float32]
Whole = NDArray[np.int64]

_ZERO, _ONE = np.float32(0), np.float32(1)


def front(pixels: Tensor, nearest: Tensor, radius: Tensor, limit: Tensor) -> tuple[Tensor, Tensor]:
    """The ball's front (n, 3, p) at the ``pixels`` (p, 2), and weights (n, p): 1 within ``limit`` (n,), 0 beyond.

    The pixels count from one at ``nearest`` (n, 2) from the ball's centre; ``radius`` (n,). All in px.
    """
    require_one_size(0, nearest, radius, limit)
    surface = torch.empty(len(nearest), 3, len(pixels))
    weights = torch.empty(len(nearest), len(pixels))
    _front(*arrays(pixels.T, nearest, radius, limit, surface, weights))
    return surface, weights


@compiled
def _front(pixels: Whole, nearest: Array, radius: Array, limit: Array, surface: Array, weights: Array) -> None:
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
            zs[i] = -np.sqrt(depth if depth > _ZERO else _ZERO)
            weight[i] = _ONE if squared < inside else _ZERO


def seen_alike(surface: Tensor, weights: Tensor, turn: Tensor, radius: Tensor, share: Tensor, least: float) -> Tensor:
    """Weights (n, p) that fall where a turn changes the view of the texture: `occlusion.weight_by_view`.

    ``surface`` (n, 3, p), ``weights`` (n, p), ``turn`` (n, 3, 3), ``radius`` (n,), px; ``share`` (n,) is what a
    foreshortening of 1 counts as, ``least`` the least cosine of a view.
    """
    require_one_size(0, surface, weights, turn, radius, share)
    require_one_size(-1, surface, weights)
    found = torch.empty(weights.shape)
    _seen_alike(*arrays(surface, weights, turn, radius, share, found), np.float32(least))
    return found


@compiled
def _seen_alike(
    surface: Array, weights: Array, turn: Array, radius: Array, share: Array, found: Array, least: np.float32
) -> None:
    for n in range(len(weights)):
        x, y, z, weight, row = surface[n, 0], surface[n, 1], surface[n, 2], weights[n], found[n]
        a, b, c, lowest = turn[n, 2, 0], turn[n, 2, 1], turn[n, 2, 2], least * radius[n]
        for i in range(len(x)):
            before, after = -z[i], -(a * x[i] + b * y[i] + c * z[i])
            height = before if before < after else after
            height = lowest if height < lowest else height
            misplaced = share[n] * (radius[n] / height - _ONE)
            row[i] = weight[i] / (_ONE + misplaced * misplaced)
