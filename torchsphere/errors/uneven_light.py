"""Light that an object near the ball changes unevenly, as a target does in a contact."""

from __future__ import annotations

import dataclasses

from torchsphere.errors import steady_error
from torchsphere.errors.evidence import Evidence
from torchsphere.motion.findings import Findings
from torchsphere.motion.track import Track

widen = steady_error.widen


def detect(track: Track, evidence: Evidence) -> Findings:
    """The share of the steps with such light."""
    return dataclasses.replace(track.findings, uneven_light=evidence.uneven_light)
