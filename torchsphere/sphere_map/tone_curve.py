"""The camera's tone curve, as far as it moves the outline: one unknown beside map and poses.

Of a camera whose grey levels are not proportional to the light, as those of most videos, a pixel at the outline is
nearer to the brighter of ball and background than the share that the disc covers. The outline seems to lie further out,
or further in, by as much of a px as it is blurred: see `rays.bent`.
"""

from __future__ import annotations

from dataclasses import replace

import torch
from torch import Tensor

from torchsphere.recording.level_scale import WHITE
from torchsphere.runtime.threads import RowRunner
from torchsphere.sphere_map import shared_unknown
from torchsphere.sphere_map.bundle_adjustment import with_error_of_model
from torchsphere.sphere_map.elimination import COMMON
from torchsphere.sphere_map.forward_model import Linearisation
from torchsphere.sphere_map.level import LAST_SETTLED_PX, MAX_STEPS, Adjustment, Level, adjust_level
from torchsphere.sphere_map.rays import coverage
from torchsphere.sphere_map.shared_unknown import SharedUnknown
from torchsphere.sphere_map.state import State

#: Prior standard deviation of the bend, its largest change at once, and change below which it has settled
#: (docs/constants.toml).
BEND_SD, MAX_CHANGE, LAST_CHANGE = 0.5, 0.3, 0.001

#: Bend that the images show: in its standard deviations, and at least (docs/constants.toml).
SEEN_SD, LEAST_SEEN = 5.0, 0.03

#: Largest bend: beyond 1, as of a background that is too bright for the camera, the edge begins within the ball
#: (docs/constants.toml).
MOST_BEND = 1.5

#: Error of the radius by further terms of the tone curve, px per square of the bend (docs/constants.toml).
RADIUS_ERROR_PX = 0.12

#: Least curvature of the tone curve that is none of the blur, and error of the radius over its change with the
#: curvature by one step (docs/constants.toml).
LEAST_CURVED, ERROR_PER_STEP = 0.3, 2.0

#: Least share of a pixel that tells the ball's grey level there.
LEAST_SHARE = 0.05

#: Change over which the model's derivative is taken.
STEP = 0.1


def _value(state: State) -> Tensor:
    return torch.full_like(state.ball.radius, state.ball.edge_bend)


def _changed(state: State, change: Tensor) -> State:
    return replace(state, ball=replace(state.ball, edge_bend=state.ball.edge_bend + float(change)))


#: The bend of the edge as an unknown beside map and poses.
UNKNOWN = SharedUnknown(_value, _changed, STEP, BEND_SD, MAX_CHANGE, LAST_CHANGE, is_linear=True)


def find_tone_curve(adjustment: Adjustment, shared: RowRunner, *, is_blurred: bool) -> Adjustment:
    """The adjustment with the bend of the edge, if the images show that the tone curve bends it."""
    assert adjustment.last is not None
    state = adjustment.state
    if not is_on_one_side(state):
        return _with_unknown_curve(adjustment, shared)
    # By the equations of the last step, which hardly mattered.
    found = shared_unknown.measure(UNKNOWN, *adjustment.last, shared)
    if not _is_seen(float(found.change), float(found.sd)):
        return adjustment
    unknowns = (*adjustment.unknowns, UNKNOWN)
    level = Level(state.ball.cells, LAST_SETTLED_PX, MAX_STEPS, is_last=True, is_blurred=is_blurred, unknowns=unknowns)
    bent = adjust_level(found.applied(state), level, shared)
    bend, sd = bent.state.ball.edge_bend, float(bent.covariance.diagonal()[-COMMON - 1].sqrt())
    if not (bent.settled and _is_seen(bend, sd)):
        return adjustment
    return with_error_of_model(bent).with_radius_error(RADIUS_ERROR_PX * bend**2)


class _Curvature(SharedUnknown):
    """The second term of the tone curve: a pixel of the edge is brighter by the square of the contrast there.

    Whichever of ball and background is the brighter one.
    """

    def column(self, state: State, model: Linearisation, shared: RowRunner) -> Tensor:
        """Change of the drawn grey levels (n, s, s) per curvature, of the range of grey levels."""
        windows, poses = state.windows, state.poses
        x, y = windows.offsets(poses.centre)
        radius = poses.radii(state.ball.radius).to(x).reshape(-1, 1, 1)
        share, _, _ = coverage(x, y, radius, state.ball.edge_blur.to(x))
        of_ball = (model.levels - windows.background) / share.clamp_min(LEAST_SHARE)
        contrast = torch.where(share > LEAST_SHARE, of_ball, 0.0)
        return share * (1 - share) * contrast.square() / WHITE


#: Looked at, and never part of a state.
_CURVATURE = _Curvature(
    lambda state: torch.zeros_like(state.ball.radius), lambda state, _: state, STEP, BEND_SD, 1.0, 0
)


def _with_unknown_curve(adjustment: Adjustment, shared: RowRunner) -> Adjustment:
    """The ``adjustment`` with the error of the radius by a tone curve that one bend of the edge does not describe."""
    assert adjustment.last is not None
    found = shared_unknown.measure(_CURVATURE, *adjustment.last, shared)
    curvature = float(found.change)
    if abs(curvature) < max(SEEN_SD * float(found.sd), LEAST_CURVED):
        return adjustment
    return adjustment.with_radius_error(ERROR_PER_STEP * curvature * found.of_radius)


def is_on_one_side(state: State) -> bool:
    """Whether most of the ball is brighter than what lies behind it, or most of it darker.

    A tone curve moves the edges of bright spots outwards and of dark ones inwards, or the other way round: one bend for
    all says what it does where the mean contrast is more than its scatter.
    """
    windows, poses = state.windows, state.poses
    x, y = windows.offsets(poses.centre)
    radius = poses.radii(state.ball.radius).to(x).reshape(-1, 1, 1)
    of_ball = (x.square() + y.square() < radius.square()) & (windows.visibility > 0)
    contrast = (windows.levels - windows.background)[of_ball]
    return bool(contrast.mean().abs() > contrast.std())


def _is_seen(bend: float, sd: float) -> bool:
    return MOST_BEND > abs(bend) > max(SEEN_SD * sd, LEAST_SEEN)
