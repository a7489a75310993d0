"""Leave out parts of the image that the motion of the ball does not explain: occluders, reflections.

Points are judged in windows, because a speckle that happens to match must go with its neighbours. The last solution
keeps the weights of the last judgement.
"""

from __future__ import annotations

import dataclasses

import torch
from torch import Tensor

from torchsphere.correlation import illumination, residual_noise, znssd
from torchsphere.correlation.gauss_newton import Solution, SolverSettings, gauss_newton
from torchsphere.correlation.reference import Reference
from torchsphere.correlation.warp import operator, warp
from torchsphere.geometry import motion_models, rotation
from torchsphere.geometry.motion_models import Displacement
from torchsphere.imaging import interpolation
from torchsphere.kernels import jit, region

#: Quantile of the residual's energy that stands for the calm part of the ball.
CALM_QUANTILE = 0.3

#: Largest energy of a window on the ball, times that of the calm part (docs/constants.toml).
MAX_ENERGY = 10.0

#: Largest energy of the calm part, times the noise of the raw image (docs/constants.toml).
MAX_CALM = 5.0

#: Misplacement of foreshortened texture, px, and its growth with the turn, px per deg (docs/constants.toml).
MISPLACED_PX, MISPLACED_PX_PER_DEG = 0.06, 0.027

#: Least cosine of a view that a misplacement is computed for.
MIN_COSINE = 0.1

#: Misplacement at which a point has half its weight, px (docs/constants.toml).
TOLERATED_PX = 0.35

#: Every how many points the quantile uses: sorting all takes as long as two iterations.
QUANTILE_STEP = 16

#: Least local correlation coefficient of a point on the ball in the first judgement.
FIRST_ZNCC = 0.6

#: Least share of unexplained points in an occluded pair.
MIN_UNEXPLAINED_SHARE = 0.002

#: Least share of the visible points that must match at the end, and in the first judgement.
MIN_BALL_SHARE, MIN_ALIKE_SHARE = 0.3, 0.1

#: Rounds of judging and solving, and iterations in each.
ROUNDS, STEPS = 5, 4


def is_ball(
    reference: Reference, warped: Tensor, seen: Tensor, trusted: Tensor, q: Tensor, model: Displacement
) -> Tensor:
    """True (n, p) where a point may be the ball; ``seen`` (n, p): weights; ``trusted`` (n, p): those of inliers."""
    rows, alike = _judge_rows(reference, warped, seen, trusted, q, model)
    good = torch.ones_like(seen, dtype=torch.bool)
    good[rows] = alike
    return good


def _judge_rows(
    reference: Reference, warped: Tensor, seen: Tensor, trusted: Tensor, q: Tensor, model: Displacement
) -> tuple[Tensor, Tensor]:
    """Indices (m,) of the rows with a window of high energy, and `is_ball` of these rows (m, p)."""
    difference = znssd.residual(reference.values, warped, trusted)
    energy = residual_noise.local_mean(reference, difference.square(), seen)
    calm = _quantile(energy[:, ::QUANTILE_STEP], trusted[:, ::QUANTILE_STEP] > 0)
    value_gain, _ = interpolation.noise_gains(reference.pre_blur)
    ceiling = MAX_CALM * 2 * value_gain * reference.noise.square()
    limit = MAX_ENERGY * torch.minimum(calm, ceiling)
    rows = torch.nonzero(_exceeds(energy, limit, seen))[:, 0]
    seen = seen[rows]
    excess = (energy[rows] - limit[rows, None]) * (seen > 0)
    if len(rows) == 0:
        return rows, excess <= 0
    return rows, (excess <= 0) | (excess <= _foreshortening(reference.take(rows), seen, q[rows], model))


@jit.in_loops(region.exceeds)
def _exceeds(energy: Tensor, limit: Tensor, seen: Tensor) -> Tensor:
    """True (n,) where the energy (n, p) of a ``seen`` point exceeds the row's limit (n,)."""
    return ((energy > limit[:, None]) & (seen > 0)).any(-1)


def _quantile(values: Tensor, counted: Tensor) -> Tensor:
    """The `CALM_QUANTILE` (n,) of the ``counted`` ``values`` (n, m); NaN in a row without any."""
    count = counted.sum(-1, keepdim=True)
    ordered = (values + torch.where(counted, 0.0, torch.inf)).sort(-1).values
    found = ordered.gather(-1, (CALM_QUANTILE * (count - 1)).round().long().clamp_min(0))
    return torch.where(count > 0, found, torch.nan)[:, 0]


def _misplacement(reference: Reference, q: Tensor, model: Displacement) -> Tensor:
    """``1 / cos - 1`` (n, p) of the steeper view of each point, before or after the motion ``q`` (n, k)."""
    radius = reference.geometry.radius[:, None]
    if model in motion_models.CLOSED_FORM:
        after = -rotation.moved(q, reference.surface, exact=model is motion_models.finite)[:, 2]
    else:
        moved = reference.points + motion_models.displacement(model, q, reference.points, reference.geometry)
        after = motion_models.depth(moved - q[:, None, :2], radius).nan_to_num(0.0)
    height = torch.minimum(-reference.surface[:, 2], after)
    return radius / height.clamp_min(MIN_COSINE * radius) - 1


def _foreshortening(reference: Reference, seen: Tensor, q: Tensor, model: Displacement) -> Tensor:
    """Energy (n, p) of the residual that the changing view of the texture may cause."""
    degrees = torch.rad2deg(motion_models.turn(q))[:, None]
    misplaced = (MISPLACED_PX + MISPLACED_PX_PER_DEG * degrees) * _misplacement(reference, q, model)
    return misplaced.square() * residual_noise.local_mean(reference, reference.gradient.square().sum(1), seen)


