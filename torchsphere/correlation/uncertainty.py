"""Status, covariance and correlation coefficient of each solved pair."""

from __future__ import annotations

import torch
from torch import Tensor

from torchsphere.correlation import frame_status, illumination, residual_noise, znssd
from torchsphere.correlation.gauss_newton import Solution
from torchsphere.correlation.options import Options
from torchsphere.correlation.reference import COVARIANCE_STEP, Reference, scale
from torchsphere.correlation.residual_noise import ResidualPower
from torchsphere.correlation.result import Correlation
from torchsphere.correlation.warp import projected_slopes
from torchsphere.geometry import motion_models, rotation
from torchsphere.geometry.motion_models import Displacement
from torchsphere.imaging import interpolation

#: Least energy of the gradients over that of noise, in the worst combination of modes (docs/constants.toml).
MIN_TEXTURE_SIGNAL = 3.0

#: Largest ratio of the best to the worst combination of modes in that measure (docs/constants.toml).
MAX_CONDITION = 15.0

#: Every how many points the products of the modes use: the modes change slowly over the ball.
MODES_STEP = 8

#: Contrast of a flat image in float32, share of the grey level: interpolation adds up to a hundred rounded terms.
FLAT_CONTRAST = 1e-5


def increment_covariance(
    reference: Reference, power: ResidualPower, weights: Tensor, q: Tensor, model: Displacement, operator: Tensor
) -> Tensor:
    """Covariance (n, k, k), float64, of the increments ``q`` (n, k): px and rad.

    Without pre-blur: ``2 sigma^2 M^-1``, the residual's variance times the inverse of the ``operator``. The pre-blur
    correlates the noise of neighbouring pixels: then ``M^-1 N M^-1`` with ``N`` of the gradients blurred once more, and
    the residual's variance is divided by the blur's gain. ``N`` shrinks with the density of the points.
    """
    k = q.shape[-1]
    thinned = reference.thinned()
    gradient, thinned_weights = thinned.blurred_gradient, weights[:, ::COVARIANCE_STEP]
    _, products = projected_slopes(thinned, gradient, q, model, thinned_weights)
    noise_operator = COVARIANCE_STEP * products / reference.spacing**2
    value_gain, _ = interpolation.noise_gains(reference.pre_blur)
    freedom = (power.weight - k - 2).clamp_min(1)
    variance = power.square.double() / freedom / value_gain
    inverse = torch.cholesky_inverse(znssd.cholesky(operator))
    in_px = variance[:, None, None] * inverse @ noise_operator @ inverse
    unit = scale(reference, k).double()
    return in_px / (unit[:, :, None] * unit[:, None])


def texture_carries_modes(
    reference: Reference, power: ResidualPower, weights: Tensor, q: Tensor, model: Displacement, operator: Tensor
) -> Tensor:
    """True (n,) where the texture determines every mode.

    The ``operator`` (n, k, k) relative to that of white noise over the same region does not depend on the geometry. It
    shows gradients of noise alone (a plain ball) and gradients on a part of the ball only (a highlight).
    """
    value_gain, slope_gain = interpolation.noise_gains(reference.pre_blur)
    # Two upper bounds: the residual exceeds the noise where the match fails, the raw image's where the texture is fine.
    # Half of the residual's variance belongs to each image.
    from_residual = power.square / power.weight.clamp_min(1) / (2 * value_gain)
    noise = torch.minimum(from_residual, reference.noise.square()).double().clamp_min(1e-12)
    noise_operator = slope_gain * noise[:, None, None] * _gram_of_modes(reference, q, model, weights)
    root = znssd.cholesky(noise_operator)
    relative = torch.linalg.solve_triangular(root, operator, upper=False)
    relative = torch.linalg.solve_triangular(root, relative.mT, upper=False)
    spectrum = torch.linalg.eigvalsh((0.5 * (relative + relative.mT)).nan_to_num())
    worst, best = spectrum[:, 0], spectrum[:, -1]
    return (worst > MIN_TEXTURE_SIGNAL) & (best < MAX_CONDITION * worst)


def _gram_of_modes(reference: Reference, q: Tensor, model: Displacement, weights: Tensor) -> Tensor:
    """Operator (n, k, k) of a gradient of independent unit components: sum of the modes' products."""
    unit = scale(reference, q.shape[-1]).double()
    if model in motion_models.CLOSED_FORM:
        total = MODES_STEP * rotation.gram(
            q, reference.surface, weights, exact=model is motion_models.finite, every=MODES_STEP
        )
    else:
        modes = motion_models.modes(model, q, reference.points, reference.geometry).double()
        total = torch.einsum("np,npck,npcl->nkl", weights.double(), modes, modes)
    return total / (unit[:, :, None] * unit[:, None])


def evaluate(
    reference: Reference, solution: Solution, visible: Tensor, model: Displacement, options: Options
) -> Correlation:
    """Status, covariance and coefficient of each pair; rows that failed are NaN.

    ``visible`` (n,) is the number of points in sight, occluded points included.
    """
    q, _, converged, warped, weights, jacobian, factor = solution
    coefficient = znssd.zncc(reference.values, warped, weights)
    warped = illumination.in_reference_light(reference, warped, weights, model)
    difference = znssd.residual(reference.values, warped, weights)
    power = residual_noise.ResidualPower.of(reference, difference, weights)
    gram = znssd.operator(jacobian, weights)
    spread = increment_covariance(reference, power, weights, q, model, gram)
    factors = residual_noise.inflation(reference, jacobian, factor, weights * difference, power, spread)
    spread = spread * factors[:, :, None] * factors[:, None, :]
    textured = texture_carries_modes(reference, power, weights, q, model, gram)
    points = torch.pi * (options.roi * reference.geometry.radius / reference.spacing) ** 2
    status = frame_status.of_pairs(
        is_alike=~(coefficient < options.min_zncc),
        converged=converged,
        has_texture=textured,
        is_in_view=~(visible < options.min_visible * points),
    )
    # Rounding errors move the points of an image without contrast: their places mean nothing.
    is_flat = _is_flat(reference) & (reference.weights.sum(-1) >= options.min_visible * points)
    status = frame_status.of_flat_images(status, is_flat)
    uneven = reference.uneven_light
    return Correlation.of(q, spread, coefficient, solution.iterations, status, uneven_light=uneven)


def _is_flat(reference: Reference) -> Tensor:
    """True (n,) where the contrast of the reference image is within the rounding errors of its grey levels."""
    contrast = znssd.centred(reference.values, reference.weights) * reference.weights
    return contrast.abs().amax(-1) < FLAT_CONTRAST * reference.values.abs().amax(-1)
