"""Change of a velocity over a recording: scatter, a steady change, or a sudden one."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

#: Least change of the velocity over the recording that is no scatter, in standard deviations (docs/constants.md).
MIN_CHANGE_SD = 5.0

#: Least sudden change that no free flight has, as a share of the speed (docs/constants.md).
NO_FREE_FLIGHT = 0.1

#: Deviation from a straight line over time of a sudden change, as a share of the change (docs/constants.md).
SUDDEN = 0.1

Array = NDArray[np.float64]


class Change(NamedTuple):
    """Change of a velocity: in words, as a share of the speed, and whether it is sudden."""

    text: str
    share: float
    is_sudden: bool


def velocity_change(velocity_m_s: Array) -> Change | None:
    """The change of the velocity (m, 2) over the recording; None if it only scatters."""
    valid = np.isfinite(velocity_m_s).all(1)
    known = velocity_m_s[valid]
    third = len(known) // 3
    start, end = known[:third].mean(0), known[-third:].mean(0)
    change = end - start
    # Scatter from one increment to the next, which a slow change does not enter.
    scatter = np.diff(known, axis=0).std(0) / math.sqrt(third)
    excess = np.abs(change) - MIN_CHANGE_SD * scatter
    axis = int(excess.argmax())
    if excess[axis] <= 0:
        return None
    size, speed = abs(float(change[axis])), max(float(np.hypot(*start)), float(np.hypot(*end)))
    is_sudden = _nonlinearity(np.flatnonzero(valid), known[:, axis]) > SUDDEN * size
    return Change(f"along {'xy'[axis]} changes by {change[axis]:.3g} m/s", size / speed, is_sudden)


def _nonlinearity(frames: NDArray[np.int64], values: Array) -> float:
    """Deviation of values (m,) from a straight line over their frames (m,), rms, without their scatter."""
    residual = values - np.polyval(np.polyfit(frames, values, 1), frames)
    return math.sqrt(max(float(residual.var()) - float(np.diff(values).var()) / 2, 0.0))
