"""Image correlation of pairs: reference -> correlation operator, built once -> batched Gauss-Newton.

The criterion is the paper's equation (3): the squared difference between the reference image ``f`` and the deformed
image ``g`` at the displaced points, gain and offset chosen so that mean and standard deviation agree over the region
of interest (ZNSSD). The operator is that of equations (7) to (10). Inside, rotations are multiplied by the radius, so
that all unknowns are px and the operator is well scaled.
"""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from torchsphere import covariance, criterion, crop, interpolate, motion
from torchsphere.inputs import as_images, as_mask, as_rows, check_circle
from torchsphere.motion import Displacement
from torchsphere.reference import Reference, build_reference, scale, slopes

STATUSES = ("ok", "weak_texture", "low_correlation", "not_converged", "out_of_frame", "lost")
OK, WEAK_TEXTURE, LOW_CORRELATION, NOT_CONVERGED, OUT_OF_FRAME, LOST = range(6)


@dataclass(frozen=True)
class Options:
    """Settings of the correlation; the defaults are measured, see the README.

    Attributes
    ----------
    model : str
        Motion model, a key of `motion.MODELS`.
    roi : float
        Radius of the region of interest as a fraction of the ball's.
    pre_blur : float
        Standard deviation of the Gaussian that blurs both images first, px; 0 for none.
    jacobian : str
        "constant": gradient of the reference, the paper's choice, built once. "autograd": gradient of the deformed
        image at each iterate, by automatic differentiation; exact and slow.
    max_iterations : int
        Gauss-Newton steps before a pair counts as not converged.
    tolerance_px : float
        A pair has converged when a step moves no point of the ball by more, px.
    min_zncc : float
        Below this correlation coefficient a pair is not believed.
    min_visible : float
        Least part of the region of interest that must be usable in both images.
    """

    model: str = "rigid"
    roi: float = 0.95
    pre_blur: float = interpolate.PRE_BLUR_PX
    jacobian: str = "constant"
    max_iterations: int = 40
    tolerance_px: float = 2e-4
    min_zncc: float = 0.6
    min_visible: float = 0.3

    def __post_init__(self) -> None:
        if self.model not in motion.MODELS:
            raise ValueError(f"unknown model {self.model!r}: expected one of {', '.join(motion.MODELS)}")
        if self.jacobian not in ("constant", "autograd"):
            raise ValueError(f"unknown jacobian {self.jacobian!r}: expected 'constant' or 'autograd'")
        if not isinstance(self.max_iterations, int):
            raise ValueError(f"max_iterations = {self.max_iterations!r}: expected a whole number")
        limits = {"roi": (0.1, 1.0), "pre_blur": (0.0, 5.0), "max_iterations": (1, 10_000), "tolerance_px": (1e-9, 1.0)}
        limits |= {"min_zncc": (0.0, 1.0), "min_visible": (0.0, 1.0)}
        for name, (low, high) in limits.items():
            value = getattr(self, name)
            if not (isinstance(value, (int, float)) and low <= value <= high):
                raise ValueError(f"{name} = {value!r}: expected a number from {low:g} to {high:g}")


@dataclass(frozen=True)
class Correlation:
    """Motion of n pairs; rows that are not "ok" are NaN in `q` and `covariance`.

    Attributes
    ----------
    q : Tensor
        Increment (n, 5) as (dx, dy, wx, wy, wz): px and rad, camera frame.
    covariance : Tensor
        (n, 5, 5), in the units of `q`.
    zncc : Tensor
        Zero-mean normalised cross-correlation coefficient (n,) over the region of interest, at the last iterate.
    iterations : Tensor
        Gauss-Newton steps taken (n,).
    status : ndarray
        Strings (n,), each one of `STATUSES`.
    """

    q: Tensor
    covariance: Tensor
    zncc: Tensor
    iterations: Tensor
    status: NDArray[np.str_]


