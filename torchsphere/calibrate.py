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
from torchsphere.correlate import GRADIENT_FROM_DEG
from torchsphere.follow import Follower
from torchsphere.joint import ALONE, Solver
from torchsphere.options import Options, margin
from torchsphere.radius import radius_evidence
from torchsphere.source import Source

#: Frames used: to follow the ball, and to look at its outline.
FRAMES, OUTLINES = 65, 16

#: What stays of the outline's error however many images are averaged, px, where the step from background to limb is
#: twice the pattern's standard deviation; it goes with the ratio's inverse square. Measured: 0.05 px low at a
#: ratio of 1.8 (dark and bright backgrounds), 0.3 to 0.5 px low at 0.9, where faint limbs are missed.
SYSTEMATIC_PX, FULL_CONTRAST = 0.15, 2.0

#: Bias of the interpolation, px, that the residuals cannot tell from a radius: measured as 0.1 px of radius at 0.01 rad
#: per frame, and inversely as the rotation.
SYSTEMATIC_RESIDUAL_PX = 0.001

#: Pre-blur with which the radius is estimated, px. Blur in the image is no blur on the sphere and makes the ball look
#: larger: by 0.06 px of 50 at 0.9 px; at 0.7 px nothing is seen.
PRE_BLUR_PX = 0.7

#: Largest change of the outline's radius that the correlation may make, as a share of it.
MAX_CHANGE = 0.03

#: Change of the radius, as a share of it, from which the frames are followed anew: the increments adapt to a smaller
#: one to first order. At 0.5 deg per frame it moves x by 0.026 px per px of radius, 0.04 px after 65 frames at R = 50.
FOLLOWED_ANEW = 5e-4

#: Fewer pairs tell no scatter.
FEWEST_PAIRS = 3

#: Pairs taken at once.
BATCH = 16


def calibrate(source: Source, found: Circle, ignore: Tensor | None, options: Options, solver: Solver = ALONE) -> Circle:
    """The circle in the frame in which it was found, with radius and centre from the frames that follow it.

    A plain ball, or one that cannot be followed, keeps its circle.
    """
    options = dataclasses.replace(options, pre_blur=min(options.pre_blur, PRE_BLUR_PX))
    if options.camera is None:
        # The radius is the ball's, whatever model measures its motion afterwards; the linearised one was measured to
        # give it within 0.15 px at up to 5 deg per frame, where the exact one's evidence runs away.
        options = dataclasses.replace(options, model="rigid", finite_from_deg=GRADIENT_FROM_DEG)
    stop = min(found.frame + FRAMES, source.count)
    followed = Follower(source, found, ignore, options, solver=solver).run(stop)
    frames = np.flatnonzero(followed.status[:stop] == "ok")
    if len(frames) < 3:
        return found
    fit = _outlines(source, followed, frames, found, ignore, fixed_radius=False)
    by_outline = float((fit.circle[:, 2] / _relative_size(followed, found, _spread(frames))).nanmedian())
    known = by_outline if math.isfinite(by_outline) else found.radius
    contrast = float(fit.contrast.median()) / _pattern_sd(source, found)
    # A faint edge says little, but the ball was found: it is no other size than that by more than may be corrected.
    systematic = min(SYSTEMATIC_PX * max(FULL_CONTRAST / max(contrast, 1e-3), 0.5) ** 2, MAX_CHANGE * known)
    radius, sd = known, math.hypot(found.sd_radius, systematic)
    for _ in range(2):
        tried = dataclasses.replace(found, radius=radius)
        correction, sd_correction = _radius_correction(source, followed, frames, tried, ignore, options)
        # Two independent values of the radius: the outline's and the correlation's.
        share = sd**2 / (sd**2 + sd_correction**2)
        by_both = known + share * (radius + correction - known)
        if abs(by_both - known) > MAX_CHANGE * known:
            # Not the radius then, but something else that leaves a residual.
            radius, sd_correction = known, math.inf
            break
        radius = by_both
        if abs(radius - followed.radius) > FOLLOWED_ANEW * radius:
            followed = Follower(source, dataclasses.replace(found, radius=radius), ignore, options, solver=solver).run(
                stop
            )
            frames = np.flatnonzero(followed.status[:stop] == "ok")
    better = dataclasses.replace(found, radius=radius, sd_radius=1 / math.hypot(1 / sd, 1 / sd_correction))
    return _recentred(source, better, followed, frames, ignore)


def _pattern_sd(source: Source, circle: Circle) -> float:
    """Standard deviation of the grey levels within the circle, at least 1e-3."""
    image = source.images(circle.frame, circle.frame + 1)[0]
    rows, columns = (torch.arange(size, device=image.device) for size in image.shape)
    inside = (rows[:, None] - circle.y) ** 2 + (columns - circle.x) ** 2 < (0.9 * circle.radius) ** 2
    return max(float(image[inside].std()), 1e-3)


