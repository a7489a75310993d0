"""Batched Gauss-Newton on the criterion: from a first guess of each pair's increment to the nearest minimum."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from typing import NamedTuple

import torch
from torch import Tensor

from torchsphere.correlation import znssd
from torchsphere.correlation.reference import Reference, scale
from torchsphere.correlation.warp import operator, warp, warp_with_gradient
from torchsphere.geometry import motion_models
from torchsphere.geometry.motion_models import Displacement
from torchsphere.imaging import interpolation
from torchsphere.kernels import gauss_newton as descent
from torchsphere.kernels import jit

#: Steps after which a point that left sight or crop stays out (docs/constants.toml).
SETTLE_AFTER = 5

#: Steps from one test for convergence to the next, on a CPU and on a GPU (docs/constants.toml).
CHECK_STEP, CHECK_STEP_ON_GPU = 1, 4

#: Largest motion of a point in a step after which the modes are kept, px (docs/constants.toml).
MODES_HOLD_PX = 0.02


class SolverSettings(NamedTuple):
    """When the iteration ends, and with which gradient."""

    max_iterations: int
    tolerance_px: float  # a pair has converged when a step moves no point of the ball by more
    exact: bool  # gradient of the deformed image at each iterate; otherwise that of the reference, once


class CoarseSolution(NamedTuple):
    """Unknowns of n pairs, solved on a part of the points."""

    q: Tensor  # unknowns (n, k), px and rad; the start where the iteration did not converge
    iterations: Tensor  # steps taken (n,)
    converged: Tensor  # (n,), bool

    @classmethod
    def none(cls, start: Tensor) -> CoarseSolution:
        """For pairs that stay at ``start`` (n, k)."""
        steps = torch.zeros(len(start), dtype=torch.long, device=start.device)
        return cls(start, steps, torch.ones_like(steps, dtype=torch.bool))

    @classmethod
    def joined(cls, parts: Sequence[CoarseSolution]) -> CoarseSolution:
        """The rows of all parts, one after the other."""
        return cls(*(torch.cat(values) for values in zip(*parts, strict=True)))


class Solution(NamedTuple):
    """Increments of n pairs and the last iterate's images and operator."""

    q: Tensor  # increments (n, k), px and rad
    iterations: Tensor  # steps taken (n,)
    converged: Tensor  # (n,), True where the last step was within the tolerance
    warped: Tensor  # deformed image (n, p) before the last step, which was too short to change it
    weights: Tensor  # weights (n, p) before the last step
    jacobian: Tensor  # Jacobian of the criterion (n, k, p), px per px, as used last
    factor: Tensor  # Cholesky factor (n, k, k) of its operator


def gauss_newton(
    reference: Reference, c_g: Tensor, shift: Tensor, start: Tensor, model: Displacement, settings: SolverSettings
) -> Solution:
    """Gauss-Newton from ``start`` (n, k)."""
    if not settings.exact and model in motion_models.CLOSED_FORM and jit.suits(c_g, start, reference.weights):
        return _descend(reference, c_g, shift, start, model, settings)
    n, device = len(start), start.device
    result = Solution(
        start.clone(),
        torch.zeros(n, dtype=torch.long, device=device),
        torch.zeros(n, dtype=torch.bool, device=device),
        *(torch.empty(0),) * 4,
    )
    rows = torch.arange(n, device=device)
    q = at = result.q
    ended = torch.zeros_like(result.converged)
    check_step = CHECK_STEP if device.type == "cpu" else CHECK_STEP_ON_GPU
    if not settings.exact:
        jacobian, factor = operator(reference, reference.gradient, q, model, reference.weights)
    for turn in range(settings.max_iterations):
        if settings.exact:
            warped, weights, gradient = warp_with_gradient(reference, c_g, shift, q, model)
            jacobian, factor = operator(reference, gradient, at, model, weights)
        else:
            warped, weights = warp(reference, c_g, shift, q, model)
        if turn >= SETTLE_AFTER:
            reference = dataclasses.replace(reference, weights=weights)
        difference = znssd.residual(reference.values, warped, weights)
        # b = J^T W r sums thousands of products in the images' own precision; the small system is solved in double.
        b = (jacobian * (weights * difference)[:, None]).sum(-1)
        step = torch.cholesky_solve(b.double()[..., None], factor)[..., 0].to(q)
        length = step.abs().amax(-1)
        # A step longer than the ball's diameter is invalid.
        sane = length < 2 * reference.geometry.radius
        # A row that has ended keeps its values while the others go on.
        going = ~ended
        q = torch.where((going & sane)[:, None], q + step / scale(reference, q.shape[-1]), q)
        done = length < settings.tolerance_px
        result.q[rows], result.iterations[rows] = q, result.iterations[rows] + going
        result.converged[rows] |= going & done
        ended = ended | done | ~sane
        if (turn + 1) % check_step and turn < settings.max_iterations - 1:
            at = q
            continue
        left = int((~ended).sum())
        last = left == 0 or turn == settings.max_iterations - 1
        if last or 2 * left <= len(rows):
            result = _stored(result, rows, (warped, weights, jacobian, factor))
        if last:
            break
        if float((length * going).max()) > MODES_HOLD_PX:
            at = q
        if 2 * left <= len(rows):
            # Dropping the ended rows copies the others: worth the time only where at least half have ended.
            active = torch.nonzero(~ended)[:, 0]
            rows, reference, c_g, shift = rows[active], reference.take(active), c_g[active], shift[active]
            at = q[active] if at is q else at[active]
            q, ended = q[active], ended[active]
            if not settings.exact:
                jacobian, factor = jacobian[active], factor[active]
    return result


def _descend(
    reference: Reference, c_g: Tensor, shift: Tensor, start: Tensor, model: Displacement, settings: SolverSettings
) -> Solution:
    """`gauss_newton` pair by pair, in compiled loops."""
    jacobian, factor = operator(reference, reference.gradient, start, model, reference.weights)
    region = reference.surface, reference.weights, reference.values
    inverse, radius = torch.cholesky_inverse(factor), reference.geometry.radius
    pairs = descent.Pairs(c_g, shift, *region, jacobian, inverse, radius)
    limits = descent.Limits(settings.max_iterations, SETTLE_AFTER, settings.tolerance_px)
    found = descent.descend(pairs, start, limits, interpolation.SHARPNESS, exact=model is motion_models.finite)
    return Solution(*found, jacobian, factor)


def _stored(result: Solution, rows: Tensor, values: tuple[Tensor, ...]) -> Solution:
    """The result with the warped images, weights, Jacobians and factors of ``rows`` (m,)."""
    if len(rows) == len(result.q):
        return Solution(*result[:3], *values)
    merged = (whole.index_copy(0, rows, part) for whole, part in zip(result[3:], values, strict=True))
    return Solution(*result[:3], *merged)
