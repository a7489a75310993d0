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
    shared_unknown,
)
from torchsphere.sphere_map.ball import LIGHT_TERMS, Poses, TexturedBall, uniform_light
from torchsphere.sphere_map.decision import NO_SOLUTION
from torchsphere.sphere_map.elimination import COMMON, GEOMETRY, PER_IMAGE, JointEquations
from torchsphere.sphere_map.footprint import fit_footprint, with_footprint_of_outline
from torchsphere.sphere_map.forward_model import Linearisation
from torchsphere.sphere_map.lens import View, is_seen
from torchsphere.sphere_map.light import fit_light
from torchsphere.sphere_map.map_fit import MapEquations
from torchsphere.sphere_map.perspective import Optics
from torchsphere.sphere_map.pixel_weights import ROUNDING_VARIANCE
from torchsphere.sphere_map.radius_error import OPTICS_BLUR_PX
from torchsphere.sphere_map.rays import rim_points
from torchsphere.sphere_map.shared_unknown import SharedUnknowns, limits
from torchsphere.sphere_map.state import State, drawn, fit_map, linearised, reweighted, with_cells
from torchsphere.sphere_map.window import Windows, texture_variance


class _Level(NamedTuple):
    """One resolution of the map."""

    cells: int  # along a side of a face
    settled_px: float  # largest move of a pose by a step below which the level is done
    max_steps: int
    is_last: bool
    # Whether the optics blur the footprint of a pixel as they blur the outline.
    is_blurred: bool = False
    unknowns: SharedUnknowns = ()  # that all images share, beside radius and blur

    def settled(self, n: int, covariance: Tensor) -> Tensor:
        """Moves of all unknowns, of n poses, that count as settled: see `limits`."""
        sd = covariance.diagonal().sqrt()
        px = max(self.settled_px, SETTLED_SD * float(sd[0]))
        of_unknowns = [
            max(unknown.last_change, SETTLED_SD * float(sd[PER_IMAGE * n + k]))
            for k, unknown in enumerate(self.unknowns)
        ]
        return limits(n, px, of_unknowns).to(covariance)


#: Width of the first map's cells, px, and move of a pose below which it counts as settled there: coarse cells align
#: poses that are off by a px (docs/constants.toml).
COARSE_PX, COARSE_SETTLED_PX = 2.0, 0.1

#: Systematic error of the radius by the model of the edge, px, further error where the ball does not turn, as the map
#: takes a texture at the limb for a part of the outline, and turn of the limb that halves it, px (docs/constants.toml).
RADIUS_ERROR_PX, STILL_RADIUS_ERROR_PX, HALVING_TURN_PX = 0.003, 0.055, 4.0

#: Largest variance of a ring over that within the disc in the first step; its square in the second, and so on
#: (docs/constants.toml).
MAX_RING_VARIANCE = 4.0

#: Move of a pose by the last step from which an adjustment is given up, px: smaller ones do not matter, as every image
#: is registered again (docs/constants.toml).
MAX_UNSETTLED_PX = 0.02

#: Most images in which a lens is looked for (docs/constants.toml).
LENS_IMAGES = 6

#: Move of a pose below which it counts as settled on the last map, px, and in standard deviations
#: (docs/constants.toml).
LAST_SETTLED_PX, SETTLED_SD = 0.0005, 0.1

#: Most steps on the last map (docs/constants.toml).
MAX_STEPS = 40

#: Conjugate gradients for a map on new cells, and most for a step of map and poses together (docs/constants.toml).
NEW_MAP_STEPS, STEPS = 6, 60

#: Conjugate gradients for a step with further unknowns, always as many (docs/constants.toml).
STEPS_OF_UNKNOWNS = 40

#: Share of a move that counts as settled, by which conjugate gradients may still change a step (docs/constants.toml).
SOLVED_SHARE = 0.2

#: Largest change of the edge's blur in a step, px: its effect on the grey levels is far from linear.
MAX_BLUR_STEP_PX = 0.2

#: Nearness of the camera in its standard deviations from which the view is taken as perspective, and largest nearness
#: (docs/constants.toml).
SEEN_NEARNESS_SD, MAX_NEARNESS = 2.0, 0.3

#: Nearness by the first step, in its standard deviations, from which it is an unknown of the adjustment
#: (docs/constants.toml).
SUSPECTED_NEARNESS_SD = 1.3

#: Largest move of a pose in a step, px (docs/constants.toml).
MAX_MOVE_PX = 1.0

#: Steps after which the weights of the pixels stay: weights and outline that follow each other creep on for long, and
#: rounding would decide where they end (docs/constants.toml).
REWEIGHTED = 6

