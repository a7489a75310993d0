"""Light that differs over the ball from image to image: by an object near it, or by its place in the image."""

from __future__ import annotations

import dataclasses

from torchsphere.errors import steady_error
from torchsphere.errors.evidence import Evidence
from torchsphere.motion.findings import Findings
from torchsphere.motion.track import Track
from torchsphere.sphere_map.decision import MadeMap

widen = steady_error.widen


def detect(track: Track, evidence: Evidence) -> Findings:
    """The share of the steps with such light."""
    return dataclasses.replace(track.findings, uneven_light=evidence.uneven_light)


def sentences(track: Track, evidence: Evidence) -> list[str]:
    """Whether the ball is darker towards the image's corners."""
    made = track.findings.map
    if not isinstance(made, MadeMap) or not made.falloff:
        return []
    return [
        f"The ball is darker away from the image's middle, in the corner by {100 * made.falloff:.0f} % or more: the "
        "lens vignettes, or a lamp lights a part of the view. Accelerations may be wrong by several of their standard "
        "deviations; divide the images by one of an even surface before they are measured."
    ]
