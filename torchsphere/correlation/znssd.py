"""The criterion: zero-mean normalised sum of squared differences (ZNSSD) over a weighted region, equation (3)."""

from __future__ import annotations

import torch
from torch import Tensor

from torchsphere import kernels
from torchsphere.kernels import operator as system
from torchsphere.kernels import znssd


def centred(values: Tensor, weights: Tensor) -> Tensor:
    """``values`` (n, p) without their weighted mean."""
    count = weights.sum(-1, keepdim=True).clamp_min(1)
    return values - torch.linalg.vecdot(weights, values)[:, None] / count


def _power(values: Tensor, weights: Tensor) -> Tensor:
    """Weighted sum (n, 1) of squares; a scalar product is one pass over the points where a sum of products is three."""
    return torch.linalg.vecdot(weights * values, values)[:, None]


def residual(values: Tensor, warped: Tensor, weights: Tensor) -> Tensor:
    """``f - a g - b`` (n, p), gain and offset from equal mean and standard deviation: equation (3)."""
    if kernels.suits(values, warped, weights):
        return znssd.residual(values, warped, weights)
    f, g = centred(values, weights), centred(warped, weights)
    return f - (_power(f, weights) / _power(g, weights).clamp_min(1e-12)).sqrt() * g


def zncc(values: Tensor, warped: Tensor, weights: Tensor) -> Tensor:
    """Zero-mean normalised cross-correlation coefficient (n,), -1 to 1; 0 where an image is flat."""
    if kernels.suits(values, warped, weights):
        return znssd.zncc(values, warped, weights)
    f, g = centred(values, weights) * weights, centred(warped, weights) * weights
    power = (torch.linalg.vecdot(f, f) * torch.linalg.vecdot(g, g)).sqrt()
    return torch.where(power > 1e-9, torch.linalg.vecdot(f, g) / power.clamp_min(1e-9), 0.0)


def nuisances(values: Tensor, weights: Tensor, normals: Tensor | None = None, blurred: Tensor | None = None) -> Tensor:
    """What may change besides the motion (n, m, p): offset, gain of the image ``values`` (n, p), and the light.

    Parameters
    ----------
    values, weights : Tensor
        Image (n, p) and weights (n, p).
    normals : Tensor, optional
        Of the ball's surface at the points (n, 3, p), unit vectors. The light stays where it is while the ball turns: a
        matt surface of the pattern's mean albedo then changes by a linear function of the normal, whatever the number
        and places of distant lamps. Without it, three spots made a spin 2.3 % too large and shifted the ball by 0.005
        px per frame; with it 0.5 % and 0.001 px. (The pattern times the normal would hold the pattern's part of the
        change, too; measured on balls in flat light it costs a bias of 0.001 px per frame, more than it mends.)
    blurred : Tensor, optional
        For light that changes unevenly (pairs that `light_is_uneven` picks out): spherical harmonics of the normal up
        to the third order, alone and times the image, take the normal's place. The irradiance of a sphere is smooth
        (Ramamoorthi and Hanrahan, J. Opt. Soc. Am. A 18 (2001) 2448, doi:10.1364/JOSAA.18.002448), and it multiplies
        the pattern before both are blurred, which shifts the pattern towards the light: `blurred` (n, 3, p) is the
        change of the normal along the image's gradient times the variance of the blur. Without it, light that falls by
        a tenth at one limb moved the ball by 0.002 px.
    """
    image = centred(values, weights)[:, None]
    if normals is None or blurred is None:
        known = (torch.ones_like(image), image)
        return torch.cat(known if normals is None else (*known, normals), 1)
    # Of the size of the others: the operator of all is regularised as a whole.
    size = (_power(image[:, 0], weights) / weights.sum(-1, keepdim=True).clamp_min(1)).sqrt().clamp_min(1e-6)[:, None]
    light, changes = harmonics(normals), harmonic_changes(normals, blurred)
    return torch.cat((torch.ones_like(image), image / size, light, (image * light + changes) / size), 1)


def harmonics(normals: Tensor) -> Tensor:
    """Spherical harmonics (n, 15, p) of the orders 1 to 3 of unit vectors (n, 3, p), up to factors."""
    x, y, z = normals.unbind(1)
    along, across, both = 5 * z * z - 1, x * x - y * y, x * y
    values = (
        *(x, y, z, both, x * z, y * z, across, 3 * z * z - 1),
        *(x * along, y * along, z * (along - 2), z * across, both * z),
        *(x * (across - 2 * y * y), y * (across + 2 * x * x)),
    )
    return torch.stack(values, 1)


def harmonic_changes(normals: Tensor, change: Tensor) -> Tensor:
    """How `harmonics` (n, 15, p) change, to first order, with the ``change`` (n, 3, p) of the vectors (n, 3, p)."""
    (x, y, z), (a, b, c) = normals.unbind(1), change.unbind(1)
    along, across, both = 5 * z * z - 1, x * x - y * y, x * y
    turned = 2 * (x * a - y * b)
    changes = (
        *(a, b, c, a * y + b * x, a * z + c * x, b * z + c * y, turned, 6 * z * c),
        *(a * along + 10 * x * z * c, b * along + 10 * y * z * c, 3 * c * along, c * across + z * turned),
        *(z * (a * y + b * x) + c * both, 3 * (a * across - 2 * b * both), 3 * (b * across + 2 * a * both)),
    )
    return torch.stack(changes, 1)


def project(slopes: Tensor, nuisance: Tensor, weights: Tensor) -> Tensor:
    """Remove from ``slopes`` (n, k, p) what the ``nuisance`` (n, m, p) explains.

    Offset, gain and light take these up, so that without this step the operator would not belong to the criterion.
    """
    weighted = nuisance * weights[:, None]
    factor = cholesky((weighted @ nuisance.mT).double())
    along = torch.cholesky_solve((weighted @ slopes.mT).double(), factor).to(slopes)
    return slopes - along.mT @ nuisance


def operator(slopes: Tensor, weights: Tensor) -> Tensor:
    """Correlation operator ``J^T W J`` (n, k, k), float64, of the slopes (n, k, p): equations (7) and (10)."""
    if kernels.suits(slopes, weights):
        return system.gram(slopes, weights)
    return ((slopes * weights[:, None]) @ slopes.mT).double()


def cholesky(operator: Tensor) -> Tensor:
    """Cholesky factor (n, k, k) of symmetric operators that should be positive definite.

    A row that is not (no texture, no points, no numbers) gets the factor of the identity: the step that follows from
    it is senseless, the row does not converge, and the rest of the batch goes on.
    """
    if operator.device.type == "cpu" and operator.dtype == torch.float64 and not operator.requires_grad:
        return system.cholesky(operator)
    identity = torch.eye(operator.shape[-1]).to(operator)
    scale = operator.diagonal(dim1=-2, dim2=-1).mean(-1)[:, None, None]
    factor, failed = torch.linalg.cholesky_ex(operator + (1e-12 * scale + 1e-30) * identity)
    sound = (failed == 0)[:, None, None] & factor.isfinite().all(-1, keepdim=True).all(-2, keepdim=True)
    return torch.where(sound, factor, identity)
