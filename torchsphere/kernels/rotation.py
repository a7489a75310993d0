"""Rotation matrices, tangents and moments of many balls: torch takes some ten operations for each kind."""

from __future__ import annotations

import math

import numpy as np
import torch
from torch import Tensor

from torchsphere.kernels.jit import Floats, arrays, compiled, require_one_size
from torchsphere.kernels.operator import dot

#: Turn below which quotients of sines and cosines come from their series, since they lose digits, rad.
_SMALL = 1e-2


def matrices(vectors: Tensor) -> Tensor:
    """`rotation.rotations`."""
    found = torch.empty(len(vectors), 3, 3)
    _matrices(*arrays(vectors, found))
    return found


def tangents(vectors: Tensor) -> Tensor:
    """`rotation.tangents`."""
    found = torch.empty(len(vectors), 3, 3)
    _tangents(*arrays(vectors, found))
    return found


def moments(places: Tensor, weights: Tensor, every: int) -> Tensor:
    """`rotation._moments`."""
    require_one_size(0, places, weights)
    require_one_size(-1, places, weights)
    found = torch.empty(len(places), 4, 4)
    _moments(*arrays(places, weights, found), every)
    return found


@compiled
def _matrices(vectors: Floats, found: Floats) -> None:
    for n in range(len(vectors)):
        rotation(vectors[n, 0], vectors[n, 1], vectors[n, 2], True, found[n])


@compiled
def rotation(x: float, y: float, z: float, exact: bool, found: Floats) -> None:
    """Rotation matrix (3, 3) of one vector by Rodrigues' formula, or its linearisation."""
    squared = float(x) * x + float(y) * y + float(z) * z
    angle = math.sqrt(squared)
    sine, versine = 1.0, 0.0
    if exact and angle < _SMALL:
        sine, versine = 1 - squared / 6, 0.5 - squared / 24
    elif exact:
        sine, versine = math.sin(angle) / angle, 2 * (math.sin(0.5 * angle) / angle) ** 2
    _combined(float(x), float(y), float(z), sine, versine, found)


@compiled
def _tangents(vectors: Floats, found: Floats) -> None:
    for n in range(len(vectors)):
        x, y, z = float(vectors[n, 0]), float(vectors[n, 1]), float(vectors[n, 2])
        squared = x * x + y * y + z * z
        angle = math.sqrt(squared)
        versine, rest = 0.5 - squared / 24, 1 / 6 - squared / 120
        if angle >= _SMALL:
            versine, rest = 2 * (math.sin(0.5 * angle) / angle) ** 2, (1 - math.sin(angle) / angle) / squared
        _combined(x, y, z, versine, rest, found[n])


@compiled
def _combined(x: float, y: float, z: float, first: float, second: float, found: Floats) -> None:
    """``I + first [w]x + second [w]x^2`` for w = (x, y, z)."""
    found[0, 0] = 1 - second * (y * y + z * z)
    found[1, 1] = 1 - second * (x * x + z * z)
    found[2, 2] = 1 - second * (x * x + y * y)
    found[0, 1], found[1, 0] = second * x * y - first * z, second * x * y + first * z
    found[0, 2], found[2, 0] = second * x * z + first * y, second * x * z - first * y
    found[1, 2], found[2, 1] = second * y * z - first * x, second * y * z + first * x


@compiled
def _moments(places: Floats, weights: Floats, found: Floats, every: int) -> None:
    at = np.ones((4, (weights.shape[1] + every - 1) // every), np.float32)
    weighted = np.empty(at.shape, np.float32)
    for n in range(len(places)):
        for i in range(at.shape[1]):
            weighted[0, i] = weights[n, i * every]
        for k in range(1, 4):
            for i in range(at.shape[1]):
                at[k, i] = places[n, k - 1, i * every]
                weighted[k, i] = weighted[0, i] * at[k, i]
        for j in range(4):
            for k in range(4):
                found[n, j, k] = dot(weighted[j], at[k])
