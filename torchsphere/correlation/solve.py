"""The motion of n pairs: a coarse solution on few points, then a solution on all points.

Rows are solved again with an exact model where they turn fast, without occluders where a part of the ball does not fit
(`occlusion`), and with uneven changes of light where the residual shows them (`illumination`).
"""

from __future__ import annotations

import dataclasses
import functools
import math

import torch
from torch import Tensor

from torchsphere.correlation import frame_status, illumination, occlusion
from torchsphere.correlation.explained import explained_cells
from torchsphere.correlation.gauss_newton import CoarseSolution, SolverSettings, gauss_newton
from torchsphere.correlation.options import Options
from torchsphere.correlation.reference import Pairs, Reference, build_reference, point_spacing
from torchsphere.correlation.result import Correlation
from torchsphere.correlation.uncertainty import evaluate
from torchsphere.correlation.warp import warp
from torchsphere.geometry import motion_models
from torchsphere.geometry.motion_models import Displacement, as_unknowns
from torchsphere.imaging import crop

#: Turn per pair from which the gradient of the deformed image is used, deg: at the limb the reference's is too far off.
GRADIENT_FROM_DEG = 2.0

#: Least turn per pair that is measured both ways, rad (docs/constants.toml).
MIN_TWO_WAY_TURN = math.radians(1.0)

#: Largest difference of both ways at the ball's front, share of the radius (docs/constants.toml).
MAX_DISAGREEMENT = 0.05

#: Largest difference of both ways in the translation alone, share of the radius (docs/constants.toml).
MAX_SHIFT_DISAGREEMENT = 0.1

#: Every how many points the coarse solution uses, and the least number of points it needs (docs/constants.toml).
COARSE_STEP, MIN_COARSE_POINTS = 4, 400

#: Most iterations of the coarse solution, and its tolerance, px (docs/constants.toml).
MAX_COARSE_ITERATIONS, COARSE_TOLERANCE_PX = 10, 0.05


def solve_coarsely(pairs: Pairs, start: Tensor, options: Options) -> CoarseSolution:
    """Unknowns from ``start`` (n, 5), right to about 0.01 px, on a part of the points; a small ball keeps ``start``."""
    radius = options.roi * float(pairs.circles[:, 2].max())
    points = math.pi * (radius / point_spacing(radius, options.pre_blur)) ** 2
    if points < COARSE_STEP * MIN_COARSE_POINTS or options.max_iterations <= MAX_COARSE_ITERATIONS:
        return CoarseSolution.none(start)
    model = motion_models.MODELS[options.model]
    model = motion_models.finite if model is motion_models.rigid else model
    exact = bool((motion_models.turn(start) >= math.radians(GRADIENT_FROM_DEG)).any())
    reference, first = _reference(pairs, start, model, options, every=COARSE_STEP)
    exact = exact or options.jacobian == "autograd"
    settings = SolverSettings(MAX_COARSE_ITERATIONS, max(COARSE_TOLERANCE_PX, options.tolerance_px), exact)
    found = gauss_newton(reference, pairs.g.c, pairs.shift, first, model, settings)
    return CoarseSolution(torch.where(found.converged[:, None], found.q, first), found.iterations, found.converged)


def solve(pairs: Pairs, guess: Tensor, options: Options, start: Tensor | None = None) -> Correlation:
    """Correlate n pairs from ``guess`` (n, k), the coarse solution from ``start`` (n, 5).

    Pairs that turn fast are solved with the exact model and the exact Jacobian.
    """
    start = guess if start is None else start
    if motion_models.MODELS[options.model] not in motion_models.RIGID_BALL:
        return _solve_with_light(pairs, guess, start, options)
    slow, fast = _by_turn(options)
    limit = math.radians(options.finite_from_deg or GRADIENT_FROM_DEG)
    turns_fast = motion_models.turn(guess) >= limit
    if bool(turns_fast.all()):
        return _solve_with_light(pairs, guess, start, fast)
    found = _solve_with_light(pairs, guess, start, slow, limit)
    # Fast turns that were expected, and fast turns that only the solution shows.
    again = turns_fast | (found.turn >= limit)
    if not bool(again.any()):
        return found
    rows = torch.nonzero(again)[:, 0]
    better = torch.where(found.q.isfinite() & ~turns_fast[:, None], found.q, guess[:, :5])[rows]
    return found.replaced(rows, _solve_with_light(pairs.take(rows), better, start[rows], fast))


