"""Gauss-Newton steps of map, poses and shared unknowns together, on one resolution of the map.

Each step is found by conjugate gradients (`elimination`), which start from the equations without the map.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import NamedTuple

import torch
from torch import Tensor

from torchsphere.runtime.threads import RowRunner
from torchsphere.sphere_map import elimination, forward_model, radius_error, shared_unknown
from torchsphere.sphere_map.decision import NO_SOLUTION
from torchsphere.sphere_map.elimination import COMMON, GEOMETRY, PER_IMAGE, PLACE, JointEquations
from torchsphere.sphere_map.footprint import with_footprint_of_outline
from torchsphere.sphere_map.forward_model import Linearisation
from torchsphere.sphere_map.map_fit import MapEquations
from torchsphere.sphere_map.shared_unknown import SharedUnknowns, limits
from torchsphere.sphere_map.state import State, drawn, fit_map, linearised, reweighted, with_cells

#: Largest variance of a ring over that within the disc in the first step; its square in the second, and so on
#: (docs/constants.toml).
MAX_RING_VARIANCE = 4.0

#: Move of a pose by the last step from which an adjustment is given up, px: smaller ones do not matter, as every image
#: is registered again (docs/constants.toml).
MAX_UNSETTLED_PX = 0.02

#: Move of a pose below which it counts as settled on the last map, px, and in standard deviations
#: (docs/constants.toml).
LAST_SETTLED_PX, SETTLED_SD = 0.0005, 0.1

#: Most steps on the last map, and with a near camera on the first (docs/constants.toml).
MAX_STEPS = 40

#: Conjugate gradients for a map on new cells, and most for a step of map and poses together (docs/constants.toml).
NEW_MAP_STEPS, STEPS = 6, 60

#: Conjugate gradients for a step with further unknowns, always as many (docs/constants.toml).
STEPS_OF_UNKNOWNS = 20

#: Share of a move that counts as settled, by which conjugate gradients may still change a step (docs/constants.toml).
SOLVED_SHARE = 0.2

#: Largest change of the edge's blur in a step, px: its effect on the grey levels is far from linear.
MAX_BLUR_STEP_PX = 0.2

#: Largest move of a pose in a step, px (docs/constants.toml).
MAX_MOVE_PX = 1.0

#: Steps after which the weights of the pixels stay: weights and outline that follow each other creep on for long, and
#: rounding would decide where they end (docs/constants.toml).
REWEIGHTED = 6

#: Least and largest share of a move that the next one is expected to have (docs/constants.toml).
LEAST_LEFT, MOST_LEFT = 0.3, 0.8

#: Least share of a step that is taken (docs/constants.toml).
LEAST_SHARE = 0.3


class Level(NamedTuple):
    """One resolution of the map."""

    cells: int  # along a side of a face
    settled_px: float  # largest move of a pose by a step below which the level is done
    max_steps: int
    is_last: bool
    # Whether the optics blur the footprint of a pixel as they blur the outline.
    is_blurred: bool = False
    unknowns: SharedUnknowns = ()  # that all images share, beside radius and blur
    most_residual: float = math.inf  # variance of the residual above which the map will be refused

    def settled(self, state: State, covariance: Tensor) -> Tensor:
        """Moves of all unknowns that count as settled: see `limits`."""
        sd, n = covariance.diagonal().sqrt(), len(state.poses)
        px = max(self.settled_px, SETTLED_SD * float(sd[PLACE if state.ball.stays else 0]))
        by_model = radius_error.of_model(state.poses.orientation, float(state.ball.radius))
        radius_px = max(px, SETTLED_SD * math.hypot(float(sd[-COMMON]), by_model))
        of_unknowns = [
            max(unknown.last_change, SETTLED_SD * float(sd[PER_IMAGE * n + k]))
            for k, unknown in enumerate(self.unknowns)
        ]
        found = limits(n, px, of_unknowns, radius_px).to(covariance)
        if state.ball.stays:
            # A place that all images share turns none of them.
            found[: PER_IMAGE * n].view(n, PER_IMAGE)[:, :PLACE] = max(px, MAX_UNSETTLED_PX)
        return found


class LastStep(NamedTuple):
    """The last step of an adjustment."""

    state: State  # before the step
    model: Linearisation
    joint: JointEquations


@dataclass(frozen=True)
class Adjustment:
    """The adjusted ball and poses."""

    state: State
    # (u, u): of each image (dx, dy, wx, wy, wz), px, rotations times the radius, the outline's added radius, px, gain
    # and offset; then of the level's unknowns; then of radius and edge blur, px. The mean orientation defines the frame
    # and has no variance, nor has the mean of the added radii.
    covariance: Tensor
    settled: bool  # False if the poses still moved at the end
    sd_nearness: float = 0.0  # standard deviation of the ball's radius over its distance, which all images share
    last: LastStep | None = None
    unknowns: SharedUnknowns = ()
    move: float = 0.0  # by the last step, in moves that count as settled
    lens: SharedUnknowns = ()  # that the images show, and the windows were not cut for: nothing else has settled

    @property
    def residual_variance(self) -> float:
        """Variance of the residual, grey levels squared."""
        return float(self.state.profile.variance[0])

    def with_radius_error(self, error_px: float) -> Adjustment:
        """The adjustment with a further error of the radius, px, and the effect of this error on the poses."""
        covariance = self.covariance
        by_radius = covariance[:, -COMMON] / covariance[-COMMON, -COMMON]
        return replace(self, covariance=covariance + error_px**2 * torch.outer(by_radius, by_radius))


def adjust_level(state: State, level: Level, shared: RowRunner, moved: float = 0.0) -> Adjustment:
    """Gauss-Newton steps until one moves no pose by more than ``settled_px``, and no unknown by its last change.

    ``moved`` is the `Adjustment.move` before, 0 if there is none.
    """
    if not math.isfinite(float(state.ball.radius)):
        raise torch.linalg.LinAlgError(NO_SOLUTION.sentence)  # type: ignore[attr-defined]
    if state.ball.cells != level.cells:
        state, _ = fit_map(with_cells(state, level.cells), shared, NEW_MAP_STEPS)
    before, share = None, None
    for number in range(level.max_steps):
        model = linearised(state, shared)
        weights = state.profile.weights(state.windows, state.poses)
        equations = MapEquations.of(drawn(state, shared), weights, shared, state.smoothness)
        # Step by step the outline is found, and may lose the weight that it lacks.
        limit = MAX_RING_VARIANCE ** (number + 1)
        if number < REWEIGHTED:
            state = reweighted(state, state.windows.levels - model.levels, equations.leverage(), shared, limit)
            weights = state.profile.weights(state.windows, state.poses)
            equations = MapEquations.of(equations.design, weights, shared, state.smoothness)
        model = shared_unknown.with_columns(level.unknowns, state, model, shared)
        joint = joint_equations(state, model, equations, level.unknowns)
        last = LastStep(state, model, joint)
        settled = level.settled(state, joint.covariance)
        of_map, step = _step(last, level.unknowns, SOLVED_SHARE * settled)
        share = _share_of_step(share, before, step)
        taken = share * step
        state = _moved(state, level.unknowns, joint, joint.with_map(of_map, taken - step), taken)
        if level.is_blurred:
            state = with_footprint_of_outline(state)
        # A part of a long step that is taken has not settled: what counts is the whole step.
        move, move_px = float((step / settled).abs().max()), _in_px(step, state)
        if not math.isfinite(move):
            raise torch.linalg.LinAlgError(NO_SOLUTION.sentence)  # type: ignore[attr-defined]
        is_bound = level.is_last and float(state.profile.variance.max()) >= limit * float(state.profile.variance[0])
        along = 0.5 if before is None else _share_along(step / settled, before / settled)
        left, ratio, before = _left(along), move / moved if moved else 0.5, step
        # A short move may follow a long one by chance, and a long one it.
        longest, moved = max(move, moved) if level.is_last else move, move
        # Moves that stay as long as they were have not settled, wherever they go.
        has_settled = max(left, _left(ratio)) * move_px < max(level.settled_px, MAX_UNSETTLED_PX)
        is_refused = number >= REWEIGHTED and float(state.profile.variance[0]) > level.most_residual
        if is_refused or (left * longest < 1 and has_settled and not is_bound):
            break
    return Adjustment(state, joint.covariance, has_settled, last=last, unknowns=level.unknowns, move=move)


def _share_along(step: Tensor, before: Tensor) -> float:
    """The share of the step ``before`` (u,) by which the last ``step`` (u,) goes on; rounding goes on nowhere."""
    return float(step @ before / (before @ before).clamp_min(1e-30))


def _left(share: float) -> float:
    """What is left to go, over the last move, if each has that ``share`` of the one before: the sum of all to come."""
    share = min(max(share, LEAST_LEFT), MOST_LEFT)
    return share / (1 - share)


def _in_px(step: Tensor, state: State) -> float:
    """Largest move of a pose, or of the radius, by a ``step`` (u,), px; without that of a place that all share."""
    n = len(state.poses)
    of_poses = step[: PER_IMAGE * n].unflatten(0, (n, PER_IMAGE))[:, PLACE if state.ball.stays else 0 : GEOMETRY]
    return float(of_poses.abs().max().maximum(step[-COMMON].abs()))


def equations_of(state: State, unknowns: SharedUnknowns, shared: RowRunner) -> LastStep:
    """The model at the ``state`` and the equations of a step, with the weights that the state has."""
    weights = state.profile.weights(state.windows, state.poses)
    equations = MapEquations.of(drawn(state, shared), weights, shared, state.smoothness)
    model = shared_unknown.with_columns(unknowns, state, linearised(state, shared), shared)
    return LastStep(state, model, joint_equations(state, model, equations, unknowns))


def joint_equations(
    state: State, model: Linearisation, equations: MapEquations, unknowns: SharedUnknowns
) -> JointEquations:
    """The equations of a step, with the priors of the ``unknowns``, which have columns in the ``model``."""
    precisions = tuple(unknown.precision for unknown in unknowns)
    ball = state.ball
    return elimination.joint_equations(model, equations, state.poses, precisions, grows=ball.grows, stays=ball.stays)


def gradients(at: LastStep, unknowns: SharedUnknowns) -> tuple[Tensor, Tensor]:
    """Gradients by the map (m,) and by all other unknowns (u,)."""
    state, model, joint = at
    residual = state.windows.levels - model.levels
    weighted = (joint.map.weights * residual).flatten(1).unsqueeze(1)
    by_unknowns = elimination.spread_gradient(torch.bmm(weighted, model.jacobian)[:, 0].double())
    first = PER_IMAGE * len(state.poses)
    for number, unknown in enumerate(unknowns):
        by_unknowns[first + number] -= unknown.precision * unknown.value(state)
    return joint.map.gradient(state.ball.coefficients, residual), by_unknowns


def _step(at: LastStep, unknowns: SharedUnknowns, settled: Tensor) -> tuple[Tensor, Tensor]:
    """Gauss-Newton step of the map (m,) and of all other unknowns (u,), down to a share of what counts as settled."""
    state, _, joint = at
    by_map, by_unknowns = gradients(at, unknowns)
    is_sharpest = float(state.ball.edge_blur) <= forward_model.MIN_BLUR_PX
    if is_sharpest and float(joint.approximate(by_map, by_unknowns).step[-1]) < 0:
        # Cut off afterwards, a blur that wants to be less would leave the others a step that is not theirs.
        joint = joint.with_blur_held()
    # Where light and texture take each other's place, the end of a step would hang on rounding.
    return joint.solve(by_map, by_unknowns, *((STEPS_OF_UNKNOWNS, None) if unknowns else (STEPS, settled)))


def _share_of_step(share: Tensor | None, before: Tensor | None, step: Tensor) -> Tensor:
    """The share (u,) of a ``step`` (u,) to take of each unknown, after those shares of the step ``before``.

    Unknowns whose steps go back a part of the step before would go on to and fro: radius and map, which share the rim,
    each step as if the other's step were small, and where the model lacks much, its curvature counts. By both steps
    their ends lie where these would vanish (the secant rule, for each unknown alone).
    """
    if share is None or before is None:
        return torch.ones_like(step)
    back = step * before / before.square().clamp_min(1e-30)
    return torch.where(back < 1, (share / (1 - back)).clamp(LEAST_SHARE, 1.0), 1.0)


def _moved(state: State, unknowns: SharedUnknowns, joint: JointEquations, of_map: Tensor, step: Tensor) -> State:
    """The state after a step, held within the limits of its length."""
    ball, poses = state.ball, len(state.poses)
    # The blur is held within its bounds; the other unknowns follow by their correlation with it.
    wanted = step[-1].clamp(-MAX_BLUR_STEP_PX, MAX_BLUR_STEP_PX).maximum(forward_model.MIN_BLUR_PX - ball.edge_blur)
    step = step + joint.covariance[:, -1] / joint.covariance[-1, -1] * (wanted - step[-1])
    most = limits(poses, MAX_MOVE_PX, [unknown.max_change for unknown in unknowns], MAX_MOVE_PX).to(step)
    share = 1 / (step / most).abs().max().clamp_min(1)
    return shared_unknown.moved(state, unknowns, share.to(of_map) * of_map, share * step)