#: Least and largest share of a move that the next one is expected to have (docs/constants.toml).
LEAST_LEFT, MOST_LEFT = 0.3, 0.8

#: Least share of a step that is taken (docs/constants.toml).
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
    is_exposure_known: bool = True,
    grows: bool = False,
    view: View | None = None,
    lens: SharedUnknowns = (),
) -> Adjustment:
    """Adjust map and poses to n images, from ``poses`` within half a speckle and a ``radius`` within a px.

    ``cell_px`` is the width of the map's cells, ``noise_variance`` that of the images, grey levels squared, and
    ``least_variance`` that which the steps of the levels leave; ``shared`` shares images out among threads.
    ``progress`` is called with the share that is done. The adjustment starts from the blur ``optics_px`` of the
    images, 0 where they are sharp, and from the exposure of the windows, which is adjusted if it is not known. The
    radius in each image is adjusted if the ball ``grows``, and with it the unknowns of a ``lens`` that the windows are
    cut for. A lens is looked for in the ``view`` on coarse cells: if the images show one, the adjustment ends there.
    Singular equations raise LinAlgError.
    """
    like = windows.levels
    size = torch.tensor(radius, dtype=torch.float64, device=like.device)
    blur, none = torch.full_like(size, max(optics_px, OPTICS_BLUR_PX)), like.new_zeros(0)
    points = rim_points(float(poses.radii(radius).max()))
    ball = TexturedBall(size, blur, 0, none, uniform_light(size), rim_points=points, grows=grows)
    state = State(
        windows,
        _with_initial_gains(windows, poses),
        ball,
        pixel_weights.uniform_profile(size, noise_variance, least_variance),
    )
    coarse = cube_map.cells_per_face(radius, max(COARSE_PX, cell_px))
    state = _with_first_map(state, max(COARSE_PX, cell_px), shared)
    level = _Level(coarse, COARSE_SETTLED_PX, 20, is_last=False, unknowns=lens)
    adjustment = _adjust_level(state, level, shared)
    if view is not None and _shows_lens(adjustment, view, shared):
        watched = _adjust_level(view.of(state), level._replace(unknowns=view.unknowns), shared)
        if watched.settled and _lens_of(watched):
            return _with_lens_alone(watched)
    if lens:
        # Cut through the lens, the windows show better what belongs to it.
        adjustment = _with_lens_alone(adjustment)
        lens = adjustment.lens
    _report(progress, 0.4)
    if not adjustment.settled:
        # Poses that jump about on a coarse map do so on a fine one.
        return adjustment
    fine = cube_map.cells_per_face(radius, cell_px)
    last = _Level(fine, LAST_SETTLED_PX, MAX_STEPS, is_last=True, is_blurred=optics_px > 0, unknowns=lens)
    # The noise as the steps between images saw it may hold more than noise, and so may a residual on coarse cells.
    noise = min(noise_variance, float(adjustment.state.profile.variance[0]))
    state = replace(adjustment.state, smoothness=map_fit.smoothness_for(noise, texture_variance(windows)))
    if last.is_blurred:
        # Coarse cells, and a sharp footprint, blur the outline more than the optics do.
        state = with_footprint_of_outline(replace(state, ball=replace(state.ball, edge_blur=blur)))
    exposure_of = None if is_exposure_known else windows
    # Poses that are off look like a light, and a light pulls at the poses: it is looked for after one step.
    first = _adjust_level(state, last._replace(max_steps=1), shared)
    lit, share = fit_light(first.state, shared)
    lit = _with_footprint(lit, last, shared)
    adjustment = _adjust_last(lit, last, light.unknowns(share), exposure_of, shared, first.move)
    if not share:
        # Poses that were off may also have hidden it.
        lit, share = fit_light(adjustment.state, shared)
        if share:
            lit = _with_footprint(lit, last, shared)
            adjustment = _adjust_last(lit, last, light.unknowns(share), exposure_of, shared, 0.0)
    if share and light.is_false(*_told_of_light(adjustment)):
        even = replace(adjustment.state, ball=replace(adjustment.state.ball, light=uniform_light(size)))
        adjustment = _adjust_last(even, last, (), exposure_of, shared, 0.0)
    _report(progress, 1.0)
    return replace(adjustment, covariance=_with_radius_error(adjustment))


