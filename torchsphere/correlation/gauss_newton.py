"""Batched Gauss-Newton on the criterion: from a first guess of each pair's increment to the nearest minimum."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from typing import NamedTuple

import torch
from torch import Tensor

from torchsphere import kernels
from torchsphere.correlation import znssd
from torchsphere.correlation.reference import IN_CLOSED_FORM, Reference, scale
from torchsphere.correlation.warp import operator, warp, warp_with_gradient
from torchsphere.geometry import motion_models
from torchsphere.geometry.motion_models import Displacement
from torchsphere.imaging import interpolation
from torchsphere.kernels import gauss_newton as descent

#: Steps after which a point that has left sight or crop stays out, so that the sum is over fixed points and settles:
#: at 20 deg per frame, points that came and went kept one row in ten from converging.
SETTLE_AFTER = 5


#: Every how many points the increments are brought near on, in at most so many steps, until a step moves no point by
#: more than so many px, and the points that this must leave. Measured at R = 50: the few points alone are off by
#: 0.01 px, from where two steps on all points do instead of three or more.
EVERY, APPROACH_STEPS, APPROACHED_PX, FEWEST = 4, 10, 0.05, 400

#: Steps from one look at how far all rows are to the next. A GPU has to come to rest for it, which costs more than
#: steps that rows no longer need; on a CPU it costs nothing.
LOOK_EVERY, LOOK_EVERY_ON_GPU = 1, 4

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


class Approach(NamedTuple):
    """Where n pairs have been brought to on a few of their points.

    Attributes
    ----------
    near : Tensor
        Unknowns (n, k), px and rad; those of a row that did not come to rest are where it started.
    steps : Tensor
        Steps taken (n,).
    at_rest : Tensor
        (n,), True where the iteration came to rest.
    """

    near: Tensor
    steps: Tensor
    at_rest: Tensor

    @classmethod
    def none(cls, start: Tensor) -> Approach:
        """For pairs that stay at ``start`` (n, k)."""
        steps = torch.zeros(len(start), dtype=torch.long, device=start.device)
        return cls(start, steps, torch.ones_like(steps, dtype=torch.bool))

    @classmethod
    def joined(cls, parts: Sequence[Approach]) -> Approach:
        """The rows of all parts, one after the other."""
        return cls(*(torch.cat(values) for values in zip(*parts, strict=True)))


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
    warped, weights : Tensor
        The deformed image (n, p) and the weights (n, p) before the last step, which was too short to change them.
    jacobian, factor : Tensor
        Of the criterion (n, k, p), px per px, and the Cholesky factor (n, k, k) of its operator, as used last.
    """

    q: Tensor
    iterations: Tensor
    converged: Tensor
    warped: Tensor
    weights: Tensor
    jacobian: Tensor
    factor: Tensor


def bring_near(
    reference: Reference, c_g: Tensor, shift: Tensor, start: Tensor, model: Displacement, how: How
) -> Approach:
    """Unknowns brought near from ``start`` (n, k) on a thin reference."""
    quick = How(min(APPROACH_STEPS, how.max_iterations), max(APPROACHED_PX, how.tolerance_px), how.exact)
    near = gauss_newton(reference, c_g, shift, start, model, quick)
    return Approach(torch.where(near.converged[:, None], near.q, start), near.iterations, near.converged)


def gauss_newton(
    reference: Reference,
    c_g: Tensor,
    shift: Tensor,
    start: Tensor,
    model: Displacement,
    how: How,
) -> Solution:
    """Gauss-Newton from ``start`` (n, k)."""
    if not how.exact and model in IN_CLOSED_FORM and kernels.suits(c_g, start, reference.weights):
        return _descend(reference, c_g, shift, start, model, how)
    n, device = len(start), start.device
    result = Solution(
        start.clone(),
        torch.zeros(n, dtype=torch.long, device=device),
        torch.zeros(n, dtype=torch.bool, device=device),
        *(torch.empty(0),) * 4,
    )
    rows = torch.arange(n, device=device)
    q = at = result.q
    over = torch.zeros_like(result.converged)
    look_every = LOOK_EVERY if device.type == "cpu" else LOOK_EVERY_ON_GPU
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
        difference = znssd.residual(reference.values, warped, weights)
        # b = J^T W r sums thousands of products in the images' own precision; the small system is solved in double.
        b = (jacobian * (weights * difference)[:, None]).sum(-1)
        step = torch.cholesky_solve(b.double()[..., None], factor)[..., 0].to(q)
        length = step.abs().amax(-1)
        # A step longer than the ball is wide has nothing to do with the images any more.
        sane = length < 2 * reference.geometry.radius
        # A row that is over stays as it is while the others go on.
        going = ~over
        q = torch.where((going & sane)[:, None], q + step / scale(reference, q.shape[-1]), q)
        done = length < how.tolerance_px
        result.q[rows], result.iterations[rows] = q, result.iterations[rows] + going
        result.converged[rows] |= going & done
        over = over | done | ~sane
        if (turn + 1) % look_every and turn < how.max_iterations - 1:
            at = q
            continue
        left = int((~over).sum())
        last = left == 0 or turn == how.max_iterations - 1
        if last or 2 * left <= len(rows):
            result = _noted(result, rows, (warped, weights, jacobian, factor))
        if last:
            break
        if float((length * going).max()) > MODES_HOLD_PX:
            at = q
        if 2 * left <= len(rows):
            # To leave the others out copies all that belongs to these: worth it where they are half of them at most.
            active = torch.nonzero(~over)[:, 0]
            rows, reference, c_g, shift = rows[active], reference.take(active), c_g[active], shift[active]
            at = q[active] if at is q else at[active]
            q, over = q[active], over[active]
            if not how.exact:
                jacobian, factor = jacobian[active], factor[active]
    return result


def _descend(
    reference: Reference, c_g: Tensor, shift: Tensor, start: Tensor, model: Displacement, how: How
) -> Solution:
    """`gauss_newton` pair by pair, in compiled loops."""
    jacobian, factor = operator(reference, reference.gradient, start, model, reference.weights)
    found = descent.descend(
        c_g,
        shift,
        start,
        (reference.surface, reference.weights, reference.values),
        jacobian,
        torch.cholesky_inverse(factor),
        reference.geometry.radius,
        descent.Limits(how.max_iterations, SETTLE_AFTER, how.tolerance_px),
        interpolation.SHARPNESS,
        exact=model is motion_models.finite,
    )
    return Solution(*found, jacobian, factor)


def _noted(result: Solution, rows: Tensor, now: tuple[Tensor, ...]) -> Solution:
    """The result with what ``rows`` (m,) have come to: warped images, weights, Jacobians and factors."""
    if len(rows) == len(result.q):
        return Solution(*result[:3], *now)
    return Solution(
        *result[:3], *(whole.index_copy(0, rows, part) for whole, part in zip(result[3:], now, strict=True))
    )