def correlate(f: Any, g: Any, circle: Any, *, start: Any = None, ignore: Any = None, **options: Any) -> Correlation:
    """Measure the motion of the ball between the images of each pair.

    Parameters
    ----------
    f, g : array_like
        Reference and deformed images (n, h, w) or (h, w), NumPy or torch, grey levels. float64 images are measured
        in float64, all others in float32; the device is that of ``f``.
    circle : array_like
        Outline (x, y, radius) of the ball in ``f``, px: one for all pairs, or (n, 3) with one radius.
    start : array_like, optional
        First guess of the increments, (5,) or (n, 5); by default none moves. It must be right to about half a
        speckle; `torchsphere.track` finds it by itself.
    ignore : array_like, optional
        (h, w), True where the images are not to be used.
    **options
        Fields of `Options`.

    Returns
    -------
    Correlation

    Raises
    ------
    ValueError
        If shapes do not fit, a circle is not finite or lies outside the image, or an option is out of its range.

    Notes
    -----
    Equations (3) and (5) to (10) of the paper.
    """
    settings = Options(**options)
    f, g = as_images(f, "f"), as_images(g, "g")
    if f.shape != g.shape:
        raise ValueError(f"f and g must have one shape, got {tuple(f.shape)} and {tuple(g.shape)}")
    n = len(f)
    if f.dtype != g.dtype:
        raise ValueError(f"f and g must have one precision, got {f.dtype} and {g.dtype}; convert one of them")
    circles = as_rows(circle, n, 3, "circle")
    check_circle(circles, f.shape[-2:])
    first = as_rows(torch.zeros(5) if start is None else start, n, 5, "start").to(f)
    if not bool(first.isfinite().all()):
        raise ValueError("start: expected finite numbers dx, dy, wx, wy, wz in px and rad")
    mask = None if ignore is None else as_mask(ignore, f)
    return correlate_pairs(f, g, circles[:, :2], float(circles[0, 2]), first, mask, settings)


def correlate_pairs(
    f: Tensor, g: Tensor, centres: Tensor, radius: float, start: Tensor, ignore: Tensor | None, options: Options
) -> Correlation:
    """`correlate` for arguments that have been checked: ``centres`` (n, 2) in ``f``, float64, ``start`` (n, 5)."""
    half = crop.half_size(radius, margin(options))
    crops_f = crop.cut(f, centres, half, ignore)
    crops_g = crop.cut(g, centres + start[:, :2].to(centres), half, ignore)
    c_f, c_g = (interpolate.coefficients(c.images, options.pre_blur) for c in (crops_f, crops_g))
    return solve(crops_f, c_f, crops_g, c_g, centres, radius, start.to(c_f), options)


def margin(options: Options) -> float:
    """Width around the ball that a crop needs, px: what the guess may be off by, and the reach of the pre-blur."""
    return 4 + 4 * options.pre_blur


def solve(
    crops_f: crop.Crops,
    c_f: Tensor,
    crops_g: crop.Crops,
    c_g: Tensor,
    centres: Tensor,
    radius: float,
    start: Tensor,
    options: Options,
) -> Correlation:
    """Correlate n pairs of crops with their spline coefficients ``c_f``, ``c_g``: see `correlate`.

    ``centres`` (n, 2) of the ball in the reference images, float64 on the CPU; ``start`` (n, 5).
    """
    model = motion.MODELS[options.model]
    reference = build_reference(crops_f, c_f, centres, radius, options.roi, options.pre_blur)
    shift = (centres - crops_g.origin).to(c_g)
    k = motion.degrees_of_freedom(model)
    reference = _where_target_is_usable(reference, crops_g, shift, start[:, :k], model)
    q, iterations, converged = gauss_newton(reference, c_g, shift, start[:, :k], model, options)
    return _conclude(reference, c_g, shift, q, iterations, converged, model, options)