def _shows_lens(adjustment: Adjustment, view: View, shared: RowRunner) -> bool:
    """Whether the images of an ``adjustment`` show a lens: some of them do, by an approximate step of all unknowns.

    Poses that have not settled may lack one.
    """
    if not adjustment.settled:
        return True
    count = len(adjustment.state.poses)
    rows = torch.linspace(0, count - 1, min(count, LENS_IMAGES)).round().long().unique()
    state = view.of(adjustment.state.take(rows))
    at = _equations(state, view.unknowns, shared)
    step = at.joint.approximate(*_gradients(at, view.unknowns)).step
    return bool(_seen(view.unknowns, step[PER_IMAGE * len(rows) :], at.joint.covariance))


def _seen(unknowns: SharedUnknowns, values: Tensor, covariance: Tensor) -> SharedUnknowns:
    """Those of the ``unknowns`` that the images show, if a lens is among them.

    The camera's nearness alone is told on fine cells. The ``values`` (k,) have their variances in the ``covariance``.
    """
    first = len(covariance) - COMMON - len(unknowns)
    sds = covariance.diagonal()[first:].sqrt()
    seen = tuple(one for one, value, sd in zip(unknowns, values, sds, strict=False) if is_seen(float(value), float(sd)))
    return () if seen == (nearness.UNKNOWN,) else seen


def _lens_of(adjustment: Adjustment) -> SharedUnknowns:
    """Those of its unknowns that the images show, if a lens is among them."""
    values = torch.stack([unknown.value(adjustment.state) for unknown in adjustment.unknowns])
    return _seen(adjustment.unknowns, values, adjustment.covariance)


def _with_lens_alone(adjustment: Adjustment) -> Adjustment:
    """The ``adjustment`` on coarse cells with the unknowns of a lens that the images show, or all if they show none."""
    state, seen = adjustment.state, _lens_of(adjustment) or adjustment.unknowns
    for unknown in adjustment.unknowns:
        if unknown not in seen:
            state = unknown.changed(state, -unknown.value(state))
    return replace(adjustment, state=state, unknowns=(), lens=seen)


def _with_footprint(state: State, level: _Level, shared: RowRunner) -> State:
    """The state with the footprint's blur that fits best, where it is not that of the optics."""
    return state if level.is_blurred else fit_footprint(state, shared)


def _told_of_light(adjustment: Adjustment) -> tuple[Tensor, Tensor, Tensor]:
    """Terms (3,) of the light from a side, their covariance (3, 3), and the weighted squares () that are left."""
    assert adjustment.last is not None
    state, model, joint = adjustment.last
    first = PER_IMAGE * len(state.poses)
    of_light = slice(first, first + LIGHT_TERMS - 1)
    squares = (joint.map.weights * (state.windows.levels - model.levels).square()).sum()
    return adjustment.state.ball.light[1:], adjustment.covariance[of_light, of_light], squares


def _adjust_last(
    state: State,
    level: _Level,
    lights: SharedUnknowns,
    exposure_of: Windows | None,
    shared: RowRunner,
    moved: float,
) -> Adjustment:
    """The adjustment on the last ``level`` with a light, and with the exposure over that of the given windows.

    The exposure stays where poses do not settle with another one. A step of ``moved`` came before.
    """
    longer = None if exposure_of is None else exposure_share.unknown_from(exposure_of)
    if longer is not None:
        adjustment = _adjust_level(state, level._replace(unknowns=(*lights, longer, *level.unknowns)), shared)
        if adjustment.settled:
            return adjustment
    # Unknowns that are new may move more than all did before.
    return _adjust_level(state, level._replace(unknowns=(*lights, *level.unknowns)), shared, 0.0 if lights else moved)


def find_nearness(adjustment: Adjustment, optics: Optics, shared: RowRunner) -> Adjustment:
    """The adjustment with the camera's distance, if the images tell it from one infinitely far away.

    ``optics`` are those of a camera infinitely far away. A nearness that is not seen, or that no camera can have, is
    left at 0, and stated as what it may be.
    """
    try:
        return _with_nearness(adjustment, optics, shared)
    except torch.linalg.LinAlgError:  # type: ignore[attr-defined]
        # A model that fits no image at all leaves no equations to solve.
        return replace(adjustment, sd_nearness=nearness.UNKNOWN_SD)


