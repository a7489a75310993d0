"""The motion of n pairs: brought near on few points, solved on all of them, and again where the first look was wrong.

Rows are solved again with an exact model where they turn fast, without what does not belong to the ball where they are
in doubt (`occlusion`), and with light that changes unevenly where they show it (`illumination`).
"""

from __future__ import annotations

import dataclasses
import functools
import math

import torch
from torch import Tensor

from torchsphere.correlation import illumination, occlusion
from torchsphere.correlation.gauss_newton import APPROACH_STEPS, EVERY, FEWEST, Approach, How, bring_near, gauss_newton
from torchsphere.correlation.options import Options
from torchsphere.correlation.pairs import Pairs
from torchsphere.correlation.reference import Reference, build_reference, enough
from torchsphere.correlation.result import Correlation
from torchsphere.correlation.uncertainty import conclude
from torchsphere.geometry import motion_models
from torchsphere.geometry.motion_models import Displacement, as_unknowns
from torchsphere.imaging import crop

#: Turn per pair from which the gradient of the deformed image is taken at each iterate, deg: that of the reference is
#: too far off at the limb by then.
GRADIENT_FROM_DEG = 2.0


def approach(pairs: Pairs, start: Tensor, options: Options) -> Approach:
    """Unknowns brought from ``start`` (n, 5) to within a hundredth of a px on a part of the points.

    Small balls have no points to spare and stay where they are.
    """
    radius = options.roi * float(pairs.circles[:, 2].max())
    points = math.pi * (radius / enough(radius, options.pre_blur)) ** 2
    if points < EVERY * FEWEST or options.max_iterations <= APPROACH_STEPS:
        return Approach.none(start)
    model = motion_models.MODELS[options.model]
    model = motion_models.finite if model is motion_models.rigid else model
    exact = bool((motion_models.turn(start) >= math.radians(GRADIENT_FROM_DEG)).any())
    reference, first = _reference(pairs, start, model, options, every=EVERY)
    how = How(options.max_iterations, options.tolerance_px, exact or options.jacobian == "autograd")
    return bring_near(reference, pairs.g.c, pairs.shift, first, model, how)


def solve(pairs: Pairs, near: Tensor, options: Options, start: Tensor | None = None) -> Correlation:
    """Correlate n pairs from ``near`` (n, k), which came from ``start`` (n, 5) by `approach`."""
    start = near if start is None else start
    if motion_models.MODELS[options.model] not in (motion_models.rigid, *motion_models.EXACT):
        return _solve(pairs, near, start, options)
    slowly, exactly = _by_turn(options)
    limit = math.radians(options.finite_from_deg or GRADIENT_FROM_DEG)
    turning = motion_models.turn(near) >= limit
    if bool(turning.all()):
        return _solve(pairs, near, start, exactly)
    found = _solve(pairs, near, start, slowly, again_from=limit)
    # Rows whose turn asks for more, whether that was expected or is only found now.
    beyond = turning | (found.turn >= limit)
    if not bool(beyond.any()):
        return found
    rows = torch.nonzero(beyond)[:, 0]
    better = torch.where(found.q.isfinite() & ~turning[:, None], found.q, near[:, :5])[rows]
    return found.replaced(rows, _solve(pairs.take(rows), better, start[rows], exactly))


@functools.lru_cache(maxsize=16)
def _by_turn(options: Options) -> tuple[Options, Options]:
    """The options for rows that turn slowly, and for those that turn fast."""
    exact = "finite" if options.model == "rigid" else options.model
    # Measured at 0.57 deg per frame: the second order of the rotation, which `rigid` lacks, is half of its bias (0.0009
    # of 0.0018 deg), and costs a tenth of the time.
    slowly = options if options.finite_from_deg else dataclasses.replace(options, model=exact)
    return slowly, dataclasses.replace(options, model=exact, jacobian="autograd")


def _solve(
    pairs: Pairs, near: Tensor, start: Tensor, options: Options, again_from: float = math.inf, *, uneven: bool = False
) -> Correlation:
    """`solve` with one model for all rows; those that turn by ``again_from``, rad, or more are to be solved again.

    With ``uneven``, light that changes unevenly over the ball is allowed for; rows that show it are solved so by
    themselves.
    """
    model = motion_models.MODELS[options.model]
    reference, first = _reference(pairs, near, model, options)
    reference = dataclasses.replace(reference, uneven_light=uneven)
    c_g, shift = pairs.g.c, pairs.shift
    how = How(options.max_iterations, options.tolerance_px, options.jacobian == "autograd")
    solution = gauss_newton(reference, c_g, shift, first, model, how)
    # Weights are 0 to 1; comparisons take three times as long.
    visible = solution.weights.ceil().sum(-1)
    lit = illumination.is_uneven(reference, solution, model)
    # Judging takes a few steps of its own.
    if (
        options.robust
        and model in (motion_models.rigid, *motion_models.EXACT)
        and options.max_iterations > occlusion.STEPS
    ):
        doubt = ~solution.converged | occlusion.doubtful(reference, solution, model, options.pre_blur)
        # What is not explained of a large turn so far is no occluder.
        turned = motion_models.turn(solution.q) >= again_from
        doubt = doubt & ~(solution.converged & turned)
        if not uneven:
            # What looks like an occluder may be light; only what that does not explain is left out.
            lit = lit | (doubt & illumination.judgeable(solution, model))
            doubt = doubt & ~lit
        guesses = (first, as_unknowns(start, model))
        reference, solution = occlusion.reconsider(
            reference, c_g, shift, guesses, solution, doubt, model, how, options.pre_blur
        )
    found = conclude(reference, solution, visible, model, options)
    rows = torch.nonzero(lit)[:, 0]
    if len(rows) == 0:
        return found
    again = _solve(pairs.take(rows), solution.q[rows], start[rows], options, again_from, uneven=True)
    return found.replaced(rows, dataclasses.replace(again, iterations=again.iterations + found.iterations[rows]))


def _reference(
    pairs: Pairs, start: Tensor, model: Displacement, options: Options, every: int = 1
) -> tuple[Reference, Tensor]:
    """The reference, weighted for a motion like ``start``, and that as the model's unknowns (n, k)."""
    first = as_unknowns(start, model)
    spacing = enough(options.roi * float(pairs.circles[:, 2].max()), options.pre_blur)
    reference = build_reference(
        pairs.f, pairs.circles, options.roi, options.pre_blur, options.camera, spacing=spacing, every=every
    )
    reference = _where_target_is_usable(reference, pairs.g.crops, pairs.shift, first, model)
    return occlusion.by_view(reference, first, model) if model in motion_models.EXACT else reference, first


def _where_target_is_usable(
    reference: Reference, crops: crop.Crops, shift: Tensor, start: Tensor, model: Displacement
) -> Reference:
    """The reference with the weights of points that fall on unusable pixels of the deformed image set to 0.

    The first guess decides: it is right to a pixel or two, and weights that stay as they are let the iteration settle.
    """
    if crops.usable is None:
        return reference
    moved = reference.points + motion_models.displacement(model, start, reference.points, reference.geometry)
    last = crops.images.shape[-1] - 1
    at = (moved + shift[:, None]).nan_to_num(0.0).round().long().clamp(0, last)
    rows = torch.arange(len(at), device=at.device)[:, None]
    usable = crops.usable[rows, at[..., 1], at[..., 0]]
    return dataclasses.replace(reference, weights=reference.weights * usable)
