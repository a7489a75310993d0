"""What the images tell of the camera's distance: a ball near the camera shows less than half of its surface.

Without a known distance, a step sideways and a turn by step / distance look alike. The distance itself can be told
apart, as the texture of a turning ball passes its limb in another way. It is one unknown beside map and poses.
"""

from __future__ import annotations

import math
from dataclasses import replace

import torch
from torch import Tensor

from torchsphere.sphere_map.ball import Poses
from torchsphere.sphere_map.perspective import Optics
from torchsphere.sphere_map.shared_unknown import SharedUnknown
from torchsphere.sphere_map.state import State

#: Prior standard deviation of the nearness, radius over distance, of a camera that is not known: 33 radii are the
#: distance of half a metre from a ball of 30 mm (docs/constants.toml).
UNKNOWN_SD = 0.03

#: Systematic error of a nearness that was measured, and the part of it that looks like a near camera where there is
#: none (docs/constants.toml).
SYSTEMATIC_SD, APPARENT_SD = 0.0007, 0.0005

#: Largest change of the nearness at once (docs/constants.toml).
MAX_CHANGE = 0.1

#: Change of the nearness below which it has settled (docs/constants.toml).
LAST_CHANGE = 0.0001

#: Nearness over which the model's derivative is taken.
STEP = 0.01


def total_sd(sd: float) -> float:
    """Standard deviation of a nearness that was measured with that ``sd``, with its systematic error."""
    return math.hypot(sd, SYSTEMATIC_SD)


def apparent_sd(sd: float) -> float:
    """Standard deviation of what is measured with that ``sd`` where the camera is infinitely far away."""
    return math.hypot(sd, APPARENT_SD)


def nearness_of(state: State) -> Tensor:
    """Radius over distance () of the ball."""
    optics = state.windows.optics
    return torch.zeros_like(state.ball.radius) if optics is None else state.ball.radius * optics.per_focal


def _nearer(state: State, change: Tensor) -> State:
    return with_nearness(state, nearness_of(state) + change)


def with_nearness(state: State, nearness: Tensor) -> State:
    """The state at another ``nearness`` (); what is seen along the line to the ball's centre stays."""
    optics = state.windows.optics
    assert optics is not None
    changed = replace(optics, per_focal=nearness / state.ball.radius)
    return replace(state, windows=state.windows.seen_by(changed), poses=seen_alike(state.poses, optics, changed))


def seen_alike(poses: Poses, before: Optics | None, after: Optics | None) -> Poses:
    """The poses in which the camera ``after`` sees the same side of the ball as the camera ``before``."""
    orientation = poses.orientation
    if before is not None:
        orientation = before.view(poses.centre).along(orientation)
    if after is not None:
        orientation = after.view(poses.centre).turn @ orientation
    return replace(poses, orientation=orientation)


#: The nearness as an unknown beside map and poses: a near ball's front seems to turn faster.
UNKNOWN = SharedUnknown(nearness_of, _nearer, STEP, UNKNOWN_SD, MAX_CHANGE, LAST_CHANGE)
