"""What the images tell of the camera's distance: a ball near the camera shows less than half of its surface.

Without a known distance, a step sideways and a turn by step / distance look alike. The distance itself can be told
apart, as the texture of a turning ball passes its limb in another way. It is one unknown beside map and poses.
"""

from __future__ import annotations

import math
from dataclasses import replace

import torch
from torch import Tensor

from torchsphere.runtime.threads import RowRunner
from torchsphere.sphere_map import shared_unknown
from torchsphere.sphere_map.ball import Poses
from torchsphere.sphere_map.elimination import JointEquations
from torchsphere.sphere_map.forward_model import Linearisation
from torchsphere.sphere_map.perspective import Optics
from torchsphere.sphere_map.shared_unknown import SharedChange, SharedUnknown
from torchsphere.sphere_map.state import State

#: Prior standard deviation of the nearness, radius over distance, of a camera that is not known: 33 radii are the
#: distance of half a metre from a ball of 30 mm (docs/constants.toml).
UNKNOWN_SD = 0.03

#: Systematic error of a nearness that was measured, and the part of it that looks like a near camera where there is
#: none (docs/constants.toml).
SYSTEMATIC_SD, APPARENT_SD = 0.0007, 0.0005

#: Share of the squared residuals that a near camera must explain where the images hardly tell (docs/constants.toml).
MIN_GAIN = 0.005

#: Squared residuals with a new map, in those without a near camera, from which no near camera is looked for
#: (docs/constants.toml).
HOPELESS = 4.0

#: Largest change of the nearness at once (docs/constants.toml).
MAX_CHANGE = 0.1

#: Nearness over which the model's derivative is taken.
STEP = 0.01


def measure(state: State, model: Linearisation, joint: JointEquations, shared: RowRunner) -> SharedChange:
    """Gauss-Newton step of the nearness, map and all poses left free, with ``model`` and ``joint`` at the state.

    A near ball's front seems to turn faster.
    """
    unknown = SharedUnknown(_nearer, STEP, UNKNOWN_SD, MAX_CHANGE)
    return shared_unknown.measure(unknown, nearness_of(state), state, model, joint, shared)


def total_sd(found: SharedChange) -> float:
    """Standard deviation of a measured nearness, with its systematic error."""
    return math.hypot(float(found.sd), SYSTEMATIC_SD)


def apparent_sd(found: SharedChange) -> float:
    """Standard deviation of the change where the camera is infinitely far away."""
    return math.hypot(float(found.sd), APPARENT_SD)


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
