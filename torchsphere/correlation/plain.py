"""The method on one page: five-mode image correlation of pairs of images, in plain torch and Kornia.

J.-C. Passieux, P. Navarro and J.-N. Périé, equations (3) and (5) to (10). For each pair find the increment q that
minimises ``sum w (f(x) - a g(x + u(x; q)) - b)^2`` over a circular region of the reference image f, where u is the
displacement of a rigid ball and a, b make mean and contrast of both images equal (ZNSSD). Gauss-Newton steps are
``M^-1 b`` with the correlation operator ``M = J^T W J``, ``b = J^T W r``, and the modes du/dq by automatic
differentiation. All pairs go together, on a CPU or a GPU: n pairs, p pixels, k unknowns.

`torchsphere.correlation.plain_engine` makes the region of the images and a `Correlation` of the `Fit`.
"""

from __future__ import annotations

from typing import NamedTuple

import torch
from kornia.geometry.transform import remap
from torch import Tensor

from torchsphere.correlation.occlusion import MIN_COSINE, MISPLACED_PX_PER_DEG, TOLERATED_PX
from torchsphere.correlation.options import Options
from torchsphere.correlation.plain_reference import Region
from torchsphere.geometry import motion_models
from torchsphere.geometry.motion_models import EXACT, Displacement
from torchsphere.imaging import interpolation


class Deformed(NamedTuple):
    """The deformed images g as splines, and where they may be used."""

    coefficients: Tensor  # (n, h, w)
    usable: Tensor | None  # (n, h, w), 1 or 0
    shift: Tensor  # (n, 2), the ball's centre in f as a place in g's crop, px


class Fit(NamedTuple):
    """Increments q (n, k), px and rad, and the images under them."""

    q: Tensor
    iterations: Tensor  # (n,)
    converged: Tensor  # (n,), True where the last step was shorter than the tolerance
    warped: Tensor  # (n, p), g at the moved points, grey levels
    weights: Tensor  # (n, p), of the points that both images show
    jacobian: Tensor  # (n, p, k), grey levels per px
    residual: Tensor  # (n, p), f - a g - b
    operator: Tensor  # (n, k, k), M = J^T W J, float64

    @property
    def energy(self) -> tuple[Tensor, Tensor]:
        """Weighted sum of the squared residual (n,), and sum of the weights (n,), float64."""
        return (self.weights * self.residual.square()).double().sum(-1), self.weights.double().sum(-1)


def fit(region: Region, g: Deformed, q: Tensor, model: Displacement, options: Options) -> Fit:
    """Gauss-Newton from the start ``q`` (n, k); a pair ends at a step below the tolerance or beyond the ball."""
    iterations = torch.zeros(len(q), dtype=torch.long, device=q.device)
    ended = converged = torch.zeros_like(iterations, dtype=torch.bool)
    for _ in range(options.max_iterations):
        warped, weights, gradient = warp(region, g, q, model)
        gradient = gradient if options.jacobian == "autograd" else region.gradient
        step, jacobian, residual, operator = gauss_newton_step(region, gradient, warped, weights, q, model)
        length = step.abs().amax(-1)
        going = ~ended & (length < 2 * region.geometry.radius)
        q = torch.where(going[:, None], q + (step / region.scale(step.shape[-1])).to(q), q)
        iterations = iterations + going
        converged = converged | (going & (length < options.tolerance_px))
        ended = ended | converged | ~going
        if bool(ended.all()):
            break
    return Fit(q, iterations, converged, warped, weights, jacobian, residual, operator)


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


def warp(region: Region, g: Deformed, q: Tensor, model: Displacement) -> tuple[Tensor, Tensor, Tensor]:
    """The deformed image (n, p) at the moved points, the weights (n, p) of those in sight, its gradient (n, p, 2)."""
    moved = region.points + motion_models.displacement(model, q, region.points, region.geometry)
    weights = region.weights * view_weights(region, moved - q[:, None, :2], q) if model in EXACT else region.weights
    moved = moved + g.shift[:, None]
    limit = g.coefficients.shape[-1] - 2
    seen = ((moved >= 1) & (moved <= limit)).all(-1)
    moved = moved.nan_to_num(1.0).clamp(1, limit).requires_grad_()
    with torch.enable_grad():
        warped = sample(g.coefficients, moved)
        (gradient,) = torch.autograd.grad(warped.sum(), moved)
    weights = weights * seen
    if g.usable is not None:
        whole = moved.detach().round().long()
        rows = torch.arange(len(whole), device=whole.device)[:, None]
        weights = weights * g.usable[rows, whole[..., 1], whole[..., 0]]
    return warped.detach(), weights, gradient


