"""Improve a circle found in one image by the first frames of the recording: its radius and its centre.

The limb of a speckled ball blurs the outline's place from image to image, by a few tenths of a px; many images average
that out. Where the ball turns, the correlation itself knows the radius too: with a wrong one the surface's depth is
wrong and leaves a residual. Both are combined by their uncertainties.
"""

from __future__ import annotations

import dataclasses
import math

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from torchsphere import crop, outline
from torchsphere.circle import MIN_SUPPORT, Circle
from torchsphere.correlate import Options, margin, radius_evidence
from torchsphere.follow import Follower
from torchsphere.source import Source

#: Frames used: to follow the ball, and to look at its outline.
FRAMES, OUTLINES = 65, 16

#: What stays of the outline's error however many images are averaged, px: texture at the limb, and the edge's own blur.
SYSTEMATIC_PX = 0.2

#: Pairs taken at once.
BATCH = 16


def calibrate(source: Source, found: Circle, ignore: Tensor | None, options: Options) -> Circle:
    """The circle in the frame in which it was found, with radius and centre from the frames that follow it.

    A plain ball, or one that cannot be followed, keeps its circle.
    """
    stop = min(found.frame + FRAMES, source.count)
    followed = Follower(source, found, ignore, options).run(stop)
    frames = np.flatnonzero(followed.status[:stop] == "ok")
    if len(frames) < 3:
        return found
    radius, sd = found.radius, math.hypot(found.sd_radius, SYSTEMATIC_PX)
    for _ in range(2):
        correction, sd_correction = _radius_correction(source, followed, frames, radius, ignore, options)
        # Two independent values of the radius: the outline's and the correlation's.
        share = sd**2 / (sd**2 + sd_correction**2)
        radius = found.radius + share * (radius + correction - found.radius)
        followed = Follower(source, dataclasses.replace(found, radius=radius), ignore, options).run(stop)
        frames = np.flatnonzero(followed.status[:stop] == "ok")
    sd_radius = math.sqrt(share) * sd_correction
    return _recentred(source, dataclasses.replace(found, radius=radius, sd_radius=sd_radius), followed, frames, ignore)


def _radius_correction(
    source: Source,
    followed: Follower,
    frames: NDArray[np.int64],
    radius: float,
    ignore: Tensor | None,
    options: Options,
) -> tuple[float, float]:
    """Correction of the radius by the residuals of successive frames, and its standard deviation, px."""
    scores, informations = [], []
    second = frames[np.isin(frames - 1, frames)]
    for some in np.array_split(second, max(1, math.ceil(len(second) / BATCH))):
        images = [torch.cat([source.images(int(i), int(i) + 1) for i in some + shift]) for shift in (-1, 0)]
        centres = [torch.from_numpy(followed.position[some + shift]) for shift in (-1, 0)]
        half = crop.half_size(radius, margin(options))
        f, g = (crop.cut(image, centre, half, ignore) for image, centre in zip(images, centres, strict=True))
        increments = torch.from_numpy(followed.increment[some - 1])
        score, information = radius_evidence((f, g), centres[0], radius, increments, options)
        scores.append(score)
        informations.append(information)
    score, information = torch.cat(scores), torch.cat(informations)
    total = float(information.sum())
    if len(score) < 3 or total <= 0:
        return 0.0, math.inf
    correction = float(score.sum()) / total
    # The pairs' own scatter, so that what the model of noise leaves out is in it.
    sd = float((score - information * correction).square().sum().sqrt()) / total
    return correction, sd


def _recentred(
    source: Source, found: Circle, followed: Follower, frames: NDArray[np.int64], ignore: Tensor | None
) -> Circle:
    """The circle with the centre that the outlines of several frames agree on, along the path that was followed."""
    chosen = frames[np.unique(np.linspace(0, len(frames) - 1, OUTLINES).round().astype(int))]
    images = torch.cat([source.images(int(i), int(i) + 1) for i in chosen])
    path = torch.from_numpy(followed.position[chosen])
    guesses = torch.cat((path, torch.full((len(path), 1), found.radius, dtype=torch.float64)), -1)
    fit = outline.refine(images, guesses, ignore=ignore, window=outline.STEP_BLUR_PX, fixed_radius=True)
    good = fit.support >= MIN_SUPPORT
    if int(good.sum()) < 3:
        return found
    offset = (fit.circle[:, :2] - path)[good]
    centre = torch.tensor([found.x, found.y], dtype=torch.float64) + offset.median(0).values
    # The same limb shows in neighbouring frames, so that their number does not count as a number of measurements.
    sd_x, sd_y = (offset.std(0).square() + (SYSTEMATIC_PX / 2) ** 2).sqrt().tolist()
    x, y = centre.tolist()
    return dataclasses.replace(found, x=x, y=y, sd_x=sd_x, sd_y=sd_y)
