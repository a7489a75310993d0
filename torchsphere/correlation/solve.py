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
from torchsphere.correlation.gauss_newton import (
    COARSE_STEP,
    COARSE_TOLERANCE_PX,
    MAX_COARSE_ITERATIONS,
    MIN_COARSE_POINTS,
    CoarseSolution,
    SolverSettings,
    gauss_newton,
)
from torchsphere.correlation.options import Options
from torchsphere.correlation.pairs import Pairs
from torchsphere.correlation.reference import Reference, build_reference, point_spacing
from torchsphere.correlation.result import Correlation
from torchsphere.correlation.uncertainty import evaluate
from torchsphere.geometry import motion_models
from torchsphere.geometry.motion_models import Displacement, as_unknowns
from torchsphere.imaging import crop

#: Turn per pair from which the gradient of the deformed image is taken at each iterate, deg: that of the reference is
#: too far off at the limb by then.
GRADIENT_FROM_DEG = 2.0


def solve_coarsely(pairs: Pairs, start: Tensor, options: Options) -> CoarseSolution:
    """Unknowns brought from ``start`` (n, 5) to within a hundredth of a px on a part of the points.

    Small balls have no points to spare and stay where they are.
    """
    radius = options.roi * float(pairs.circles[:, 2].max())
    points = math.pi * (radius / point_spacing(radius, options.pre_blur)) ** 2
    if points < COARSE_STEP * MIN_COARSE_POINTS or options.max_iterations <= MAX_COARSE_ITERATIONS:
        return CoarseSolution.none(start)
    model = motion_models.MODELS[options.model]
    model = motion_models.finite if model is motion_models.rigid else model
    exact = bool((motion_models.turn(start) >= math.radians(GRADIENT_FROM_DEG)).any())
    reference, first = _reference(pairs, start, model, options, every=COARSE_STEP)
    settings = SolverSettings(
        min(MAX_COARSE_ITERATIONS, options.max_iterations),
        max(COARSE_TOLERANCE_PX, options.tolerance_px),
        exact or options.jacobian == "autograd",
    )
    found = gauss_newton(reference, pairs.g.c, pairs.shift, first, model, settings)
    return CoarseSolution(torch.where(found.converged[:, None], found.q, first), found.iterations, found.converged)


def solve(pairs: Pairs, near: Tensor, options: Options, start: Tensor | None = None) -> Correlation:
    """Correlate n pairs from ``near`` (n, k), which came from ``start`` (n, 5) by `solve_coarsely`.

    Pairs that turn fast are solved with the exact model and the exact Jacobian.
    """
    start = near if start is None else start
    if motion_models.MODELS[options.model] not in motion_models.RIGID_BALL:
        return _solve_in_any_light(pairs, near, start, options)
    slow, fast = _by_turn(options)
    limit = math.radians(options.finite_from_deg or GRADIENT_FROM_DEG)
    turns_fast = motion_models.turn(near) >= limit
    if bool(turns_fast.all()):
        return _solve_in_any_light(pairs, near, start, fast)
    found = _solve_in_any_light(pairs, near, start, slow, limit)
    # Pairs whose fast turn was expected, and pairs whose fast turn shows only now.
    again = turns_fast | (found.turn >= limit)
    if not bool(again.any()):
        return found
    rows = torch.nonzero(again)[:, 0]
    better = torch.where(found.q.isfinite() & ~turns_fast[:, None], found.q, near[:, :5])[rows]
    return found.replaced(rows, _solve_in_any_light(pairs.take(rows), better, start[rows], fast))


@functools.lru_cache(maxsize=16)
def _by_turn(options: Options) -> tuple[Options, Options]:
    """The options for pairs that turn slowly, and for pairs that turn fast."""
    exact = "finite" if options.model == "rigid" else options.model
    # The linearised model lacks the second order of the rotation, half of its bias at 0.57 deg per frame, and saves a
    # tenth of the time: it is used only where the user asks for it.
    slow = options if options.finite_from_deg else dataclasses.replace(options, model=exact)
    return slow, dataclasses.replace(options, model=exact, jacobian="autograd")


def _solve_in_any_light(
    pairs: Pairs, near: Tensor, start: Tensor, options: Options, fast_from: float = math.inf
) -> Correlation:
    """Correlate all pairs by one model, and pairs whose light changes unevenly once more with that light allowed for.

    Pairs that turn by ``fast_from``, rad, or more are to be solved again by another model.
    """
    found, q, light_is_uneven = _solve(pairs, near, start, options, fast_from)
    rows = torch.nonzero(light_is_uneven)[:, 0]
    if len(rows) == 0:
        return found
    again, _, _ = _solve(pairs.take(rows), q[rows], start[rows], options, fast_from, uneven_light=True)
    return found.replaced(rows, dataclasses.replace(again, iterations=again.iterations + found.iterations[rows]))


def _solve(
    pairs: Pairs, near: Tensor, start: Tensor, options: Options, fast_from: float, *, uneven_light: bool = False
) -> tuple[Correlation, Tensor, Tensor]:
    """The correlation by one model, its unknowns (n, k), and True (n,) for pairs whose light changes unevenly.

    With ``uneven_light`` such a change is allowed for, and no pair shows it any more.
    """
    model = motion_models.MODELS[options.model]
    reference, first = _reference(pairs, near, model, options)
    reference = dataclasses.replace(reference, uneven_light=uneven_light)
    c_g, shift = pairs.g.c, pairs.shift
    settings = SolverSettings(options.max_iterations, options.tolerance_px, options.jacobian == "autograd")
    solution = gauss_newton(reference, c_g, shift, first, model, settings)
    # Weights are 0 to 1; comparisons take three times as long.
    visible = solution.weights.ceil().sum(-1)
    light_is_uneven = illumination.light_is_uneven(reference, solution, model)
    # The search for occluders takes a few steps of its own.
    is_rigid = model in motion_models.RIGID_BALL
    if options.robust and is_rigid and options.max_iterations > occlusion.STEPS:
        doubt = ~solution.converged | occlusion.is_occluded(reference, solution, model)
        # A large turn that the model does not explain yet is no occluder.
        doubt = doubt & ~(solution.converged & (motion_models.turn(solution.q) >= fast_from))
        if not uneven_light:
            # Light may look like an occluder; only what light does not explain is left out.
            light_is_uneven = light_is_uneven | (doubt & illumination.is_light_identifiable(solution, model))
            doubt = doubt & ~light_is_uneven
        guesses = (first, as_unknowns(start, model))
        reference, solution = occlusion.solve_without_occluders(
            reference, c_g, shift, guesses, solution, doubt, model, settings
        )
    return evaluate(reference, solution, visible, model, options), solution.q, light_is_uneven


def _reference(
    pairs: Pairs, start: Tensor, model: Displacement, options: Options, every: int = 1
) -> tuple[Reference, Tensor]:
    """The reference, weighted for a motion like ``start``, and that as the model's unknowns (n, k)."""
    first = as_unknowns(start, model)
    spacing = point_spacing(options.roi * float(pairs.circles[:, 2].max()), options.pre_blur)
    reference = build_reference(
        pairs.f, pairs.circles, options.roi, options.pre_blur, options.camera, spacing=spacing, every=every
    )
    reference = _where_target_is_usable(reference, pairs.g.crops, pairs.shift, first, model)
    return occlusion.weight_by_view(reference, first, model) if model in motion_models.EXACT else reference, first


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
