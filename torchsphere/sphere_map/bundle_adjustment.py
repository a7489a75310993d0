"""Bundle adjustment of one sphere: texture map, radius and edge blur of the ball, and its poses in many images.

The grey levels are linear in the thousands of map coefficients, and only neighbours are coupled: the map is eliminated
exactly (`map_fit`). Five unknowns per image and two common ones remain; the inverse of their normal matrix is the
covariance of all poses, with the uncertainty of the map. One elimination serves several Gauss-Newton steps.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
import torch
from numpy.typing import NDArray

from torchsphere.runtime import threads
from torchsphere.sphere_map import cube_map, forward_model, map_fit, pixel_weights
from torchsphere.sphere_map.forward_model import Linearisation, Pose, TexturedBall, uniform_light
from torchsphere.sphere_map.map_fit import Elimination
from torchsphere.sphere_map.state import LinearisedState, State
from torchsphere.sphere_map.window import Window

Array = NDArray[np.float64]


class _Level(NamedTuple):
    """One resolution of the map."""

    cell_px: float  # width of the cells
    tolerance_px: float  # length of a step at which the steps with one elimination end
    settled_px: float  # move by the first step of an elimination below which the level is done


#: Levels of the map, coarse to fine; coarse cells align poses that are off by a px (docs/constants.md).
LEVELS = (_Level(2.0, 0.02, 0.1), _Level(1.5, 0.01, 0.1), _Level(1.0, 0.001, 0.02))

#: Blur of the outline at the start, px (docs/constants.md).
INITIAL_BLUR_PX = 0.3

#: Largest number of eliminations at one level.
MAX_ELIMINATIONS = 4

#: Residual variance within the disc, in variances of the noise, from which a shading is fitted (docs/constants.md).
SHADING_FROM = 1.5

#: Systematic error of the radius by the model of the edge, px (docs/constants.md).
RADIUS_ERROR_PX = 0.012

#: Blur that optics alone make, px, and systematic error of the radius per px of further blur (docs/constants.md).
OPTICS_BLUR_PX, RADIUS_ERROR_PER_BLUR = 0.3, 0.8

#: Number of fits of gains and offsets, each followed by a fit of the map, before the first level (docs/constants.md).
BRIGHTNESS_ROUNDS = 2

#: Largest number of steps with one elimination, and ratio of two steps from which they end (docs/constants.md).
MAX_STEPS, MAX_STEP_RATIO = 4, 0.8

#: Shares of a step, tried in turn until the squares fall: near the limb no step is linear (docs/constants.md).
STEP_SHARES: tuple[float, ...] = (1.0, 0.3, 0.1)

#: Share that is tried first after a step whose first share was accepted (docs/constants.md).
EXTENDED_SHARE = 2.0

#: Smallest decrease of the weighted squares for another step (docs/constants.md).
MIN_DECREASE = 1.0


@dataclass(frozen=True)
class Adjustment:
    """The adjusted ball and poses."""

    state: State  # images with their visibility, poses, ball, and profile of the residuals
    # (5 n + 2, 5 n + 2) of the poses as (dx, dy, wx, wy, wz), px, rotations times the radius, then of radius and edge
    # blur, px. The mean orientation defines the frame and has no variance.
    covariance: Array
    settled: bool  # False if the poses still moved at the end


def adjust(
    windows: list[Window],
    poses: list[Pose],
    radius: float,
    noise_variance: float,
    progress: Callable[[float], None] | None = None,
) -> Adjustment:
    """Adjust map and poses to n images, from ``poses`` within half a speckle and a ``radius`` within a px.

    Light that differs from side to side is fitted, too, if the residual is much larger than ``noise_variance``, grey
    levels squared. ``progress`` is called with the share that is done. Singular equations raise LinAlgError.
    """
    cells = cube_map.cells_per_face(radius, LEVELS[0].cell_px)
    ball = TexturedBall(radius, INITIAL_BLUR_PX, cells, torch.zeros(0).double(), uniform_light())
    poses = pixel_weights.with_initial_gains(windows, poses)
    state = State(windows, poses, ball, pixel_weights.uniform_profile(radius))
    state = map_fit.fit_map(state, brightness_rounds=BRIGHTNESS_ROUNDS)
    costs = np.cumsum([level.cell_px**-2 for level in LEVELS])
    for level, cost in zip(LEVELS, costs, strict=True):
        cells = cube_map.cells_per_face(radius, level.cell_px)
        if cells != state.ball.cells:
            state = map_fit.fit_map(replace(state, ball=replace(state.ball, cells=cells)))
        adjustment = _adjust_level(state, level)
        state = adjustment.state
        if progress is not None:
            progress(float(cost / costs[-1]))
    if state.profile.variance[0] > SHADING_FROM * noise_variance:
        adjustment = _adjust_level(map_fit.fit_shading(state), LEVELS[-1])
    blur = adjustment.state.ball.edge_blur
    return replace(adjustment, covariance=_with_radius_error(adjustment.covariance, len(poses), blur))


def _adjust_level(state: State, level: _Level) -> Adjustment:
    """Eliminations and steps until the first step of an elimination moves no pose by more than ``settled_px``."""
    linearised = state.linearise(state.project())
    for _ in range(MAX_ELIMINATIONS):
        linearised = linearised.fit_brightness().measure_profile().estimate_visibility()
        elimination = map_fit.eliminate(linearised)
        linearised, move = iterate(linearised, elimination, level.tolerance_px)
        if move < level.settled_px:
            break
    return Adjustment(linearised.measure_profile().state, elimination.covariance, move < level.settled_px)


def _with_radius_error(covariance: Array, n: int, edge_blur: float) -> Array:
    """The covariance with the systematic error of the radius, and the effect of this error on the poses."""
    by_radius = covariance[:, 5 * n] / covariance[5 * n, 5 * n]
    error = np.hypot(RADIUS_ERROR_PX, RADIUS_ERROR_PER_BLUR * max(edge_blur - OPTICS_BLUR_PX, 0.0))
    return covariance + error**2 * np.outer(by_radius, by_radius)


def iterate(
    linearised: LinearisedState, elimination: Elimination, tolerance_px: float
) -> tuple[LinearisedState, float]:
    """Take Gauss-Newton steps with one elimination while they shrink and are longer than ``tolerance_px``.

    Returns the state after the last step, and the largest move of a ball's centre by the first whole step, px.
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
    by_poses = np.zeros(5 * n + map_fit.SHARED_UNKNOWNS)

    def image_gradient(window: Window, pose: Pose, model: Linearisation) -> tuple[Array, Array, float]:
        residual = window.levels - model.levels
        weighted = pixel_weights.weights(window, pose, state.profile) * residual
        by_coefficients = model.stencil.adjoint(window.to_rays(weighted, model.map_slopes))
        image_squares = float(weighted.double() @ residual.double())
        return by_coefficients.numpy(), (model.jacobian.T @ weighted).numpy(), image_squares

    images = threads.parallel_map(image_gradient, state.windows, state.poses, linearised.model)
    for i, (image_by_map, image_by_pose, image_squares) in enumerate(images):
        by_map += image_by_map
        by_poses[map_fit.image_unknowns(i, n)] += image_by_pose
        squares += image_squares
    smoothness = map_fit.roughness_gradient(ball)
    return _Gradient(by_map - smoothness, by_poses, squares + float(ball.coefficients.numpy() @ smoothness))


