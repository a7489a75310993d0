"""What correlated pairs say of the ball's radius: the residual that a wrong one leaves, most of all at the limb."""

from __future__ import annotations

import math

import torch
from torch import Tensor

from torchsphere.correlation import occlusion, znssd
from torchsphere.correlation.options import Options
from torchsphere.correlation.pairs import Pairs
from torchsphere.correlation.reference import Reference, build_reference, nuisances, slopes
from torchsphere.correlation.solve import GRADIENT_FROM_DEG
from torchsphere.correlation.warp import warp_with_gradient
from torchsphere.geometry import motion_models, rotation
from torchsphere.geometry.motion_models import Displacement, as_unknowns

#: Turn per pair above which the residual tells nothing of the radius, deg: the changing view of the texture leaves
#: more. Measured as errors of 50 px: 0.1 px at 3 and 6 deg, 0.35 at 10, 0.6 at 15; the outline alone errs by 0.3.
MAX_RADIUS_TURN_DEG = 8.0


def radius_score(pairs: Pairs, q: Tensor, options: Options) -> tuple[Tensor, Tensor]:
    """What n correlated pairs say of the radius that they were correlated with.

    The residual that the increments ``q`` (n, 5) leave is compared with what a change of the radius would leave after
    the increments have adapted to it.

    Returns
    -------
    score, information : Tensor
        (n,) each; the pairs' common correction of the radius is ``sum(score) / sum(information)``, px.
    """
    model, c_g = motion_models.MODELS[options.model], pairs.g.c
    # All pixels: half of them told radii of 50 px to 0.095 px, root mean square of twelve shots, and all to 0.063.
    reference = build_reference(
        pairs.f, pairs.circles, options.roi, options.pre_blur, options.camera, blurred_every=None
    )
    q = as_unknowns(q.to(c_g), model)
    # The exact Jacobian: at the limb, where the radius shows, the reference's gradient is off by a third at 5 deg.
    warped, weights, gradient = warp_with_gradient(reference, c_g, pairs.shift, q, model)
    difference = znssd.residual(reference.values, warped, weights)
    of_radius = (_radius_mode(reference, q, model) * gradient).sum(1, keepdim=True)
    # The radius is one more unknown, the last: what belongs to all of them is computed once.
    both = torch.cat((slopes(gradient, q, model, reference), of_radius), 1)
    both = znssd.project(both, nuisances(reference, model, weights), weights)
    normal = znssd.operator(both, weights)
    adapted = torch.cholesky_solve(normal[:, :-1, -1:], znssd.cholesky(normal[:, :-1, :-1])).to(both)
    left = (both[:, -1:] - adapted.mT @ both[:, :-1])[:, 0]
    # Of fast turns the exact models tell no radius at all: errors of 0.3 px of 50 at 7 deg and 3 radii's distance.
    up_to = MAX_RADIUS_TURN_DEG if options.camera is None else GRADIENT_FROM_DEG
    weights = weights * (q[:, 2:5].norm(dim=-1, keepdim=True) < math.radians(up_to))
    if options.robust and model is motion_models.rigid:
        weights = weights * occlusion.is_ball(reference, warped, weights, weights, q, model)
    return (weights * left * difference).sum(-1).double().cpu(), (weights * left.square()).sum(-1).double().cpu()


def _radius_mode(reference: Reference, q: Tensor, model: Displacement) -> Tensor:
    """How far (n, 2, p) a change of the radius moves each point in the deformed image, px per px."""
    if model in motion_models.CLOSED_FORM:
        # Automatic differentiation loads a compiler at its first use, which takes 2 s: the time of 1000 pairs.
        return rotation.radius_mode(
            q, reference.surface, reference.geometry.radius, exact=model is motion_models.finite
        )
    return motion_models.radius_mode(model, q, reference.points, reference.geometry).mT
