"""Batched Gauss-Newton on the criterion: from a first guess of each pair's increment to the nearest minimum."""

from __future__ import annotations

import dataclasses
from typing import NamedTuple

import torch
from torch import Tensor

from torchsphere import criterion, interpolate, motion
from torchsphere.motion import Displacement
from torchsphere.reference import Reference, scale, slopes

#: Steps after which a point that has left sight or crop stays out, so that the sum is over fixed points and settles:
#: at 20 deg per frame, points that came and went kept one row in ten from converging.
SETTLE_AFTER = 5


#: Modes are taken anew after a step that moves a point of the ball by more than this, px: a ten-thousandth of the
#: radius changes them by as little.
MODES_HOLD_PX = 0.02


class How(NamedTuple):
    """How to iterate.

    Attributes
    ----------
    max_iterations : int
    tolerance_px : float
        A pair has converged when a step moves no point of the ball by more, px.
    exact : bool
        Take the gradient of the deformed image at each iterate; otherwise that of the reference, once.
    """

    max_iterations: int
    tolerance_px: float
    exact: bool


class Solution(NamedTuple):
    """Where n pairs have come to.

    Attributes
    ----------
    q : Tensor
        Increments (n, k), px and rad.
    iterations : Tensor
        Steps taken (n,).
    converged : Tensor
        (n,), True where the last step was within the tolerance.
    """

    q: Tensor
    iterations: Tensor
    converged: Tensor


def gauss_newton(
    reference: Reference,
    c_g: Tensor,
    shift: Tensor,
    start: Tensor,
    model: Displacement,
    how: How,
) -> Solution:
    """Gauss-Newton from ``start`` (n, k)."""
    result = Solution(
        start.clone(),
        torch.zeros(len(start), dtype=torch.long, device=start.device),
        torch.zeros(len(start), dtype=torch.bool, device=start.device),
    )
    rows = torch.arange(len(start), device=start.device)
    q = at = result.q
    unit = scale(reference, q.shape[-1])
    if not how.exact:
        jacobian, factor = operator(reference, reference.gradient, q, model, reference.weights)
    for turn in range(how.max_iterations):
        if how.exact:
            warped, weights, gradient = warp_with_gradient(reference, c_g, shift, q, model)
            jacobian, factor = operator(reference, gradient, at, model, weights)
        else:
            warped, weights = warp(reference, c_g, shift, q, model)
        if turn >= SETTLE_AFTER:
            reference = dataclasses.replace(reference, weights=weights)
        difference = criterion.residual(reference.values, warped, weights)
        # b = J^T W r sums thousands of products in the images' own precision; the small system is solved in double.
        b = (jacobian * (weights * difference)[..., None]).sum(1)
        step = torch.cholesky_solve(b.double()[..., None], factor)[..., 0].to(q)
        length = step.abs().amax(-1)
        # A step longer than the ball is wide has nothing to do with the images any more.
        sane = length < 2 * reference.geometry.radius
        q = torch.where(sane[:, None], q + step / unit, q)
        done = length < how.tolerance_px
        result.q[rows], result.converged[rows] = q, done
        result.iterations[rows] += 1
        active = torch.nonzero(sane & ~done)[:, 0]
        if len(active) == 0:
            break
        if float(length[active].max()) > MODES_HOLD_PX:
            at = q
        if len(active) < len(rows):
            rows, reference, c_g, shift = rows[active], reference.take(active), c_g[active], shift[active]
            at = q[active] if at is q else at[active]
            q, unit = q[active], unit[active]
            if not how.exact:
                jacobian, factor = jacobian[active], factor[active]
    return result


def operator(
    reference: Reference, gradient: Tensor, q: Tensor, model: Displacement, weights: Tensor
) -> tuple[Tensor, Tensor]:
    """Jacobian (n, p, k) that belongs to the criterion, and the Cholesky factor (n, k, k) of its operator."""
    jacobian = criterion.project(slopes(gradient, q, model, reference), reference.values, weights)
    return jacobian, criterion.cholesky(criterion.operator(jacobian, weights))


def warp(reference: Reference, c_g: Tensor, shift: Tensor, q: Tensor, model: Displacement) -> tuple[Tensor, Tensor]:
    """The deformed image (n, p) at the displaced points, and the weights of the points that are still in sight."""
    points, weights = _displaced(reference, c_g, shift, q, model)
    return interpolate.sample(c_g, points), weights


def warp_with_gradient(
    reference: Reference, c_g: Tensor, shift: Tensor, q: Tensor, model: Displacement
) -> tuple[Tensor, Tensor, Tensor]:
    """`warp`, and the gradient (n, p, 2) of the deformed image at the displaced points, by reverse differentiation."""
    points, weights = _displaced(reference, c_g, shift, q, model)
    with torch.enable_grad():
        nudge = torch.zeros_like(reference.points, requires_grad=True)
        warped = interpolate.sample(c_g, points + nudge)
        # Each value depends on its own point alone, so the gradient of the sum is the gradient at each point.
        (gradient,) = torch.autograd.grad(warped.sum(), nudge)
    return warped.detach(), weights, gradient


def _displaced(
    reference: Reference, c_g: Tensor, shift: Tensor, q: Tensor, model: Displacement
) -> tuple[Tensor, Tensor]:
    """Places (n, p, 2) of the points in the deformed image's crop, and their weights (n, p): 0 where not to be seen."""
    points = reference.points + motion.displacement(model, q, reference.points, reference.geometry) + shift[:, None]
    last = c_g.shape[-1] - 1
    inside = ((points >= 1) & (points <= last - 1)).all(-1)
    return points.nan_to_num(1.0).clamp(1, last - 1), reference.weights * inside
