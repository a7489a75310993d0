"""Correction of the ball's radius from correlated pairs: a wrong radius leaves a residual, mostly at the limb."""

from __future__ import annotations

import math

import torch
from torch import Tensor

from torchsphere.correlation import occlusion, znssd
from torchsphere.correlation.options import Options
from torchsphere.correlation.reference import Pairs, Reference, build_reference, nuisances, slopes
from torchsphere.correlation.solve import GRADIENT_FROM_DEG
from torchsphere.correlation.warp import warp_with_gradient
from torchsphere.geometry import motion_models, rotation
from torchsphere.geometry.motion_models import Displacement, as_unknowns

#: Largest turn per pair that determines the radius, deg (docs/constants.md).
MAX_RADIUS_TURN_DEG = 8.0


def radius_score(pairs: Pairs, q: Tensor, options: Options) -> tuple[Tensor, Tensor]:
    """Score and information (n,) of the radius: the common correction is ``sum(score) / sum(information)``, px.

    The residual of the increments ``q`` (n, 5) is compared with the residual of a change of the radius to which the
    increments have adapted.
    """
    model, c_g = motion_models.MODELS[options.model], pairs.g.c
    # All pixels: half of them give radii of 50 px to 0.095 px (twelve shots), all to 0.063.
    reference = build_reference(
        pairs.f, pairs.circles, options.roi, options.pre_blur, options.camera, blurred_every=None
    )
    q = as_unknowns(q.to(c_g), model)
    # The exact Jacobian: at the limb, where the radius shows, the reference's gradient is off by a third at 5 deg.
    warped, weights, gradient = warp_with_gradient(reference, c_g, pairs.shift, q, model)
    difference = znssd.residual(reference.values, warped, weights)
    radius_slope = (_radius_mode(reference, q, model) * gradient).sum(1, keepdim=True)
    # The radius is the last unknown.
    jacobian = torch.cat((slopes(gradient, q, model, reference), radius_slope), 1)
    jacobian = znssd.project(jacobian, nuisances(reference, model, weights), weights)
    normal = znssd.operator(jacobian, weights)
    adapted = torch.cholesky_solve(normal[:, :-1, -1:], znssd.cholesky(normal[:, :-1, :-1])).to(jacobian)
    residual = (jacobian[:, -1:] - adapted.mT @ jacobian[:, :-1])[:, 0]
    # The perspective models give no radius of fast turns: errors of 0.3 px of 50 at 7 deg and a distance of 3 radii.
    limit = MAX_RADIUS_TURN_DEG if options.camera is None else GRADIENT_FROM_DEG
    weights = weights * (q[:, 2:5].norm(dim=-1, keepdim=True) < math.radians(limit))
    if options.robust and model is motion_models.rigid:
        weights = weights * occlusion.is_ball(reference, warped, weights, weights, q, model)
    score, information = (weights * residual * difference).sum(-1), (weights * residual.square()).sum(-1)
    return score.double().cpu(), information.double().cpu()


def _radius_mode(reference: Reference, q: Tensor, model: Displacement) -> Tensor:
    """Derivative (n, 2, p) of the displacement with respect to the radius, px per px."""
    if model in motion_models.CLOSED_FORM:
        # Automatic differentiation loads a compiler at its first use, which takes 2 s.
        exact = model is motion_models.finite
        return rotation.radius_mode(q, reference.surface, reference.geometry.radius, exact=exact)
    return motion_models.radius_mode(model, q, reference.points, reference.geometry).mT
