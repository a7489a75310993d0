"""Images missing between two frames: there the ball moves and turns a whole number of times as far as elsewhere."""

from __future__ import annotations

import dataclasses

import numpy as np

from torchsphere.errors.evidence import Evidence
from torchsphere.motion.findings import Findings
from torchsphere.motion.track import Track
from torchsphere.runtime.warning_levels import severe

#: Largest relative difference of steps that count as equal (docs/constants.toml).
MAX_DIFFERENCE = 0.1

#: Least length of the neighbouring steps, in standard deviations (docs/constants.toml).
MIN_LENGTH_SD = 20.0

#: Most gaps that a sentence names.
MAX_NAMED_GAPS = 5


def missing_frames(track: Track) -> tuple[tuple[int, int], ...]:
    """Frames before which images seem to be missing, and how many: ((frame, images), ...)."""
    to_px = np.array([1.0, 1.0, *3 * [track.circle.radius]])
    # A gap that the images' own times state is not missing.
    steps = track.increment * to_px / track.durations[:, None]
    sd = np.sqrt(np.diagonal(track.covariance, axis1=1, axis2=2)) * to_px
    gaps = []
    for i in range(1, len(steps) - 1):
        before, step, after = steps[i - 1 : i + 2]
        expected = 0.5 * (before + after)
        length = float(np.linalg.norm(expected))
        # Steps that were not measured are NaN, and comparisons with NaN are false.
        is_measurable = length > MIN_LENGTH_SD * np.linalg.norm(sd[i])
        if not (is_measurable and np.linalg.norm(after - before) < MAX_DIFFERENCE * length):
            continue
        ratio = round(float(step @ expected) / length**2)
        if ratio >= 2 and np.linalg.norm(step / ratio - expected) < MAX_DIFFERENCE * length:
            gaps.append((i + 1, ratio - 1))
    return tuple(gaps)


def detect(track: Track, evidence: Evidence) -> Findings:
    """Where images seem to be missing, and how many."""
    return dataclasses.replace(track.findings, missing_frames=missing_frames(track))


def sentences(track: Track, evidence: Evidence) -> list[str]:
    """Before which frames images seem to be missing."""
    gaps = track.findings.missing_frames
    if not gaps:
        return []
    numbers = ", ".join(f"{count} before frame {track.first_frame + i}" for i, count in gaps[:MAX_NAMED_GAPS])
    return [
        severe(
            "Images seem to be missing, as the ball moves and turns a whole number of times as far in one step as "
            f"in the steps next to it: {numbers}{', ...' if len(gaps) > MAX_NAMED_GAPS else ''}. Times, velocities "
            "and forces are wrong there; measure the parts between with `frames`."
        )
    ]
