"""Bundle adjustment of one sphere: texture map, radius and edge blur of the ball, and its poses in many images.

Each Gauss-Newton step of map and poses together is found by conjugate gradients (`elimination`), which start from the
equations without the map. The inverse of their matrix is the covariance of all poses, with the uncertainty of the map.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import NamedTuple

import torch
from torch import Tensor

from torchsphere.runtime.threads import RowRunner
from torchsphere.sphere_map import (
    cube_map,
    elimination,
    exposure_share,
    forward_model,
    light,
    map_fit,
    nearness,
    pixel_weights,
)
from torchsphere.sphere_map.ball import Poses, TexturedBall, uniform_light
from torchsphere.sphere_map.decision import NO_SOLUTION
from torchsphere.sphere_map.elimination import COMMON, PER_IMAGE, JointEquations
from torchsphere.sphere_map.footprint import fit_footprint, with_footprint_of_outline
from torchsphere.sphere_map.forward_model import Linearisation
from torchsphere.sphere_map.light import LAST_CHANGE, fit_light, is_lit_from_a_side
from torchsphere.sphere_map.map_fit import MapEquations
from torchsphere.sphere_map.perspective import Optics
from torchsphere.sphere_map.pixel_weights import ROUNDING_VARIANCE
from torchsphere.sphere_map.radius_error import OPTICS_BLUR_PX
from torchsphere.sphere_map.rays import rim_points
from torchsphere.sphere_map.shared_unknown import SharedChange
from torchsphere.sphere_map.state import State, drawn, fit_map, linearised, reweighted, with_cells
from torchsphere.sphere_map.window import Windows, texture_variance


class _Level(NamedTuple):
    """One resolution of the map."""

    cell_px: float  # width of the cells
    settled_px: float  # largest move of a pose by a step below which the level is done
    max_steps: int
    is_last: bool
    # Whether the optics blur the footprint of a pixel as they blur the outline.
    is_blurred: bool = False
    is_outline_found: bool = False  # from the start


#: Width of the first map's cells, px: coarse cells align poses that are off by a px (docs/constants.toml).
COARSE_PX = 2.0

#: Systematic error of the radius by the model of the edge, px, further error where the ball does not turn, as the map
#: takes a texture at the limb for a part of the outline, and turn of the limb that halves it, px (docs/constants.toml).
RADIUS_ERROR_PX, STILL_RADIUS_ERROR_PX, HALVING_TURN_PX = 0.003, 0.055, 4.0

#: Largest variance of a ring over that within the disc while the outline is not yet found (docs/constants.toml).
MAX_RING_VARIANCE = 4.0

#: Move of a pose by a step below which the outline counts as found, px (docs/constants.toml).
OUTLINE_FOUND_PX = 0.02

#: Move of a pose by the last step from which an adjustment is given up, px: smaller ones do not matter, as every image
#: is registered again (docs/constants.toml).
MAX_UNSETTLED_PX = 0.02

#: Most searches for a light from a side: one that is found changes with each step of the poses (docs/constants.toml).
LIGHT_ROUNDS = 3

#: Conjugate gradients for the map to which a light is fitted (docs/constants.toml).
LIGHT_MAP_STEPS = 12

#: Move of a pose below which it counts as settled on the last map, px, and in standard deviations
#: (docs/constants.toml).
LAST_SETTLED_PX, SETTLED_SD = 0.0005, 0.1

#: Conjugate gradients for a map on new cells, and for a step of map and poses together (docs/constants.toml).
NEW_MAP_STEPS, STEPS = 6, 60

#: Share of a settled move that the conjugate gradients may leave.
SOLVED_SHARE = 0.2

#: Largest change of the edge's blur in a step, px: its effect on the grey levels is far from linear.
MAX_BLUR_STEP_PX = 0.2

#: Nearness of the camera in its standard deviations from which the view is taken as perspective, and largest nearness
#: (docs/constants.toml).
SEEN_NEARNESS_SD, MAX_NEARNESS = 2.0, 0.3

#: Nearness by the first step, in its standard deviations, from which the search goes on: a step reaches a tenth to a
#: third of the nearness, as the map follows with delay (docs/constants.toml).
SUSPECTED_NEARNESS_SD = 1.3

#: Rounds of the search for a shared unknown, steps of the adjustment in each, and largest share of a change that the
#: next is expected to have (docs/constants.toml).
SEARCH_ROUNDS, SEARCH_STEPS, MAX_SHARE_LEFT = 15, 2, 0.6

#: Change of the nearness below which the search ends, and below which it has settled at least (docs/constants.toml).
LAST_NEARNESS_CHANGE, SETTLED_NEARNESS = 0.0001, 0.0004

#: Change of the exposure, as a share of it, below which the search ends (docs/constants.toml).
LAST_EXPOSURE_CHANGE = 0.0005

#: Largest move of a pose in a step, px (docs/constants.toml).
MAX_MOVE_PX = 1.0

#: Least move of a pose that is told from none, px.
MIN_MOVE_PX = 1e-9

#: Least share of a step that is taken.
LEAST_SHARE = 0.3


class LastStep(NamedTuple):
    """The last step of an adjustment."""

    state: State  # before the step
    model: Linearisation
    joint: JointEquations


@dataclass(frozen=True)
class Adjustment:
    """The adjusted ball and poses."""

    state: State
    # (7 n + 2, 7 n + 2): of each image (dx, dy, wx, wy, wz), px, rotations times the radius, then gain and offset; then
    # of radius and edge blur, px. The mean orientation defines the frame and has no variance.
    covariance: Tensor
    settled: bool  # False if the poses still moved at the end
    sd_nearness: float = 0.0  # standard deviation of the ball's radius over its distance, which all images share
    last: LastStep | None = None


def adjust(
    windows: Windows,
    poses: Poses,
    radius: float,
    noise_variance: float,
    cell_px: float,
    shared: RowRunner,
    progress: Callable[[float], None] | None = None,
    *,
    optics_px: float = 0.0,
    least_variance: float = ROUNDING_VARIANCE,
) -> Adjustment:
    """Adjust map and poses to n images, from ``poses`` within half a speckle and a ``radius`` within a px.

    ``cell_px`` is the width of the map's cells, ``noise_variance`` that of the images, grey levels squared, and
    ``least_variance`` that which the steps of the levels leave; ``shared`` shares images out among threads.
    ``progress`` is called with the share that is done. The adjustment starts from the blur ``optics_px`` of the
    images, 0 where they are sharp. Singular equations raise LinAlgError.
    """
    like = windows.levels
    size = torch.tensor(radius, dtype=torch.float64, device=like.device)
    blur, none = torch.full_like(size, max(optics_px, OPTICS_BLUR_PX)), like.new_zeros(0)
    ball = TexturedBall(size, blur, 0, none, uniform_light(size), rim_points=rim_points(radius))
    state = State(
        windows,
        _with_initial_gains(windows, poses),
        ball,
        pixel_weights.uniform_profile(size, noise_variance, least_variance),
    )
    state = _with_first_map(state, max(COARSE_PX, cell_px), shared)
    adjustment = _adjust_level(state, _Level(max(COARSE_PX, cell_px), 0.1, 20, is_last=False), shared)
    _report(progress, 0.4)
    if not adjustment.settled:
        # Poses that jump about on a coarse map do so on a fine one.
        return adjustment
    last = _Level(cell_px, LAST_SETTLED_PX, 30, is_last=True, is_blurred=optics_px > 0)
    # The noise as the steps between images saw it may hold more than noise, and so may a residual on coarse cells.
    noise = min(noise_variance, float(adjustment.state.profile.variance[0]))
    state = replace(adjustment.state, smoothness=map_fit.smoothness_for(noise, texture_variance(windows)))
    state = with_cells(state, cube_map.cells_per_face(radius, cell_px))
    if last.is_blurred:
        # Coarse cells, and a sharp footprint, blur the outline more than the optics do.
        state = with_footprint_of_outline(replace(state, ball=replace(state.ball, edge_blur=blur)))
    state, _ = fit_map(state, shared, LIGHT_MAP_STEPS)
    # A light that differs from side to side pulls at the outline: it is fitted before the poses are.
    state = _with_light(state, last, shared)
    adjustment = _adjust_level(state, last, shared)
    for _ in range(LIGHT_ROUNDS):
        lit = _with_light(adjustment.state, last, shared)
        if float((lit.ball.light - adjustment.state.ball.light).abs().max()) < LAST_CHANGE:
            break
        adjustment = _adjust_level(lit, last._replace(is_outline_found=True), shared)
    _report(progress, 1.0)
    return replace(adjustment, covariance=_with_radius_error(adjustment))


def _with_light(state: State, level: _Level, shared: RowRunner) -> State:
    """The state with the light that fits best, and, where the outline alone is blurred, with the footprint's blur."""
    state = fit_light(state, shared)
    return state if level.is_blurred else fit_footprint(state, shared)


