"""Robust least squares: a circle's correction from the shifts of its outline along rays, by Tukey's biweight."""

from __future__ import annotations

import numpy as np
import torch
from torch import Tensor

from torchsphere.runtime.arrays import Array

#: Tukey's constant for 95 % efficiency under Gaussian errors.
TUKEY = 4.685


def least_squares(design: Tensor, shift: Tensor, precision: Tensor) -> tuple[Tensor, Tensor, Tensor]:
    """Reweighted least squares of ``design @ c = shift`` -> c (n, k), weights (n, a), normal matrices (n, k, k).

    ``precision`` (n, a) are the first weights. In NumPy, which takes half of torch's time for arrays this small.
    """
    across, shifts, first = design.numpy(), shift.numpy(), _relative(precision).numpy()
    k, root, weights = across.shape[1], np.sqrt(first), first
    products = (across[:, :, None] * across[:, None]).reshape(-1, k * k)
    # A fit that failed is NaN, and so is its result.
    with np.errstate(invalid="ignore"):
        for _ in range(12):
            normal = (weights @ products).reshape(-1, k, k) + 1e-9 * np.eye(k)
            solution = np.linalg.solve(normal, ((weights * shifts) @ across)[..., None])[..., 0]
            # Deviations in units of their expected size, which is inverse to the step's height.
            residual = (shifts - solution @ across.T) * root
            scale = _weighted_median(np.abs(residual), first) * 1.4826
            weights = first * np.maximum(1 - np.square(residual / (TUKEY * np.maximum(scale, 1e-3))), 0.0) ** 2
    return torch.from_numpy(solution), torch.from_numpy(weights), torch.from_numpy(normal)


def _relative(precision: Tensor) -> Tensor:
    """Each row (n, a) in units of its largest value."""
    return precision / precision.amax(-1, keepdim=True).clamp_min(1e-12)


def covariance(shift: Tensor, precision: Tensor, weights: Tensor, normal: Tensor) -> Tensor:
    """Covariance (n, k, k) of the result of `least_squares`, which leaves the residual ``shift`` (n, a)."""
    residual, used = shift * _relative(precision).sqrt(), (weights > 0).double()
    variance = (used * residual.square()).sum(-1) / (used.sum(-1) - normal.shape[-1]).clamp_min(1)
    return (variance * run_length(residual * used))[:, None, None] * torch.linalg.inv(normal)


def _weighted_median(values: Array, weights: Array) -> Array:
    """Weighted median (n, 1) of each row of ``values`` (n, a)."""
    order, rows = values.argsort(-1), np.arange(len(values))
    share = weights[rows[:, None], order].cumsum(-1)
    at = np.minimum((share < 0.5 * share[:, -1:]).sum(-1), values.shape[-1] - 1)
    return values[rows, order[rows, at]][:, None]


def run_length(residual: Tensor) -> Tensor:
    """Number (n,) of neighbouring rays with correlated errors: sum of the autocorrelation, at least 1."""
    power = torch.fft.rfft(residual).abs().square()
    correlation = torch.fft.irfft(power, n=residual.shape[-1])
    correlation = correlation / correlation[:, :1].clamp_min(1e-12)
    # Beyond its first zero the autocorrelation is noise.
    half = correlation[:, : residual.shape[-1] // 2]
    before = (half <= 0).cumsum(-1) == 0
    return (2 * (half * before).sum(-1) - 1).clamp_min(1.0)