def _take_step(state: State, gradient: _Gradient, elimination: Elimination, share: float) -> LinearisedState:
    """The state after a ``share`` of a Gauss-Newton step, with the map corrected for the new poses."""
    map_step = elimination.map_factor.solve(gradient.by_map[elimination.observed])
    covariance, blur = elimination.covariance, 5 * len(state.poses) + 1
    step = share * covariance @ (gradient.by_poses - elimination.coupling.T @ map_step)
    # The blur is not lowered below its bound; the other unknowns follow by their correlation with the blur.
    lowest = forward_model.MIN_BLUR_PX - state.ball.edge_blur
    if step[blur] < lowest:
        step = step + covariance[:, blur] / covariance[blur, blur] * (lowest - step[blur])
    ball = state.ball.with_map_change(elimination.observed, share * map_step - elimination.map_response @ step)
    radius, edge_blur = ball.radius + float(step[blur - 1]), ball.edge_blur + float(step[blur])
    steps = torch.from_numpy(step[: blur - 1]).reshape(-1, 5)
    poses = [forward_model.move_pose(p, s, ball.radius) for p, s in zip(state.poses, steps, strict=True)]
    state = replace(state, poses=poses, ball=replace(ball, radius=radius, edge_blur=edge_blur))
    projections = state.project()
    return map_fit.update_map(state, projections, elimination).linearise(projections)
