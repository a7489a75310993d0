"""Joint adjustment of the ball's texture map and of its poses in many images: bundle adjustment of one sphere.

Pairs of images know the step between two poses; all images together know the map that explains every one of them, and
with it the poses, the radius and the blur of the outline. The map's coefficients are thousands, but enter linearly and
touch their neighbours only, so they are eliminated exactly (Schur complement); what remains are five unknowns per image
and two in common. Its inverse is the covariance of all poses with the map's own uncertainty in it.

The way to it is Gauss-Newton: the elimination is costly and is renewed rarely, the residuals are always exact.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from torchsphere import lit_map, parallel, schur, texture, trust, view
from torchsphere.trust import Profile
from torchsphere.view import Ball, Pose
from torchsphere.window import Window

Array = NDArray[np.float64]

#: Width of the map's cells in each round, px. Speckle of 4 px leaves a residual of 2.0 grey levels over noise of 2.0 at
#: 1.0 px, and 3.0 at 1.5 px, where a round costs a third. The coarse ones bring poses that are a px off together.
SPACINGS_PX = (2.0, 1.5, 1.0)

#: Blur of the outline that the adjustment starts from, px.
EDGE_BLUR_PX = 0.3

#: Rounds at most with cells of one width, and how far the last step of a round may still have moved a pose, px, to go
#: on to the next width.
ROUNDS = 4
SETTLED_PX = (0.1, 0.05, 0.02)

#: Steps at most after each elimination, and the length of the last one, as a share of what settles the width.
STEPS, DONE = 4, 0.05

#: A round ends when a step is no longer this share of the one before: its elimination is too old then.
SHRINKS = 0.8

#: Shares of a step that are tried until the residuals fall: near the limb no step is linear.
SHARES = (1.0, 0.3, 0.1)

#: Variance within the disc, against that of the noise, from which a shading is sought. Without need, its terms would
#: wander with the map's own slow changes.
SHADED_FROM = 1.5

#: What the model of the edge may be wrong by, as an error of the radius, px: measured -0.007 px where pixels are exact
#: means, and -0.02 where they are means of nine points.
SYSTEMATIC_RADIUS_PX = 0.015

#: The same for each px of the outline's blur above what optics alone make, px: motion blurs the edge to two sides only,
#: which the model does not know. Measured with 0.65 px: the radius stays up to 0.29 px away, where it started from.
SHARP_PX, SYSTEMATIC_PER_BLUR = 0.3, 0.8

#: Rounds of map and gains in turns at the start, for recordings that flicker.
GAIN_ROUNDS = 3


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
    shading = torch.zeros(view.SHADES, dtype=torch.float64)
    shading[0] = 1.0
    ball = Ball(radius, EDGE_BLUR_PX, texture.cells_for(radius, SPACINGS_PX[0]), torch.zeros(0).double(), shading)
    poses, profile = trust.first_gains(windows, poses), trust.level_profile(radius)
    for _ in range(GAIN_ROUNDS):
        ball = lit_map.first_map(windows, poses, ball, profile)
        poses, _ = _levelled(windows, poses, ball, profile)
    state = Bundle(ball, poses, np.zeros((0, 0)), profile, windows, settled=False)
    for spacing, settled in zip(SPACINGS_PX, SETTLED_PX, strict=True):
        cells = texture.cells_for(radius, spacing)
        if cells != state.ball.cells:
            finer = replace(state.ball, cells=cells)
            state = replace(state, ball=lit_map.first_map(state.windows, state.poses, finer, state.profile))
        state = _rounds(state, settled)
        if progress is not None:
            # A width costs as its number of cells.
            progress(sum(s**-2 for s in SPACINGS_PX if s >= spacing) / sum(s**-2 for s in SPACINGS_PX))
    if state.profile.variance[0] > SHADED_FROM * noise_variance:
        state = replace(state, ball=lit_map.shaded(state.windows, state.poses, state.ball, state.profile))
        state = _rounds(state, SETTLED_PX[-1])
    return replace(state, covariance=_with_systematic(state.covariance, len(poses), state.ball.edge_blur))


def _rounds(state: Bundle, settled: float) -> Bundle:
    """Rounds of elimination and steps until a fresh step moves no pose by more than ``settled`` px."""
    for _ in range(ROUNDS):
        ball = state.ball
        poses, levels = _levelled(state.windows, state.poses, ball, state.profile)
        profile = trust.profile(state.windows, poses, levels, ball.radius)
        each = zip(state.windows, poses, levels, strict=True)
        windows = [trust.doubt(window, pose, profile, seen) for window, pose, seen in each]
        elimination = schur.eliminate(windows, poses, ball, profile)
        poses, ball, move = _iterate(windows, poses, ball, profile, elimination, DONE * settled)
        state = Bundle(ball, poses, elimination.reduced_inverse, profile, windows, move < settled)
        if state.settled:
            break
    levels = trust.appearances(state.windows, state.poses, state.ball)
    return replace(state, profile=trust.profile(state.windows, state.poses, levels, state.ball.radius))


def _levelled(
    windows: list[Window], poses: list[Pose], ball: Ball, profile: Profile
) -> tuple[list[Pose], list[Tensor]]:
    """The poses with the gains and offsets that fit best, and what the model then gives the pixels (p,) of each."""
    levels = trust.appearances(windows, poses, ball)
    each = zip(windows, poses, levels, strict=True)
    lit = [trust.levelled(window, pose, profile, seen) for window, pose, seen in each]
    return lit, [view.relit(*column) for column in zip(levels, poses, lit, strict=True)]


def _with_systematic(covariance: Array, n: int, edge_blur: float) -> Array:
    """The covariance with what a systematic error of the radius does to it and, by their correlation, to the poses."""
    of_radius = covariance[:, 5 * n] / covariance[5 * n, 5 * n]
    systematic = np.hypot(SYSTEMATIC_RADIUS_PX, SYSTEMATIC_PER_BLUR * max(edge_blur - SHARP_PX, 0.0))
    return covariance + systematic**2 * np.outer(of_radius, of_radius)


def _iterate(
    windows: list[Window],
    poses: list[Pose],
    ball: Ball,
    profile: Profile,
    elimination: schur.Elimination,
    done_px: float,
) -> tuple[list[Pose], Ball, float]:
    """Steps with one elimination while they shrink, and are longer than ``done_px``.

    Returns poses, ball, and how far the first step moved a pose, px.
    """
    moves: list[float] = []
    pull = _pull(windows, poses, ball, profile)
    for _ in range(STEPS):
        for share in SHARES:
            tried = _step(pull, poses, ball, elimination, share)
            settled = lit_map.brought_up_to_date(windows, *tried, profile, elimination)
            after = _pull(windows, tried[0], settled, profile)
            if after.squares < pull.squares:
                break
        else:
            break
        moves.append(max(float((p.centre - q.centre).abs().max()) for p, q in zip(poses, tried[0], strict=True)))
        poses, ball, pull = tried[0], settled, after
        if moves[-1] < done_px or (len(moves) > 1 and moves[-1] > SHRINKS * moves[-2]):
            break
    return poses, ball, moves[0] if moves else np.inf


@dataclass(frozen=True)
class _Pull:
    """Where the residuals pull the map (m,) and the poses (5 n + 2,), and their weighted sum of squares."""

    of_map: Array
    of_poses: Array
    squares: float


def _pull(windows: list[Window], poses: list[Pose], ball: Ball, profile: Profile) -> _Pull:
    n, squares = len(windows), 0.0
    of_map, of_poses = np.zeros(texture.size(ball.cells)), np.zeros(5 * n + schur.SHARED)

    def of_one(window: Window, pose: Pose) -> tuple[Array, Array, float]:
        now = view.linearised(window, pose, ball)
        rest = window.levels - now.levels
        weighted = trust.weights(window, pose, profile) * rest
        own = now.look.add(weighted[window.owner] * now.light)
        return own.numpy(), (now.slopes.T @ weighted).numpy(), float(weighted.double() @ rest.double())

    for i, (own_map, own_pose, own_squares) in enumerate(parallel.each(of_one, windows, poses)):
        of_map += own_map
        of_poses[schur.columns_of(i, n)] += own_pose
        squares += own_squares
    coefficients = ball.coefficients.numpy()
    rough = schur.SMOOTHNESS * (schur.roughness_matrix(ball.cells) @ coefficients)
    return _Pull(of_map - rough, of_poses, squares + float(coefficients @ rough))


def _step(
    pull: _Pull, poses: list[Pose], ball: Ball, elimination: schur.Elimination, share: float
) -> tuple[list[Pose], Ball]:
    """A ``share`` of one step of Gauss-Newton, with an elimination that may be a few steps old."""
    right = elimination.map.solve(pull.of_map[elimination.seen])
    inverse, blur = elimination.reduced_inverse, 5 * len(poses) + 1
    step = share * inverse @ (pull.of_poses - elimination.coupling.T @ right)
    # An edge cannot be sharper than the pixels make it: the blur stops there, and the others take that into account.
    least = view.LEAST_BLUR_PX - ball.edge_blur
    if step[blur] < least:
        step = step + inverse[:, blur] / inverse[blur, blur] * (least - step[blur])
    coefficients = ball.coefficients.numpy().copy()
    coefficients[elimination.seen] += share * right - elimination.solved @ step
    steps = torch.from_numpy(step)
    poses = [view.moved(pose, steps[5 * i : 5 * i + 5], ball.radius) for i, pose in enumerate(poses)]
    return poses, replace(
        ball,
        radius=ball.radius + float(step[blur - 1]),
        edge_blur=ball.edge_blur + float(step[blur]),
        coefficients=torch.from_numpy(coefficients),
    )
