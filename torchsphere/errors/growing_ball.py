"""A ball that comes nearer or goes away although no model was given for it."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from torchsphere.errors.evidence import Evidence
from torchsphere.motion.track import Track
from torchsphere.runtime.warning_levels import note


def sentences(track: Track, evidence: Evidence) -> list[str]:
    """How much the image of the ball grows, what this does to the lengths, and how it was measured."""
    known = np.flatnonzero(np.isfinite(track.radius) & np.isfinite(track.position[:, 0]))
    if not track.findings.grows or len(known) < 2:
        return []
    course = " and ".join(_said(track, *part) for part in _flights(np.log(track.radius[known]), known))
    if track.findings.camera_assumed:
        lengths = (
            "lengths are those at its size in each image, with the optical axis in the middle of the image; for the "
            "motion along this axis give `focal_px`, or `distance_mm` with `diameter_mm`"
        )
    else:
        lengths = "its motion along the optical axis is measured, too"
    by_pairs = "" if track.findings.is_on_map else " It was measured from frame to frame, without a map."
    return [note(f"The image of the ball {course}: {lengths}.{by_pairs}")]


def _flights(size: NDArray[np.float64], known: NDArray[np.int64]) -> list[tuple[int, int]]:
    """First and last frames of the parts in which the image grows, or shrinks: two where an impact turns it."""
    first, last = int(known[0]), int(known[-1])
    chord = size[0] + (size[-1] - size[0]) * (known - first) / (last - first)
    turn = int(np.abs(size - chord).argmax())
    if (size[turn] - size[0]) * (size[-1] - size[turn]) >= 0:
        return [(first, last)]
    return [(first, int(known[turn])), (int(known[turn]), last)]


def _said(track: Track, first: int, last: int) -> str:
    percent = 100 * ((track.radius[last] / track.radius[first]) ** (1 / (last - first)) - 1)
    grows, comes = ("grows", "comes nearer") if percent > 0 else ("shrinks", "goes away")
    return f"{grows} by {abs(percent):.2g} % per frame, as of a ball that {comes}"
