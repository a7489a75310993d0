"""Points of the region of interest on the ball's front, and their weights in a changed view."""

from __future__ import annotations

import numpy as np
import torch
from torch import Tensor

from torchsphere.kernels.jit import ONE, ZERO, Floats, Integers, arrays, compiled, require_one_size


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


def seen_alike(surface: Tensor, weights: Tensor, turn: Tensor, radius: Tensor, share: Tensor, least: float) -> Tensor:
    """Weights (n, p) of `occlusion.weight_by_view`.

    ``share`` (n,) is the weight of a foreshortening of 1, ``least`` the least cosine of a view.
    """
    require_one_size(0, surface, weights, turn, radius, share)
    require_one_size(-1, surface, weights)
    found = torch.empty(weights.shape)
    _seen_alike(*arrays(surface, weights, turn, radius, share, found), np.float32(least))
    return found


@compiled
def _seen_alike(
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
