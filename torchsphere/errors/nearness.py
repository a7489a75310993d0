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
    if isinstance(found.map, MadeMap):
        sd = found.map.sd_radius_over_distance
    else:
        sd = 0.0 if _is_stated(track) else UNKNOWN_SD
    return dataclasses.replace(found, sd_radius_over_distance=sd)


def sentences(track: Track, evidence: Evidence) -> list[str]:
    """Whether turns are uncertain as the camera's distance is not known, or not the one that was stated."""
    turns = track.covariance[:, [2, 3], [2, 3]]
    if not np.isfinite(turns).any():
        return []
    sd = track.findings.sd_radius_over_distance
    apparent = float(np.degrees(steady_error.sd_of_apparent_turn(track.increment, track.circle.radius, sd).max()))
    if apparent < np.degrees(np.sqrt(np.nanmedian(turns))):
        return []
    nearness = track.findings.radius_over_distance
    effect = (
        "a near ball is seen from another side as it moves sideways, and shows its front larger: all turns may be off "
        f"by the same {apparent:.2g} deg per frame, which their standard deviations include"
    )
    if _is_stated(track):
        stated = f"at the stated {1 / nearness:.0f} radii" if nearness else "infinitely far away, as was stated"
        return [f"The images show a camera that is nearer than {stated}, and {effect}; check what was given."]
    known = f"was found from the images alone ({1 / nearness:.0f} radii)" if nearness else "is not known"
    return [
        f"The camera's distance {known}, and {effect}; give `distance_mm` with `diameter_mm`, or `focal_px`, or "
        "`telecentric` for such a lens."
    ]


def _is_stated(track: Track) -> bool:
    """Whether somebody stated the camera's distance."""
    settings = track.settings
    return settings["telecentric"] or (settings["camera"] is not None and not track.findings.camera_assumed)
