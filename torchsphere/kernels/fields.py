"""Sums over the pixels of images whose rows may belong to two fields."""

from __future__ import annotations

import numpy as np
import torch
from torch import Tensor

from torchsphere.kernels.jit import ZERO, Floats, arrays, compiled, require_nodes
from torchsphere.kernels.operator import dot

_NEAR, _FAR, _HALF = (np.float32(value) for value in (9 / 16, -1 / 16, 1 / 2))


def products(images: Tensor) -> Tensor:
    """`interlacing.row_products`."""
    require_nodes(images, 9)
    found = torch.empty(len(images), 3, 3)
    _products(*arrays(images, found))
    return found


@compiled
def _products(images: Floats, found: Floats) -> None:
    _, height, width = images.shape
    between, values = np.empty((height, width), np.float32), np.empty((3, width - 2), np.float32)
    for n in range(len(images)):
        found[n, :, :] = ZERO
        for y in range(3, height - 3):
            _interpolated(images[n], y, between[y])
        for y in range(4, height - 4):
            _slopes_and_rest(images[n, y], between, y, values)
            for j in range(3):
                for k in range(3):
                    found[n, j, k] += dot(values[j], values[k])


@compiled
def _interpolated(image: Floats, y: int, found: Floats) -> None:
    """Row ``y`` by the cubic through the four nearest rows of the other field."""
    for x in range(len(found)):
        found[x] = _FAR * (image[y - 3, x] + image[y + 3, x]) + _NEAR * (image[y - 1, x] + image[y + 1, x])


@compiled
def _slopes_and_rest(row: Floats, between: Floats, y: int, found: Floats) -> None:
    sign = np.float32(1 - 2 * (y % 2))
    for x in range(1, len(row) - 1):
        found[0, x - 1] = _HALF * (between[y, x + 1] - between[y, x - 1])
        found[1, x - 1] = _HALF * (between[y + 1, x] - between[y - 1, x])
        found[2, x - 1] = sign * (row[x] - between[y, x])
