"""Gauss-Newton with the gradient of the reference, pair by pair."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
import torch
from torch import Tensor

from torchsphere.kernels.jit import ONE, ZERO, Doubles, Floats, arrays, compiled, require_nodes, require_one_size
from torchsphere.kernels.rotation import rotation
from torchsphere.kernels.spline import sample_one
from torchsphere.kernels.znssd import adjusted


class Limits(NamedTuple):
    """Limits of the iteration: see `torchsphere.correlation.gauss_newton`."""

    steps: int  # most steps
    settle_after: int  # steps after which a point that has left sight stays out
    tolerance_px: float  # a pair has converged when a step moves no point of the ball further


class Pairs(NamedTuple):
    """Tensors or arrays of n pairs with p points in the region."""

    c: Any  # splines (n, h, h) of the deformed images
    shift: Any  # (n, 2), to their crops
    surface: Any  # (n, 3, p)
    weights: Any  # (n, p)
    values: Any  # (n, p) of the reference
    jacobian: Any  # (n, 5, p), for all steps
    inverse: Any  # (n, 5, 5), float64, of the operator
    radius: Any  # (n,), px


def descend(
    pairs: Pairs, start: Tensor, limits: Limits, sharpness: float, *, exact: bool
) -> tuple[Tensor, Tensor, Tensor, Tensor, Tensor]:
    """Gauss-Newton from ``start`` (n, 5), px and rad; ``exact``: rotation, or its linearisation."""
    require_nodes(pairs.c, 4)
    require_one_size(0, start, *pairs)
    require_one_size(-1, pairs.surface, pairs.weights, pairs.values, pairs.jacobian)
    n, points = len(start), pairs.jacobian.shape[-1]
    q = start.double().contiguous()
    iterations, converged = torch.zeros(n, dtype=torch.long), torch.zeros(n, dtype=torch.bool)
    warped, weights = torch.empty(n, points), torch.empty(n, points)
    _descend(
        Pairs(*arrays(*pairs)), arrays(q, iterations, converged, warped, weights), limits, np.float32(sharpness), exact
    )
    return q.to(start), iterations, converged, warped, weights


def displaced(
    c: Tensor, surface: Tensor, weights: Tensor, turn: Tensor, middle: Tensor, *, exact: bool
) -> tuple[Tensor, Tensor]:
    """Places (n, p, 2) of the points in crops like ``c`` (n, h, h), and their weights (n, p), 0 out of sight.

    ``surface`` (n, 3, p) is turned by ``turn`` (n, 3, 3) around ``middle`` (n, 2), px of the crop. ``exact``: points
    that turn to the back are out of sight.
    """
    require_one_size(0, c, surface, weights, turn, middle)
    require_one_size(-1, surface, weights)
    points, seen = torch.empty(len(c), 2, weights.shape[-1]), torch.empty(weights.shape)
    _displaced(*arrays(surface, weights, turn, middle, points, seen), c.shape[-1], exact)
    return points.mT, seen


@compiled
def _displaced(
    surface: Floats, weights: Floats, turn: Floats, middle: Floats, points: Floats, seen: Floats, size: int, exact: bool
) -> None:
    for n in range(len(surface)):
        _place(surface[n], weights[n], turn[n], middle[n], size, exact, (points[n, 0], points[n, 1], seen[n]))


@compiled
def _place(
    surface: Floats, weights: Floats, turn: Floats, middle: Floats, size: int, exact: bool, found: tuple[Floats, ...]
) -> None:
    """`displaced` for one pair; the sampling holds points outside the crop at its border."""
    columns, lines, seen = found
    xs, ys, zs = surface[0], surface[1], surface[2]
    centre = np.float32(0.5 * (size - 1))
    left, top = middle[0], middle[1]
    a, b, c, d, e, f = turn[0, 0], turn[0, 1], turn[0, 2], turn[1, 0], turn[1, 1], turn[1, 2]
    away_x, away_y, away_z = (turn[2, 0], turn[2, 1], turn[2, 2]) if exact else (ZERO, ZERO, ZERO)
    for i in range(len(xs)):
        x, y, z = xs[i], ys[i], zs[i]
        column, line = a * x + b * y + c * z + left, d * x + e * y + f * z + top
        across, down = abs(column - centre), abs(line - centre)
        room = centre - ONE - (across if across > down else down)
        hidden = away_x * x + away_y * y + away_z * z
        room = -hidden if -hidden < room else room
        columns[i], lines[i] = column, line
        # NaN is out of sight: no comparison with it holds.
        seen[i] = weights[i] if (room >= ZERO) & (across + down >= ZERO) else ZERO


@compiled
def _descend(pairs: Pairs, found: tuple[Any, ...], limits: Limits, sharpness: np.float32, exact: bool) -> None:
    c, shift, surface, weights, values, jacobian, inverse, radius = pairs
    q, iterations, converged, warped, seen = found
    size = c.shape[-1]
    points = np.empty((2, weights.shape[1]), np.float32)
    counting = np.empty(weights.shape[1], np.float32)
    turn, middle = np.empty((3, 3), np.float32), np.empty(2, np.float32)
    step = np.empty(5)
    for n in range(len(q)):
        _copy(weights[n], counting)
        for turned in range(limits.steps):
            rotation(q[n, 2], q[n, 3], q[n, 4], exact, turn)
            middle[0], middle[1] = q[n, 0] + shift[n, 0], q[n, 1] + shift[n, 1]
            _place(surface[n], counting, turn, middle, size, exact, (points[0], points[1], seen[n]))
            sample_one(c[n], points, sharpness, warped[n])
            if turned >= limits.settle_after:
                _copy(seen[n], counting)
            length = _step(values[n], warped[n], seen[n], jacobian[n], inverse[n], step)
            iterations[n] += 1
            # A step longer than the ball is wide, or NaN, has left the images.
            if not length < 2 * radius[n]:
                break
            for k in range(5):
                q[n, k] += step[k] if k < 2 else step[k] / radius[n]
            if length < limits.tolerance_px:
                converged[n] = True
                break


@compiled
def _copy(values: Floats, found: Floats) -> None:
    for i in range(len(values)):
        found[i] = values[i]


@compiled
def _step(values: Floats, warped: Floats, weights: Floats, jacobian: Floats, inverse: Doubles, step: Doubles) -> float:
    """Gauss-Newton step (5,), px, from the residual of equation (3), and the largest motion of a point."""
    mean_f, mean_g, gain = adjusted(values, warped, weights)
    for j in range(len(step)):
        step[j] = 0
    for k in range(len(jacobian)):
        mode, total = jacobian[k], ZERO
        for i in range(len(values)):
            total += mode[i] * weights[i] * (values[i] - mean_f - gain * (warped[i] - mean_g))
        for j in range(len(step)):
            step[j] += inverse[j, k] * total
    length = 0.0
    for j in range(len(step)):
        if not abs(step[j]) < np.inf:
            return np.inf
        length = max(length, abs(step[j]))
    return length