def weight_by_view(reference: Reference, q: Tensor, model: Displacement) -> Reference:
    """The reference with less weight where a turn like that of ``q`` (n, k) changes the view of the texture much."""
    degrees = torch.rad2deg(motion_models.turn(q))[:, None]
    surface, weights, radius = reference.surface, reference.weights, reference.geometry.radius
    if model in motion_models.CLOSED_FORM and jit.suits(surface, weights, q):
        turn = rotation.matrices(q, exact=model is motion_models.finite)
        share = MISPLACED_PX_PER_DEG / TOLERATED_PX * degrees
        weights = region.view_weights(surface, weights, turn, radius, share[:, 0], MIN_COSINE)
        return dataclasses.replace(reference, weights=weights)
    misplaced = MISPLACED_PX_PER_DEG * degrees * _misplacement(reference, q, model)
    return dataclasses.replace(reference, weights=weights / (1 + (misplaced / TOLERATED_PX).square()))


def is_occluded(reference: Reference, solution: Solution, model: Displacement) -> Tensor:
    """True (n,) where the motion of the whole does not explain a part of the pair."""
    weights = solution.weights
    warped = illumination.in_reference_light(reference, solution.warped, weights, model)
    rows, alike = _judge_rows(reference, warped, weights, weights, solution.q, model)
    weights = weights[rows]
    found = torch.zeros_like(solution.converged)
    found[rows] = ((weights > 0) & ~alike).sum(-1) > MIN_UNEXPLAINED_SHARE * weights.sum(-1)
    return found


def solve_without_occluders(
    reference: Reference,
    c_g: Tensor,
    shift: Tensor,
    starts: tuple[Tensor, ...],
    solution: Solution,
    occluded: Tensor,
    model: Displacement,
    settings: SolverSettings,
) -> tuple[Reference, Solution]:
    """The reference without the occluders of the ``occluded`` (n,) rows, and its solution.

    ``starts`` (n, k) each: further guesses, in case the solution followed an occluder. A row of which only a small part
    matches keeps its weights and has not converged.
    """
    rows = torch.nonzero(occluded)[:, 0]
    if len(rows) == 0:
        return reference, solution
    part = reference.take(rows)
    q, converged = solution.q[rows], solution.converged[rows]
    guesses = (torch.where(converged[:, None], q, starts[0][rows]), *(start[rows] for start in starts))
    partly, found, taken, settled = _settle(part, c_g[rows], shift[rows], guesses, model, settings)
    enough = partly.weights.sum(-1) >= MIN_BALL_SHARE * part.weights.sum(-1)
    weights = torch.where(enough[:, None], partly.weights, part.weights)
    q = torch.where(enough[:, None], found, q)
    part = dataclasses.replace(part, weights=weights)
    warped, seen = warp(part, c_g[rows], shift[rows], q, model)
    jacobian, factor = operator(part, part.gradient, q, model, seen)
    return dataclasses.replace(reference, weights=reference.weights.index_copy(0, rows, weights)), Solution(
        solution.q.index_copy(0, rows, q),
        solution.iterations.index_add(0, rows, taken),
        solution.converged.index_copy(0, rows, enough & settled),
        solution.warped.index_copy(0, rows, warped),
        solution.weights.index_copy(0, rows, seen),
        solution.jacobian.index_copy(0, rows, jacobian),
        solution.factor.index_copy(0, rows, factor),
    )


def _settle(
    full: Reference,
    c_g: Tensor,
    shift: Tensor,
    guesses: tuple[Tensor, ...],
    model: Displacement,
    settings: SolverSettings,
) -> tuple[Reference, Tensor, Tensor, Tensor]:
    """Solve pairs on the points that match, from the best of the ``guesses`` (n, k).

    Returns the reference with their weights, the increments (n, k), the iterations (n,) and True (n,) where converged.
    """
    q, trusted = _first_judgement(full, c_g, shift, guesses, model)
    reference = dataclasses.replace(full, weights=trusted)
    taken = torch.zeros(len(q), dtype=torch.long, device=q.device)
    if not bool(trusted.any()):
        return reference, q, taken, torch.zeros_like(taken, dtype=torch.bool)
    few = SolverSettings(STEPS, 10 * settings.tolerance_px, settings.exact)
    for _ in range(ROUNDS):
        q, iterations = gauss_newton(reference, c_g, shift, q, model, few)[:2]
        taken += iterations
        warped, seen = warp(full, c_g, shift, q, model)
        judged = full.weights * is_ball(full, warped, seen, trusted * (seen > 0), q, model)
        settled = bool((judged == trusted).all())
        trusted = judged
        reference = dataclasses.replace(full, weights=trusted)
        if settled:
            break
    last = gauss_newton(reference, c_g, shift, q, model, settings)
    taken = taken + last.iterations
    return reference, last.q, taken, last.converged & (taken <= settings.max_iterations)


def _first_judgement(
    reference: Reference, c_g: Tensor, shift: Tensor, guesses: tuple[Tensor, ...], model: Displacement
) -> tuple[Tensor, Tensor]:
    """The guess (n, k) that matches the shape of more points of each pair, and the weights (n, p) of these points."""
    q, best = guesses[0], torch.zeros_like(reference.weights)
    for guess in guesses:
        warped, seen = warp(reference, c_g, shift, guess, model)
        alike = seen * (residual_noise.local_zncc(reference, warped, seen) > FIRST_ZNCC)
        better = (alike.sum(-1) > best.sum(-1))[:, None]
        q, best = torch.where(better, guess, q), torch.where(better, alike, best)
    enough = best.sum(-1, keepdim=True) > MIN_ALIKE_SHARE * reference.weights.sum(-1, keepdim=True)
    return q, torch.where(enough, best, 0.0)
