"""Bundle adjustment of one sphere: texture map, radius and edge blur of the ball, and its poses in many images.

Coarse cells align the poses, and show whether a lens bends the images; fine cells settle all. The inverse of the last
step's matrix is the covariance of all poses, with the uncertainty of the map.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace

import torch
from torch import Tensor

from torchsphere.runtime.threads import RowRunner
from torchsphere.sphere_map import cube_map, exposure_share, lens_decision, light, map_fit, pixel_weights, radius_error
from torchsphere.sphere_map.ball import LIGHT_TERMS, Poses, TexturedBall, uniform_light
from torchsphere.sphere_map.decision import MAX_MISFIT
from torchsphere.sphere_map.elimination import PER_IMAGE
from torchsphere.sphere_map.footprint import fit_footprint, with_footprint_of_outline
from torchsphere.sphere_map.lens import View
from torchsphere.sphere_map.level import LAST_SETTLED_PX, MAX_STEPS, NEW_MAP_STEPS, Adjustment, Level, adjust_level
from torchsphere.sphere_map.light import fit_light
from torchsphere.sphere_map.pixel_weights import ROUNDING_VARIANCE
from torchsphere.sphere_map.radius_error import OPTICS_BLUR_PX
from torchsphere.sphere_map.rays import rim_points
from torchsphere.sphere_map.shared_unknown import SharedUnknowns
from torchsphere.sphere_map.state import State, fit_map, with_cells
from torchsphere.sphere_map.window import Windows, texture_variance

#: Width of the first map's cells, px, and move of a pose below which it counts as settled there: coarse cells align
#: poses that are off by a px (docs/constants.toml).
COARSE_PX, COARSE_SETTLED_PX = 2.0, 0.1


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
    stays: bool = False,
    view: View | None = None,
    lens: SharedUnknowns = (),
) -> Adjustment:
    """Adjust map and poses to n images, from ``poses`` within half a speckle and a ``radius`` within a px.

    ``cell_px`` is the width of the map's cells, ``noise_variance`` that of the images, grey levels squared, and
    ``least_variance`` that which the steps of the levels leave; ``shared`` shares images out among threads.
    ``progress`` is called with the share that is done. The adjustment starts from the blur ``optics_px`` of the
    images, 0 where they are sharp, and from the exposure of the windows, which is adjusted if it is not known. The
    radius in each image is adjusted if the ball ``grows``, one place of all if it ``stays``, and the unknowns of a
    ``lens`` that the windows are cut for. A lens is looked for in the ``view`` on coarse cells: if the images show one,
    the adjustment ends there. Singular equations raise LinAlgError.
    """
    ball = replace(_first_ball(windows, poses, radius, optics_px), grows=grows, stays=stays)
    profile = pixel_weights.uniform_profile(ball.radius, noise_variance, least_variance)
    state = State(windows, _with_initial_gains(windows, poses), ball, profile)
    # Defocus blurs a pixel as it blurs the outline. Beside an exposure, only fine cells tell one from the other.
    is_defocused = optics_px > 0 and windows.moments is None
    if is_defocused:
        state = with_footprint_of_outline(state)
    coarse = cube_map.cells_per_face(radius, max(COARSE_PX, cell_px))
    state = _with_first_map(state, max(COARSE_PX, cell_px), shared)
    level = Level(coarse, COARSE_SETTLED_PX, 20, is_last=False, is_blurred=is_defocused, unknowns=lens)
    adjustment = adjust_level(state, level, shared)
    longer = None if is_exposure_known else exposure_share.unknown_from(windows)
    if view is not None:
        # What smears the outline along the motion looks like pixels that are not square, and a lamp like a lens.
        view = replace(view, beside=(*light.unknowns(1.0), *(() if longer is None else (longer,))))
        found = lens_decision.found_in(view, state, adjustment, level, shared)
        if found is not None:
            return found
    if lens:
        # Cut through the lens, the windows show better what belongs to it.
        adjustment = lens_decision.with_lens_alone(adjustment, lens)
        lens = adjustment.lens
    _report(progress, 0.4)
    if not adjustment.settled:
        # Poses that jump about on a coarse map do so on a fine one.
        return adjustment
    fine = cube_map.cells_per_face(radius, cell_px)
    last = Level(fine, LAST_SETTLED_PX, MAX_STEPS, is_last=True, is_blurred=optics_px > 0, unknowns=lens)
    last = last._replace(most_residual=MAX_MISFIT * noise_variance)
    # The noise as the steps between images saw it may hold more than noise, and so may a residual on coarse cells.
    noise = min(noise_variance, adjustment.residual_variance)
    state = replace(adjustment.state, smoothness=map_fit.smoothness_for(noise, texture_variance(windows)))
    if last.is_blurred and not level.is_blurred:
        # Coarse cells, and a sharp footprint, blur the outline more than the optics do.
        state = with_footprint_of_outline(replace(state, ball=replace(state.ball, edge_blur=ball.edge_blur)))
    adjustment = _with_light(state, last, None if is_exposure_known else windows, shared)
    _report(progress, 1.0)
    return with_error_of_model(adjustment)


def _with_light(state: State, last: Level, exposure_of: Windows | None, shared: RowRunner) -> Adjustment:
    """The adjustment on the ``last`` level with a light from a side, if the images show one.

    The exposure over that of the windows ``exposure_of`` is adjusted, too.
    """
    # Poses that are off look like a light, and a light pulls at the poses: it is looked for after one step.
    first = adjust_level(state, last._replace(max_steps=1), shared)
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
        even = replace(adjustment.state, ball=replace(adjustment.state.ball, light=uniform_light(state.ball.radius)))
        adjustment = _adjust_last(even, last, (), exposure_of, shared, 0.0)
    return adjustment


def _with_footprint(state: State, level: Level, shared: RowRunner) -> State:
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
    level: Level,
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
        adjustment = adjust_level(state, level._replace(unknowns=(*lights, longer, *level.unknowns)), shared)
        if adjustment.settled:
            return adjustment
    # Unknowns that are new may move more than all did before.
    return adjust_level(state, level._replace(unknowns=(*lights, *level.unknowns)), shared, 0.0 if lights else moved)


def _report(progress: Callable[[float], None] | None, share: float) -> None:
    if progress is not None:
        progress(share)


def _first_ball(windows: Windows, poses: Poses, radius: float, optics_px: float) -> TexturedBall:
    """A ball without a map, evenly lit, whose edge has the blur of the optics."""
    like = windows.levels
    size = torch.tensor(radius, dtype=torch.float64, device=like.device)
    blur, none = torch.full_like(size, max(optics_px, OPTICS_BLUR_PX)), like.new_zeros(0)
    points = rim_points(float(poses.radii(radius).max()))
    return TexturedBall(size, blur, 0, none, uniform_light(size), rim_points=points)


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


def with_error_of_model(adjustment: Adjustment) -> Adjustment:
    """The adjustment with the systematic error of the radius: by texture that passes for outline, and by light."""
    ball = adjustment.state.ball
    of_texture = radius_error.of_model(adjustment.state.poses.orientation, float(ball.radius))
    return adjustment.with_radius_error(math.hypot(of_texture, radius_error.by_light(ball.light)))