def _outlines(
    source: Source,
    followed: Follower,
    frames: NDArray[np.int64],
    found: Circle,
    ignore: Tensor | None,
    *,
    fixed_radius: bool,
) -> outline.OutlineFit:
    """Outlines of frames spread over those that were followed."""
    chosen = _spread(frames)
    images = torch.cat([source.images(int(i), int(i) + 1) for i in chosen])
    guesses = _balls(followed, found, chosen)
    return outline.refine(
        images,
        guesses,
        ignore=ignore,
        window=outline.STEP_BLUR_PX,
        fixed_radius=fixed_radius,
        camera=followed.options.camera,
    )


def _relative_size(followed: Follower, found: Circle, frames: NDArray[np.int64]) -> Tensor:
    """The ball's size in the given frames against that in the frame in which it was found: 1 unless it comes nearer."""
    return torch.from_numpy(followed.size[frames] / followed.size[found.frame])


def _balls(followed: Follower, circle: Circle, frames: NDArray[np.int64]) -> Tensor:
    """The ball (m, 3) in the given frames, where it was followed to, with the radius of ``circle`` in its frame."""
    radii = circle.radius * _relative_size(followed, circle, frames)
    return torch.cat((torch.from_numpy(followed.position[frames]), radii[:, None]), -1)


def _spread(frames: NDArray[np.int64]) -> NDArray[np.int64]:
    return frames[np.unique(np.linspace(0, len(frames) - 1, OUTLINES).round().astype(int))]


def _radius_correction(
    source: Source,
    followed: Follower,
    frames: NDArray[np.int64],
    tried: Circle,
    ignore: Tensor | None,
    options: Options,
) -> tuple[float, float]:
    """Correction of the radius that is ``tried`` by the residuals of successive frames, and its standard deviation, px.

    The increments were found with another radius, perhaps; they adapt. Pairs that a target takes light from are left
    out: it leaves more than a wrong radius does. With them, radii of 40 and 50 px in sixteen rendered impacts were off
    by 0.64 and 0.82 px, root mean square, and low; without by 0.48 and 0.44.
    """
    scores, informations = [], []
    alone = frames[~followed.uneven_light[frames]]
    # Beside pairs that show the light others have some of it: both frames must be without.
    second = alone[np.isin(alone - 1, alone)]
    if len(second) < FEWEST_PAIRS:
        return 0.0, math.inf
    for some in np.array_split(second, max(1, math.ceil(len(second) / BATCH))):
        images = [torch.cat([source.images(int(i), int(i) + 1) for i in some + shift]) for shift in (-1, 0)]
        circles = [_balls(followed, tried, some + shift) for shift in (-1, 0)]
        half = crop.half_size(max(float(circle[:, 2].max()) for circle in circles), margin(options))
        f, g = (crop.cut(image, circle[:, :2], half, ignore) for image, circle in zip(images, circles, strict=True))
        increments = torch.from_numpy(followed.increment[some - 1])
        score, information = radius_evidence((f, g), circles[0], increments, options)
        scores.append(score)
        informations.append(information)
    score, information = torch.cat(scores), torch.cat(informations)
    total = float(information.sum())
    if total <= 0:
        return 0.0, math.inf
    correction = float(score.sum()) / total
    # The pairs' own scatter, so that what the model of noise leaves out is in it; and what all pairs have in common.
    scatter = float((score - information * correction).square().sum().sqrt()) / total
    turn = np.sqrt(np.mean(np.sum(followed.increment[second - 1, 2:4] ** 2, axis=1)))
    return correction, math.hypot(scatter, SYSTEMATIC_RESIDUAL_PX / max(float(turn), 1e-6))


def _recentred(
    source: Source, found: Circle, followed: Follower, frames: NDArray[np.int64], ignore: Tensor | None
) -> Circle:
    """The circle with the centre that the outlines of several frames agree on, along the path that was followed."""
    fit = _outlines(source, followed, frames, found, ignore, fixed_radius=True)
    path = torch.from_numpy(followed.position[_spread(frames)])
    good = fit.support >= MIN_SUPPORT
    if int(good.sum()) < 3:
        return found
    offset = (fit.circle[:, :2] - path)[good]
    centre = torch.tensor([found.x, found.y], dtype=torch.float64) + offset.median(0).values
    # The same limb shows in neighbouring frames, so that their number does not count as a number of measurements.
    sd_x, sd_y = (offset.std(0).square() + (SYSTEMATIC_PX / 2) ** 2).sqrt().tolist()
    x, y = centre.tolist()
    return dataclasses.replace(found, x=x, y=y, sd_x=sd_x, sd_y=sd_y)
