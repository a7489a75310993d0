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

from torchsphere import criterion, interpolate, misfit, motion
from torchsphere.motion import Displacement
from torchsphere.newton import How, Solution, gauss_newton, warp
from torchsphere.reference import Reference

#: A window is no noise when its residual's energy is above this many times that of the calmer part of the ball, its
#: 0.3 quantile. Measured over clean pairs: 8 at most.
MAX_ENERGY, CALM = 10.0, 0.3

#: The calm part is itself no match where its energy is above this many times the noise that the raw image shows, which
#: texture raises too. Measured: 0.1 to 0.9, 2.2 at 20 deg per frame, 2 to 5 under strong compression.
MAX_CALM = 5.0

#: Texture that foreshortens differently in both images matches to within a misplacement of this many px, and so many
#: more per degree of turn, times 1 / cos - 1 of the steeper of its two views. Measured as the worst windows of clean
#: pairs: 0.10 px at 1 deg, 0.2 at 3, 0.53 at 10 and 0.67 at 15 where the cosine is 0.3; 0.11 px at 10 deg and 0.7.
MISPLACED_PX, MISPLACED_PX_PER_DEG, LEAST_COSINE = 0.06, 0.027, 0.1

#: Misplacement at which a point counts half, px. Measured at 10 to 20 deg: 0.2 to 0.5 px give about the same.
TOLERATED_PX = 0.35

#: Local coefficient that tells ball from occluder before gain, offset and motion are known well.
FIRST_ZNCC = 0.6

#: Share of the points that make a pair doubtful.
DOUBT = 0.002

#: Least share of the visible points that must agree; less is another match than the ball's.
LEAST_SHARE = 0.3

#: Share of the points that must look alike at the outset.
HOPELESS = 0.1

#: Rounds of judging and solving, with this many steps in each.
ROUNDS, STEPS = 5, 4


def is_ball(
    reference: Reference,
    warped: Tensor,
    seen: Tensor,
    trusted: Tensor,
    q: Tensor,
    model: Displacement,
    pre_blur: float,
) -> Tensor:
    """True (n, p) where a point may be the ball; ``seen`` (n, p): all weights; ``trusted``: of those believed."""
    difference = criterion.residual(reference.values, warped, trusted)
    energy = misfit.local_mean(reference, difference.square(), seen)
    calm = torch.where(trusted > 0, energy, torch.nan).nanquantile(CALM, dim=-1, keepdim=True)
    value_gain, _ = interpolate.noise_gains(pre_blur)
    ceiling = MAX_CALM * 2 * value_gain * reference.noise.square()[:, None]
    calm = torch.minimum(calm, ceiling)
    good = ~(energy > MAX_ENERGY * calm)
    rows = torch.nonzero(~(good | (seen == 0)).all(-1))[:, 0]
    if len(rows):
        excess = (energy - MAX_ENERGY * calm)[rows]
        good[rows] |= excess <= _foreshortening(reference.take(rows), seen[rows], q[rows], model)
    return good


def _misplacement(reference: Reference, q: Tensor, model: Displacement) -> Tensor:
    """``1 / cos - 1`` (n, p) of the steeper view of each point, before or after the motion ``q`` (n, k)."""
    radius = reference.geometry.radius[:, None]
    moved = reference.points + motion.displacement(model, q, reference.points, reference.geometry) - q[:, None, :2]
    height = torch.minimum(*(motion.depth(at, radius) for at in (reference.points, moved)))
    return 1 / (height / radius).nan_to_num(0.0).clamp_min(LEAST_COSINE) - 1


def _foreshortening(reference: Reference, seen: Tensor, q: Tensor, model: Displacement) -> Tensor:
    """Residual's energy (n, p) that the changing view of the texture alone may leave."""
    degrees = torch.rad2deg(q[:, 2:5].norm(dim=-1, keepdim=True))
    misplaced = (MISPLACED_PX + MISPLACED_PX_PER_DEG * degrees) * _misplacement(reference, q, model)
    return misplaced.square() * misfit.local_mean(reference, reference.gradient.square().sum(-1), seen)


def by_view(reference: Reference, q: Tensor, model: Displacement) -> Reference:
    """The reference with less weight where a turn like that of ``q`` (n, k) spoils the match of the texture.

    Measured with `finite` both ways: at 20 deg per frame the errors fall from 0.032 px and 0.054 deg to 0.012 px and
    0.011 deg, at 10 deg from 0.013 px and 0.024 deg to 0.006 px and 0.009 deg; at 3 deg nothing changes.
    """
    degrees = torch.rad2deg(q[:, 2:5].norm(dim=-1, keepdim=True))
    misplaced = MISPLACED_PX_PER_DEG * degrees * _misplacement(reference, q, model)
    return dataclasses.replace(reference, weights=reference.weights / (1 + (misplaced / TOLERATED_PX).square()))


