"""The criterion: zero-mean normalised sum of squared differences (ZNSSD) over a weighted region, equation (3).

Gain and offset make mean and standard deviation of both images agree. Beyond the paper, the models of a rigid ball
allow for light that does not turn with the ball (`nuisances`).
"""

from __future__ import annotations

import torch
from torch import Tensor

from torchsphere.kernels import jit, znssd
from torchsphere.kernels import operator as system


def centred(values: Tensor, weights: Tensor) -> Tensor:
    """``values`` (n, p) without their weighted mean."""
    count = weights.sum(-1, keepdim=True).clamp_min(1)
    return values - torch.linalg.vecdot(weights, values)[:, None] / count


def _power(values: Tensor, weights: Tensor) -> Tensor:
    """Weighted sum (n, 1) of squares, as one pass over the points."""
    return torch.linalg.vecdot(weights * values, values)[:, None]


@jit.in_loops(znssd.residual)
def residual(values: Tensor, warped: Tensor, weights: Tensor) -> Tensor:
    """``f - a g - b`` (n, p), gain and offset from equal mean and standard deviation: equation (3)."""
    f, g = centred(values, weights), centred(warped, weights)
    return f - (_power(f, weights) / _power(g, weights).clamp_min(1e-12)).sqrt() * g


@jit.in_loops(znssd.zncc)
def zncc(values: Tensor, warped: Tensor, weights: Tensor) -> Tensor:
    """Zero-mean normalised cross-correlation coefficient (n,), -1 to 1; 0 where an image is flat."""
    f, g = centred(values, weights) * weights, centred(warped, weights) * weights
    power = (torch.linalg.vecdot(f, f) * torch.linalg.vecdot(g, g)).sqrt()
    return torch.where(power > 1e-9, torch.linalg.vecdot(f, g) / power.clamp_min(1e-9), 0.0)


def nuisances(values: Tensor, weights: Tensor, normals: Tensor | None = None, blurred: Tensor | None = None) -> Tensor:
    """Changes of the image besides the motion (n, m, p): offset, gain of the image ``values`` (n, p), and the light.

    ``normals`` (n, 3, p): unit normals of the ball. Distant light that does not turn with the ball changes a matt
    surface by a linear function of the normal. Without it, three spots made a spin 2.3 % too large.

    ``blurred`` (n, 3, p), for uneven light: change of the normal along the image's gradient times the variance of the
    blur. Spherical harmonics of the normal up to the third order, alone and times the image, then take the normal's
    place: the irradiance of a sphere is smooth (Ramamoorthi and Hanrahan, J. Opt. Soc. Am. A 18 (2001) 2448,
    doi:10.1364/JOSAA.18.002448), and it multiplies the pattern before the blur.
    """
    image = centred(values, weights)[:, None]
    if normals is None or blurred is None:
        known = (torch.ones_like(image), image)
        return torch.cat(known if normals is None else (*known, normals), 1)
    # All terms have one size, since their operator is regularised as a whole.
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
    """First-order change (n, 15, p) of the `harmonics` with the ``change`` (n, 3, p) of the vectors (n, 3, p)."""
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
    """The ``slopes`` (n, k, p) without the part that the ``nuisance`` (n, m, p) explains, as the criterion needs."""
    weighted = nuisance * weights[:, None]
    factor = cholesky((weighted @ nuisance.mT).double())
    along = torch.cholesky_solve((weighted @ slopes.mT).double(), factor).to(slopes)
    return slopes - along.mT @ nuisance


@jit.in_loops(system.gram)
def operator(slopes: Tensor, weights: Tensor) -> Tensor:
    """Correlation operator ``J^T W J`` (n, k, k), float64, of the slopes (n, k, p): equations (7) and (10)."""
    return ((slopes * weights[:, None]) @ slopes.mT).double()


@jit.in_loops(system.cholesky, torch.float64)
def cholesky(operator: Tensor) -> Tensor:
    """Cholesky factor (n, k, k) of symmetric operators; the identity for rows that are not positive definite.

    Such a row (no texture, no points, not finite) does not converge, and the rest of the batch goes on.
    """
    identity = torch.eye(operator.shape[-1]).to(operator)
    # Each term by its own size: the unit of the grey levels must not decide.
    raised = (1e-12 * operator.diagonal(dim1=-2, dim2=-1) + 1e-30).diag_embed()
    factor, failed = torch.linalg.cholesky_ex(operator + raised)
    sound = (failed == 0)[:, None, None] & factor.isfinite().all(-1, keepdim=True).all(-2, keepdim=True)
    return torch.where(sound, factor, identity)
