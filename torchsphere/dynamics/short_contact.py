"""A contact of too few frames: its edges are known to about half a frame, its force is not known."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from torchsphere.dynamics.impact_estimate import Estimate, Impact

Array = NDArray[np.float64]

#: Frames that a contact has to last for its course to be seen. Of half-sines of force of 2.5 frames and more, peak and
#: duration were right to 1.5 standard deviations rms; of 2 frames the peak was 9 % too low and scattered by 6 %, where
#: 3 % were stated, of one frame 27 and 23 % (10 shots each, noise of 1.5 um).
SHORT = 2.5

#: Standard deviation of an edge of such a contact, frames: durations of half-sines of 0.5 to 2 frames were off by 0.3
#: to 0.9 rms, of which either edge has its share.
EDGE = 0.5


def frames_of(found: Impact, time_s: Array) -> float:
    """Frames that the contact lasts."""
    return float(found.duration.value) / float(np.diff(time_s).min())


def as_far_as_seen(found: Impact, time_s: Array) -> Impact:
    """The impact, without the force of a contact that is too short to show it; ``time_s`` (n,) are the frames' times.

    Impulse, speeds and spin follow from the flights before and after.
    """
    if frames_of(found, time_s) >= SHORT:
        return found
    edge = EDGE * float(np.diff(time_s).min())
    return replace(
        found,
        contact_start=_widened(found.contact_start, edge),
        contact_end=_widened(found.contact_end, edge),
        duration=_widened(found.duration, edge * np.sqrt(2)),
        peak_force=_unknown(found.peak_force),
        mean_force=_unknown(found.mean_force),
        peak_time=found.peak_time and _widened(found.peak_time, edge),
    )


def _widened(estimate: Estimate, sd: float) -> Estimate:
    return replace(estimate, sd=np.hypot(estimate.sd, sd))


def _unknown(estimate: Estimate | None) -> Estimate | None:
    return estimate and replace(estimate, value=np.asarray(np.nan), sd=np.asarray(np.nan))
