"""The method on one page: five-mode image correlation of pairs of images, in plain torch and Kornia.

J.-C. Passieux, P. Navarro and J.-N. Périé, equations (3) and (5) to (10). For each pair find the increment q that
minimises ``sum w (f(x) - a g(x + u(x; q)) - b)^2`` over a circular region of the reference image f, where u is the
displacement of a rigid ball and a, b make mean and contrast of both images equal (ZNSSD). Gauss-Newton steps are
``M^-1 b`` with the correlation operator ``M = J^T W J``, ``b = J^T W r``, and the modes du/dq by automatic
differentiation. All pairs go together, on a CPU or a GPU: n pairs, p pixels, k unknowns.

`torchsphere.correlate` takes it with ``engine="plain"``. The default engine minimises the same criterion faster; it
leaves out occluders and allows for uneven light. Here both only widen the covariance.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
import torch
import torch.nn.functional as F  # noqa: N812  (torch's own custom)
from kornia.geometry.transform import remap
from torch import Tensor

from torchsphere.correlation.occlusion import MIN_COSINE, MISPLACED_PX_PER_DEG, TOLERATED_PX
from torchsphere.correlation.options import Options, margin
from torchsphere.correlation.residual_noise import BLOCK, MAX_CHANCE_SCATTER, MIN_BLOCK_PX
from torchsphere.correlation.result import CELLS, STATUSES, Correlation
from torchsphere.correlation.uncertainty import MAX_CONDITION, MIN_TEXTURE_SIGNAL
from torchsphere.geometry import motion_models
from torchsphere.geometry.camera import view_of
from torchsphere.geometry.motion_models import EXACT, Displacement, Geometry
from torchsphere.imaging import crop, interpolation

#: Difference of two Laplacians, blind to the image itself (J. Immerkaer, doi:10.1006/cviu.1996.0060).
_DIFFERENCES = torch.tensor([[1.0, -2.0, 1.0], [-2.0, 4.0, -2.0], [1.0, -2.0, 1.0]])


class Region(NamedTuple):
    """The reference images over the region of interest."""

    points: Tensor  # (n, p, 2), px from the ball's centre
    weights: Tensor  # (n, p), 1 in the region and usable, else 0
    values: Tensor  # (n, p), grey levels
    gradient: Tensor  # (n, p, 2), grey levels per px
    blurred_gradient: Tensor  # the gradient after one more pre-blur
    normals: Tensor  # (n, p, 3), unit normals of the ball
    noise: Tensor  # (n,), standard deviation of the raw image's noise
    geometry: Geometry


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
    region = _region(crop_f, circles, options)
    c_g = spline_coefficients(crop_g.images, options.pre_blur)
    shift = (circles[:, :2] - crop_g.origin).to(f)
    usable = None if crop_g.usable is None else crop_g.usable.to(f)
    q = motion_models.as_unknowns(start.to(f), model)
    iterations = torch.zeros(len(q), dtype=torch.long, device=q.device)
    ended = converged = torch.zeros_like(iterations, dtype=torch.bool)
    for _ in range(options.max_iterations):
        warped, weights, gradient = _warp(region, c_g, usable, shift, q, model)
        gradient = gradient if options.jacobian == "autograd" else region.gradient
        step, jacobian, residual = _step(region, gradient, warped, weights, q, model)
        length = step.abs().amax(-1)
        going = ~ended & (length < 2 * region.geometry.radius)
        q = torch.where(going[:, None], q + (step / _scale(region, step.shape[-1])).to(q), q)
        iterations = iterations + going
        converged = converged | (going & (length < options.tolerance_px))
        ended = ended | converged | ~going
        if bool(ended.all()):
            break
    covariance, carried = _uncertainty(region, jacobian, residual, weights, q, model, options.pre_blur)
    coefficient = zncc(region.values, warped, weights)
    finite = (crop_f.images.isfinite() & crop_g.images.isfinite()).flatten(1).all(1)
    expected = torch.pi * (options.roi * region.geometry.radius) ** 2
    status = torch.zeros_like(iterations)
    for failed, name in (
        (coefficient < options.min_zncc, "low_correlation"),
        (~converged, "not_converged"),
        (~carried, "weak_texture"),
        ((weights > 0).sum(-1) < options.min_visible * expected, "out_of_frame"),
        (~finite, "lost"),
    ):
        status = torch.where(failed, STATUSES.index(name), status)
    return _as_correlation(q, covariance, coefficient, iterations, status)


def spline_coefficients(images: Tensor, pre_blur: float) -> Tensor:
    """Spline coefficients (n, h, w) of the images (n, h, w), blurred by ``pre_blur`` px: one matrix per axis."""
    height, width = (interpolation.prefilter_matrix(size, pre_blur).to(images) for size in images.shape[-2:])
    return height @ images @ width.T


def sample(c: Tensor, points: Tensor) -> Tensor:
    """The spline ``c`` (n, h, w) at ``points`` (n, p, 2), (x, y) in px: (n, p); differentiable by the points.

    The sixteen weights of a cubic spline are positive and separable, so that four bilinear look-ups between its nodes
    are exact (C. Sigg and M. Hadwiger, GPU Gems 2, chapter 20).
    """
    base = points.detach().floor()
    first, second, third, last = interpolation.spline_weights(points - base, interpolation.SHARPNESS)
    before, behind = first + second, third + last
    nodes = ((base - 1 + second / before, before), (base + 1 + last / behind, behind))
    total = torch.zeros_like(points[..., 0])
    for at_x, weight_x in nodes:
        for at_y, weight_y in nodes:
            level = remap(c[:, None], at_x[:, None, :, 0], at_y[:, None, :, 1], align_corners=True)[:, 0, 0]
            total = total + weight_x[..., 0] * weight_y[..., 1] * level
    return total


def _at_nodes(c: Tensor) -> Tensor:
    """Value and derivatives along x and y of the splines (n, h, w) at their nodes: (n, 3, h, w)."""
    side, middle, _ = interpolation.NODE_WEIGHTS
    near, far = interpolation.SLOPE_WEIGHTS
    value, slope = c.new_tensor([0.0, side, middle, side, 0.0]), c.new_tensor([-far, -near, 0.0, near, far])
    kernels = torch.stack((torch.outer(value, value), torch.outer(value, slope), torch.outer(slope, value)))
    return F.conv2d(c[:, None], kernels[:, None], padding=2)


def _region(crops: crop.Crops, circles: Tensor, options: Options) -> Region:
    """Values and gradients of the reference images at all pixels within the region of interest."""
    c = spline_coefficients(crops.images, options.pre_blur)
    side = torch.arange(c.shape[-1], device=c.device)
    pixels = torch.stack(torch.meshgrid(side, side, indexing="xy"), -1).reshape(-1, 2)
    points = pixels + (crops.origin - circles[:, :2]).to(c)[:, None]
    radius = circles[:, 2].to(c)
    inside = points.square().sum(-1) < (options.roi * radius[:, None]).square()
    weights = inside.to(c) if crops.usable is None else (inside & crops.usable.flatten(1)).to(c)
    maps = _at_nodes(c)
    blur = interpolation.blur_matrix(c.shape[-1], options.pre_blur).to(c)
    maps = torch.cat((maps, blur @ maps[:, 1:] @ blur.T), 1).flatten(2)
    rough = F.conv2d(crops.images[:, None], _DIFFERENCES.to(c)[None, None], padding=1).abs().flatten(1)
    noise = math.sqrt(math.pi / 2) / 6 * (weights * rough).sum(-1) / weights.sum(-1).clamp_min(1)
    kept = inside.any(0)
    points, weights, maps = points[:, kept], weights[:, kept], maps[:, :, kept]
    depth = motion_models.depth(points, radius[:, None])
    return Region(
        points=points,
        weights=weights,
        values=maps[:, 0],
        gradient=maps[:, 1:3].mT,
        blurred_gradient=maps[:, 3:].mT,
        normals=torch.cat((points, -depth[..., None]), -1) / radius[:, None, None],
        noise=noise,
        geometry=Geometry(radius, None if options.camera is None else view_of(options.camera, circles[:, :2], c)),
    )


def _warp(
    region: Region, c_g: Tensor, usable: Tensor | None, shift: Tensor, q: Tensor, model: Displacement
) -> tuple[Tensor, Tensor, Tensor]:
    """The deformed image (n, p) at the moved points, the weights (n, p) of those in sight, its gradient (n, p, 2)."""
    moved = region.points + motion_models.displacement(model, q, region.points, region.geometry)
    weights = region.weights * _view_weights(region, moved - q[:, None, :2], q) if model in EXACT else region.weights
    moved = moved + shift[:, None]
    limit = c_g.shape[-1] - 2
    seen = ((moved >= 1) & (moved <= limit)).all(-1)
    moved = moved.nan_to_num(1.0).clamp(1, limit).requires_grad_()
    with torch.enable_grad():
        warped = sample(c_g, moved)
        (gradient,) = torch.autograd.grad(warped.sum(), moved)
    weights = weights * seen
    if usable is not None:
        whole = moved.detach().round().long()
        rows = torch.arange(len(whole), device=whole.device)[:, None]
        weights = weights * usable[rows, whole[..., 1], whole[..., 0]]
    return warped.detach(), weights, gradient


def _view_weights(region: Region, turned: Tensor, q: Tensor) -> Tensor:
    """Weights (n, p) that fall where a turn changes the foreshortening of the texture, seen at ``turned`` (n, p, 2)."""
    radius = region.geometry.radius[:, None]
    cosine = torch.minimum(-region.normals[..., 2], motion_models.depth(turned, radius).nan_to_num(0.0) / radius)
    degrees = torch.rad2deg(motion_models.turn(q))[:, None]
    misplaced = MISPLACED_PX_PER_DEG * degrees * (1 / cosine.clamp_min(MIN_COSINE) - 1)
    return 1 / (1 + (misplaced / TOLERATED_PX).square())


def _step(
    region: Region, gradient: Tensor, warped: Tensor, weights: Tensor, q: Tensor, model: Displacement
) -> tuple[Tensor, Tensor, Tensor]:
    """The step (n, k) of equations (7) to (10), px, float64; its Jacobian (n, p, k) and residual (n, p)."""
    jacobian = _jacobian(region, gradient, q, model, weights)
    residual = znssd_residual(region.values, warped, weights)
    step = _solve(_products(jacobian, weights), _products(jacobian, weights, residual[..., None]))[..., 0]
    return step, jacobian, residual


def _jacobian(region: Region, gradient: Tensor, q: Tensor, model: Displacement, weights: Tensor) -> Tensor:
    """Change (n, p, k) of the grey levels per px of each unknown, without what gain, offset or light can explain.

    Distant light that does not turn with the ball changes a matt surface in proportion to the components of its normal.
    """
    modes = motion_models.modes(model, q, region.points, region.geometry)
    slopes = (modes * gradient[..., None]).sum(-2) / _scale(region, q.shape[-1])[:, None]
    image = _centred(region.values, weights)[..., None]
    light = torch.cat((torch.ones_like(image), image, region.normals), -1)
    if model not in motion_models.RIGID_BALL:
        light = light[..., :2]
    return slopes - light @ _solve(_products(light, weights), _products(light, weights, slopes)).to(slopes)


def znssd_residual(values: Tensor, warped: Tensor, weights: Tensor) -> Tensor:
    """``f - a g - b`` (n, p), with a and b that make weighted mean and standard deviation equal: equation (3)."""
    f, g = _centred(values, weights), _centred(warped, weights)
    gain = ((weights * f * f).sum(-1) / (weights * g * g).sum(-1).clamp_min(1e-12)).sqrt()
    return f - gain[:, None] * g


def zncc(values: Tensor, warped: Tensor, weights: Tensor) -> Tensor:
    """Correlation coefficient (n,) of both images over the weighted points; 0 where one is flat."""
    f, g = _centred(values, weights), _centred(warped, weights)
    power = ((weights * f * f).sum(-1) * (weights * g * g).sum(-1)).sqrt()
    return torch.where(power > 1e-9, (weights * f * g).sum(-1) / power.clamp_min(1e-9), 0.0)


def _uncertainty(
    region: Region, jacobian: Tensor, residual: Tensor, weights: Tensor, q: Tensor, model: Displacement, pre_blur: float
) -> tuple[Tensor, Tensor]:
    """Covariance (n, k, k) of the increments, px and rad, and True (n,) where the texture determines every mode.

    The pre-blur leaves a share of the noise's variance and correlates neighbours: ``s^2 M^-1 N M^-1``, N as M with the
    gradients blurred once more. Where the residual is more than noise, its scatter widens it: `_widening`.
    """
    k = q.shape[-1]
    of_value, of_slope = interpolation.noise_gains(pre_blur)
    count = weights.double().sum(-1)
    power = (weights * residual.square()).double().sum(-1)
    variance = power / (count - k - 2).clamp_min(1) / of_value
    operator = _products(jacobian, weights)
    spread = _products(_jacobian(region, region.blurred_gradient, q, model, weights), weights)
    half = _solve(operator, spread)
    unit = _scale(region, k).double()
    covariance = variance[:, None, None] * _solve(operator, half.mT) / (unit[:, :, None] * unit[:, None])
    wider = _widening(region, operator, jacobian, weights * residual, covariance * (unit[:, :, None] * unit[:, None]))
    covariance = covariance * wider[:, :, None] * wider[:, None]
    # The operator over that of noise alone, whose gradients have independent components.
    modes = motion_models.modes(model, q, region.points, region.geometry) / _scale(region, k)[:, None, None]
    # Two upper bounds: the residual exceeds the noise where the match fails, the raw image's where texture is fine.
    noise = torch.minimum(power / count.clamp_min(1) / (2 * of_value), region.noise.double().square()).clamp_min(1e-12)
    of_noise = of_slope * noise[:, None, None] * _products(modes.flatten(1, 2), weights.repeat_interleave(2, 1))
    ratios = torch.linalg.eigvals(_solve(of_noise, operator).nan_to_num()).real
    worst, best = ratios.amin(-1), ratios.amax(-1)
    return covariance, (worst > MIN_TEXTURE_SIGNAL) & (best < MAX_CONDITION * worst)


def _widening(region: Region, operator: Tensor, jacobian: Tensor, weighted: Tensor, covariance: Tensor) -> Tensor:
    """Factors (n, k), 1 or more, on the standard deviations for a residual that is not noise, as behind an occluder.

    The scatter of the scores ``J^T W r`` between blocks gives a covariance without a model of the residual (the
    sandwich of Huber and White); ``weighted`` (n, p) is ``W r``, ``covariance`` (n, k, k) that of noise, px.
    """
    radius = float(region.geometry.radius.max())
    side = max(MIN_BLOCK_PX, BLOCK * radius)
    count = math.ceil(2 * radius / side)
    column, row = ((region.points + radius) / side).long().clamp(0, count - 1).unbind(-1)
    scores = jacobian.new_zeros(len(jacobian), count * count, jacobian.shape[-1])
    blocks = (row * count + column)[..., None].expand_as(jacobian)
    scores.scatter_add_(1, blocks, jacobian * weighted[..., None])
    response = _solve(operator, scores.mT.double())
    ratio = response.square().sum(-1) / covariance.diagonal(dim1=-2, dim2=-1)
    return (ratio / MAX_CHANCE_SCATTER).nan_to_num(1.0, 1.0).clamp_min(1.0).sqrt()


def _scale(region: Region, k: int) -> Tensor:
    """What turns unknowns (n, k) into px: 1 for translations, the radius for rotations and for growth."""
    radius = region.geometry.radius[:, None]
    return torch.cat((torch.ones_like(radius).expand(-1, 2), radius.expand(-1, k - 2)), -1)


def _centred(values: Tensor, weights: Tensor) -> Tensor:
    return values - (weights * values).sum(-1, keepdim=True) / weights.sum(-1, keepdim=True).clamp_min(1)


def _products(a: Tensor, weights: Tensor, b: Tensor | None = None) -> Tensor:
    """``A^T W B`` (n, k, l), float64, of (n, p, k) and (n, p, l); without ``b`` that of A with itself."""
    return ((a * weights[..., None]).mT @ (a if b is None else b)).double()


def _solve(matrix: Tensor, right: Tensor) -> Tensor:
    """Solution of symmetric systems (n, k, k), float64; rows without a solution (no texture) give NaN or 0."""
    scale = matrix.diagonal(dim1=-2, dim2=-1).mean(-1)[:, None, None]
    regular = matrix + (1e-12 * scale + 1e-30) * torch.eye(matrix.shape[-1]).to(matrix)
    return torch.linalg.solve_ex(regular, right)[0]


def _as_correlation(
    q: Tensor, covariance: Tensor, coefficient: Tensor, iterations: Tensor, status: Tensor
) -> Correlation:
    """The result for n pairs; rows that are not "ok" are NaN, and so are components that the model does not measure."""
    good, k = status == 0, q.shape[-1]
    unknowns = torch.where(good[:, None], torch.cat((q, q.new_zeros(len(q), 6 - k)), -1), torch.nan)
    stated = torch.full((len(q), 6, 6), torch.nan).to(covariance)
    stated[:, :k, :k] = torch.where(good[:, None, None], covariance, torch.nan)
    return Correlation(
        q=unknowns[:, :5],
        covariance=stated[:, :5, :5],
        zncc=coefficient,
        iterations=iterations,
        growth=unknowns[:, 5],
        sd_growth=torch.where(good, stated[:, 5, 5].sqrt() if k == 6 else 0.0, torch.nan),
        uneven_light=torch.zeros_like(good),
        explained=torch.ones(len(good), 2, CELLS, CELLS).to(unknowns),
        status=np.array(STATUSES)[status.cpu().numpy()],
    )