def find_exposure(
    adjustment: Adjustment, cell_px: float, optics_px: float, shared: RowRunner
) -> tuple[Adjustment, float]:
    """The adjustment with the exposure that fits best, and that exposure over the one by the outlines.

    The given one and 1 where poses do not settle with another exposure.
    """
    level = _Level(
        cell_px, LAST_SETTLED_PX, SEARCH_STEPS, is_last=True, is_blurred=optics_px > 0, is_outline_found=True
    )

    def factor(at: Adjustment) -> float:
        return exposure_share.factor_between(adjustment.state, at.state)

    def measured(at: Adjustment) -> SharedChange:
        assert at.last is not None
        return exposure_share.measure(*at.last, factor(at), shared)

    found, _ = _searched(adjustment, measured, level, LAST_EXPOSURE_CHANGE, shared)
    if not found.settled:
        return adjustment, 1.0
    return replace(found, covariance=_with_radius_error(found)), factor(found)


def _searched(
    start: Adjustment,
    measured: Callable[[Adjustment], SharedChange],
    level: _Level,
    last_change: float,
    shared: RowRunner,
) -> tuple[Adjustment, SharedChange]:
    """The adjustment with the shared unknown that fits best, and its last change as ``measured``.

    The search ends after a change below ``last_change``.
    """
    at, before = start, math.inf
    for _ in range(SEARCH_ROUNDS):
        found = measured(at)
        change = float(found.change)
        # Changes get shorter by a steady share, as the map follows the unknown with delay.
        share_left = min(max(change / before, 0.0), MAX_SHARE_LEFT)
        at = _adjust_level(replace(found, change=found.change / (1 - share_left)).applied(at.state), level, shared)
        if abs(change) < last_change:
            break
        before = change
    return at, found


