"""Interlaced video: odd rows show the ball at another instant."""

from __future__ import annotations

from torchsphere.errors.evidence import Evidence
from torchsphere.motion.track import Track
from torchsphere.runtime.warning_levels import note


def sentences(track: Track, evidence: Evidence) -> list[str]:
    """Which rows were used."""
    if not track.findings.interlaced:
        return []
    return [
        note(
            "The video is interlaced: odd rows show the ball at another instant. The even rows alone were used; "
            "all times are theirs."
        )
    ]
