"""The share of the time between frames for which the shutter is open, fitted together with map and poses.

The outline tells this share to 15 %, and the radius is too large where it is too small: an outline that is smeared by
less reaches further.
"""

from __future__ import annotations

from dataclasses import replace

import torch

from torchsphere.runtime.threads import RowRunner
from torchsphere.sphere_map import shared_unknown
from torchsphere.sphere_map.elimination import JointEquations
from torchsphere.sphere_map.forward_model import Linearisation
from torchsphere.sphere_map.shared_unknown import SharedChange
from torchsphere.sphere_map.state import State, drawn

#: Standard deviation of the share as the outlines tell it, and largest change at once, both over the share
#: (docs/constants.toml).
OUTLINES_SD, MAX_CHANGE = 0.2, 0.2

#: Change over which the model's derivative is taken.
STEP = 0.02


def measure(
    state: State, model: Linearisation, joint: JointEquations, factor: float, shared: RowRunner
) -> SharedChange:
    """Gauss-Newton step of the share over that by the outlines, which is ``factor`` so far; all else is left free."""
    longer, shorter = (drawn(lengthened(state, 1 + h), shared).levels(state.ball.coefficients) for h in (STEP, -STEP))
    column = (longer - shorter) / (2 * STEP * factor)
    off = torch.full_like(state.ball.radius, factor - 1)
    found = shared_unknown.measure(state, model, joint, column, off, OUTLINES_SD)
    return replace(found, change=found.change.clamp(-MAX_CHANGE, MAX_CHANGE))


def lengthened(state: State, factor: float) -> State:
    """The state with exposures that are longer by the ``factor``."""
    assert state.windows.moments is not None
    return replace(state, windows=replace(state.windows, moments=factor * state.windows.moments))
