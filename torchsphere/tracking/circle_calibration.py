"""Improve a found circle, its radius and its centre, by the first frames of the recording.

The ball's path tells the still background from the ball, and so its limb better than one image does. Where the ball
turns, the correlation tells the radius too: a wrong radius means a wrong depth of the surface, which leaves a residual.
Both values are combined by their uncertainties. Later frames tell the radius alone, where no target takes the limb's
light: the path drifts from the centre.
"""

from __future__ import annotations

import dataclasses
import math

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from torchsphere.correlation.options import Options, margin
from torchsphere.correlation.pairs import Pairs
from torchsphere.correlation.radius_mode import radius_score
from torchsphere.correlation.reference import Filtered
from torchsphere.correlation.solve import GRADIENT_FROM_DEG
from torchsphere.detection import limb_fit, outline_fit
from torchsphere.detection.detect import at_limb
from torchsphere.geometry.camera import Camera
from torchsphere.geometry.circle import Circle
from torchsphere.imaging import background, crop
from torchsphere.recording.frame_source import Source
from torchsphere.tracking.follow import Follower
from torchsphere.tracking.record import Record

#: Frames used: to follow the ball, and to tell where the ball hides the background in all of them.
FRAMES, PLACES = 65, 16

#: Failed searches for the ball after which the remaining frames are left out.
SEARCHES = 4

#: Distance beyond the outline up to which the limb is looked at, px, with the reach of the spline.
LIMB_REACH_PX = 16.0

#: Bias of the interpolation, px, that the residuals cannot tell from a radius (docs/constants.md).
SYSTEMATIC_RESIDUAL_PX = 0.001

#: Pre-blur with which the radius is estimated, px: blur in the image is no blur on the sphere and makes the ball look
#: larger (docs/constants.md).
PRE_BLUR_PX = 0.7

#: Largest change of the outline's radius that the correlation may make, as a share of it.
MAX_CHANGE = 0.03

#: Change of the radius, as a share of it, from which the frames are followed anew (docs/constants.md).
FOLLOWED_ANEW = 5e-4

#: How often the correlation is asked for the radius: the second time with the increments that belong to it.
ROUNDS = 2

#: Ratio of standard deviations, against the frame in which the ball was found, from which a frame's radius is left out.
WORSE = 1.2

#: Fewest pairs that tell a scatter.
FEWEST_PAIRS = 3

#: Pairs taken at once.
BATCH = 16


def calibrate_circle(source: Source, found: Circle, ignore: Tensor | None, options: Options) -> Circle:
    """The ``found`` circle with radius and centre from the frames that follow it.

    A plain ball, or a ball that cannot be followed, keeps its circle.
    """
    options = dataclasses.replace(options, pre_blur=min(options.pre_blur, PRE_BLUR_PX))
    if options.camera is None:
        # The linearised model gives the radius within 0.15 px at up to 5 deg per frame, where the residual of the
        # exact model leads the radius astray.
        options = dataclasses.replace(options, model="rigid", finite_from_deg=GRADIENT_FROM_DEG)
    stop = min(found.frame + FRAMES, source.count)
    source = source.cached(found.frame, stop)
    followed = Follower(source, found, ignore, options, searches=SEARCHES).run(stop)
    frames = np.flatnonzero(followed.status[:stop] == "ok")
    if len(frames) < 3:
        return found
    found = _at_limb_before_background(source, found, followed, ignore, options.camera)
    by_outline = radius = _radius_over_frames(source, found, followed, frames, ignore, options.camera)
    sd = found.sd_radius
    for turn in range(ROUNDS):
        tried = dataclasses.replace(found, radius=radius)
        correction, sd_correction = _radius_correction(source, followed, frames, tried, ignore, options)
        # Two independent values of the radius: the outline's and the correlation's.
        share = sd**2 / (sd**2 + sd_correction**2)
        combined = by_outline + share * (radius + correction - by_outline)
        if abs(combined - by_outline) > MAX_CHANGE * by_outline:
            # Another cause than the radius leaves this residual.
            radius, sd_correction = by_outline, math.inf
            break
        radius = combined
        # After the last round the positions are not used any more.
        if turn < ROUNDS - 1 and abs(radius - followed.radius) > FOLLOWED_ANEW * radius:
            anew = dataclasses.replace(found, radius=radius)
            followed = Follower(source, anew, ignore, options, searches=SEARCHES).run(stop)
            frames = np.flatnonzero(followed.status[:stop] == "ok")
    return dataclasses.replace(found, radius=radius, sd_radius=1 / math.hypot(1 / sd, 1 / sd_correction))


