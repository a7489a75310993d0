"""Images that hold a part of the images beside them: averaged or blended video.

The noise of the still background shows it: what a camera sees anew in each image differs as much from the image before
as from one much earlier.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Sequence

import numpy as np
import torch
from torch import Tensor

from torchsphere.errors.background_blocks import MIN_BLOCKS
from torchsphere.errors.evidence import Evidence
from torchsphere.geometry.circle import Circle
from torchsphere.motion.findings import Findings
from torchsphere.motion.track import Track
from torchsphere.recording.level_scale import SAME
from torchsphere.runtime.arrays import Array

#: Smallest memory that is more than chance (docs/constants.toml).
MIN_MEMORY = 0.15

#: Variance of the texture over that of the noise from which it shows a gain (docs/constants.toml).
SHOWN = 4.0

#: Largest lag of the ball behind the images, frames: half of an image is another one (docs/constants.toml).
MAX_LAG = 1.0

#: Error of the steps of such images over the stated one: the ball is drawn twice in them (docs/constants.toml).
WIDENING = 1.5


def noise_memory(looks: Sequence[Tensor]) -> float:
    """Share of the noise of `background_blocks` that each image has in common with the one before, 0 to 1.

    0 where it is unknown.
    """
    if sum(blocks.shape[1] for blocks in looks) < MIN_BLOCKS:
        return 0.0
    near = torch.cat([_changes(*blocks) for blocks in looks]).var(1)
    far = torch.cat([_changes(*blocks[[0, 2, 1]]) for blocks in looks]).var(1)
    if float(far.median()) < SAME**2:
        return 0.0
    memory = 1 - float(near.median() / far.median())
    return memory if memory > MIN_MEMORY else 0.0


def _changes(first: Tensor, later: Tensor, other: Tensor) -> Tensor:
    """Changes (k, p) of the grey levels of blocks, but for their means, without those by a flicker of the light.

    Its gain is told by what both images have in common with an ``other`` one, which is no noise, where that is enough.
    """
    first, later, other = (blocks - blocks.mean(1, keepdim=True) for blocks in (first, later, other))
    change, texture = later - first, (first * other).mean()
    if texture < SHOWN * change.square().mean() / 2:
        return change
    return later - (later * other).mean() / texture * first


def lag_of(memory: float) -> float:
    """Frames by which the ball in the images is behind, or before, that of the camera: `MAX_LAG` at most.

    A filter that keeps the share m of the image before, m of that before it, and so on, lags by m / (1 - m).
    """
    return min(memory / (1 - memory), MAX_LAG) if memory < 1 else MAX_LAG


def widened(increment: Array, covariance: Array, memory: float) -> Array:
    """The ``covariance`` (n - 1, 5, 5) with the error of a lag: a lag of a steady motion shows in its changes.

    Before the first and after the last step of ``increment`` (n - 1, 5) the images hold no motion.
    """
    steps = np.pad(np.nan_to_num(increment), ((1, 1), (0, 0)))
    changes = np.abs(np.diff(steps, axis=0))
    error = lag_of(memory) * np.maximum(changes[:-1], changes[1:])
    return WIDENING**2 * covariance + np.einsum("ni,ij->nij", np.square(error), np.eye(5))


def less_certain(circle: Circle, increment: Array, memory: float) -> Circle:
    """The ``circle`` with the error of two outlines, a step of ``increment`` (n - 1, 5) apart, in each image.

    Blended video, radii of 29 to 37 px: up to 0.2 steps too large, on a map and by the outline.
    """
    apart = np.hypot(*increment[:, :2].T)
    apart = apart[np.isfinite(apart)]
    error_px = memory * (1 - memory) * float(apart.mean()) if len(apart) else 0.0
    return dataclasses.replace(circle, sd_radius=math.hypot(circle.sd_radius, error_px))


def detect(track: Track, evidence: Evidence) -> Findings:
    """The share of an image that is the image beside it; a codec's copies have the noise of the images before, too."""
    memory = 0.0 if track.findings.coded else noise_memory(evidence.blocks)
    return dataclasses.replace(track.findings, noise_memory=memory)


def widen(track: Track, evidence: Evidence) -> Track:
    """The steps with the error of a lag, and the outline with that of two outlines in each image."""
    memory = track.findings.noise_memory
    if not memory:
        return track
    return dataclasses.replace(
        track,
        covariance=widened(track.increment, track.covariance, memory),
        circle=less_certain(track.circle, track.increment, memory),
    )


def sentences(track: Track, evidence: Evidence) -> list[str]:
    """How much of an image is the image beside it."""
    memory = track.findings.noise_memory
    if not memory:
        return []
    return [
        f"Each image holds {100 * memory:.0f} % of the image beside it, by its noise, as after temporal noise "
        "reduction or a change of the frame rate: the ball is seen late or early by up to "
        f"{lag_of(memory):.1g} frames, and changes of its motion are smoothed. The standard deviations of the "
        "steps include this; the positions have this shift in time. Switch such processing off in camera and "
        "software."
    ]
