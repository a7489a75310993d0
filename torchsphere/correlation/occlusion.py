"""Leave out what is not the ball: occluders, reflections, whatever the motion of the ball cannot explain.

A pair is doubted where, somewhere on the ball, the residual is far above the rest of it and the two images also differ
in shape there. Only such pairs come here. Points are then judged by windows, not one by one, because a speckle that
happens to look like the occluder must go with its neighbours; and once the judgement is settled it stays, so that the
last iteration is an ordinary one.
"""

from __future__ import annotations

import dataclasses

import torch
from torch import Tensor

from torchsphere import kernels
from torchsphere.correlation import illumination, residual_noise, znssd
from torchsphere.correlation.gauss_newton import Solution, SolverSettings, gauss_newton
from torchsphere.correlation.reference import Reference
from torchsphere.correlation.warp import operator, warp
from torchsphere.geometry import motion_models, rotation
from torchsphere.geometry.motion_models import Displacement
from torchsphere.imaging import interpolation
from torchsphere.kernels import region
from torchsphere.kernels import znssd as znssd_loop

#: A window is no noise when its residual's energy is above this many times that of the calmer part of the ball, its
#: 0.3 quantile. Measured over clean pairs: 8 at most.
MAX_ENERGY, CALM_QUANTILE = 10.0, 0.3

#: The calm part is itself no match where its energy is above this many times the noise that the raw image shows, which
#: texture raises too. Measured: 0.1 to 0.9, 2.2 at 20 deg per frame, 2 to 5 under strong compression.
MAX_CALM = 5.0

#: Texture that foreshortens differently in both images matches to within a misplacement of this many px, and so many
#: more per degree of turn, times 1 / cos - 1 of the steeper of its two views. Measured as the worst windows of clean
#: pairs: 0.10 px at 1 deg, 0.2 at 3, 0.53 at 10 and 0.67 at 15 where the cosine is 0.3; 0.11 px at 10 deg and 0.7.
MISPLACED_PX, MISPLACED_PX_PER_DEG, MIN_COSINE = 0.06, 0.027, 0.1

#: Misplacement at which a point counts half, px. Measured at 10 to 20 deg: 0.2 to 0.5 px give about the same.
TOLERATED_PX = 0.35

#: Of the energies, which are means over windows, every so many are looked at to find that quantile: sorting all
#: took as long as two iterations.
QUANTILE_STEP = 16

#: Local coefficient that tells ball from occluder before gain, offset and motion are known well.
FIRST_ZNCC = 0.6

#: Share of the points that make a pair is_occluded.
MIN_UNEXPLAINED_SHARE = 0.002

#: Least share of the visible points that must agree; less is another match than the ball's.
MIN_BALL_SHARE = 0.3

#: Share of the points that must look alike at the outset.
MIN_ALIKE_SHARE = 0.1

#: Rounds of judging and solving, with this many steps in each.
ROUNDS, STEPS = 5, 4


def is_ball(
    reference: Reference,
    warped: Tensor,
    seen: Tensor,
    trusted: Tensor,
    q: Tensor,
    model: Displacement,
) -> Tensor:
    """True (n, p) where a point may be the ball; ``seen`` (n, p): all weights; ``trusted``: of those believed."""
    rows, alike = _suspects(reference, warped, seen, trusted, q, model)
    good = torch.ones_like(seen, dtype=torch.bool)
    good[rows] = alike
    return good


def _suspects(
    reference: Reference,
    warped: Tensor,
    seen: Tensor,
    trusted: Tensor,
    q: Tensor,
    model: Displacement,
) -> tuple[Tensor, Tensor]:
    """Numbers (m,) of the rows that are not calm throughout, few as a rule, and `is_ball` of these (m, p)."""
    difference = znssd.residual(reference.values, warped, trusted)
    energy = residual_noise.local_mean(reference, difference.square(), seen)
    calm = _quantile(energy[:, ::QUANTILE_STEP], trusted[:, ::QUANTILE_STEP] > 0)
    value_gain, _ = interpolation.noise_gains(reference.pre_blur)
    ceiling = MAX_CALM * 2 * value_gain * reference.noise.square()
    limit = MAX_ENERGY * torch.minimum(calm, ceiling)
    rows = torch.nonzero(_beyond(energy, limit, seen))[:, 0]
    seen = seen[rows]
    excess = (energy[rows] - limit[rows, None]) * (seen > 0)
    if len(rows) == 0:
        return rows, excess <= 0
    return rows, (excess <= 0) | (excess <= _foreshortening(reference.take(rows), seen, q[rows], model))


def _beyond(energy: Tensor, limit: Tensor, seen: Tensor) -> Tensor:
    """True (n,) where the energy (n, p) of a point that is ``seen`` is above the row's limit (n,)."""
    if kernels.suits(energy, limit, seen):
        return znssd_loop.beyond(energy, limit, seen)
    return ((energy > limit[:, None]) & (seen > 0)).any(-1)


