"""Rotations of many balls, and their modes: torch takes some ten operations for each kind, whatever their number."""

from __future__ import annotations

import math

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from torchsphere.kernels.jit import arrays, compiled, require_one_size

Array = NDArray[np.float32]
Double = NDArray[np.float64]

#: Turns below which the quotients of sines and cosines are taken from their series, rad: they lose their digits there.
_SMALL = 1e-2


def matrices(vectors: Tensor, *, exact: bool) -> Tensor:
    """Rotation matrices (n, 3, 3) of rotation vectors (n, 3), rad, or their linearisation: see `rotation.matrices`."""
    found = torch.empty(len(vectors), 3, 3)
    _matrices(*arrays(vectors, found), exact)
    return found


def tangents(vectors: Tensor) -> Tensor:
    """Left Jacobians (n, 3, 3) of SO(3) at rotation vectors (n, 3), rad: see `rotation.tangents`."""
    found = torch.empty(len(vectors), 3, 3)
    _tangents(*arrays(vectors, found))
    return found


def gram(surface: Tensor, weights: Tensor, turn: Tensor, tangent: Tensor, every: int) -> Tensor:
    """Weighted sum (n, 5, 5), float64, over every so many-th point of the modes' products: see `rotation.gram`.

    The ball's front ``surface`` (n, 3, p), with ``weights`` (n, p), has turned by ``turn`` (n, 3, 3); ``tangent``
    (n, 3, 3) leads from changes of the rotation vector to the small rotations that follow it.
    """
    require_one_size(0, surface, weights, turn, tangent)
    require_one_size(-1, surface, weights)
    found = torch.zeros(len(weights), 5, 5, dtype=torch.float64)
    _gram(*arrays(surface, weights, turn, tangent, found), every)
    return found


@compiled
def _gram(surface: Array, weights: Array, turn: Array, tangent: Array, found: Double, every: int) -> None:
    # Of the small rotations, which stand in the last three rows and columns.
    spin, both = np.zeros((3, 3)), np.zeros((2, 3))
    for n in range(len(weights)):
        count, x, y, z, across, deep, x_deep, y_deep = _moments(surface[n], weights[n], turn[n], every)
        spin[0, 0] = spin[1, 1] = deep
        spin[0, 2] = spin[2, 0] = -x_deep
        spin[1, 2] = spin[2, 1] = -y_deep
        spin[2, 2] = across
        both[0, 1], both[0, 2], both[1, 0], both[1, 2] = z, -y, -z, x
        found[n, 0, 0] = found[n, 1, 1] = count
        for j in range(3):
            for k in range(3):
                for i in range(3):
                    if j < 2:
                        found[n, j, 2 + k] += both[j, i] * tangent[n, i, k]
                    for m in range(3):
                        found[n, 2 + j, 2 + k] += tangent[n, i, j] * spin[i, m] * tangent[n, m, k]
        for j in range(2):
            for k in range(3):
                found[n, 2 + k, j] = found[n, j, 2 + k]


@compiled
def _moments(surface: Array, weights: Array, turn: Array, every: int) -> tuple[float, ...]:
    """Weighted sums of 1, x, y, z, x^2 + y^2, z^2, x z and y z of the turned points."""
    count, x, y, z, across, deep, x_deep, y_deep = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
    for i in range(0, len(weights), every):
        a, b, c, weight = surface[0, i], surface[1, i], surface[2, i], weights[i]
        u = turn[0, 0] * a + turn[0, 1] * b + turn[0, 2] * c
        v = turn[1, 0] * a + turn[1, 1] * b + turn[1, 2] * c
        w = turn[2, 0] * a + turn[2, 1] * b + turn[2, 2] * c
        count, x, y, z = count + weight, x + weight * u, y + weight * v, z + weight * w
        across, deep = across + weight * (u * u + v * v), deep + weight * w * w
        x_deep, y_deep = x_deep + weight * u * w, y_deep + weight * v * w
    return count, x, y, z, across, deep, x_deep, y_deep


@compiled
def _matrices(vectors: Array, found: Array, exact: bool) -> None:
    for n in range(len(vectors)):
        rotation(vectors[n, 0], vectors[n, 1], vectors[n, 2], exact, found[n])


@compiled
def rotation(x: float, y: float, z: float, exact: bool, found: Array) -> None:
    """Rotation matrix (3, 3) of one vector, by Rodrigues' formula, or its linearisation."""
    squared = float(x) * x + float(y) * y + float(z) * z
    angle = math.sqrt(squared)
    sine, versine = 1.0, 0.0
    if exact and angle < _SMALL:
        sine, versine = 1 - squared / 6, 0.5 - squared / 24
    elif exact:
        sine, versine = math.sin(angle) / angle, 2 * (math.sin(0.5 * angle) / angle) ** 2
    _combined(float(x), float(y), float(z), sine, versine, found)


@compiled
def _tangents(vectors: Array, found: Array) -> None:
    for n in range(len(vectors)):
        x, y, z = float(vectors[n, 0]), float(vectors[n, 1]), float(vectors[n, 2])
        squared = x * x + y * y + z * z
        angle = math.sqrt(squared)
        versine, rest = 0.5 - squared / 24, 1 / 6 - squared / 120
        if angle >= _SMALL:
            versine, rest = 2 * (math.sin(0.5 * angle) / angle) ** 2, (1 - math.sin(angle) / angle) / squared
        _combined(x, y, z, versine, rest, found[n])


@compiled
def _combined(x: float, y: float, z: float, first: float, second: float, found: Array) -> None:
    """``I + first [w]x + second [w]x^2``, the cross product's matrix being that of w = (x, y, z)."""
    found[0, 0] = 1 - second * (y * y + z * z)
    found[1, 1] = 1 - second * (x * x + z * z)
    found[2, 2] = 1 - second * (x * x + y * y)
    found[0, 1], found[1, 0] = second * x * y - first * z, second * x * y + first * z
    found[0, 2], found[2, 0] = second * x * z + first * y, second * x * z - first * y
    found[1, 2], found[2, 1] = second * y * z - first * x, second * y * z + first * x
