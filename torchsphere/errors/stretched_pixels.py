"""Images that were drawn anew from pixels that are not square."""

from __future__ import annotations

import dataclasses

from torchsphere.errors import steady_error
from torchsphere.errors.evidence import Evidence
from torchsphere.motion.findings import Findings
from torchsphere.motion.track import Track

widen = steady_error.widen


def detect(track: Track, evidence: Evidence) -> Findings:
    """The ratio of the sides of the pixels that the images were drawn from."""
    return dataclasses.replace(track.findings, stretch=evidence.source.stretch)
