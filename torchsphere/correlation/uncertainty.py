"""What a solution is worth: status, covariance and coefficient of each pair."""

from __future__ import annotations

import numpy as np
import torch
from torch import Tensor

from torchsphere.correlation import covariance, illumination, residual_noise, znssd
from torchsphere.correlation.gauss_newton import Solution
from torchsphere.correlation.options import Options
from torchsphere.correlation.reference import Reference
from torchsphere.correlation.result import (
    LOW_CORRELATION,
    NOT_CONVERGED,
    OK,
    OUT_OF_FRAME,
    STATUSES,
    WEAK_TEXTURE,
    Correlation,
)
from torchsphere.geometry.motion_models import Displacement


def conclude(
    reference: Reference, solution: Solution, visible: Tensor, model: Displacement, options: Options
) -> Correlation:
    """Status, covariance and coefficient of each pair; what cannot be vouched for becomes NaN.

    ``visible`` (n,) is the number of points in sight, whether they agree or not.
    """
    q, _, converged, warped, weights, jacobian, factor = solution
    coefficient = znssd.zncc(reference.values, warped, weights)
    warped = illumination.relit(reference, warped, weights, model)
    difference = znssd.residual(reference.values, warped, weights)
    power = residual_noise.Power.of(reference, difference, weights)
    gram = znssd.operator(jacobian, weights)
    spread = covariance.increment_covariance(reference, power, weights, q, model, gram, options.pre_blur)
    wider = residual_noise.inflation(reference, jacobian, factor, weights * difference, power, spread)
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
