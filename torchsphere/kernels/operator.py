"""Change of grey level by each mode at each point, and the small systems of equations of the operator."""

from __future__ import annotations

import math

import numpy as np
import torch
from torch import Tensor

from torchsphere.kernels.jit import ONE, ZERO, Doubles, Floats, arrays, compiled, require_one_size


def projected(
    surface: Tensor, gradient: Tensor, values: Tensor, weights: Tensor, radius: Tensor, turn: Tensor, mix: Tensor
) -> tuple[Tensor, Tensor]:
    """`warp.projected_slopes` (n, 5, p), px per px, and their `gram`; the nuisances are offset, gain and light.

    ``surface`` (n, 3, p), px; ``gradient`` (n, 2, p); ``values``, ``weights`` (n, p); ``radius`` (n,), px; ``turn``,
    ``mix`` (n, 3, 3): the rotation, and from small rotations after it to changes of the rotation vector.
    """
    require_one_size(0, surface, gradient, values, weights, radius, turn, mix)
    require_one_size(-1, surface, gradient, values, weights)
    found = torch.empty(len(weights), 5, weights.shape[1])
    operator = torch.empty(len(weights), 5, 5, dtype=torch.float64)
    _projected(arrays(surface, gradient, values, weights, radius, turn, mix), *arrays(found, operator))
    return found, operator


def cholesky(operators: Tensor) -> Tensor:
    """`znssd.cholesky`."""
    found = operators.clone(memory_format=torch.contiguous_format)
    _cholesky(*arrays(found))
    return found


def gram(slopes: Tensor, weights: Tensor) -> Tensor:
    """`znssd.operator`."""
    require_one_size(0, slopes, weights)
    require_one_size(-1, slopes, weights)
    k = slopes.shape[1]
    operator = torch.empty(len(slopes), k, k, dtype=torch.float64)
    _gram(*arrays(slopes, weights, operator))
    return operator


@compiled
def _projected(given: tuple[Floats, ...], found: Floats, operator: Doubles) -> None:
    surface, gradient, values, weights, radius, turn, mix = given
    points = weights.shape[1]
    weighted, nuisances = np.empty(points, np.float32), np.empty((5, points), np.float32)
    known, both = np.empty((5, 5)), np.empty((5, 5))
    for n in range(len(weights)):
        _slopes(surface[n], gradient[n], turn[n], mix[n], ONE / radius[n], found[n])
        _nuisances(surface[n], values[n], weights[n], ONE / radius[n], nuisances)
        for j in range(5):
            _product(nuisances[j], weights[n], weighted)
            # The factor of a symmetric matrix needs its lower triangle only.
            for k in range(j + 1):
                known[j, k] = dot(weighted, nuisances[k])
            for k in range(5):
                both[j, k] = dot(weighted, found[n, k])
        solve(known, both)
        for k in range(5):
            _subtract(found[n, k], both, k, nuisances)
        _products(found[n], weights[n], weighted, operator[n])


@compiled
def _cholesky(operators: Doubles) -> None:
    for n in range(len(operators)):
        matrix = operators[n]
        sound = factorise(matrix)
        for j in range(len(matrix)):
            for k in range(len(matrix)):
                if k > j or not sound:
                    matrix[j, k] = 1.0 if j == k else 0.0


@compiled
def factorise(matrix: Doubles) -> bool:
    """Cholesky factor in the lower triangle of ``matrix`` (k, k); False where it is not positive definite.

    The diagonal is raised as in `znssd.cholesky`.
    """
    size = len(matrix)
    for j in range(size):
        matrix[j, j] += 1e-12 * matrix[j, j] + 1e-30
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
def solve(matrix: Doubles, right: Doubles) -> None:
    """Solve for the columns of ``right`` (k, m) in place; the ``matrix`` (k, k) becomes its Cholesky factor.

    ``right`` stays as it is where the matrix is not positive definite.
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
def _slopes(surface: Floats, gradient: Floats, turn: Floats, mix: Floats, per_px: np.float32, found: Floats) -> None:
    """`rotation.slopes`, per px on the ball's front."""
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
def _nuisances(surface: Floats, values: Floats, weights: Floats, per_px: np.float32, found: Floats) -> None:
    """`znssd.nuisances` for light that changes evenly."""
    count, total = ZERO, ZERO
    for i in range(len(values)):
        count += weights[i]
        total += weights[i] * values[i]
    mean = total / (count if count > ONE else ONE)
    for i in range(len(values)):
        found[0, i] = ONE
        found[1, i] = values[i] - mean
    for k in range(3):
        _scaled(surface[k], per_px, found[2 + k])


@compiled
def _gram(slopes: Floats, weights: Floats, operator: Doubles) -> None:
    weighted = np.empty(weights.shape[1], np.float32)
    for n in range(len(slopes)):
        _products(slopes[n], weights[n], weighted, operator[n])


@compiled
def _products(slopes: Floats, weights: Floats, weighted: Floats, operator: Doubles) -> None:
    for j in range(len(slopes)):
        _product(slopes[j], weights, weighted)
        for k in range(j, len(slopes)):
            operator[j, k] = operator[k, j] = dot(weighted, slopes[k])


@compiled
def dot(first: Floats, second: Floats) -> np.float32:
    """Sum of the products of two rows (m,)."""
    total = ZERO
    for i in range(len(first)):
        total += first[i] * second[i]
    return total


@compiled
def _product(first: Floats, second: Floats, found: Floats) -> None:
    for i in range(len(first)):
        found[i] = first[i] * second[i]


@compiled
def _scaled(values: Floats, factor: np.float32, found: Floats) -> None:
    for i in range(len(values)):
        found[i] = values[i] * factor


@compiled
def _subtract(values: Floats, factors: Doubles, column: int, others: Floats) -> None:
    for i in range(len(values)):
        total = ZERO
        for j in range(5):
            total += np.float32(factors[j, column]) * others[j, i]
        values[i] -= total
