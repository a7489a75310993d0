"""Gauss-Newton steps of map and poses between two eliminations of the map.

An elimination is costly and serves several steps; the residuals are exact at every step.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import torch
from numpy.typing import NDArray

from torchsphere.runtime import threads
from torchsphere.sphere_map import cube_map, forward_model, map_fit, pixel_weights, projection, schur
from torchsphere.sphere_map.forward_model import Linearisation
from torchsphere.sphere_map.projection import Pose
from torchsphere.sphere_map.schur import Elimination
from torchsphere.sphere_map.state import LinearisedState, State
from torchsphere.sphere_map.window import Window

Array = NDArray[np.float64]

#: Largest number of steps with one elimination, and length of a step, in lengths of the step before, at which they end.
MAX_STEPS, MAX_STEP_RATIO = 4, 0.8

#: Shares of a step, tried in turn until the squares fall: near the limb no step is linear.
STEP_SHARES: tuple[float, ...] = (1.0, 0.3, 0.1)

#: Share that is tried first after a step whose first share was accepted (docs/constants.md).
EXTENDED_SHARE = 2.0

#: Least decrease of the weighted squares for another step; 1 is about one standard deviation of all unknowns together.
MIN_DECREASE = 1.0


def iterate(
    linearised: LinearisedState, elimination: Elimination, tolerance_px: float
) -> tuple[LinearisedState, float]:
    """Take steps with one elimination while they shrink and are longer than ``tolerance_px``.

    Returns
    -------
    linearised : LinearisedState
        The state after the last step.
    first_move : float
        Largest move of a ball's centre by the first whole step, px.
    """
    moves: list[float] = []
    gradient, shares = _gradient(linearised), STEP_SHARES
    for _ in range(MAX_STEPS):
        for share in shares:
            candidate = _take_step(linearised.state, gradient, elimination, share)
            candidate_gradient = _gradient(candidate)
            move = _largest_move(linearised.state.poses, candidate.state.poses) / share
            if candidate_gradient.squares < gradient.squares:
                break
        else:
            # No share lowers the squares. Without an earlier step, this step tells whether the poses have settled.
            moves = moves or [move]
            break
        moves.append(move)
        decrease = gradient.squares - candidate_gradient.squares
        linearised, gradient = candidate, candidate_gradient
        too_long = len(moves) > 1 and move > MAX_STEP_RATIO * moves[-2]
        if move < tolerance_px or decrease < MIN_DECREASE or too_long:
            break
        shares = (EXTENDED_SHARE, *STEP_SHARES) if share == shares[0] else STEP_SHARES
    return linearised, moves[0]


def _largest_move(before: list[Pose], after: list[Pose]) -> float:
    """Largest component of a move of a ball's centre, px."""
    return max(float((p.centre - q.centre).abs().max()) for p, q in zip(before, after, strict=True))


@dataclass(frozen=True)
class _Gradient:
    """Descent directions of the map (m,) and the other unknowns (5 n + 2,), and the weighted sum of squares."""

    by_map: Array
    by_poses: Array
    squares: float


def _gradient(linearised: LinearisedState) -> _Gradient:
    state, squares = linearised.state, 0.0
    n, ball = len(state.windows), state.ball
    by_map = np.zeros(cube_map.coefficient_count(ball.cells))
    by_poses = np.zeros(5 * n + schur.SHARED_UNKNOWNS)

    def image_gradient(window: Window, pose: Pose, model: Linearisation) -> tuple[Array, Array, float]:
        residual = window.levels - model.levels
        weighted = pixel_weights.weights(window, pose, state.profile) * residual
        by_coefficients = model.stencil.adjoint(window.spread(weighted, model.map_slopes))
        image_squares = float(weighted.double() @ residual.double())
        return by_coefficients.numpy(), (model.jacobian.T @ weighted).numpy(), image_squares

    images = threads.each(image_gradient, state.windows, state.poses, linearised.model)
    for i, (image_by_map, image_by_pose, image_squares) in enumerate(images):
        by_map += image_by_map
        by_poses[schur.image_unknowns(i, n)] += image_by_pose
        squares += image_squares
    smoothness = schur.roughness_gradient(ball)
    return _Gradient(by_map - smoothness, by_poses, squares + float(ball.coefficients.numpy() @ smoothness))


def _take_step(state: State, gradient: _Gradient, elimination: Elimination, share: float) -> LinearisedState:
    """The state after a ``share`` of a Gauss-Newton step, with the map corrected for the new poses."""
    map_step = elimination.map_factor.solve(gradient.by_map[elimination.observed])
    covariance, blur = elimination.covariance, 5 * len(state.poses) + 1
    step = share * covariance @ (gradient.by_poses - elimination.coupling.T @ map_step)
    # The blur is not lowered below its bound; the other unknowns follow by their correlation with the blur.
    lowest = projection.MIN_BLUR_PX - state.ball.edge_blur
    if step[blur] < lowest:
        step = step + covariance[:, blur] / covariance[blur, blur] * (lowest - step[blur])
    ball = state.ball.with_map_change(elimination.observed, share * map_step - elimination.map_response @ step)
    radius, edge_blur = ball.radius + float(step[blur - 1]), ball.edge_blur + float(step[blur])
    steps = torch.from_numpy(step[: blur - 1]).reshape(-1, 5)
    poses = [forward_model.move_pose(p, s, ball.radius) for p, s in zip(state.poses, steps, strict=True)]
    state = replace(state, poses=poses, ball=replace(ball, radius=radius, edge_blur=edge_blur))
    projections = state.project()
    return map_fit.update_map(state, projections, elimination).linearise(projections)
