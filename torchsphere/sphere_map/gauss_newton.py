"""Map and poses brought nearer to what the images show: steps of Gauss-Newton between two eliminations of the map.

The elimination is costly and gets old, the residuals are exact at every step.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import torch
from numpy.typing import NDArray

from torchsphere.runtime import threads
from torchsphere.sphere_map import cube_map, forward_model, map_fit, pixel_weights, projection, schur
from torchsphere.sphere_map.forward_model import Linearised
from torchsphere.sphere_map.pixel_weights import Profile
from torchsphere.sphere_map.projection import Ball, Pose, Sight
from torchsphere.sphere_map.window import Window

Array = NDArray[np.float64]

#: Steps at most after each elimination; they end when one is no longer this share of the one before: the elimination
#: is too old then.
STEPS, SHRINKS = 4, 0.8

#: Shares of a step that are tried until the residuals fall: near the limb no step is linear.
SHARES: tuple[float, ...] = (1.0, 0.3, 0.1)

#: What is tried first after a step that was taken as it was meant. Radius, blur and place of the outline are hard to
#: tell apart: where they are wrong together, each step was measured to leave 0.5 to 0.7 of it.
FURTHER = 2.0

#: By how much a step must lower the weighted squares for another one: by less, all poses and the ball together are
#: about one standard deviation from where the squares are least.
WORTH_IT = 1.0


@dataclass(frozen=True)
class State:
    """Images and ball as an adjustment has them.

    Attributes
    ----------
    windows : list of Window
        The images (n) with the trust that their pixels deserve.
    poses : list of Pose
    ball : Ball
    profile : Profile
        Residual against the distance from the outline.
    model : list of Linearised
        What the model gives each image.
    """

    windows: list[Window]
    poses: list[Pose]
    ball: Ball
    profile: Profile
    model: list[Linearised]

    @classmethod
    def of(cls, windows: list[Window], poses: list[Pose], ball: Ball, profile: Profile) -> State:
        """With the model of that ball."""
        return cls(windows, poses, ball, profile, _model(windows, poses, ball, projection.sights(windows, poses, ball)))

    def levelled(self) -> State:
        """With the gains and offsets that fit best."""
        each = zip(self.windows, self.poses, self.model, strict=True)
        poses = [pixel_weights.levelled(window, pose, self.profile, now.levels) for window, pose, now in each]
        changes = zip(self.model, self.poses, poses, strict=True)
        return replace(self, poses=poses, model=[now.relit(before, after) for now, before, after in changes])

    def profiled(self) -> State:
        """With the profile of its residuals."""
        levels = [now.levels for now in self.model]
        return replace(self, profile=pixel_weights.profile(self.windows, self.poses, levels, self.ball.radius))

    def doubted(self) -> State:
        """With trust in what fits the model."""
        each = zip(self.windows, self.poses, self.model, strict=True)
        windows = [pixel_weights.doubt(window, pose, self.profile, now.levels) for window, pose, now in each]
        return replace(self, windows=windows)


def _model(windows: list[Window], poses: list[Pose], ball: Ball, sights: list[Sight]) -> list[Linearised]:
    def of_one(window: Window, pose: Pose, seen: Sight) -> Linearised:
        return forward_model.linearised(window, pose, ball, seen)

    return list(threads.each(of_one, windows, poses, sights))


def iterate(state: State, elimination: schur.Elimination, done_px: float) -> tuple[State, float]:
    """Steps with one elimination while they shrink, and are longer than ``done_px``.

    With the state comes how far the first step, taken whole, moves a pose, px.
    """
    moves: list[float] = []
    pull, shares = _pull(state), SHARES
    for _ in range(STEPS):
        for share in shares:
            tried = _tried(state, pull, elimination, share)
            after = _pull(tried)
            length = _longest(state.poses, tried.poses) / share
            if after.squares < pull.squares:
                break
        else:
            # Nothing is to be gained any more: settled, if what was tried is as short as that.
            moves = moves or [length]
            break
        moves.append(length)
        gained = pull.squares - after.squares
        state, pull = tried, after
        if moves[-1] < done_px or gained < WORTH_IT or (len(moves) > 1 and moves[-1] > SHRINKS * moves[-2]):
            break
        shares = (FURTHER, *SHARES) if share == shares[0] else SHARES
    return state, moves[0]


def _longest(before: list[Pose], after: list[Pose]) -> float:
    return max(float((p.centre - q.centre).abs().max()) for p, q in zip(before, after, strict=True))


def _tried(state: State, pull: _Pull, elimination: schur.Elimination, share: float) -> State:
    """The state after a ``share`` of a step, its map brought up to date."""
    windows, profile = state.windows, state.profile
    poses, ball = _step(pull, state.poses, state.ball, elimination, share)
    sights = projection.sights(windows, poses, ball)
    ball = map_fit.brought_up_to_date(windows, sights, poses, ball, profile, elimination)
    return State(windows, poses, ball, profile, _model(windows, poses, ball, sights))


@dataclass(frozen=True)
class _Pull:
    """Where the residuals pull the map (m,) and the poses (5 n + 2,), and their weighted sum of squares."""

    of_map: Array
    of_poses: Array
    squares: float


def _pull(state: State) -> _Pull:
    n, ball, squares = len(state.windows), state.ball, 0.0
    of_map, of_poses = np.zeros(cube_map.size(ball.cells)), np.zeros(5 * n + schur.SHARED)

    def of_one(window: Window, pose: Pose, now: Linearised) -> tuple[Array, Array, float]:
        rest = window.levels - now.levels
        weighted = pixel_weights.weights(window, pose, state.profile) * rest
        own = now.look.add(window.spread(weighted, now.light))
        return own.numpy(), (now.slopes.T @ weighted).numpy(), float(weighted.double() @ rest.double())

    each = threads.each(of_one, state.windows, state.poses, state.model)
    for i, (own_map, own_pose, own_squares) in enumerate(each):
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
    least = projection.LEAST_BLUR_PX - ball.edge_blur
    if step[blur] < least:
        step = step + inverse[:, blur] / inverse[blur, blur] * (least - step[blur])
    coefficients = ball.coefficients.numpy().copy()
    coefficients[elimination.seen] += share * right - elimination.solved @ step
    steps = torch.from_numpy(step)
    poses = [forward_model.moved(pose, steps[5 * i : 5 * i + 5], ball.radius) for i, pose in enumerate(poses)]
    return poses, replace(
        ball,
        radius=ball.radius + float(step[blur - 1]),
        edge_blur=ball.edge_blur + float(step[blur]),
        coefficients=torch.from_numpy(coefficients),
    )
