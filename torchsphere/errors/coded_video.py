"""Video after strong compression, as by H.264 or MPEG-4: images are drawn from pieces of the images before.

No camera's noise gives a piece of an image the same grey levels twice. A codec does, and leaves the ball's trail behind
it so. It moves pieces of the ball likewise, by quarters of a px, and mends only what is seen to be wrong.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from torchsphere.errors.background_blocks import MIN_BLOCKS
from torchsphere.errors.evidence import Evidence
from torchsphere.motion.findings import Findings
from torchsphere.motion.track import Track
from torchsphere.recording.level_scale import SAME, alike
from torchsphere.runtime.arrays import Array

#: Share of the background's blocks with a texture that are copies, from which the video is a codec's
#: (docs/constants.toml).
MIN_COPIES = 0.03

#: Error of the steps on a map of such images over the stated one, and size of a codec's steps, px
#: (docs/constants.toml).
WIDENING, VECTOR_PX = 2.0, 0.25


def is_coded(looks: Sequence[Tensor]) -> bool:
    """Whether parts of the background, `background_blocks`, are copied from image to image."""
    copies, total = 0, 0
    for first, following, _ in looks:
        is_textured = first.var(1) > SAME**2 if len(first) else torch.zeros(0, dtype=torch.bool)
        is_copy = alike(following, first).all(1)
        if not bool(is_copy.all()):
            # An image that is shown twice is no sign of a codec.
            copies, total = copies + int((is_copy & is_textured).sum()), total + int(is_textured.sum())
    return copies >= MIN_BLOCKS and copies > MIN_COPIES * total


def widened(covariance: Array, on_map: NDArray[np.bool_], radius: float) -> Array:
    """The ``covariance`` (n - 1, 5, 5) with a codec's errors; ``on_map`` (n,) is True for frames on a map of the ball.

    Steps between two images keep the error of a codec's step on the ball's front.
    """
    both = (on_map[:-1] & on_map[1:])[:, None, None]
    of_step = np.square(VECTOR_PX / np.array([1, 1, radius, radius, radius])) / 12
    return WIDENING**2 * covariance + np.where(both, 0.0, np.diag(of_step))


def detect(track: Track, evidence: Evidence) -> Findings:
    """Whether a codec draws the ball from parts of the images before."""
    return dataclasses.replace(track.findings, coded=is_coded(evidence.blocks))


def widen(track: Track, evidence: Evidence) -> Track:
    """The steps with a codec's errors."""
    if not track.findings.coded:
        return track
    return dataclasses.replace(track, covariance=widened(track.covariance, evidence.on_map, track.circle.radius))


def sentences(track: Track, evidence: Evidence) -> list[str]:
    """That the video was compressed."""
    if not track.findings.coded:
        return []
    return [
        "Parts of the still background are the same to the last grey level from image to image, as after strong "
        "compression (H.264, MPEG-4), which draws the ball from parts of the images before, too. The standard "
        "deviations include this. Save recordings as the camera's own raw file, or without loss."
    ]
