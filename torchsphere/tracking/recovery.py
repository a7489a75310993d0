"""Measure a frame by itself where a batch failed: at an impact, at the start, behind a blank image.

The ball is sought over the whole image, the correlation tries several first guesses on small images, and if none of
them leads anywhere, rotations are searched through. Where nothing correlates, its outline may still tell where a ball
is that has no pattern, or that shows another side by now.

Choose among first guesses of one pair: each is refined on small images, and the best are kept.
"""

from __future__ import annotations

import dataclasses
from typing import NamedTuple

import torch
import torch.nn.functional as F  # noqa: N812  (its usual name)
from torch import Tensor

from torchsphere.correlation.correlate import correlate_pairs
from torchsphere.correlation.options import Options
from torchsphere.correlation.result import Correlation
from torchsphere.detection import detect, outline_fit
from torchsphere.detection.detect import MIN_SUPPORT
from torchsphere.geometry import motion_models
from torchsphere.imaging import template_matching
from torchsphere.tracking import rotation_search
from torchsphere.tracking.prediction import Seen
from torchsphere.tracking.successive_pairs import Setup, correlate_one

#: Radius that the images are reduced to, px.
SMALL_RADIUS_PX = 25.0

#: Steps and tolerance, px, on the small images, and the coefficient below which a guess leads nowhere: low, because a
#: part of the ball may be hidden.
STEPS, TOLERANCE_PX, LEAST_ZNCC = 20, 0.01, 0.2


def ranked(
    pair: Tensor, centre: Tensor, radius: float, starts: Tensor, ignore: Tensor | None, options: Options
) -> Tensor:
    """First guesses (m, 5), refined, the best first; those that lead nowhere are left out.

    Parameters
    ----------
    pair : Tensor
        The two images (2, h, w).
    centre : Tensor
        Centre (2,) of the ball in the first, px, float64.
    radius : float
        Radius of the ball, px.
    starts : Tensor
        First guesses (k, 5) of the increment, px and rad, float64.
    ignore : Tensor, optional
        (h, w), True where the images are not to be used.
    options : Options
        Of the correlation that is to start from there.
    """
    factor = max(1, round(radius / SMALL_RADIUS_PX))
    unit = torch.tensor([factor, factor, 1, 1, 1], dtype=torch.float64)
    small = F.avg_pool2d(pair[:, None], factor)[:, 0]
    if ignore is not None:
        ignore = F.max_pool2d(ignore[None].to(pair.dtype), factor)[0] > 0
    # Pixel i of the small image is the mean of the pixels from i factor on.
    small_circle = torch.cat(((centre + 0.5) / factor - 0.5, torch.tensor([radius / factor], dtype=torch.float64)))
    f, g = (image.expand(len(starts), -1, -1) for image in small)
    coarse = dataclasses.replace(
        options,
        robust=False,
        max_iterations=STEPS,
        tolerance_px=TOLERANCE_PX,
        min_zncc=LEAST_ZNCC,
        camera=None if options.camera is None else options.camera.reduced(factor),
    )
    guess = correlate_pairs(f, g, small_circle.expand(len(starts), 3), starts / unit, ignore, coarse)
    found = guess.q.isfinite().all(-1)
    order = torch.where(found, guess.zncc, -1.0).argsort(descending=True)
    return (guess.q[order].double().cpu() * unit)[: int(found.sum())]


#: First guesses that a search over rotations may try at full size.
TRIED = 3

#: Searches in vain from which the next one waits, and for which share of the frames since: a search takes up to
#: seconds, and in footage of no such ball each frame would have one.
PATIENT, WAITS = 4, 0.25

#: Height of the outline's step, against that of the last frame, below which the ball is not believed to be there.
MIN_CONTRAST = 0.4

#: How well the radius of a ball must be met that is found by its outline alone.
RESTART_RADIUS = 0.06

#: Share of the disc in the image below which a ball that was not measured counts as out of the frame.
MIN_IN_FRAME = 0.5


class Outlined(NamedTuple):
    """Step of the centre (2,), px, by the outlines of two images, and its covariance (2, 2)."""

    step: Tensor
    covariance: Tensor


