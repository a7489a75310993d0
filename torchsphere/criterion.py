"""The criterion: zero-mean normalised sum of squared differences (ZNSSD) over a weighted region, equation (3)."""

from __future__ import annotations

import torch
from torch import Tensor


def residual(values: Tensor, warped: Tensor, weights: Tensor) -> Tensor:
    """``f - a g - b`` (n, p), gain and offset from equal mean and standard deviation: equation (3)."""
    count = weights.sum(-1, keepdim=True).clamp_min(1)
    f = values - (weights * values).sum(-1, keepdim=True) / count
    g = warped - (weights * warped).sum(-1, keepdim=True) / count
    power_f, power_g = ((weights * v.square()).sum(-1, keepdim=True) for v in (f, g))
    return f - (power_f / power_g.clamp_min(1e-12)).sqrt() * g


def zncc(values: Tensor, warped: Tensor, weights: Tensor) -> Tensor:
    """Zero-mean normalised cross-correlation coefficient (n,), -1 to 1; 0 where an image is flat."""
    count = weights.sum(-1, keepdim=True).clamp_min(1)
    f = (values - (weights * values).sum(-1, keepdim=True) / count) * weights
    g = (warped - (weights * warped).sum(-1, keepdim=True) / count) * weights
    power = (f.square().sum(-1) * g.square().sum(-1)).sqrt()
    return torch.where(power > 1e-9, (f * g).sum(-1) / power.clamp_min(1e-9), 0.0)


def project(slopes: Tensor, values: Tensor, weights: Tensor) -> Tensor:
    """Remove from ``slopes`` (n, p, k) their mean and their component along the image ``values`` (n, p).

    Offset and gain take these up, so that without this step the operator would not belong to the criterion.
    """
    count = weights.sum(-1, keepdim=True).clamp_min(1)
    image = (values - (weights * values).sum(-1, keepdim=True) / count) * weights
    centred = slopes - ((weights[..., None] * slopes).sum(1) / count)[:, None]
    along = (image[..., None] * centred).sum(1) / image.square().sum(-1, keepdim=True).clamp_min(1e-12)
    return centred - image[..., None] * along[:, None]


def operator(slopes: Tensor, weights: Tensor) -> Tensor:
    """Correlation operator ``J^T W J`` (n, k, k), float64, of the slopes (n, p, k): equations (7) and (10)."""
    return ((slopes * weights[..., None]).mT @ slopes).double()


def cholesky(operator: Tensor) -> Tensor:
    """Cholesky factor (n, k, k) of symmetric operators that should be positive definite.

    A row that is not (no texture, no points, no numbers) gets the factor of the identity: the step that follows from
    it is senseless, the row does not converge, and the rest of the batch goes on.
    """
    identity = torch.eye(operator.shape[-1]).to(operator)
    scale = operator.diagonal(dim1=-2, dim2=-1).mean(-1)[:, None, None]
    factor, failed = torch.linalg.cholesky_ex(operator + (1e-12 * scale + 1e-30) * identity)
    sound = (failed == 0)[:, None, None] & factor.isfinite().all(-1, keepdim=True).all(-2, keepdim=True)
    return torch.where(sound, factor, identity)
