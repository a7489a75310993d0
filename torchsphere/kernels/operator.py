"""The modes' change of grey level at each point, and the small systems of equations that come of it."""

from __future__ import annotations

import math

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from torchsphere.kernels.jit import arrays, compiled, require_one_size

Array = NDArray[np.float32]
Double = NDArray[np.float64]

_ZERO, _ONE = np.float32(0), np.float32(1)


def projected(
    surface: Tensor, gradient: Tensor, values: Tensor, weights: Tensor, radius: Tensor, turn: Tensor, mix: Tensor
) -> tuple[Tensor, Tensor]:
    """Changes of grey level per px of each unknown (n, 5, p), without what may change besides the motion; their `gram`.

    What may change is offset, gain, and the light, by the normal: `znssd.project` of `rotation.slopes`.

    Parameters
    ----------
    surface, gradient : Tensor
        The ball's front (n, 3, p), px from its centre, and the image's gradient (n, 2, p) there.
    values, weights : Tensor
        The image (n, p) and the weights (n, p).
    radius : Tensor
        (n,), px.
    turn, mix : Tensor
        Matrices (n, 3, 3): that of the rotation so far, and that from the small rotations that follow it to changes
        of the rotation vector.
    """
    require_one_size(0, surface, gradient, values, weights, radius, turn, mix)
    require_one_size(-1, surface, gradient, values, weights)
    found = torch.empty(len(weights), 5, weights.shape[1])
    operator = torch.empty(len(weights), 5, 5, dtype=torch.float64)
    _projected(*arrays(surface, gradient, values, weights, radius, turn, mix, found, operator))
    return found, operator


def cholesky(operators: Tensor) -> Tensor:
    """Cholesky factors (n, k, k) of operators (n, k, k), float64: see `znssd.cholesky`."""
    found = operators.clone(memory_format=torch.contiguous_format)
    _cholesky(*arrays(found))
    return found


def gram(slopes: Tensor, weights: Tensor) -> Tensor:
    """Weighted sums (n, k, k), float64, of the products of ``slopes`` (n, k, p) with each other."""
    require_one_size(0, slopes, weights)
    require_one_size(-1, slopes, weights)
    k = slopes.shape[1]
    operator = torch.empty(len(slopes), k, k, dtype=torch.float64)
    _gram(*arrays(slopes, weights, operator))
    return operator


@compiled
def _projected(
    surface: Array,
    gradient: Array,
    values: Array,
    weights: Array,
    radius: Array,
    turn: Array,
    mix: Array,
    found: Array,
    operator: Double,
) -> None:
    points = weights.shape[1]
    weighted, nuisances = np.empty(points, np.float32), np.empty((5, points), np.float32)
    known, both = np.empty((5, 5)), np.empty((5, 5))
    for n in range(len(weights)):
        _slopes(surface[n], gradient[n], turn[n], mix[n], _ONE / radius[n], found[n])
        _nuisances(surface[n], values[n], weights[n], _ONE / radius[n], nuisances)
        for j in range(5):
            _product(nuisances[j], weights[n], weighted)
            # Of a symmetric matrix the factor is made from its lower triangle.
            for k in range(j + 1):
                known[j, k] = dot(weighted, nuisances[k])
            for k in range(5):
                both[j, k] = dot(weighted, found[n, k])
        solve(known, both)
        for k in range(5):
            _subtract(found[n, k], both, k, nuisances)
        _products(found[n], weights[n], weighted, operator[n])


@compiled
def _cholesky(operators: Double) -> None:
    for n in range(len(operators)):
        matrix = operators[n]
        sound = factorise(matrix)
        for j in range(len(matrix)):
            for k in range(len(matrix)):
                if k > j or not sound:
                    matrix[j, k] = 1.0 if j == k else 0.0


@compiled
def factorise(matrix: Double) -> bool:
    """Put a Cholesky factor in the lower triangle of a ``matrix`` (k, k); False where it is not positive definite.

    It is made a little more so than it is, as in `znssd.cholesky`.
    """
    size = len(matrix)
    mean = 0.0
    for j in range(size):
        mean += matrix[j, j] / size
    for j in range(size):
        matrix[j, j] += 1e-12 * mean + 1e-30
        for k in range(j + 1):
            rest = matrix[j, k]
            for i in range(k):
                rest -= matrix[j, i] * matrix[k, i]
            if k < j:
                matrix[j, k] = rest / matrix[k, k]
            elif 0 < rest < np.inf:
                matrix[j, j] = math.sqrt(rest)
            else:
                return False
    return True