def sighted(pair: Tensor, seen: Seen, setup: Setup) -> Tensor:
    """Where (2,) the second of two images (2, h, w) looks most like the ball in the first, px."""
    if setup.in_place:
        return seen.centre
    return template_matching.best_match(pair[0], pair[1], seen.centre, seen.radius, setup.ignore)


def from_guesses(pair: Tensor, seen: Seen, place: Tensor, expected: Tensor, setup: Setup) -> Correlation:
    """Correlate the pair from the best of a few first guesses, by ``place`` (2,) and the ``expected`` motion (5,)."""
    unturned = torch.cat((place - seen.centre, torch.zeros(3, dtype=torch.float64)))
    turned = torch.cat((place - seen.centre, expected[2:]))
    starts = torch.stack((unturned, turned, expected, torch.zeros_like(expected)))
    best = ranked(pair, seen.centre, seen.radius, starts, setup.ignore, setup.options)
    return correlate_one(pair, seen.ball, best[0] if len(best) else unturned, setup)


def is_worth_a_search(found: Correlation, seen: Seen, expected: Tensor, is_plain: bool, setup: Setup) -> bool:
    """Whether a search over rotations may find what the first guesses did not."""
    # A plain ball has nothing to be sought by.
    plain = is_plain and found.status[0] == "weak_texture"
    turns = motion_models.MODELS[setup.options.model] in (motion_models.rigid, *motion_models.EXACT)
    return found.status[0] != "ok" and turns and not plain and not is_gone(seen, expected)


def is_due(frame: int, in_vain: list[int]) -> bool:
    """Whether to search in ``frame``, after others that were searched ``in_vain`` since the ball was seen."""
    return len(in_vain) < PATIENT or frame - in_vain[-1] >= WAITS * (in_vain[-1] - in_vain[0])


def by_search(pair: Tensor, seen: Seen, setup: Setup) -> Correlation | None:
    """Correlate the pair from the likeliest of all rotations; None where none of them leads to the motion."""
    wide = rotation_search.guesses(pair[0], pair[1], seen.centre, seen.radius, setup.ignore)
    if setup.in_place:
        wide[:, :2] = 0
    if len(wide) == 0:
        return None
    for start in ranked(pair, seen.centre, seen.radius, wide, setup.ignore, setup.options)[:TRIED]:
        found = correlate_one(pair, seen.ball, start, setup)
        if found.status[0] == "ok":
            return found
    return None


def by_outlines(pair: Tensor, seen: Seen, place: Tensor, is_plain: bool, setup: Setup) -> Outlined | None:
    """Translation to about ``place`` (2,) of a ball whose texture cannot carry the modes; None if it is not there."""
    centres = torch.stack((seen.centre, place))
    fit = outline_fit.refine(
        pair,
        torch.cat((centres, torch.full((2, 1), seen.radius)), -1),
        ignore=setup.ignore,
        window=max(2.0, 0.06 * seen.radius),
        fixed_radius=True,
        plain=is_plain,
        camera=setup.options.camera,
    )
    there = (fit.support >= MIN_SUPPORT).all() and fit.contrast[1] > MIN_CONTRAST * fit.contrast[0]
    return Outlined(*outline_fit.centre_step(fit)) if bool(there) else None


def by_own_outline(image: Tensor, seen: Seen, setup: Setup) -> Tensor | None:
    """Centre (2,) of a ball that shows another side by now in ``image`` (1, h, w), px; None where there is none."""
    if setup.in_place:
        return None
    try:
        found = detect.find(lambda start, stop: image[start:stop], 1, setup.ignore)
    except ValueError:
        return None
    if abs(found.radius - seen.radius) > RESTART_RADIUS * seen.radius:
        return None
    fit = outline_fit.refine(
        image,
        torch.tensor([[found.x, found.y, seen.radius]], dtype=torch.float64),
        ignore=setup.ignore,
        window=outline_fit.STEP_BLUR_PX,
        fixed_radius=True,
        camera=setup.options.camera,
    )
    return fit.circle[0, :2] if float(fit.support[0]) >= MIN_SUPPORT else None


def is_gone(seen: Seen, expected: Tensor) -> bool:
    """Whether the ball is out of the frame by where it should be, not where something is least unlike it."""
    return seen.share_in_image(seen.centre + expected[:2]) < MIN_IN_FRAME
