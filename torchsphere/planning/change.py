"""How a velocity changes over a recording: what scatters, drifts or jumps."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

#: Change of the velocity over the recording, in standard deviations of what scatter alone would give, that is no
#: scatter any more.
STEADY = 5.0

#: The same as a share of the speed, from which the standard deviations say nothing at all, if it comes at once; and the
#: share of the change by which the velocity then departs from a straight line over time: 0.14 and more for a jump in 12
#: steps or more, 0.08 for drag that takes half of the speed, none for gravity.
NO_FLIGHT, SUDDEN = 0.1, 0.1

Array = NDArray[np.float64]


class Change(NamedTuple):
    """How a velocity changes: in words, by what share of the speed, and whether at once rather than steadily."""

    text: str
    share: float
    is_sudden: bool


def change_of(velocity_m_s: Array) -> Change | None:
    """How the velocity (m, 2) changes over the recording; None where it only scatters."""
    valid = np.isfinite(velocity_m_s).all(1)
    known = velocity_m_s[valid]
    third = len(known) // 3
    start, end = known[:third].mean(0), known[-third:].mean(0)
    change = end - start
    # Scatter from one increment to the next, which a slow change does not enter.
    scatter = np.diff(known, axis=0).std(0) / math.sqrt(third)
    beyond = np.abs(change) - STEADY * scatter
    at = int(beyond.argmax())
    if beyond[at] <= 0:
        return None
    size, speed = abs(float(change[at])), max(float(np.hypot(*start)), float(np.hypot(*end)))
    is_sudden = _off_line(np.flatnonzero(valid), known[:, at]) > SUDDEN * size
    return Change(f"along {'xy'[at]} changes by {change[at]:.3g} m/s", size / speed, is_sudden)


def _off_line(frames: NDArray[np.int64], values: Array) -> float:
    """How far values (m,) are off a straight line over their frames (m,), rms, beside their scatter."""
    rest = values - np.polyval(np.polyfit(frames, values, 1), frames)
    return math.sqrt(max(float(rest.var()) - float(np.diff(values).var()) / 2, 0.0))