def average_both_ways(pairs: Pairs, targets: Tensor, found: Correlation, options: Options) -> Correlation:
    """``found`` with the mean of both directions, f to g and g to f, in the rows that turn by `MIN_TWO_WAY_TURN`.

    Errors of even order in the rotation cancel in the mean. ``targets`` (n, 3): circles of the ball in the deformed
    images. A row whose way back fails takes its status; a row whose ways disagree has not converged.
    """
    chosen = torch.nonzero(found.turn >= MIN_TWO_WAY_TURN)[:, 0]
    if len(chosen) == 0:
        return found
    forth = found.q[chosen]
    rows = chosen.cpu()
    some = pairs.take(chosen)
    back = solve(Pairs(some.g, some.f, targets[rows]), -forth, options)
    dx, dy, wx, wy, wz = (forth + back.q).unbind(-1)
    radius = some.circles[:, 2].to(dx)
    # The motion of the ball's front is known better than translation or rotation alone.
    front = torch.stack((dx - radius * wy, dy + radius * wx, radius * wz), -1).norm(dim=-1)
    # A way back that failed is NaN: the comparison is False, and its own status is kept.
    disagree = (front > MAX_DISAGREEMENT * radius) | (torch.hypot(dx, dy) > MAX_SHIFT_DISAGREEMENT * radius)
    status = found.status.copy()
    status[rows.numpy()] = frame_status.of_both_ways(back.status, disagree.cpu().numpy())
    good = torch.from_numpy(status[rows.numpy()] == frame_status.OK).to(forth.device)
    q, covariance, zncc, growth = (v.clone() for v in (found.q, found.covariance, found.zncc, found.growth))
    q[chosen] = torch.where(good[:, None], (forth - back.q) / 2, torch.nan)
    covariance[chosen] = torch.where(good[:, None, None], covariance[chosen], torch.nan)
    zncc[chosen] = torch.minimum(zncc[chosen], back.zncc)
    growth[chosen] = torch.where(good, (growth[chosen] - back.growth) / 2, torch.nan)
    return dataclasses.replace(found, q=q, covariance=covariance, zncc=zncc, growth=growth, status=status)


@functools.lru_cache(maxsize=16)
def _by_turn(options: Options) -> tuple[Options, Options]:
    """The options for pairs that turn slowly, and for pairs that turn fast."""
    exact = "finite" if options.model == "rigid" else options.model
    # The linearised model lacks the rotation's second order and saves only a tenth of the time: used on request alone.
    slow = options if options.finite_from_deg else dataclasses.replace(options, model=exact)
    return slow, dataclasses.replace(options, model=exact, jacobian="autograd")


def _solve_with_light(
    pairs: Pairs, guess: Tensor, start: Tensor, options: Options, fast_from: float = math.inf
) -> Correlation:
    """Correlate all pairs by one model, and again with uneven light where the light changes unevenly.

    Pairs that turn by ``fast_from``, rad, or more are to be solved again by another model.
    """
    found, q, light_is_uneven = _solve(pairs, guess, start, options, fast_from)
    rows = torch.nonzero(light_is_uneven)[:, 0]
    if len(rows) == 0:
        return found
    again, _, _ = _solve(pairs.take(rows), q[rows], start[rows], options, fast_from, uneven_light=True)
    return found.replaced(rows, dataclasses.replace(again, iterations=again.iterations + found.iterations[rows]))