def find_nearness(adjustment: Adjustment, optics: Optics, cell_px: float, shared: RowRunner) -> Adjustment:
    """The adjustment with the camera's distance, if the images tell it from one infinitely far away.

    ``optics`` are those of a camera infinitely far away. A nearness that is not seen, or that no camera can have, is
    left at 0, and stated as what it may be.
    """
    try:
        return _with_nearness(adjustment, optics, cell_px, shared)
    except torch.linalg.LinAlgError:  # type: ignore[attr-defined]
        # A model that fits no image at all leaves no equations to solve.
        return replace(adjustment, sd_nearness=nearness.UNKNOWN_SD)


def _measured_nearness(adjustment: Adjustment, optics: Optics, shared: RowRunner) -> SharedChange:
    """The nearness by the equations of the last step, as ``optics`` see the ball; the step itself hardly matters."""
    assert adjustment.last is not None
    before, model, joint = adjustment.last
    return nearness.measure(replace(before, windows=before.windows.seen_by(optics)), model, joint, shared)


def _with_nearness(adjustment: Adjustment, optics: Optics, cell_px: float, shared: RowRunner) -> Adjustment:
    state = replace(adjustment.state, windows=adjustment.state.windows.seen_by(optics))
    level = _Level(cell_px, LAST_SETTLED_PX, SEARCH_STEPS, is_last=True)

    def measured(at: Adjustment) -> SharedChange:
        seen_by = at.state.windows.optics
        assert seen_by is not None
        return _measured_nearness(at, seen_by, shared)

    found = _measured_nearness(adjustment, optics, shared)
    sd = min(math.hypot(float(found.change), nearness.total_sd(found)), nearness.UNKNOWN_SD)
    unseen = _not_seen(adjustment, found, sd)
    if float(found.change) > SUSPECTED_NEARNESS_SD * nearness.apparent_sd(found):
        start: Adjustment | None = _adjust_level(found.applied(state), level, shared)
    else:
        # Where the ball hardly turns, the map hides a near camera in part: it may be seen from near by alone.
        start = _probe(state, level, shared)
    if start is None:
        return unseen
    near, last = _searched(start, measured, level, LAST_NEARNESS_CHANGE, shared)
    settled = near.settled and abs(float(last.change)) < SETTLED_NEARNESS
    value = float(nearness.nearness_of(near.state))
    if settled and value <= SEEN_NEARNESS_SD * nearness.apparent_sd(last):
        return _not_seen(adjustment, last, min(math.hypot(value, nearness.total_sd(last)), nearness.UNKNOWN_SD))
    if not settled or value >= MAX_NEARNESS:
        # What was seen and could not be settled is not known to less than what the search had found.
        return replace(unseen, sd_nearness=max(nearness.UNKNOWN_SD, abs(value)))
    sd = nearness.total_sd(last)
    near = replace(near, covariance=_with_radius_error(near), sd_nearness=sd)
    return replace(near, covariance=with_radius_error(near, last.of_radius * sd))