def view_weights(region: Region, turned: Tensor, q: Tensor) -> Tensor:
    """Weights (n, p) that fall where a turn changes the foreshortening of the texture, seen at ``turned`` (n, p, 2)."""
    radius = region.geometry.radius[:, None]
    cosine = torch.minimum(-region.normals[..., 2], motion_models.depth(turned, radius).nan_to_num(0.0) / radius)
    degrees = torch.rad2deg(motion_models.turn(q))[:, None]
    misplaced = MISPLACED_PX_PER_DEG * degrees * (1 / cosine.clamp_min(MIN_COSINE) - 1)
    return 1 / (1 + (misplaced / TOLERATED_PX).square())


def gauss_newton_step(
    region: Region, gradient: Tensor, warped: Tensor, weights: Tensor, q: Tensor, model: Displacement
) -> tuple[Tensor, Tensor, Tensor, Tensor]:
    """The step (n, k) of equations (7) to (10), px, float64; its Jacobian, residual and operator as in `Fit`."""
    jacobian = jacobian_of(region, gradient, q, model, weights)
    residual = znssd_residual(region.values, warped, weights)
    operator = products(jacobian, weights)
    step = solve(operator, products(jacobian, weights, residual[..., None]))[..., 0]
    return step, jacobian, residual, operator


def jacobian_of(region: Region, gradient: Tensor, q: Tensor, model: Displacement, weights: Tensor) -> Tensor:
    """Change (n, p, k) of the grey levels per px of each unknown, without what gain, offset or light can explain.

    Distant light that does not turn with the ball changes a matt surface in proportion to the components of its normal.
    """
    modes = motion_models.modes(model, q, region.points, region.geometry)
    slopes = (modes * gradient[..., None]).sum(-2) / region.scale(q.shape[-1])[:, None]
    image = centred(region.values, weights)[..., None]
    light = torch.cat((torch.ones_like(image), image, region.normals), -1)
    if model not in motion_models.RIGID_BALL:
        light = light[..., :2]
    return slopes - light @ solve(products(light, weights), products(light, weights, slopes)).to(slopes)


def znssd_residual(values: Tensor, warped: Tensor, weights: Tensor) -> Tensor:
    """``f - a g - b`` (n, p), with a and b that make weighted mean and standard deviation equal: equation (3)."""
    f, g = centred(values, weights), centred(warped, weights)
    gain = ((weights * f * f).sum(-1) / (weights * g * g).sum(-1).clamp_min(1e-12)).sqrt()
    return f - gain[:, None] * g


def covariance(region: Region, found: Fit, model: Displacement, pre_blur: float) -> Tensor:
    """Covariance (n, k, k), float64, of the increments in px, by the residual's variance s^2.

    The pre-blur leaves a share of the noise's variance and correlates neighbours: ``s^2 M^-1 N M^-1``, N as M with the
    gradients blurred once more.
    """
    power, count = found.energy
    variance = power / (count - found.q.shape[-1] - 2).clamp_min(1) / interpolation.noise_gains(pre_blur)[0]
    spread = jacobian_of(region, region.blurred_gradient, found.q, model, found.weights)
    half = solve(found.operator, products(spread, found.weights))
    return variance[:, None, None] * solve(found.operator, half.mT)


def centred(values: Tensor, weights: Tensor) -> Tensor:
    """Values (n, p) without their weighted mean."""
    return values - (weights * values).sum(-1, keepdim=True) / weights.sum(-1, keepdim=True).clamp_min(1)


def products(a: Tensor, weights: Tensor, b: Tensor | None = None) -> Tensor:
    """``A^T W B`` (n, k, l), float64, of (n, p, k) and (n, p, l); without ``b`` that of A with itself."""
    return ((a * weights[..., None]).mT @ (a if b is None else b)).double()


def solve(matrix: Tensor, right: Tensor) -> Tensor:
    """Solution of symmetric systems (n, k, k), float64; rows without a solution (no texture) give NaN or 0."""
    raised = (1e-12 * matrix.diagonal(dim1=-2, dim2=-1) + 1e-30).diag_embed()
    return torch.linalg.solve_ex(matrix + raised, right)[0]