def _where_target_is_usable(
    reference: Reference, crops: crop.Crops, shift: Tensor, start: Tensor, model: Displacement
) -> Reference:
    """The reference with the weights of points that fall on unusable pixels of the deformed image set to 0.

    The first guess decides: it is right to a pixel or two, and weights that stay as they are let the iteration settle.
    """
    if crops.usable is None:
        return reference
    moved = reference.points + motion.displacement(model, start, reference.points, reference.geometry)
    last = crops.images.shape[-1] - 1
    at = (moved + shift[:, None]).nan_to_num(0.0).round().long().clamp(0, last)
    rows = torch.arange(len(at), device=at.device)[:, None]
    usable = crops.usable[rows, at[..., 1], at[..., 0]]
    return dataclasses.replace(reference, weights=reference.weights * usable)


def radius_evidence(
    crops: tuple[crop.Crops, crop.Crops], centres: Tensor, radius: float, q: Tensor, options: Options
) -> tuple[Tensor, Tensor]:
    """What n correlated pairs say of the radius that they were correlated with.

    The residual that the increments ``q`` (n, 5) leave is compared with what a change of the radius would leave after
    the increments have adapted to it.

    Returns
    -------
    score, information : Tensor
        (n,) each; the pairs' common correction of the radius is ``sum(score) / sum(information)``, px.
    """
    model = motion.MODELS[options.model]
    c_f, c_g = (interpolate.coefficients(c.images, options.pre_blur) for c in crops)
    reference = build_reference(crops[0], c_f, centres, radius, options.roi, options.pre_blur)
    shift = (centres - crops[1].origin).to(c_g)
    q = q.to(c_g)[:, : motion.degrees_of_freedom(model)]
    # The exact Jacobian: at the limb, where the radius shows, the reference's gradient is off by a third at 5 deg.
    warped, weights, gradient = _warp_with_gradient(reference, c_g, shift, q, model)
    difference = criterion.residual(reference.values, warped, weights)
    mode = motion.radius_mode(model, q, reference.points, reference.geometry)
    of_radius = (mode * gradient).sum(-1, keepdim=True)
    jacobian, factor = _operator(reference, gradient, q, model, weights)
    slope = criterion.project(of_radius, reference.values, weights)
    shared = ((jacobian * weights[..., None]).mT @ slope).double()
    left = slope[..., 0] - (jacobian @ torch.cholesky_solve(shared, factor).to(jacobian))[..., 0]
    return (weights * left * difference).sum(-1).double().cpu(), (weights * left.square()).sum(-1).double().cpu()


def gauss_newton(
    reference: Reference, c_g: Tensor, shift: Tensor, start: Tensor, model: Displacement, options: Options
) -> tuple[Tensor, Tensor, Tensor]:
    """Gauss-Newton from ``start`` (n, k) -> increments (n, k), iterations (n,), converged (n,)."""
    q = start.clone()
    unit = scale(reference, q.shape[-1])
    active = torch.ones(len(q), dtype=torch.bool, device=q.device)
    converged = torch.zeros_like(active)
    iterations = torch.zeros(len(q), dtype=torch.long, device=q.device)
    constant = options.jacobian == "constant"
    if constant:
        jacobian, factor = _operator(reference, reference.gradient, q, model, reference.weights)
    for _ in range(options.max_iterations):
        if constant:
            warped, weights = warp(reference, c_g, shift, q, model)
        else:
            warped, weights, gradient = _warp_with_gradient(reference, c_g, shift, q, model)
            jacobian, factor = _operator(reference, gradient, q, model, weights)
        difference = criterion.residual(reference.values, warped, weights)
        # b = J^T W r sums thousands of products in the images' own precision; the small system is solved in double.
        b = (jacobian * (weights * difference)[..., None]).sum(1)
        step = torch.cholesky_solve(b.double()[..., None], factor)[..., 0].to(q)
        length = step.abs().amax(-1)
        # A step longer than the ball is wide has nothing to do with the images any more.
        sane = length < 2 * reference.geometry.radius
        q = torch.where((active & sane)[:, None], q + step / unit, q)
        iterations += active
        done = active & (length < options.tolerance_px)
        converged |= done
        active = active & sane & ~done
        if not bool(active.any()):
            break
    return q, iterations, converged