def _with_nearness(adjustment: Adjustment, optics: Optics, shared: RowRunner) -> Adjustment:
    assert adjustment.last is not None
    if adjustment.unknowns[-1:] == (nearness.UNKNOWN,):
        sd, of_radius = _told(adjustment, shared)
        is_near = float(nearness.nearness_of(adjustment.state)) > SEEN_NEARNESS_SD * nearness.apparent_sd(sd)
        # A near camera and a lens look alike, and the steps end before the two have parted.
        sd = nearness.UNKNOWN_SD if is_near else nearness.total_sd(sd)
        return replace(adjustment, covariance=with_radius_error(adjustment, of_radius * sd), sd_nearness=sd)
    before, model, joint = adjustment.last
    # A lens that was found stays.
    optics = before.windows.optics or optics
    far = replace(before, windows=before.windows.seen_by(optics))
    # By the equations of the last step: the step itself hardly matters.
    found = shared_unknown.measure(nearness.UNKNOWN, far, model, joint, shared)
    change, sd = float(found.change), float(found.sd)
    if change <= SUSPECTED_NEARNESS_SD * nearness.apparent_sd(sd):
        return _not_seen(adjustment, math.hypot(change, nearness.total_sd(sd)), found.of_radius)
    unknowns = (*adjustment.unknowns, nearness.UNKNOWN)
    level = _Level(adjustment.state.ball.cells, LAST_SETTLED_PX, MAX_STEPS, is_last=True, unknowns=unknowns)
    start = replace(adjustment.state, windows=adjustment.state.windows.seen_by(optics))
    near = _adjust_level(found.applied(start), level, shared)
    value = float(nearness.nearness_of(near.state))
    sd, of_radius = _told(near, shared)
    if near.settled and value <= SEEN_NEARNESS_SD * nearness.apparent_sd(sd):
        return _not_seen(adjustment, math.hypot(value, nearness.total_sd(sd)), of_radius)
    if not near.settled or value >= MAX_NEARNESS:
        # What was seen and could not be settled is not known to less than what the search had found.
        unseen = _not_seen(adjustment, nearness.UNKNOWN_SD, found.of_radius)
        return replace(unseen, sd_nearness=max(nearness.UNKNOWN_SD, abs(value)))
    sd = nearness.total_sd(sd)
    near = replace(near, covariance=_with_radius_error(near), sd_nearness=sd)
    return replace(near, covariance=with_radius_error(near, of_radius * sd))


def _not_seen(adjustment: Adjustment, sd: float, of_radius: float) -> Adjustment:
    """The ``adjustment`` of a camera infinitely far away, whose radius errs with a nearness of that ``sd``."""
    sd = min(sd, nearness.UNKNOWN_SD)
    return replace(adjustment, covariance=with_radius_error(adjustment, of_radius * sd), sd_nearness=sd)


def _told(adjustment: Adjustment, shared: RowRunner) -> tuple[float, float]:
    """Standard deviation of the last unknown of the ``adjustment``, and change of the radius with it, px."""
    assert adjustment.last is not None
    state, model, joint = adjustment.last
    columns = model.jacobian.shape[-1] - 1
    without = Linearisation(model.levels, model.jacobian[..., :columns].contiguous())
    rest = _joint_equations(state, without, joint.map, adjustment.unknowns[:-1])
    found = shared_unknown.measure(adjustment.unknowns[-1], state, without, rest, shared)
    return float(found.sd), found.of_radius


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


def _adjust_level(state: State, level: _Level, shared: RowRunner, moved: float = 0.0) -> Adjustment:
    """Gauss-Newton steps until one moves no pose by more than ``settled_px``, and no unknown by its last change.

    ``moved`` is the `Adjustment.move` before, 0 if there is none.
    """
    if not math.isfinite(float(state.ball.radius)):
        raise torch.linalg.LinAlgError(NO_SOLUTION.sentence)  # type: ignore[attr-defined]
    if state.ball.cells != level.cells:
        state, _ = fit_map(with_cells(state, level.cells), shared, NEW_MAP_STEPS)
    before, share = None, 1.0
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
        joint = _joint_equations(state, model, equations, level.unknowns)
        last = LastStep(state, model, joint)
        settled = level.settled(len(state.poses), joint.covariance)
        of_map, step = _step(last, level.unknowns, SOLVED_SHARE * settled)
        share, before = _share_of_step(share, before, step / settled), step / settled
        state, of_step = _moved(state, level.unknowns, joint, share * of_map, share * step)
        if level.is_blurred:
            state = with_footprint_of_outline(state)
        move, move_px = float((of_step / settled).abs().max()), _in_px(of_step, len(state.poses))
        if not math.isfinite(move):
            raise torch.linalg.LinAlgError(NO_SOLUTION.sentence)  # type: ignore[attr-defined]
        is_bound = level.is_last and float(state.profile.variance.max()) >= limit * float(state.profile.variance[0])
        # A short move may follow a long one by chance, and a long one it.
        left, longest, moved = _share_left(move, moved), max(move, moved) if level.is_last else move, move
        if left * longest < 1 and not is_bound:
            break
    has_settled = left * move_px < max(level.settled_px, MAX_UNSETTLED_PX)
    return Adjustment(state, joint.covariance, has_settled, last=last, unknowns=level.unknowns, move=move)


