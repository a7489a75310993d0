"""Gauss-Newton with the reference's gradient, pair by pair: where the points go, what is seen there, the next step."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from torchsphere.kernels.jit import arrays, compiled, require_one_size, require_room
from torchsphere.kernels.rotation import rotation
from torchsphere.kernels.spline import sample_one
from torchsphere.kernels.znssd import adjusted

Array = NDArray[np.float32]
Double = NDArray[np.float64]

_ZERO, _ONE = np.float32(0), np.float32(1)


class Limits(NamedTuple):
    """When to end: see `torchsphere.correlation.gauss_newton`.

    Attributes
    ----------
    steps, settle_after : int
        Steps at most, and those after which a point that has left sight stays out.
    tolerance_px : float
        A pair has converged when a step moves no point of the ball by more.
    """

    steps: int
    settle_after: int
    tolerance_px: float


class Descended(NamedTuple):
    """Where n pairs have come to: see `gauss_newton.Solution`."""

    q: Tensor
    iterations: Tensor
    converged: Tensor
    warped: Tensor
    weights: Tensor


def descend(
    c: Tensor,
    shift: Tensor,
    start: Tensor,
    region: tuple[Tensor, Tensor, Tensor],
    jacobian: Tensor,
    inverse: Tensor,
    radius: Tensor,
    limits: Limits,
    sharpness: float,
    *,
    exact: bool,
) -> Descended:
    """Gauss-Newton from ``start`` (n, 5), px and rad, with one ``jacobian`` (n, 5, p) for all steps.

    ``c`` (n, h, h) are the splines of the deformed images, ``shift`` (n, 2) leads to their crops, ``region`` is the
    surface (n, 3, p), weights (n, p) and values (n, p) of the reference; ``inverse`` (n, 5, 5), float64, is that of the
    operator; ``radius`` (n,), px. ``exact``: with the rotation itself, otherwise with its linearisation.
    """
    require_room(c, 4)
    require_one_size(0, c, shift, start, *region, jacobian, inverse, radius)
    require_one_size(-1, *region, jacobian)
    n, points = len(start), jacobian.shape[-1]
    q = start.double().contiguous()
    iterations, converged = torch.zeros(n, dtype=torch.long), torch.zeros(n, dtype=torch.bool)
    warped, weights = torch.empty(n, points), torch.empty(n, points)
    given = arrays(c, shift, *region, jacobian, inverse, radius, q, iterations, converged, warped, weights)
    _descend(*given, limits, np.float32(sharpness), exact)
    return Descended(q.to(start), iterations, converged, warped, weights)


def look(
    c: Tensor, surface: Tensor, weights: Tensor, turn: Tensor, middle: Tensor, *, exact: bool
) -> tuple[Tensor, Tensor]:
    """Places (n, p, 2) of the points in crops like ``c`` (n, h, h), and their weights there (n, p), 0 where not seen.

    The ball's front ``surface`` (n, 3, p), with ``weights`` (n, p), is turned by the matrices ``turn`` (n, 3, 3) around
    ``middle`` (n, 2), px of the crop. ``exact``: what turns to the back is out of sight.
    """
    require_one_size(0, c, surface, weights, turn, middle)
    require_one_size(-1, surface, weights)
    points, seen = torch.empty(len(c), 2, weights.shape[-1]), torch.empty(weights.shape)
    _look(*arrays(surface, weights, turn, middle, points, seen), c.shape[-1], exact)
    return points.mT, seen


@compiled
def _look(
    surface: Array, weights: Array, turn: Array, middle: Array, points: Array, seen: Array, size: int, exact: bool
) -> None:
    for n in range(len(surface)):
        _place(surface[n], weights[n], turn[n], middle[n], size, exact, points[n, 0], points[n, 1], seen[n])


@compiled
def _place(
    surface: Array,
    weights: Array,
    turn: Array,
    middle: Array,
    size: int,
    exact: bool,
    columns: Array,
    lines: Array,
    seen: Array,
) -> None:
    """`look` for one pair; points that leave the crop are left to the sampling, which holds them at its border."""
    xs, ys, zs = surface[0], surface[1], surface[2]
    centre = np.float32(0.5 * (size - 1))
    left, top = middle[0], middle[1]
    a, b, c, d, e, f = turn[0, 0], turn[0, 1], turn[0, 2], turn[1, 0], turn[1, 1], turn[1, 2]
    away_x, away_y, away_z = (turn[2, 0], turn[2, 1], turn[2, 2]) if exact else (_ZERO, _ZERO, _ZERO)
    for i in range(len(xs)):
        x, y, z = xs[i], ys[i], zs[i]
        column, line = a * x + b * y + c * z + left, d * x + e * y + f * z + top
        across, down = abs(column - centre), abs(line - centre)
        room = centre - _ONE - (across if across > down else down)
        hidden = away_x * x + away_y * y + away_z * z
        room = -hidden if -hidden < room else room
        columns[i], lines[i] = column, line
        # What is no number is nowhere: no comparison with it holds.
        seen[i] = weights[i] if (room >= _ZERO) & (across + down >= _ZERO) else _ZERO


@compiled
def _descend(
    c: Array,
    shift: Array,
    surface: Array,
    weights: Array,
    values: Array,
    jacobian: Array,
    inverse: Double,
    radius: Array,
    q: Double,
    iterations: NDArray[np.int64],
    converged: NDArray[np.bool_],
    warped: Array,
    seen: Array,
    limits: Limits,
    sharpness: np.float32,
    exact: bool,
) -> None:
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
            _place(surface[n], counting, turn, middle, size, exact, points[0], points[1], seen[n])
            sample_one(c[n], points, sharpness, warped[n])
            if turned >= limits.settle_after:
                _copy(seen[n], counting)
            length = _step(values[n], warped[n], seen[n], jacobian[n], inverse[n], step)
            iterations[n] += 1
            # A step longer than the ball is wide has nothing to do with the images any more; nor has what is no number.
            if not length < 2 * radius[n]:
                break
            for k in range(5):
                q[n, k] += step[k] if k < 2 else step[k] / radius[n]
            if length < limits.tolerance_px:
                converged[n] = True
                break


@compiled
def _copy(values: Array, found: Array) -> None:
    for i in range(len(values)):
        found[i] = values[i]


@compiled
def _step(values: Array, warped: Array, weights: Array, jacobian: Array, inverse: Double, step: Double) -> float:
    """The Gauss-Newton step (5,), px, from the residual of equation (3), and how far it moves a point at most."""
    mean_f, mean_g, gain = adjusted(values, warped, weights)
    for j in range(len(step)):
        step[j] = 0
    for k in range(len(jacobian)):
        mode, total = jacobian[k], _ZERO
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
