"""The deformed image at the displaced points of n pairs, and the Jacobian of the criterion."""

from __future__ import annotations

import torch
from torch import Tensor

from torchsphere.correlation import znssd
from torchsphere.correlation.reference import Reference, nuisances, slopes
from torchsphere.geometry import motion_models, rotation
from torchsphere.geometry.motion_models import Displacement
from torchsphere.imaging import interpolation
from torchsphere.kernels import gauss_newton, jit
from torchsphere.kernels import operator as system


def operator(
    reference: Reference, gradient: Tensor, q: Tensor, model: Displacement, weights: Tensor
) -> tuple[Tensor, Tensor]:
    """Jacobian (n, k, p) of the criterion, and the Cholesky factor (n, k, k) of its operator."""
    jacobian, products = projected_slopes(reference, gradient, q, model, weights)
    return jacobian, znssd.cholesky(products)


def projected_slopes(
    reference: Reference, gradient: Tensor, q: Tensor, model: Displacement, weights: Tensor
) -> tuple[Tensor, Tensor]:
    """Change of grey level per px of each unknown (n, k, p), projected off the nuisances; its operator."""
    if model not in motion_models.CLOSED_FORM or reference.uneven_light or not jit.suits(gradient, q, weights):
        found = slopes(gradient, q, model, reference)
        found = znssd.project(found, nuisances(reference, model, weights), weights)
        return found, znssd.operator(found, weights)
    turn = mix = torch.eye(3).expand(len(q), 3, 3)
    if model is motion_models.finite:
        turn, mix = rotation.rotations(q[:, 2:5]), rotation.tangents(q[:, 2:5]).mT
    radius = reference.geometry.radius
    return system.projected(reference.surface, gradient, reference.values, weights, radius, turn, mix)


def warp(reference: Reference, c_g: Tensor, shift: Tensor, q: Tensor, model: Displacement) -> tuple[Tensor, Tensor]:
    """The deformed image (n, p) at the displaced points, and the weights of the points in sight."""
    points, weights = _displaced(reference, c_g, shift, q, model)
    return interpolation.sample(c_g, points), weights


def warp_with_gradient(
    reference: Reference, c_g: Tensor, shift: Tensor, q: Tensor, model: Displacement
) -> tuple[Tensor, Tensor, Tensor]:
    """`warp`, and the gradient (n, 2, p) of the deformed image at the displaced points."""
    points, weights = _displaced(reference, c_g, shift, q, model)
    warped, gradient = interpolation.sample_with_gradient(c_g, points)
    return warped, weights, gradient


def _displaced(
    reference: Reference, c_g: Tensor, shift: Tensor, q: Tensor, model: Displacement
) -> tuple[Tensor, Tensor]:
    """Places (n, p, 2) of the points in the deformed image's crop, and their weights (n, p): 0 out of sight."""
    if model in motion_models.CLOSED_FORM and jit.suits(c_g, q, reference.weights):
        turn = rotation.matrices(q, exact=model is motion_models.finite)
        places = q[:, :2] + shift
        return gauss_newton.displaced(
            c_g, reference.surface, reference.weights, turn, places, exact=model is motion_models.finite
        )
    middle = 0.5 * (c_g.shape[-1] - 1)
    reach = middle - 1
    if model in motion_models.CLOSED_FORM:
        turned = rotation.moved(q, reference.surface, exact=model is motion_models.finite)
        points = turned[:, :2] + (q[:, :2] + shift)[..., None]
        room = reach - (points - middle).abs().amax(1)
        if model is motion_models.finite:
            # Points that turned to the back are out of sight.
            room = torch.minimum(room, -turned[:, 2])
    else:
        moved = reference.points + motion_models.displacement(model, q, reference.points, reference.geometry)
        points = (moved + shift[:, None]).mT.nan_to_num(torch.inf)
        room = reach - (points - middle).abs().amax(1)
    # One comparison: each costs as much as eight sums.
    return points.clamp(1, c_g.shape[-1] - 2).mT, reference.weights * (room >= 0)
