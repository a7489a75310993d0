"""Joint adjustment of the ball's texture map and of its poses in many images: bundle adjustment of one sphere.

Pairs of images know the step between two poses; all images together know the map that explains every one of them, and
with it the poses, the radius and the blur of the outline. The map's coefficients are thousands, but enter linearly and
touch their neighbours only, so they are eliminated exactly (Schur complement); what remains are five unknowns per image
and two in common. Its inverse is the covariance of all poses with the map's own uncertainty in it.

The way to it is Gauss-Newton (`torchsphere.sphere_map.gauss_newton`).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
import torch
from numpy.typing import NDArray

from torchsphere.sphere_map import cube_map, gauss_newton, map_fit, pixel_weights, projection, schur
from torchsphere.sphere_map.gauss_newton import State
from torchsphere.sphere_map.pixel_weights import Profile
from torchsphere.sphere_map.projection import Ball, Pose
from torchsphere.sphere_map.window import Window

Array = NDArray[np.float64]

#: Width of the map's cells in each round, px. Speckle of 4 px leaves a residual of 2.0 grey levels over noise of 2.0 at
#: 1.0 px, and 3.0 at 1.5 px, where a round costs a third. The coarse ones bring poses that are a px off together.
SPACINGS_PX = (2.0, 1.5, 1.0)

#: Blur of the outline that the adjustment starts from, px.
EDGE_BLUR_PX = 0.3

#: Rounds at most with cells of one width, and how far the last step of a round may still have moved a pose, px, to go
#: on to the next width.
ROUNDS = 4
SETTLED_PX = (0.1, 0.1, 0.02)

#: Length of the last step of a round for each width, px.
DONE_PX = (0.02, 0.01, 0.001)

#: Variance within the disc, against that of the noise, from which a shading is sought. Without need, its terms would
#: wander with the map's own slow changes.
SHADED_FROM = 1.5

#: What the model of the edge may be wrong by, as an error of the radius, px: measured -0.003 px where pixels are exact
#: means, and -0.011 where they are means of nine points.
SYSTEMATIC_RADIUS_PX = 0.012

#: The same for each px of the outline's blur above what optics alone make, px: motion blurs the edge to two sides only,
#: which the model does not know. Measured with 0.65 px: the radius stays up to 0.29 px away, where it started from.
SHARP_PX, SYSTEMATIC_PER_BLUR = 0.3, 0.8

#: Rounds of gains and map in turns at the start, after a first map, for recordings that flicker.
GAIN_ROUNDS = 2


@dataclass(frozen=True)
class Bundle:
    """The adjusted ball and poses.

    Attributes
    ----------
    ball : Ball
    poses : list of Pose
    covariance : ndarray
        (5 n + 2, 5 n + 2) of the poses as (dx, dy, wx, wy, wz), px, rotations times the radius, then of radius and
        edge blur, px. The mean orientation is the frame of all and has none.
    profile : Profile
        Residual against the distance from the outline.
    windows : list of Window
        The images with the trust that their pixels deserve.
    settled : bool
        False where the poses still moved at the end.
    """

    ball: Ball
    poses: list[Pose]
    covariance: Array
    profile: Profile
    windows: list[Window]
    settled: bool


def adjust(
    windows: list[Window],
    poses: list[Pose],
    radius: float,
    noise_variance: float,
    progress: Callable[[float], None] | None = None,
) -> Bundle:
    """Adjust map and poses to the images.

    Parameters
    ----------
    windows : list of Window
        Pixels around the ball in n images.
    poses : list of Pose
        Poses (n) that are right to within half a speckle.
    radius : float
        Of the outline, right to within a px, px.
    noise_variance : float
        Of the images; where much more is left, a light that is not the same from all sides is sought.
    progress : callable, optional
        Called with the share that is done, after each width of the cells.

    Returns
    -------
    Bundle
    """
    shading = torch.zeros(projection.SHADES, dtype=torch.float64)
    shading[0] = 1.0
    ball = Ball(radius, EDGE_BLUR_PX, cube_map.cells_for(radius, SPACINGS_PX[0]), torch.zeros(0).double(), shading)
    poses, profile = pixel_weights.first_gains(windows, poses), pixel_weights.level_profile(radius)
    ball, poses = map_fit.first_map(windows, poses, ball, profile, GAIN_ROUNDS)
    state = Bundle(ball, poses, np.zeros((0, 0)), profile, windows, settled=False)
    for spacing, settled, done in zip(SPACINGS_PX, SETTLED_PX, DONE_PX, strict=True):
        cells = cube_map.cells_for(radius, spacing)
        if cells != state.ball.cells:
            finer = replace(state.ball, cells=cells)
            state = replace(state, ball=map_fit.first_map(state.windows, state.poses, finer, state.profile)[0])
        state = _rounds(state, settled, done)
        if progress is not None:
            # A width costs as its number of cells.
            progress(sum(s**-2 for s in SPACINGS_PX if s >= spacing) / sum(s**-2 for s in SPACINGS_PX))
    if state.profile.variance[0] > SHADED_FROM * noise_variance:
        state = replace(state, ball=map_fit.shaded(state.windows, state.poses, state.ball, state.profile))
        state = _rounds(state, SETTLED_PX[-1], DONE_PX[-1])
    return replace(state, covariance=_with_systematic(state.covariance, len(poses), state.ball.edge_blur))


def _rounds(before: Bundle, settled: float, done: float) -> Bundle:
    """Rounds of elimination and steps until a fresh step moves no pose by more than ``settled`` px.

    The steps of a round end with one of ``done`` px.
    """
    state = State.of(before.windows, before.poses, before.ball, before.profile)
    for _ in range(ROUNDS):
        state = state.levelled().profiled().doubted()
        elimination = schur.eliminate(state.windows, state.poses, state.model, state.profile)
        state, move = gauss_newton.iterate(state, elimination, done)
        if move < settled:
            break
    profile = state.profiled().profile
    return Bundle(state.ball, state.poses, elimination.reduced_inverse, profile, state.windows, move < settled)


def _with_systematic(covariance: Array, n: int, edge_blur: float) -> Array:
    """The covariance with what a systematic error of the radius does to it and, by their correlation, to the poses."""
    of_radius = covariance[:, 5 * n] / covariance[5 * n, 5 * n]
    systematic = np.hypot(SYSTEMATIC_RADIUS_PX, SYSTEMATIC_PER_BLUR * max(edge_blur - SHARP_PX, 0.0))
    return covariance + systematic**2 * np.outer(of_radius, of_radius)
