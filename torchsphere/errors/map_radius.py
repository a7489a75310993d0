"""The radius of a map of the ball where its outline shows another one, or does not tell it."""

from __future__ import annotations

import dataclasses
import math

from torchsphere.errors.evidence import Evidence
from torchsphere.motion.track import Track
from torchsphere.runtime.warning_levels import severe
from torchsphere.sphere_map.decision import MadeMap

#: Error of the map's radius by the outline, as a share of the radius, from which a sentence names it.
MAX_OFF_OUTLINE = 0.005


def without(track: Track, evidence: Evidence) -> Track:
    """The track without the error of its radius by what the outline tells: the adjustment of the map holds it."""
    made = track.findings.map
    if not isinstance(made, MadeMap):
        return track
    variance = track.circle.sd_radius**2 - made.radius_off_outline_px**2
    return dataclasses.replace(track, circle=dataclasses.replace(track.circle, sd_radius=math.sqrt(max(variance, 0.0))))


def sentences(track: Track, evidence: Evidence) -> list[str]:
    """Whether the radius contradicts the outline."""
    made, radius, sd = track.findings.map, track.circle.radius, track.circle.sd_radius
    if not isinstance(made, MadeMap) or made.radius_off_outline_px <= MAX_OFF_OUTLINE * radius:
        return []
    return [
        severe(
            f"The radius on the map of the ball, {radius:.2f} px, may be {sd:.2g} px off: its outline shows "
            "another one, or does not tell it, and the ball hardly turns. Scale, speeds and rotations may be "
            f"wrong by {100 * sd / radius:.2g} %, which their errors include. Look at the circle in the preview, "
            "and give it with `circle`."
        )
    ]
