"""A ball that something in front hides in many of the frames: what was measured beside these frames is less certain.

The frames in which the object was recognised are flagged. In those beside them it may still cover a part of the ball's
edge: they pass the same tests, some by chance.
"""

from __future__ import annotations

import dataclasses

import numpy as np
from numpy.typing import NDArray

from torchsphere.correlation.frame_status import OUT_OF_FRAME, TRANSLATION_KNOWN
from torchsphere.errors.evidence import Evidence
from torchsphere.motion.findings import Findings
from torchsphere.motion.track import Track
from torchsphere.runtime.arrays import Array

#: Share of unmeasured frames, of those with the whole ball in view, from which the others count as beside an object
#: in front of the ball (docs/constants.toml).
MOST_UNMEASURED = 0.3

#: Error of the measured frames of such a recording, and of its circle, over the stated one (docs/constants.toml).
WIDENING = 2.0

#: Steps that tell where the ball came from.
FIRST_STEPS = 5


def is_hidden_often(
    status: NDArray[np.str_], position: Array, increment: Array, radius: float, shape: tuple[int, int]
) -> bool:
    """Whether many frames (n,) of this ``status`` were not measured although the image (h, w) holds the whole ball.

    Before the first known ``position`` (n, 2), px, the ball came from where its first steps in ``increment`` (n - 1, 5)
    point to. Its radius is that in the image, px.
    """
    known = np.flatnonzero(np.isfinite(position[:, 0]))
    steps = increment[known[0] :, :2] if len(known) else np.empty((0, 2))
    steps = steps[np.isfinite(steps[:, 0])][:FIRST_STEPS]
    if not len(steps):
        return False
    first, step = known[0], np.median(steps, axis=0)
    before = position[first] - step * (first - np.arange(first))[:, None]
    size = np.array(shape[::-1]) - 1
    came_in_view = ((before >= radius) & (before <= size - radius)).all(1)
    in_view = np.concatenate((came_in_view, np.ones(len(status) - first, dtype=bool))) & (status != OUT_OF_FRAME)
    unmeasured = ~np.isin(status, TRANSLATION_KNOWN)
    return bool(unmeasured[in_view].mean() > MOST_UNMEASURED)


def detect(track: Track, evidence: Evidence) -> Findings:
    """Whether something stands in front of the ball in many frames."""
    height, width = evidence.image.shape[-2:]
    hidden = is_hidden_often(track.status, track.position, track.increment, track.circle.radius, (height, width))
    return dataclasses.replace(track.findings, hidden=hidden)


def widen(track: Track, evidence: Evidence) -> Track:
    """The measured frames of such a recording, and its circle."""
    if not track.findings.hidden:
        return track
    return dataclasses.replace(
        track, covariance=WIDENING**2 * track.covariance, circle=track.circle.with_errors(WIDENING)
    )


def sentences(track: Track, evidence: Evidence) -> list[str]:
    """That something stands in front of the ball."""
    if not track.findings.hidden:
        return []
    return [
        "In many frames with the whole ball in view it could not be measured, as where something stands in front "
        "of it: the standard deviations of the other frames are twice those of their noise. Look at the overlay."
    ]