def _not_seen(adjustment: Adjustment, found: SharedChange, sd: float) -> Adjustment:
    """The ``adjustment`` of a camera infinitely far away, whose radius errs with a nearness of that ``sd``."""
    return replace(adjustment, covariance=with_radius_error(adjustment, found.of_radius * sd), sd_nearness=sd)


def _probe(state: State, level: _Level, shared: RowRunner) -> Adjustment | None:
    """The adjustment at the nearness of a usual camera; None if it explains the images no better than the ``state``."""
    weights = state.profile.weights(state.windows, state.poses.centre)

    def unexplained(other: State) -> Tensor:
        levels = drawn(other, shared).levels(other.ball.coefficients)
        return (weights * (other.windows.levels - levels).square()).sum()

    before = unexplained(state)
    near = nearness.with_nearness(state, torch.full_like(state.ball.radius, nearness.UNKNOWN_SD))
    # A new map alone shows where poses that follow will not help: it saves their steps.
    near, _ = fit_map(near, shared, NEW_MAP_STEPS)
    if bool(unexplained(near) > nearness.HOPELESS * before):
        return None
    adjusted = _adjust_level(near, level, shared)
    return adjusted if bool(unexplained(adjusted.state) < (1 - nearness.MIN_GAIN) * before) else None


def _report(progress: Callable[[float], None] | None, share: float) -> None:
    if progress is not None:
        progress(share)


def _with_initial_gains(windows: Windows, poses: Poses) -> Poses:
    """The poses with gains from the mean grey levels around the ball, before a map exists."""
    visible = windows.visibility
    means = (visible * windows.levels).sum((1, 2)) / visible.sum((1, 2)).clamp_min(1)
    return replace(poses, gain=(means / means.mean().clamp_min(1e-6)).clamp_min(0.1).double())


def _with_first_map(state: State, cell_px: float, shared: RowRunner) -> State:
    """The state with a map that is refined from wide cells to cells of twice ``cell_px``.

    Wide cells are seen often enough even near the limb: what they hold is a start for narrow ones.
    """
    windows, radius = state.windows, float(state.ball.radius)
    level = (windows.visibility * windows.levels).sum() / windows.visibility.sum().clamp_min(1)
    cells = cube_map.cells_per_face(radius, 4 * cell_px)
    coefficients = level.expand(cube_map.coefficient_count(cells)).clone()
    state = replace(state, ball=replace(state.ball, cells=cells, coefficients=coefficients))
    state, _ = fit_map(state, shared, NEW_MAP_STEPS)
    state = with_cells(state, cube_map.cells_per_face(radius, 2 * cell_px))
    return fit_map(state, shared, NEW_MAP_STEPS)[0]


def _adjust_level(state: State, level: _Level, shared: RowRunner) -> Adjustment:
    """Gauss-Newton steps until one moves no pose by more than ``settled_px``."""
    if not math.isfinite(float(state.ball.radius)):
        raise torch.linalg.LinAlgError(NO_SOLUTION.sentence)  # type: ignore[attr-defined]
    state = with_cells(state, cube_map.cells_per_face(float(state.ball.radius), level.cell_px))
    state, equations = fit_map(state, shared, NEW_MAP_STEPS)
    limit, before, share, moved = (math.inf if level.is_outline_found else MAX_RING_VARIANCE), None, 1.0, MIN_MOVE_PX
    for number in range(level.max_steps):
        model = linearised(state, shared)
        if number:
            weights = state.profile.weights(state.windows, state.poses.centre)
            equations = MapEquations.of(drawn(state, shared), weights, shared, state.smoothness)
        state = reweighted(state, state.windows.levels - model.levels, equations.leverage(), shared, limit)
        weights = state.profile.weights(state.windows, state.poses.centre)
        equations = MapEquations.of(equations.design, weights, shared, state.smoothness)
        last = LastStep(state, model, elimination.joint_equations(model, equations, state.poses))
        settled = max(level.settled_px, SETTLED_SD * float(last.joint.covariance.diagonal()[0].sqrt()))
        of_map, step = _step(last, SOLVED_SHARE * settled)
        share, before = _share_of_step(share, before, step), step
        state, move = _moved(state, last.joint, share * of_map, share * step)
        if level.is_blurred:
            state = with_footprint_of_outline(state)
        state, relit = _relit(state, level, shared)
        if not math.isfinite(move):
            raise torch.linalg.LinAlgError(NO_SOLUTION.sentence)  # type: ignore[attr-defined]
        is_bound = level.is_last and float(state.profile.variance.max()) >= limit * float(state.profile.variance[0])
        # The next move is shorter by as much as this one was, at least.
        left, moved = move * min(1.0, move / moved), move
        if left < settled and relit < LAST_CHANGE and not is_bound:
            break
        if move < OUTLINE_FOUND_PX:
            limit = math.inf
    return Adjustment(state, last.joint.covariance, left < max(settled, MAX_UNSETTLED_PX), last=last)


