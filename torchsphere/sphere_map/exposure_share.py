"""The share of the time between frames for which the shutter is open, fitted together with map and poses.

The outline tells this share to 15 %, and the radius is too large where it is too small: an outline that is smeared by
less reaches further.
"""

from __future__ import annotations

from dataclasses import replace

import torch
from torch import Tensor

from torchsphere.runtime.threads import RowRunner
from torchsphere.sphere_map import shared_unknown
from torchsphere.sphere_map.elimination import JointEquations
from torchsphere.sphere_map.forward_model import Linearisation
from torchsphere.sphere_map.shared_unknown import SharedChange, SharedUnknown
from torchsphere.sphere_map.state import State

#: Standard deviation of the share as the outlines tell it, and largest change at once, both over the share
#: (docs/constants.toml).
OUTLINES_SD, MAX_CHANGE = 0.2, 0.2

#: Change over which the model's derivative is taken.
STEP = 0.02


def measure(
    state: State, model: Linearisation, joint: JointEquations, factor: float, shared: RowRunner
) -> SharedChange:
    """Gauss-Newton step of the share, as a part of what it is so far: ``factor`` times that by the outlines."""
    unknown = SharedUnknown(lengthened, STEP, OUTLINES_SD / factor, MAX_CHANGE)
    off = torch.full_like(state.ball.radius, (factor - 1) / factor)
    return shared_unknown.measure(unknown, off, state, model, joint, shared)


def lengthened(state: State, change: Tensor) -> State:
    """The state with exposures that are longer by the ``change`` (), a part of them."""
    return replace(state, windows=replace(state.windows, moments=(1 + change) * _moments(state)))


def factor_between(before: State, after: State) -> float:
    """Exposure ``after`` over that ``before``; 1 where the ball rests in all images, which are not smeared."""
    smear = float(_moments(before).norm())
    return float(_moments(after).norm()) / smear if smear else 1.0


def _moments(state: State) -> Tensor:
    assert state.windows.moments is not None
    return state.windows.moments