def _solve(
    pairs: Pairs, guess: Tensor, start: Tensor, options: Options, fast_from: float, *, uneven_light: bool = False
) -> tuple[Correlation, Tensor, Tensor]:
    """The correlation by one model, its unknowns (n, k), and True (n,) for pairs whose light changes unevenly.

    With ``uneven_light`` the criterion allows for such a change, and no pair is True.
    """
    model = motion_models.MODELS[options.model]
    reference, first = _reference(pairs, guess, model, options)
    reference = dataclasses.replace(reference, uneven_light=uneven_light)
    c_g, shift = pairs.g.c, pairs.shift
    settings = SolverSettings(options.max_iterations, options.tolerance_px, options.jacobian == "autograd")
    solution = gauss_newton(reference, c_g, shift, first, model, settings)
    # Weights are 0 to 1; a comparison takes three times as long.
    visible = solution.weights.ceil().sum(-1)
    light_is_uneven = illumination.light_is_uneven(reference, solution, model)
    # The search for occluders takes a few steps of its own.
    if options.robust and model in motion_models.RIGID_BALL and options.max_iterations > occlusion.STEPS:
        occluded = ~solution.converged | occlusion.is_occluded(reference, solution, model)
        # A large turn that the model does not explain yet is no occluder.
        occluded = occluded & ~(solution.converged & (motion_models.turn(solution.q) >= fast_from))
        if not uneven_light:
            # Light may look like an occluder: it is allowed for first.
            light_is_uneven = light_is_uneven | (occluded & illumination.is_light_identifiable(solution, model))
            occluded = occluded & ~light_is_uneven
        whole, occluded_rows = reference, torch.nonzero(occluded)[:, 0]
        guesses = (first, as_unknowns(start, model))
        reference, solution = occlusion.solve_without_occluders(
            reference, c_g, shift, guesses, solution, occluded, model, settings
        )
        found = evaluate(reference, solution, visible, model, options)
        if len(occluded_rows):
            some = whole.take(occluded_rows)
            cells = _cells(some, c_g[occluded_rows], shift[occluded_rows], solution.q[occluded_rows], model)
            found = dataclasses.replace(found, explained=found.explained.index_copy(0, occluded_rows, cells))
        return found, solution.q, light_is_uneven
    return evaluate(reference, solution, visible, model, options), solution.q, light_is_uneven


def _cells(reference: Reference, c_g: Tensor, shift: Tensor, q: Tensor, model: Displacement) -> Tensor:
    """`explained_cells` of the motion ``q`` (n, k)."""
    warped, seen = warp(reference, c_g, shift, q, model)
    return explained_cells(reference, warped, seen, q, model)


def explain(pairs: Pairs, q: Tensor, options: Options) -> Tensor:
    """Share (n, 2, c, c) of each cell of the ball that the motion ``q`` (n, 5) explains, before and after it."""
    model = motion_models.MODELS[options.model]
    model = motion_models.finite if model is motion_models.rigid else model
    reference, unknowns = _reference(pairs, q, model, options)
    return _cells(reference, pairs.g.c, pairs.shift, unknowns, model)


def _reference(
    pairs: Pairs, start: Tensor, model: Displacement, options: Options, every: int = 1
) -> tuple[Reference, Tensor]:
    """The reference, weighted for a motion like ``start``, and ``start`` as the model's unknowns (n, k)."""
    first = as_unknowns(start, model)
    spacing = point_spacing(options.roi * float(pairs.circles[:, 2].max()), options.pre_blur)
    reference = build_reference(
        pairs.f, pairs.circles, options.roi, options.pre_blur, options.camera, spacing=spacing, every=every
    )
    reference = _without_unusable(reference, pairs.g.crops, pairs.shift, first, model)
    return occlusion.weight_by_view(reference, first, model) if model in motion_models.EXACT else reference, first


def _without_unusable(
    reference: Reference, crops: crop.Crops, shift: Tensor, start: Tensor, model: Displacement
) -> Reference:
    """The reference with weight 0 for points that ``start`` moves to unusable pixels of the deformed image.

    The guess is right to a px or two, and constant weights let the iteration converge.
    """
    if crops.usable is None:
        return reference
    moved = reference.points + motion_models.displacement(model, start, reference.points, reference.geometry)
    last = crops.images.shape[-1] - 1
    at = (moved + shift[:, None]).nan_to_num(0.0).round().long().clamp(0, last)
    rows = torch.arange(len(at), device=at.device)[:, None]
    usable = crops.usable[rows, at[..., 1], at[..., 0]]
    return dataclasses.replace(reference, weights=reference.weights * usable)