@compiled
def solve(matrix: Double, right: Double) -> None:
    """Solve for the columns of ``right`` (k, m), in place; of the ``matrix`` (k, k) remains a Cholesky factor.

    Where the matrix is not positive definite, ``right`` stays as it is.
    """
    size = len(matrix)
    if not factorise(matrix):
        return
    for column in range(right.shape[1]):
        for j in range(size):
            for i in range(j):
                right[j, column] -= matrix[j, i] * right[i, column]
            right[j, column] /= matrix[j, j]
        for j in range(size - 1, -1, -1):
            for i in range(j + 1, size):
                right[j, column] -= matrix[i, j] * right[i, column]
            right[j, column] /= matrix[j, j]


@compiled
def _slopes(surface: Array, gradient: Array, turn: Array, mix: Array, per_px: np.float32, found: Array) -> None:
    """The modes' products with the gradient, as in `rotation.slopes`, per px on the ball's front."""
    xs, ys, zs, across, down = surface[0], surface[1], surface[2], gradient[0], gradient[1]
    along_x, along_y, first, second, third = found[0], found[1], found[2], found[3], found[4]
    for i in range(len(xs)):
        gx, gy = across[i], down[i]
        x = turn[0, 0] * xs[i] + turn[0, 1] * ys[i] + turn[0, 2] * zs[i]
        y = turn[1, 0] * xs[i] + turn[1, 1] * ys[i] + turn[1, 2] * zs[i]
        z = turn[2, 0] * xs[i] + turn[2, 1] * ys[i] + turn[2, 2] * zs[i]
        a, b, c = -gy * z * per_px, gx * z * per_px, (gy * x - gx * y) * per_px
        along_x[i], along_y[i] = gx, gy
        first[i] = mix[0, 0] * a + mix[0, 1] * b + mix[0, 2] * c
        second[i] = mix[1, 0] * a + mix[1, 1] * b + mix[1, 2] * c
        third[i] = mix[2, 0] * a + mix[2, 1] * b + mix[2, 2] * c


@compiled
def _nuisances(surface: Array, values: Array, weights: Array, per_px: np.float32, found: Array) -> None:
    """`znssd.nuisances` of light that does not change unevenly."""
    count, total = _ZERO, _ZERO
    for i in range(len(values)):
        count += weights[i]
        total += weights[i] * values[i]
    mean = total / (count if count > _ONE else _ONE)
    for i in range(len(values)):
        found[0, i] = _ONE
        found[1, i] = values[i] - mean
    for k in range(3):
        _scaled(surface[k], per_px, found[2 + k])


@compiled
def _gram(slopes: Array, weights: Array, operator: Double) -> None:
    weighted = np.empty(weights.shape[1], np.float32)
    for n in range(len(slopes)):
        _products(slopes[n], weights[n], weighted, operator[n])


@compiled
def _products(slopes: Array, weights: Array, weighted: Array, operator: Double) -> None:
    for j in range(len(slopes)):
        _product(slopes[j], weights, weighted)
        for k in range(j, len(slopes)):
            operator[j, k] = operator[k, j] = dot(weighted, slopes[k])


@compiled
def dot(first: Array, second: Array) -> np.float32:
    """Sum of the products of two rows (m,)."""
    total = _ZERO
    for i in range(len(first)):
        total += first[i] * second[i]
    return total


@compiled
def _product(first: Array, second: Array, found: Array) -> None:
    for i in range(len(first)):
        found[i] = first[i] * second[i]


@compiled
def _scaled(values: Array, factor: np.float32, found: Array) -> None:
    for i in range(len(values)):
        found[i] = values[i] * factor


@compiled
def _subtract(values: Array, factors: Double, column: int, others: Array) -> None:
    for i in range(len(values)):
        total = _ZERO
        for j in range(5):
            total += np.float32(factors[j, column]) * others[j, i]
        values[i] -= total