def _at_limb_before_background(
    source: Source, found: Circle, followed: Record, ignore: Tensor | None, camera: Camera | None
) -> Circle:
    """The circle at the ball's limb, with and without the still background taken out, whichever is more certain."""
    image = source.images(found.frame, found.frame + 1)[0].cpu()
    if outline_fit.is_plain(image, torch.tensor([found.x, found.y, found.radius], dtype=torch.float64)):
        return found
    still = _background_near(source, found, followed, image)
    hidden = _hidden(followed, found, image.shape)
    if ignore is not None:
        # The image and its background are on the CPU, wherever the pairs are measured.
        ignore = ignore.cpu()
        hidden = hidden | ignore
    fits = (
        at_limb(image[None], found, ignore, camera),
        at_limb((image - still).to(image)[None], found, hidden, camera),
    )
    return min(fits, key=lambda circle: math.hypot(circle.sd_x, circle.sd_y, circle.sd_radius))


def _background_near(source: Source, found: Circle, followed: Record, image: Tensor) -> Tensor:
    """The still background (h, w) around the ball in its frame; the ``image`` itself elsewhere."""
    reach = found.radius + LIMB_REACH_PX
    left, top = (max(0, math.floor(v - reach)) for v in (found.x, found.y))
    part = slice(top, math.ceil(found.y + reach) + 1), slice(left, math.ceil(found.x + reach) + 1)

    def read(start: int, stop: int) -> Tensor:
        return source.images(start, stop)[:, part[0], part[1]]

    near = dataclasses.replace(source, read=read, is_file=False)
    still = image.double().clone()
    still[part] = background.background(near, followed.position - [left, top], found.radius)
    return still


def _radius_over_frames(
    source: Source,
    found: Circle,
    followed: Record,
    frames: NDArray[np.int64],
    ignore: Tensor | None,
    camera: Camera | None,
) -> float:
    """Median radius over several frames; that of ``found`` where later frames are less certain than its own."""
    even = frames[~followed.uneven_light[frames]]
    if len(even) < FEWEST_PAIRS:
        return found.radius
    chosen = _spread(even)
    circles = _circles(followed, found, chosen)
    images = torch.cat([source.images(int(i), int(i) + 1) for i in chosen])
    fitted, covariance = limb_fit.fit(images, circles, ignore=ignore, camera=camera)
    good = ((fitted - circles).abs() < 0.5 * MAX_CHANGE * found.radius).all(-1)
    good &= covariance[:, 2, 2] < (WORSE * found.sd_radius) ** 2
    if int(good.sum()) < FEWEST_PAIRS:
        return found.radius
    return float((fitted[:, 2] / _relative_size(followed, found, chosen))[good].median())


def _spread(frames: NDArray[np.int64]) -> NDArray[np.int64]:
    """Up to `PLACES` of the frames, evenly between the first and the last."""
    return frames[np.unique(np.linspace(0, len(frames) - 1, PLACES).round().astype(int))]


