"""A camera whose distance is not known: a near ball is seen from the side, and its front is larger than its outline."""

from __future__ import annotations

import dataclasses

import numpy as np

from torchsphere.errors import steady_error
from torchsphere.errors.evidence import Evidence
from torchsphere.motion.findings import Findings
from torchsphere.motion.track import Track
from torchsphere.sphere_map.decision import MadeMap
from torchsphere.sphere_map.nearness import UNKNOWN_SD

widen = steady_error.widen


def detect(track: Track, evidence: Evidence) -> Findings:
    """The standard deviation of the ball's radius over the camera's distance."""
    found = track.findings
    if track.settings["telecentric"] or (evidence.options.camera is not None and not found.camera_assumed):
        sd = 0.0
    else:
        sd = found.map.sd_radius_over_distance if isinstance(found.map, MadeMap) else UNKNOWN_SD
    return dataclasses.replace(found, sd_radius_over_distance=sd)


def sentences(track: Track, evidence: Evidence) -> list[str]:
    """Whether turns are uncertain as the camera's distance is not known."""
    settings, turns = track.settings, track.covariance[:, [2, 3], [2, 3]]
    is_known = settings["camera"] is not None and not track.findings.camera_assumed
    if settings["telecentric"] or is_known or not np.isfinite(turns).any():
        return []
    sd = track.findings.sd_radius_over_distance
    apparent = float(np.degrees(steady_error.sd_of_apparent_turn(track.increment, track.circle.radius, sd).max()))
    if apparent < np.degrees(np.sqrt(np.nanmedian(turns))):
        return []
    nearness = track.findings.radius_over_distance
    known = f"was found from the images alone ({1 / nearness:.0f} radii)" if nearness else "is not known"
    return [
        f"The camera's distance {known}, and a near ball is seen from another side as it moves sideways, and shows "
        f"its front larger: all turns may be off by the same {apparent:.2g} deg per frame, which their standard "
        "deviations include; give `distance_mm` with `diameter_mm`, or `focal_px`, or `telecentric` for such a lens."
    ]
