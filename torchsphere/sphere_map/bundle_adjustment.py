"""Bundle adjustment of one sphere: texture map, radius and edge blur of the ball, and its poses in many images.

The map has thousands of coefficients, but the grey levels are linear in them, and only neighbours are coupled. The map
is eliminated exactly (Schur complement). Five unknowns per image and two common ones remain; the inverse of
their normal matrix is the covariance of all poses, which includes the uncertainty of the map.

The steps are those of `torchsphere.sphere_map.gauss_newton`.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
import torch
from numpy.typing import NDArray

from torchsphere.sphere_map import cube_map, gauss_newton, map_fit, pixel_weights, schur
from torchsphere.sphere_map.projection import Pose, TexturedBall, uniform_light
from torchsphere.sphere_map.state import State
from torchsphere.sphere_map.window import Window

Array = NDArray[np.float64]


@dataclass(frozen=True)
class _Level:
    """One resolution of the map."""

    cell_px: float  # width of the cells
    tolerance_px: float  # length of a step at which the steps with one elimination end
    settled_px: float  # move by the first step of an elimination below which the level is done


#: Levels of the map, coarse to fine; coarse cells align poses that are off by a px (docs/constants.md).
LEVELS = (_Level(2.0, 0.02, 0.1), _Level(1.5, 0.01, 0.1), _Level(1.0, 0.001, 0.02))

#: Blur of the outline at the start, px.
INITIAL_BLUR_PX = 0.3

#: Largest number of eliminations at one level.
MAX_ELIMINATIONS = 4

#: Residual variance within the disc, in variances of the noise, from which a shading is fitted (docs/constants.md).
SHADING_FROM = 1.5

#: Systematic error of the radius by the model of the edge, px (docs/constants.md).
RADIUS_ERROR_PX = 0.012

#: Blur that optics alone make, px, and systematic error of the radius per px of further blur (docs/constants.md).
OPTICS_BLUR_PX, RADIUS_ERROR_PER_BLUR = 0.3, 0.8

#: Number of fits of gains and offsets, each followed by a fit of the map, before the first level.
BRIGHTNESS_ROUNDS = 2


@dataclass(frozen=True)
class Adjustment:
    """The adjusted ball and poses.

    Attributes
    ----------
    state : State
        Images with their visibility, poses, ball, and profile of the residuals.
    covariance : ndarray
        (5 n + 2, 5 n + 2) of the poses as (dx, dy, wx, wy, wz), px, rotations times the radius, then of radius and
        edge blur, px. The mean orientation defines the frame and has no variance.
    settled : bool
        False if the poses still moved at the end.
    """

    state: State
    covariance: Array
    settled: bool


def adjust(
    windows: list[Window],
    poses: list[Pose],
    radius: float,
    noise_variance: float,
    progress: Callable[[float], None] | None = None,
) -> Adjustment:
    """Adjust map and poses to the images.

    Parameters
    ----------
    windows : list of Window
        Pixels around the ball in n images.
    poses : list of Pose
        Initial poses (n), with errors of up to half a speckle.
    radius : float
        Initial radius of the outline, with an error of up to a px, px.
    noise_variance : float
        Variance of the images' noise, grey levels squared. If the residual is much larger, the light on the ball is
        fitted, too.
    progress : callable, optional
        Called with the share that is done, after each level.

    Returns
    -------
    Adjustment

    Raises
    ------
    LinAlgError
        If the normal equations are singular.
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
        elimination = schur.eliminate(linearised)
        linearised, move = gauss_newton.iterate(linearised, elimination, level.tolerance_px)
        if move < level.settled_px:
            break
    return Adjustment(linearised.measure_profile().state, elimination.covariance, move < level.settled_px)


def _with_radius_error(covariance: Array, n: int, edge_blur: float) -> Array:
    """The covariance with the systematic error of the radius, and the effect of this error on the poses."""
    by_radius = covariance[:, 5 * n] / covariance[5 * n, 5 * n]
    error = np.hypot(RADIUS_ERROR_PX, RADIUS_ERROR_PER_BLUR * max(edge_blur - OPTICS_BLUR_PX, 0.0))
    return covariance + error**2 * np.outer(by_radius, by_radius)