def doubtful(
    reference: Reference, warped: Tensor, weights: Tensor, q: Tensor, model: Displacement, pre_blur: float
) -> Tensor:
    """True (n,) where a part of the pair is not explained by the motion ``q`` (n, k) of the whole."""
    wrong = ~is_ball(reference, warped, weights, weights, q, model, pre_blur) & (weights > 0)
    return wrong.sum(-1) > DOUBT * weights.sum(-1)


def reconsider(
    reference: Reference,
    c_g: Tensor,
    shift: Tensor,
    start: Tensor,
    solution: Solution,
    doubt: Tensor,
    model: Displacement,
    how: How,
    pre_blur: float,
) -> tuple[Reference, Solution]:
    """The reference with the weights of what is the ball, and its solution, in the rows that are in ``doubt`` (n,).

    A row in which a small part only agrees is no match: it keeps its weights and counts as not converged.
    """
    rows = torch.nonzero(doubt)[:, 0]
    if len(rows) == 0:
        return reference, solution
    q, converged = solution.q[rows], solution.converged[rows]
    part = reference.take(rows)
    guesses = (torch.where(converged[:, None], q, start[rows]), start[rows])
    partly, settled = _settle(part, c_g[rows], shift[rows], guesses, model, how, pre_blur)
    enough = partly.weights.sum(-1) >= LEAST_SHARE * part.weights.sum(-1)
    weights = torch.where(enough[:, None], partly.weights, part.weights)
    return dataclasses.replace(reference, weights=reference.weights.index_copy(0, rows, weights)), Solution(
        solution.q.index_copy(0, rows, torch.where(enough[:, None], settled.q, q)),
        solution.iterations.index_add(0, rows, settled.iterations),
        solution.converged.index_copy(0, rows, enough & settled.converged),
    )


def _settle(
    full: Reference,
    c_g: Tensor,
    shift: Tensor,
    guesses: tuple[Tensor, ...],
    model: Displacement,
    how: How,
    pre_blur: float,
) -> tuple[Reference, Solution]:
    """Solve pairs on the points that agree -> the reference with their weights, and the solution.

    ``guesses`` (n, k) each: of these the one that makes more of the ball look alike is taken.
    """
    q, trusted = _first_judgement(full, c_g, shift, guesses, model)
    reference = dataclasses.replace(full, weights=trusted)
    taken = torch.zeros(len(q), dtype=torch.long, device=q.device)
    if not bool(trusted.any()):
        return reference, Solution(q, taken, torch.zeros_like(taken, dtype=torch.bool))
    few = How(STEPS, 10 * how.tolerance_px, how.exact)
    for _ in range(ROUNDS):
        q, iterations, _ = gauss_newton(reference, c_g, shift, q, model, few)
        taken += iterations
        warped, seen = warp(full, c_g, shift, q, model)
        believed = full.weights * is_ball(full, warped, seen, trusted * (seen > 0), q, model, pre_blur)
        settled = bool((believed == trusted).all())
        trusted = believed
        reference = dataclasses.replace(full, weights=trusted)
        if settled:
            break
    q, iterations, converged = gauss_newton(reference, c_g, shift, q, model, how)
    return reference, Solution(q, taken + iterations, converged & (taken + iterations <= how.max_iterations))


def _first_judgement(
    reference: Reference, c_g: Tensor, shift: Tensor, guesses: tuple[Tensor, ...], model: Displacement
) -> tuple[Tensor, Tensor]:
    """The better guess (n, k) of each pair, and the weights (n, p) of the points that it makes alike in shape."""
    q, best = guesses[0], torch.zeros_like(reference.weights)
    for guess in guesses:
        warped, seen = warp(reference, c_g, shift, guess, model)
        alike = seen * (misfit.local_zncc(reference, warped, seen) > FIRST_ZNCC)
        better = (alike.sum(-1) > best.sum(-1))[:, None]
        q, best = torch.where(better, guess, q), torch.where(better, alike, best)
    # With hardly a point alike there is nothing to begin with.
    enough = best.sum(-1, keepdim=True) > HOPELESS * reference.weights.sum(-1, keepdim=True)
    return q, torch.where(enough, best, 0.0)
