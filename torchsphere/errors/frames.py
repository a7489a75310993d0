"""Frames that were not measured, and images that repeat the image before them."""

from __future__ import annotations

import numpy as np

from torchsphere.correlation.frame_status import ALL_KNOWN, TRANSLATION_KNOWN
from torchsphere.errors.evidence import Evidence
from torchsphere.motion.track import Track, status_counts


def sentences(track: Track, evidence: Evidence) -> list[str]:
    """How many frames were not measured, and which repeat others."""
    found, n = [], len(track.status)
    # `motion_model` reports that the translation model measures no rotation.
    good = TRANSLATION_KNOWN if track.settings["model"] == "translation" else ALL_KNOWN
    bad = n - int(np.isin(track.status, good).sum())
    if bad:
        counts = ", ".join(f"{count} {name}" for name, count in status_counts(track).items())
        found.append(f"{bad} of {n} frames were not fully measured: {counts}.")
    repeated = track.findings.repeated_frames
    if repeated:
        numbers = ", ".join(str(track.first_frame + i) for i in repeated)
        found.append(
            f"Frames that repeat the image before them bit for bit while the ball moves, not measured: {numbers}."
        )
    return found