def _quantile(values: Tensor, counted: Tensor) -> Tensor:
    """The `CALM_QUANTILE` quantile (n,) of those ``values`` (n, m) that are ``counted``; NaN where none is."""
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
        moved = (
            reference.points
            + motion_models.displacement(model, q, reference.points, reference.geometry)
            - q[:, None, :2]
        )
        after = motion_models.depth(moved, radius).nan_to_num(0.0)
    height = torch.minimum(-reference.surface[:, 2], after)
    return radius / height.clamp_min(MIN_COSINE * radius) - 1


def _foreshortening(reference: Reference, seen: Tensor, q: Tensor, model: Displacement) -> Tensor:
    """Residual's energy (n, p) that the changing view of the texture alone may leave."""
    degrees = torch.rad2deg(motion_models.turn(q))[:, None]
    misplaced = (MISPLACED_PX + MISPLACED_PX_PER_DEG * degrees) * _misplacement(reference, q, model)
    return misplaced.square() * residual_noise.local_mean(reference, reference.gradient.square().sum(1), seen)


def weight_by_view(reference: Reference, q: Tensor, model: Displacement) -> Reference:
    """The reference with less weight where a turn like that of ``q`` (n, k) spoils the match of the texture.

    Measured with `finite` both ways: at 20 deg per frame the errors fall from 0.032 px and 0.054 deg to 0.012 px and
    0.011 deg, at 10 deg from 0.013 px and 0.024 deg to 0.006 px and 0.009 deg; at 3 deg nothing changes.
    """
    degrees = torch.rad2deg(motion_models.turn(q))[:, None]
    surface, weights, radius = reference.surface, reference.weights, reference.geometry.radius
    if model in motion_models.CLOSED_FORM and kernels.suits(surface, weights, q):
        turn, share = (
            rotation.matrices(q, exact=model is motion_models.finite),
            MISPLACED_PX_PER_DEG / TOLERATED_PX * degrees,
        )
        weights = region.seen_alike(surface, weights, turn, radius, share[:, 0], MIN_COSINE)
        return dataclasses.replace(reference, weights=weights)
    misplaced = MISPLACED_PX_PER_DEG * degrees * _misplacement(reference, q, model)
    return dataclasses.replace(reference, weights=weights / (1 + (misplaced / TOLERATED_PX).square()))


def is_occluded(reference: Reference, solution: Solution, model: Displacement) -> Tensor:
    """True (n,) where a part of the pair is not explained by the motion of the whole that was found."""
    warped, weights = (
        illumination.in_reference_light(reference, solution.warped, solution.weights, model),
        solution.weights,
    )
    rows, alike = _suspects(reference, warped, weights, weights, solution.q, model)
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
    doubt: Tensor,
    model: Displacement,
    settings: SolverSettings,
) -> tuple[Reference, Solution]:
    """The reference with the weights of what is the ball, and its solution, in the rows that are in ``doubt`` (n,).

    ``starts`` (n, k) each: where the solution may have gone astray from.

    A row in which a small part only agrees is no match: it keeps its weights and counts as not converged.
    """
    rows = torch.nonzero(doubt)[:, 0]
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
    """Solve pairs on the points that agree -> the reference with their weights, increments, steps, what converged.

    ``guesses`` (n, k) each: of these the one that makes more of the ball look alike is taken.
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
        believed = full.weights * is_ball(full, warped, seen, trusted * (seen > 0), q, model)
        settled = bool((believed == trusted).all())
        trusted = believed
        reference = dataclasses.replace(full, weights=trusted)
        if settled:
            break
    last = gauss_newton(reference, c_g, shift, q, model, settings)
    taken = taken + last.iterations
    return reference, last.q, taken, last.converged & (taken <= settings.max_iterations)


def _first_judgement(
    reference: Reference, c_g: Tensor, shift: Tensor, guesses: tuple[Tensor, ...], model: Displacement
) -> tuple[Tensor, Tensor]:
    """The better guess (n, k) of each pair, and the weights (n, p) of the points that it makes alike in shape."""
    q, best = guesses[0], torch.zeros_like(reference.weights)
    for guess in guesses:
        warped, seen = warp(reference, c_g, shift, guess, model)
        alike = seen * (residual_noise.local_zncc(reference, warped, seen) > FIRST_ZNCC)
        better = (alike.sum(-1) > best.sum(-1))[:, None]
        q, best = torch.where(better, guess, q), torch.where(better, alike, best)
    # With hardly a point alike there is nothing to begin with.
    enough = best.sum(-1, keepdim=True) > MIN_ALIKE_SHARE * reference.weights.sum(-1, keepdim=True)
    return q, torch.where(enough, best, 0.0)