def _relit(state: State, level: _Level, shared: RowRunner) -> tuple[State, float]:
    """The state with its light, if it has one from a side, after one more change, and the change.

    Poses and light take up a part of each other: changed in turns, they settle together.
    """
    is_lit = level.is_last and is_lit_from_a_side(state.ball)
    return light.changed(state, shared) if is_lit else (state, 0.0)


def _step(at: LastStep, settled_px: float) -> tuple[Tensor, Tensor]:
    """Gauss-Newton step of the map (m,) and of all other unknowns (7 n + 2,)."""
    state, model, joint = at
    weighted = (joint.map.weights * (state.windows.levels - model.levels)).flatten(1).unsqueeze(1)
    by_unknowns = elimination.spread_gradient(torch.bmm(weighted, model.jacobian)[:, 0].double())
    by_map = joint.map.gradient(state.ball.coefficients, state.windows.levels)
    return joint.solve(by_map, by_unknowns, STEPS, settled_px)


def _share_of_step(share: float, before: Tensor | None, step: Tensor) -> float:
    """The share of a ``step`` (u,) to take, after that ``share`` of the step ``before``.

    Steps that go back a part of the step before, as the weights change with what is drawn, would go on to and fro. By
    both steps the end lies where they would vanish (the secant rule).
    """
    if before is None:
        return 1.0
    back = float(step @ before / (before @ before).clamp_min(1e-30))
    return min(1.0, max(share / (1 - back), LEAST_SHARE)) if back < 1 else 1.0


def _moved(state: State, joint: JointEquations, of_map: Tensor, step: Tensor) -> tuple[State, float]:
    """The state after a step, held within the limits of its length, and the largest move of a pose, px."""
    ball = state.ball
    # The blur is held within its bounds; the other unknowns follow by their correlation with it.
    wanted = step[-1].clamp(-MAX_BLUR_STEP_PX, MAX_BLUR_STEP_PX).maximum(forward_model.MIN_BLUR_PX - ball.edge_blur)
    step = step + joint.covariance[:, -1] / joint.covariance[-1, -1] * (wanted - step[-1])
    own = step[:-COMMON].unflatten(0, (-1, PER_IMAGE))
    longest = own[:, :5].abs().max()
    share = MAX_MOVE_PX / longest.clamp_min(MAX_MOVE_PX)
    step, own = share * step, share * own
    poses = state.poses.moved(own[:, :5], ball.radius).brightened(own[:, 5:])
    coefficients = ball.coefficients + share.to(of_map) * of_map
    ball = replace(ball, radius=ball.radius + step[-2], edge_blur=ball.edge_blur + step[-1], coefficients=coefficients)
    return replace(state, poses=poses, ball=ball), float(own[:, :5].abs().max().maximum(step[-2].abs()))


def _with_radius_error(adjustment: Adjustment) -> Tensor:
    """The covariance with the systematic error of the radius."""
    by_texture = STILL_RADIUS_ERROR_PX / (1 + _turned_px(adjustment.state) / HALVING_TURN_PX)
    return with_radius_error(adjustment, math.hypot(RADIUS_ERROR_PX, by_texture))


def _turned_px(state: State) -> float:
    """Way, px, by which new texture has come over the limb between the images: a turn in the image brings none."""
    sight = state.poses.orientation[:, 2]
    return float(state.ball.radius * (sight[1:] - sight[:-1]).norm(dim=1).sum())


def with_radius_error(adjustment: Adjustment, error_px: float) -> Tensor:
    """The covariance with a further error of the radius, px, and the effect of this error on the poses."""
    covariance = adjustment.covariance
    by_radius = covariance[:, -COMMON] / covariance[-COMMON, -COMMON]
    return covariance + error_px**2 * torch.outer(by_radius, by_radius)
