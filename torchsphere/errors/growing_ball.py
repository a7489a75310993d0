"""A ball that comes nearer or goes away although no model was given for it."""

from __future__ import annotations

import numpy as np

from torchsphere.errors.evidence import Evidence
from torchsphere.motion.track import Track
from torchsphere.runtime.warning_levels import note


def sentences(track: Track, evidence: Evidence) -> list[str]:
    """How much the image of the ball grows, and how it was measured."""
    known = np.flatnonzero(np.isfinite(track.position[:, 0]))
    if not track.findings.grows or len(known) < 2:
        return []
    first, last = known[0], known[-1]
    percent = 100 * ((track.radius[last] / track.radius[first]) ** (1 / (last - first)) - 1)
    grows, comes = ("grows", "comes nearer") if percent > 0 else ("shrinks", "goes away")
    return [
        note(
            f"The image of the ball {grows} by {abs(percent):.2g} % per frame, as of a ball that {comes}: it was "
            "measured with the model 'pinhole6', from frame to frame, without a map."
        )
    ]