def _share_left(move: float, before: float) -> float:
    """What is left to move over the last ``move``, if moves get shorter by the share that this one has of that before.

    It is the sum of all moves to come.
    """
    if not before:
        return 1.0
    share = min(max(move / before, LEAST_LEFT), MOST_LEFT)
    return share / (1 - share)


def _in_px(step: Tensor, n: int) -> float:
    """Largest move of one of n poses, or of the radius, by a ``step`` (u,), px."""
    of_poses = step[: PER_IMAGE * n].unflatten(0, (n, PER_IMAGE))[:, :GEOMETRY]
    return float(of_poses.abs().max().maximum(step[-COMMON].abs()))


def _equations(state: State, unknowns: SharedUnknowns, shared: RowRunner) -> LastStep:
    """The model at the ``state`` and the equations of a step, with the weights that the state has."""
    weights = state.profile.weights(state.windows, state.poses)
    equations = MapEquations.of(drawn(state, shared), weights, shared, state.smoothness)
    model = shared_unknown.with_columns(unknowns, state, linearised(state, shared), shared)
    return LastStep(state, model, _joint_equations(state, model, equations, unknowns))


def _joint_equations(
    state: State, model: Linearisation, equations: MapEquations, unknowns: SharedUnknowns
) -> JointEquations:
    precisions = tuple(unknown.precision for unknown in unknowns)
    return elimination.joint_equations(model, equations, state.poses, precisions, grows=state.ball.grows)


def _gradients(at: LastStep, unknowns: SharedUnknowns) -> tuple[Tensor, Tensor]:
    """Gradients by the map (m,) and by all other unknowns (u,)."""
    state, model, joint = at
    weighted = (joint.map.weights * (state.windows.levels - model.levels)).flatten(1).unsqueeze(1)
    by_unknowns = elimination.spread_gradient(torch.bmm(weighted, model.jacobian)[:, 0].double())
    first = PER_IMAGE * len(state.poses)
    for number, unknown in enumerate(unknowns):
        by_unknowns[first + number] -= unknown.precision * unknown.value(state)
    return joint.map.gradient(state.ball.coefficients, state.windows.levels), by_unknowns


def _step(at: LastStep, unknowns: SharedUnknowns, settled: Tensor) -> tuple[Tensor, Tensor]:
    """Gauss-Newton step of the map (m,) and of all other unknowns (u,), down to a share of what counts as settled."""
    state, _, joint = at
    by_map, by_unknowns = _gradients(at, unknowns)
    is_sharpest = float(state.ball.edge_blur) <= forward_model.MIN_BLUR_PX
    if is_sharpest and float(joint.approximate(by_map, by_unknowns).step[-1]) < 0:
        # Cut off afterwards, a blur that wants to be less would leave the others a step that is not theirs.
        joint = joint.with_blur_held()
    # Where light and texture take each other's place, the end of a step would hang on rounding.
    return joint.solve(by_map, by_unknowns, *((STEPS_OF_UNKNOWNS, None) if unknowns else (STEPS, settled)))


def _share_of_step(share: float, before: Tensor | None, step: Tensor) -> float:
    """The share of a ``step`` (u,) to take, after that ``share`` of the step ``before``, in moves that are settled.

    Steps that go back a part of the step before would go on to and fro: the weights change with what is drawn, and
    radius and map, which share the rim, each step as if the other's step were small. By both steps the end lies where
    they would vanish (the secant rule).
    """
    if before is None:
        return 1.0
    back = float(step @ before / (before @ before).clamp_min(1e-30))
    return min(1.0, max(share / (1 - back), LEAST_SHARE)) if back < 1 else 1.0


def _moved(
    state: State, unknowns: SharedUnknowns, joint: JointEquations, of_map: Tensor, step: Tensor
) -> tuple[State, Tensor]:
    """The state after a step, held within the limits of its length, and what was taken of the step (u,)."""
    ball, poses = state.ball, len(state.poses)
    # The blur is held within its bounds; the other unknowns follow by their correlation with it.
    wanted = step[-1].clamp(-MAX_BLUR_STEP_PX, MAX_BLUR_STEP_PX).maximum(forward_model.MIN_BLUR_PX - ball.edge_blur)
    step = step + joint.covariance[:, -1] / joint.covariance[-1, -1] * (wanted - step[-1])
    most = limits(poses, MAX_MOVE_PX, [unknown.max_change for unknown in unknowns]).to(step)
    share = 1 / (step / most).abs().max().clamp_min(1)
    return shared_unknown.moved(state, unknowns, share.to(of_map) * of_map, share * step), share * step


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
