"""The share of the time between frames for which the shutter is open, an unknown beside map and poses.

The outline tells this share to 15 %, and the radius is too large where it is too small: an outline that is smeared by
less reaches further.
"""

from __future__ import annotations

import math
from dataclasses import replace

import torch
from torch import Tensor

from torchsphere.sphere_map.shared_unknown import SharedUnknown
from torchsphere.sphere_map.state import State
from torchsphere.sphere_map.window import Windows

#: Standard deviation of the logarithm of the share as the outlines tell it, and its largest change at once
#: (docs/constants.toml).
OUTLINES_SD, MAX_CHANGE = 0.2, 0.2

#: Change of the share's logarithm below which it has settled (docs/constants.toml).
LAST_CHANGE = 0.0005

#: Change over which the model's derivative is taken.
STEP = 0.02


def unknown_from(start: Windows) -> SharedUnknown | None:
    """The logarithm of the share over that of the ``start``; None where no image is smeared."""
    if not _smear(start.moments):
        return None

    def value(state: State) -> Tensor:
        return torch.full_like(state.ball.radius, math.log(factor_between(start.moments, state.windows.moments)))

    return SharedUnknown(value, _lengthened, STEP, OUTLINES_SD, MAX_CHANGE, LAST_CHANGE)


def factor_between(before: Tensor | None, after: Tensor | None) -> float:
    """Exposure with the `Windows.moments` ``after`` over that ``before``; 1 where the ball rests in all images."""
    smear = _smear(before)
    return _smear(after) / smear if smear else 1.0


def _lengthened(state: State, change: Tensor) -> State:
    windows = state.windows
    assert windows.moments is not None
    return replace(state, windows=replace(windows, moments=change.exp() * windows.moments))


def _smear(moments: Tensor | None) -> float:
    return 0.0 if moments is None else float(moments.norm())