def _operator(
    reference: Reference, gradient: Tensor, q: Tensor, model: Displacement, weights: Tensor
) -> tuple[Tensor, Tensor]:
    """Jacobian (n, p, k) that belongs to the criterion, and the Cholesky factor (n, k, k) of its operator."""
    jacobian = criterion.project(slopes(gradient, q, model, reference), reference.values, weights)
    return jacobian, criterion.cholesky(criterion.operator(jacobian, weights))


def warp(reference: Reference, c_g: Tensor, shift: Tensor, q: Tensor, model: Displacement) -> tuple[Tensor, Tensor]:
    """The deformed image (n, p) at the displaced points, and the weights of the points that are still in sight."""
    points = reference.points + motion.displacement(model, q, reference.points, reference.geometry) + shift[:, None]
    last = c_g.shape[-1] - 1
    inside = ((points >= 1) & (points <= last - 1)).all(-1)
    weights = reference.weights * inside
    return interpolate.sample(c_g, points.nan_to_num(1.0).clamp(1, last - 1)), weights


def _warp_with_gradient(
    reference: Reference, c_g: Tensor, shift: Tensor, q: Tensor, model: Displacement
) -> tuple[Tensor, Tensor, Tensor]:
    """`warp`, and the gradient (n, p, 2) of the deformed image at the displaced points, by reverse differentiation."""
    with torch.enable_grad():
        nudge = torch.zeros_like(reference.points, requires_grad=True)
        displaced = motion.displacement(model, q, reference.points, reference.geometry)
        points = reference.points + displaced + shift[:, None]
        last = c_g.shape[-1] - 1
        inside = ((points >= 1) & (points <= last - 1)).all(-1)
        warped = interpolate.sample(c_g, points.nan_to_num(1.0).clamp(1, last - 1) + nudge)
        # Each value depends on its own point alone, so the gradient of the sum is the gradient at each point.
        (gradient,) = torch.autograd.grad(warped.sum(), nudge)
    return warped.detach(), reference.weights * inside, gradient


def _conclude(
    reference: Reference,
    c_g: Tensor,
    shift: Tensor,
    q: Tensor,
    iterations: Tensor,
    converged: Tensor,
    model: Displacement,
    options: Options,
) -> Correlation:
    """Status, covariance and coefficient of each pair; what cannot be vouched for becomes NaN."""
    warped, weights = warp(reference, c_g, shift, q, model)
    difference = criterion.residual(reference.values, warped, weights)
    coefficient = criterion.zncc(reference.values, warped, weights)
    spread = covariance.increment_covariance(reference, difference, weights, q, model, options.pre_blur)
    carried = covariance.texture_carries_modes(reference, difference, weights, q, model, options.pre_blur)
    area = torch.pi * (options.roi * reference.geometry.radius) ** 2
    status = torch.full((len(q),), OK, device=q.device)
    for wrong, code in (
        (coefficient < options.min_zncc, LOW_CORRELATION),
        (~converged, NOT_CONVERGED),
        (~carried, WEAK_TEXTURE),
        (weights.sum(-1) < options.min_visible * area, OUT_OF_FRAME),
    ):
        status = torch.where(wrong, code, status)
    good = status == OK
    full_q = torch.zeros(len(q), 5).to(q)
    full_q[:, : q.shape[-1]] = q
    # What a model does not measure it cannot state an uncertainty of.
    full = torch.full((len(q), 5, 5), torch.nan).to(spread)
    full[:, : q.shape[-1], : q.shape[-1]] = spread
    return Correlation(
        q=torch.where(good[:, None], full_q, torch.nan),
        covariance=torch.where(good[:, None, None], full, torch.nan),
        zncc=coefficient,
        iterations=iterations,
        status=np.array(STATUSES)[status.cpu().numpy()],
    )