def _hidden(followed: Record, found: Circle, shape: torch.Size) -> Tensor:
    """True (h, w) where the ball hides the background in all frames looked at except that of ``found``.

    A pixel seen in that frame alone is taken for the background there, whatever it shows.
    """
    known = np.flatnonzero(np.isfinite(followed.position[:, 0]))
    known = known[known != found.frame]
    chosen = _spread(known)
    rows, columns = (torch.arange(size, dtype=torch.float64) for size in shape)
    hidden, limit = torch.ones(shape, dtype=torch.bool), (found.radius + background.CLEARANCE_PX) ** 2
    for x, y in followed.position[chosen].tolist():
        hidden &= (columns - x).square() < (limit - (rows - y).square())[:, None]
    return hidden


def _relative_size(followed: Record, found: Circle, frames: NDArray[np.int64]) -> Tensor:
    """Size (m,) of the ball in the given frames relative to the frame in which it was found."""
    return torch.from_numpy(followed.size[frames] / followed.size[found.frame])


def _circles(followed: Record, circle: Circle, frames: NDArray[np.int64]) -> Tensor:
    """Followed circles (m, 3) in the given frames, with the radius of ``circle`` in its frame."""
    radii = circle.radius * _relative_size(followed, circle, frames)
    return torch.cat((torch.from_numpy(followed.position[frames]), radii[:, None]), -1)


def _radius_correction(
    source: Source,
    followed: Record,
    frames: NDArray[np.int64],
    tried: Circle,
    ignore: Tensor | None,
    options: Options,
) -> tuple[float, float]:
    """Correction of the ``tried`` radius by the residuals of successive frames, and its standard deviation, px.

    The increments may have been found with another radius; they adapt. Pairs with uneven light are left out: a target
    that takes light leaves a larger residual than a wrong radius (docs/constants.md).
    """
    scores, informations = [], []
    even = frames[~followed.uneven_light[frames]]
    # Pairs next to those that show the uneven light have some of it: both frames must be without.
    second = even[np.isin(even - 1, even)]
    if len(second) < FEWEST_PAIRS:
        return 0.0, math.inf
    for some in np.array_split(second, max(1, math.ceil(len(second) / BATCH))):
        pairs = _pairs(source, followed, some, tried, ignore, options)
        score, information = radius_score(pairs, torch.from_numpy(followed.increment[some - 1]), options)
        scores.append(score)
        informations.append(information)
    score, information = torch.cat(scores), torch.cat(informations)
    total = float(information.sum())
    if total <= 0:
        return 0.0, math.inf
    correction = float(score.sum()) / total
    # The pairs' own scatter holds errors that the noise model lacks; the systematic residual is common to all pairs.
    scatter = float((score - information * correction).square().sum().sqrt()) / total
    turn = np.sqrt(np.mean(np.sum(followed.increment[second - 1, 2:4] ** 2, axis=1)))
    return correction, math.hypot(scatter, SYSTEMATIC_RESIDUAL_PX / max(float(turn), 1e-6))


def _pairs(
    source: Source,
    followed: Record,
    second: NDArray[np.int64],
    tried: Circle,
    ignore: Tensor | None,
    options: Options,
) -> Pairs:
    """The frames ``second`` (m,), each with the frame before; each image is filtered once, for both its pairs."""
    shown = np.union1d(second - 1, second)
    circles = _circles(followed, tried, shown)
    half = crop.half_size(float(circles[:, 2].max()), margin(options))
    runs = np.split(shown, np.flatnonzero(np.diff(shown) > 1) + 1)
    images = [source.images(int(run[0]), int(run[-1]) + 1) for run in runs]
    # One run of frames, as there mostly is, needs no copy.
    crops = crop.cut(images[0] if len(images) == 1 else torch.cat(images), circles[:, :2], half, ignore)
    filtered = Filtered.of(crops, options.pre_blur)
    if len(runs) == 1:
        return Pairs(filtered.rows(0, len(second)), filtered.rows(1, len(shown)), circles[:-1])
    first = torch.from_numpy(np.searchsorted(shown, second - 1))
    return Pairs(filtered.take(first), filtered.take(first + 1), circles[first])
