"""What a solution is worth: status, covariance and coefficient of each pair."""

from __future__ import annotations

import numpy as np
import torch
from torch import Tensor

from torchsphere import covariance, criterion, light, misfit
from torchsphere.correlation import (
    LOW_CORRELATION,
    NOT_CONVERGED,
    OK,
    OUT_OF_FRAME,
    STATUSES,
    WEAK_TEXTURE,
    Correlation,
)
from torchsphere.motion import Displacement
from torchsphere.newton import Solution
from torchsphere.options import Options
from torchsphere.reference import Reference


def conclude(
    reference: Reference, solution: Solution, visible: Tensor, model: Displacement, options: Options
) -> Correlation:
    """Status, covariance and coefficient of each pair; what cannot be vouched for becomes NaN.

    ``visible`` (n,) is the number of points in sight, whether they agree or not.
    """
    q, _, converged, warped, weights, jacobian, factor = solution
    coefficient = criterion.zncc(reference.values, warped, weights)
    warped = light.relit(reference, warped, weights, model)
    difference = criterion.residual(reference.values, warped, weights)
    power = misfit.Power.of(reference, difference, weights)
    gram = criterion.operator(jacobian, weights)
    spread = covariance.increment_covariance(reference, power, weights, q, model, gram, options.pre_blur)
    wider = misfit.inflation(reference, jacobian, factor, weights * difference, power, spread)
    spread = spread * wider[:, :, None] * wider[:, None, :]
    carried = covariance.texture_carries_modes(reference, power, weights, q, model, gram, options.pre_blur)
    points = torch.pi * (options.roi * reference.geometry.radius / reference.spacing) ** 2
    status = torch.full((len(q),), OK, device=q.device)
    for wrong, code in (
        (coefficient < options.min_zncc, LOW_CORRELATION),
        (~converged, NOT_CONVERGED),
        (~carried, WEAK_TEXTURE),
        (visible < options.min_visible * points, OUT_OF_FRAME),
    ):
        status = torch.where(wrong, code, status)
    return _as_correlation(solution, spread, coefficient, status, reference.uneven_light)


def _as_correlation(
    solution: Solution, spread: Tensor, coefficient: Tensor, status: Tensor, uneven_light: bool
) -> Correlation:
    """The result for n pairs of ``status`` (n,), with the covariances ``spread`` (n, k, k) of the model's unknowns."""
    q, good = solution.q, status == OK
    k = min(q.shape[-1], 5)
    full_q = torch.zeros(len(q), 6).to(q)
    full_q[:, : q.shape[-1]] = q
    full_q = torch.where(good[:, None], full_q, torch.nan)
    # What a model does not measure it cannot state an uncertainty of.
    full = torch.full((len(q), 5, 5), torch.nan).to(spread)
    full[:, :k, :k] = spread[:, :k, :k]
    return Correlation(
        q=full_q[:, :5],
        covariance=torch.where(good[:, None, None], full, torch.nan),
        zncc=coefficient,
        iterations=solution.iterations,
        growth=full_q[:, 5],
        uneven_light=torch.full_like(good, uneven_light),
        sd_growth=torch.where(good, spread[:, 5, 5].sqrt() if q.shape[-1] == 6 else 0.0, torch.nan),
        status=np.array(STATUSES)[status.cpu().numpy()],
    )
