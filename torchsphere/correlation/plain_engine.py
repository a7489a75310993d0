"""The plain engine: `torchsphere.correlate` with ``engine="plain"``, by the method of `torchsphere.correlation.plain`.

The default engine minimises the same criterion faster; it leaves out occluders and allows for uneven light. Here both
only widen the covariance.
"""

from __future__ import annotations

import math

import torch
from torch import Tensor

from torchsphere.correlation import frame_status, plain
from torchsphere.correlation.options import Options, margin
from torchsphere.correlation.plain import Fit, centred, products, solve
from torchsphere.correlation.plain_reference import Region, region_of, spline_coefficients
from torchsphere.correlation.residual_noise import BLOCK, MAX_CHANCE_SCATTER, MIN_BLOCK_PX
from torchsphere.correlation.result import Correlation
from torchsphere.correlation.uncertainty import MAX_CONDITION, MIN_TEXTURE_SIGNAL
from torchsphere.geometry import motion_models
from torchsphere.geometry.motion_models import Displacement
from torchsphere.imaging import crop, interpolation


def correlate_plain(
    f: Tensor, g: Tensor, circles: Tensor, start: Tensor, ignore: Tensor | None, options: Options
) -> Correlation:
    """Correlate the images ``f`` and ``g`` (n, h, w) from ``start`` (n, 5), px and rad.

    ``circles`` (n, 3): the ball in ``f``, px, float64 on the CPU; ``ignore`` (h, w): True where not to be used.
    """
    model = motion_models.MODELS["finite" if options.model == "rigid" else options.model]
    half = crop.half_size(float(circles[:, 2].max()), margin(options))
    crop_f = crop.cut(f, circles[:, :2], half, ignore)
    crop_g = crop.cut(g, circles[:, :2] + start[:, :2].to(circles), half, ignore)
    region = region_of(crop_f, circles, options)
    deformed = plain.Deformed(
        coefficients=spline_coefficients(crop_g.images, options.pre_blur),
        usable=None if crop_g.usable is None else crop_g.usable.to(f),
        shift=(circles[:, :2] - crop_g.origin).to(f),
    )
    found = plain.fit(region, deformed, motion_models.as_unknowns(start.to(f), model), model, options)
    in_px = plain.covariance(region, found, model, options.pre_blur)
    wider = widening(region, found, in_px) / region.scale(found.q.shape[-1]).double()
    coefficient = zncc(region.values, found.warped, found.weights)
    finite = (crop_f.images.isfinite() & crop_g.images.isfinite()).flatten(1).all(1)
    expected = torch.pi * (options.roi * region.geometry.radius) ** 2
    status = frame_status.of_pairs(
        is_alike=~(coefficient < options.min_zncc),
        converged=found.converged,
        has_texture=texture_carries_modes(region, found, model, options.pre_blur),
        is_in_view=~((found.weights > 0).sum(-1) < options.min_visible * expected),
        is_known=finite,
    )
    covariance = in_px * wider[:, :, None] * wider[:, None]
    return Correlation.of(found.q, covariance, coefficient, found.iterations, status)


def zncc(values: Tensor, warped: Tensor, weights: Tensor) -> Tensor:
    """Correlation coefficient (n,) of both images over the weighted points; 0 where one is flat."""
    f, g = centred(values, weights), centred(warped, weights)
    power = ((weights * f * f).sum(-1) * (weights * g * g).sum(-1)).sqrt()
    return torch.where(power > 1e-9, (weights * f * g).sum(-1) / power.clamp_min(1e-9), 0.0)


def widening(region: Region, found: Fit, covariance: Tensor) -> Tensor:
    """Factors (n, k), 1 or more, on the standard deviations for a residual that is not noise, as behind an occluder.

    The scatter of the scores ``J^T W r`` between blocks gives a covariance without a model of the residual (the
    sandwich of Huber and White); ``covariance`` (n, k, k): that of noise, px.
    """
    jacobian = found.jacobian
    radius = float(region.geometry.radius.max())
    side = max(MIN_BLOCK_PX, BLOCK * radius)
    count = math.ceil(2 * radius / side)
    column, row = ((region.points + radius) / side).long().clamp(0, count - 1).unbind(-1)
    scores = jacobian.new_zeros(len(jacobian), count * count, jacobian.shape[-1])
    blocks = (row * count + column)[..., None].expand_as(jacobian)
    scores.scatter_add_(1, blocks, jacobian * (found.weights * found.residual)[..., None])
    response = solve(found.operator, scores.mT.double())
    ratio = response.square().sum(-1) / covariance.diagonal(dim1=-2, dim2=-1)
    return (ratio / MAX_CHANCE_SCATTER).nan_to_num(1.0, 1.0).clamp_min(1.0).sqrt()


def texture_carries_modes(region: Region, found: Fit, model: Displacement, pre_blur: float) -> Tensor:
    """True (n,) where the texture determines every mode: the operator over that of noise alone is large and even."""
    of_value, of_slope = interpolation.noise_gains(pre_blur)
    power, count = found.energy
    # Two upper bounds: the residual exceeds the noise where the match fails, the raw image's where texture is fine.
    noise = torch.minimum(power / count.clamp_min(1) / (2 * of_value), region.noise.double().square()).clamp_min(1e-12)
    # Gradients of noise have independent components.
    modes = motion_models.modes(model, found.q, region.points, region.geometry)
    modes = modes / region.scale(found.q.shape[-1])[:, None, None]
    of_modes = products(modes.flatten(1, 2), found.weights.repeat_interleave(2, 1))
    ratios = torch.linalg.eigvals(solve(of_slope * noise[:, None, None] * of_modes, found.operator).nan_to_num()).real
    worst, best = ratios.amin(-1), ratios.amax(-1)
    return (worst > MIN_TEXTURE_SIGNAL) & (best < MAX_CONDITION * worst)
