"""The criterion: zero-mean normalised sum of squared differences (ZNSSD) over a weighted region, equation (3)."""

from __future__ import annotations

import torch
from torch import Tensor


def centred(values: Tensor, weights: Tensor) -> Tensor:
    """``values`` (n, p) without their weighted mean."""
    count = weights.sum(-1, keepdim=True).clamp_min(1)
    return values - torch.linalg.vecdot(weights, values)[:, None] / count


def _power(values: Tensor, weights: Tensor) -> Tensor:
    """Weighted sum (n, 1) of squares; a scalar product is one pass over the points where a sum of products is three."""
    return torch.linalg.vecdot(weights * values, values)[:, None]


def residual(values: Tensor, warped: Tensor, weights: Tensor) -> Tensor:
    """``f - a g - b`` (n, p), gain and offset from equal mean and standard deviation: equation (3)."""
    f, g = centred(values, weights), centred(warped, weights)
    return f - (_power(f, weights) / _power(g, weights).clamp_min(1e-12)).sqrt() * g


def zncc(values: Tensor, warped: Tensor, weights: Tensor) -> Tensor:
    """Zero-mean normalised cross-correlation coefficient (n,), -1 to 1; 0 where an image is flat."""
    f, g = centred(values, weights) * weights, centred(warped, weights) * weights
    power = (torch.linalg.vecdot(f, f) * torch.linalg.vecdot(g, g)).sqrt()
    return torch.where(power > 1e-9, torch.linalg.vecdot(f, g) / power.clamp_min(1e-9), 0.0)


def project(slopes: Tensor, values: Tensor, weights: Tensor) -> Tensor:
    """Remove from ``slopes`` (n, k, p) their mean and their component along the image ``values`` (n, p).

    Offset and gain take these up, so that without this step the operator would not belong to the criterion.
    """
    count = weights.sum(-1)[:, None].clamp_min(1)
    image = (centred(values, weights) * weights)[:, None]
    level = slopes - (torch.linalg.vecdot(weights[:, None], slopes) / count)[..., None]
    along = torch.linalg.vecdot(image, level) / image.square().sum(-1).clamp_min(1e-12)
    return level - image * along[..., None]


def operator(slopes: Tensor, weights: Tensor) -> Tensor:
    """Correlation operator ``J^T W J`` (n, k, k), float64, of the slopes (n, k, p): equations (7) and (10)."""
    return ((slopes * weights[:, None]) @ slopes.mT).double()


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
