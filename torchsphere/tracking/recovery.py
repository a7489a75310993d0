"""Measure a frame by itself where a batch failed: at an impact, at the start, after a blank image.

The ball is searched for in the whole image, and the correlation starts from the best of several first guesses. If all
guesses fail, a search over rotations follows (`rotation_search`). Where nothing correlates, the outline may still show
a ball without a pattern, or a ball that shows another side by now. These are the measurements; `follow` says in which
order they are tried, and when.
"""

from __future__ import annotations

import dataclasses

import torch
import torch.nn.functional as F  # noqa: N812  (torch's own custom)
from torch import Tensor

from torchsphere.correlation.correlate import correlate_pairs
from torchsphere.correlation.frame_status import OK, WEAK_TEXTURE
from torchsphere.correlation.options import Options
from torchsphere.correlation.result import CELLS, Correlation
from torchsphere.detection import ball_search, limb_fit, outline_fit
from torchsphere.detection.candidates import MIN_SUPPORT
from torchsphere.geometry import motion_models
from torchsphere.imaging import template_matching
from torchsphere.tracking import rotation_search
from torchsphere.tracking.prediction import BallState
from torchsphere.tracking.successive_pairs import PairSetup, correlate_one, explain_one

#: Radius of the ball in the small images on which first guesses are refined, px (docs/constants.toml).
SMALL_RADIUS_PX = 25.0

#: Largest number of iterations on the small images, and their tolerance, px.
MAX_ITERATIONS, TOLERANCE_PX = 20, 0.01

#: Correlation coefficient on the small images below which a guess is dropped (docs/constants.toml).
MIN_SMALL_ZNCC = 0.2

#: Number of first guesses of a search over rotations that are tried at full size.
MAX_TRIED = 3

#: Failed searches before further ones wait, and wait as a share of the frames since the first (docs/constants.toml).
FREE_SEARCHES, WAIT_SHARE = 4, 0.25

#: Smallest height of the outline's step, as a share of that in the last frame (docs/constants.toml).
MIN_CONTRAST = 0.4

#: Relative error of the radius up to which a ball found by its outline alone is the same ball (docs/constants.toml).
RESTART_RADIUS = 0.06

#: Share of a cell of the ball that its motion must have explained for its pixels to be used (docs/constants.toml).
MIN_EXPLAINED = 0.5

#: Motion of the ball's front, px, up to which a part of the image may be something still (docs/constants.toml).
STILL_PX = 0.25

#: Distance from the ball's last place, radii, at which the texture of another object was (docs/constants.toml).
MAX_OFF_PLACE = 0.25

#: Largest standard deviation of the limb of a ball that is in its place, px (docs/constants.toml).
MAX_LIMB_SD_PX = 0.5


def without_occluder(state: BallState, explained: Tensor, setup: PairSetup) -> PairSetup:
    """The setup without the part of the last image that shows no ball, by its ``explained`` (c, c) cells."""
    device = state.image.device
    rows, columns = (torch.arange(size, device=device) for size in state.image.shape[-2:])
    x, y = ((v - c) / state.radius for v, c in zip((columns, rows), state.centre.tolist(), strict=True))
    column, row = (((v + 1) * (CELLS / 2)).floor().long().clamp(0, CELLS - 1) for v in (x, y))
    middles = (torch.arange(CELLS, device=device) + 0.5) * (2 / CELLS) - 1
    disc = (middles.square() + middles[:, None].square() < 1).to(explained)
    # With its neighbours, as a cell holds hardly a speckle.
    known, all_cells = (F.avg_pool2d(v[None], 3, stride=1, padding=1)[0] for v in (disc * explained.to(device), disc))
    is_ball = (known >= MIN_EXPLAINED * all_cells)[row[:, None], column]
    hidden = (x.square() + y[:, None].square() < 1) & ~is_ball
    return dataclasses.replace(setup, ignore=hidden if setup.ignore is None else setup.ignore | hidden)


def locate(pair: Tensor, state: BallState, setup: PairSetup) -> Tensor:
    """Centre (2,), px, at which the second of two images (2, h, w) is most similar to the ball in the first."""
    if setup.in_place:
        return state.centre
    return template_matching.best_match(pair[0], pair[1], state.centre, state.radius, setup.ignore)


def rank_guesses(pair: Tensor, state: BallState, starts: Tensor, ignore: Tensor | None, options: Options) -> Tensor:
    """First guesses ``starts`` (k, 5) of the increment, refined on small images: (m, 5), the best first.

    Guesses that fail are left out. ``pair`` (2, h, w); ``state`` of the ball in its first image; ``options`` of the
    correlation that starts from the guesses.
    """
    factor = max(1, round(state.radius / SMALL_RADIUS_PX))
    unit = torch.tensor([factor, factor, 1, 1, 1], dtype=torch.float64)
    small = F.avg_pool2d(pair[:, None], factor)[:, 0]
    if ignore is not None:
        ignore = F.max_pool2d(ignore[None].to(pair.dtype), factor)[0] > 0
    # Pixel i of the small image is the mean of the pixels from i factor on.
    centre, radius = (state.centre + 0.5) / factor - 0.5, torch.tensor([state.radius / factor], dtype=torch.float64)
    f, g = (image.expand(len(starts), -1, -1) for image in small)
    coarse = dataclasses.replace(
        options,
        robust=False,
        max_iterations=MAX_ITERATIONS,
        tolerance_px=TOLERANCE_PX,
        min_zncc=MIN_SMALL_ZNCC,
        camera=None if options.camera is None else options.camera.reduced(factor),
    )
    circles = torch.cat((centre, radius)).expand(len(starts), 3)
    guess = correlate_pairs(f, g, circles, starts / unit, ignore, coarse)
    found = guess.q.isfinite().all(-1)
    order = torch.where(found, guess.zncc, -1.0).argsort(descending=True)
    return (guess.q[order].double().cpu() * unit)[: int(found.sum())]


def correlate_from_guesses(
    pair: Tensor, state: BallState, place: Tensor, expected: Tensor, setup: PairSetup
) -> Correlation:
    """Correlate the pair from the best of a few first guesses, by ``place`` (2,) and the ``expected`` motion (5,)."""
    unturned = torch.cat((place - state.centre, torch.zeros(3, dtype=torch.float64)))
    turned = torch.cat((place - state.centre, expected[2:]))
    starts = torch.stack((unturned, turned, expected, torch.zeros_like(expected)))
    best = rank_guesses(pair, state, starts, setup.ignore, setup.options)
    return correlate_one(pair, state.circle, best[0] if len(best) else unturned, setup)


def is_worth_a_search(found: Correlation, is_plain: bool, setup: PairSetup) -> bool:
    """Whether a search over rotations may succeed where the first guesses failed."""
    # A plain ball has no texture to search by.
    plain = is_plain and found.status[0] == WEAK_TEXTURE
    return found.status[0] != OK and not plain


def is_search_due(frame: int, failed: list[int]) -> bool:
    """Whether to search in ``frame``, after searches that ``failed`` in earlier frames since the ball was seen."""
    return len(failed) < FREE_SEARCHES or frame - failed[-1] >= WAIT_SHARE * (failed[-1] - failed[0])


def correlate_by_search(pair: Tensor, state: BallState, setup: PairSetup) -> Correlation | None:
    """Correlate the pair from the most similar rotations of a search; None where all fail, or none is measured."""
    if motion_models.MODELS[setup.options.model] not in (motion_models.rigid, *motion_models.EXACT):
        return None
    guesses = rotation_search.find_guesses(pair[0], pair[1], state.centre, state.radius, setup.ignore)
    if setup.in_place:
        guesses[:, :2] = 0
    if len(guesses) == 0:
        return None
    for start in rank_guesses(pair, state, guesses, setup.ignore, setup.options)[:MAX_TRIED]:
        found = correlate_one(pair, state.circle, start, setup)
        if found.status[0] == OK:
            return found
    return None


def step_by_outlines(
    pair: Tensor, state: BallState, place: Tensor, is_plain: bool, setup: PairSetup
) -> tuple[Tensor, Tensor] | None:
    """Step (2,), px, of the centre to about ``place`` (2,) by the outlines, and its covariance; None without a ball."""
    centres = torch.stack((state.centre, place))
    fit = outline_fit.refine(
        pair,
        torch.cat((centres, torch.full((2, 1), state.radius)), -1),
        ignore=setup.ignore,
        window=max(2.0, 0.06 * state.radius),
        fixed_radius=True,
        plain=is_plain,
        camera=setup.options.camera,
    )
    is_there = (fit.support >= MIN_SUPPORT).all() and fit.contrast[1] > MIN_CONTRAST * fit.contrast[0]
    return outline_fit.centre_step(fit) if bool(is_there) else None


def find_by_outline(image: Tensor, state: BallState, setup: PairSetup) -> Tensor | None:
    """Centre (2,), px, of a ball that shows another side in ``image`` (1, h, w); None without a ball."""
    if setup.in_place:
        return state.centre if _shows_limb(image, state, setup) else None
    found = ball_search.find_in_image(image[0], setup.ignore)
    if found is None or abs(found.radius - state.radius) > RESTART_RADIUS * state.radius:
        return None
    fit = outline_fit.refine(
        image,
        torch.tensor([[found.x, found.y, state.radius]], dtype=torch.float64),
        ignore=setup.ignore,
        window=outline_fit.STEP_BLUR_PX,
        fixed_radius=True,
        camera=setup.options.camera,
    )
    return fit.circle[0, :2] if float(fit.support[0]) >= MIN_SUPPORT else None


def moving_part(pair: Tensor, state: BallState, expected: Tensor, found: Correlation, setup: PairSetup) -> Correlation:
    """The motion of the part of the disc that moves, where the motion ``found`` is that of a still part.

    A disc of which one part rests and the other moves as a ball is a ball behind something still.
    """
    front = state.radius * found.q[0, 2:].norm() + found.q[0, :2].norm()
    if bool((found.explained == 1).all()) or float(front) > STILL_PX:
        return found
    rest = without_occluder(state, 1 - found.explained[0, 0], setup)
    moving = correlate_from_guesses(pair, state, locate(pair, state, rest), expected, rest)
    if moving.status[0] != OK:
        return found
    explained = explain_one(pair, state.circle, moving.q[0], setup)
    return dataclasses.replace(moving, explained=explained[None])


def motion_to(image: Tensor, centre: Tensor, state: BallState, frames: float, setup: PairSetup) -> Tensor | None:
    """Motion (5,) to a ball around ``centre`` (2,) in ``image`` (1, h, w), ``frames`` later; None if it is another."""
    pair = torch.cat((state.image, image))
    expected = torch.cat((centre - state.centre, frames * state.increment[2:]))
    found = correlate_from_guesses(pair, state, centre, expected, setup)
    if found.status[0] != OK:
        found = correlate_by_search(pair, state, setup) or found
    motion = found.q[0].double().cpu()
    # A motion that was not measured is NaN: the comparison is False.
    is_there = (state.centre + motion[:2] - centre).norm() < MAX_OFF_PLACE * state.radius
    return motion if bool(is_there) else None


def is_other_object(image: Tensor, centre: Tensor, state: BallState, setup: PairSetup) -> bool:
    """Whether the last image showed the disc around ``centre`` (2,) in ``image`` (1, h, w) as well, beside the ball.

    Then it is a plate in front of the ball, or another ball.
    """
    nothing = torch.zeros(5, dtype=torch.float64)
    there = dataclasses.replace(state, image=image, centre=centre, increment=nothing, trend=nothing, explained=None)
    pair = torch.cat((image, state.image))
    found = correlate_from_guesses(pair, there, locate(pair, there, setup), nothing, setup)
    if found.status[0] != OK:
        found = correlate_by_search(pair, there, setup) or found
    place = centre + found.q[0, :2].to(centre)
    # A motion that was not measured is NaN: the comparison is False.
    return bool((place - state.centre).norm() > MAX_OFF_PLACE * state.radius)


def _shows_limb(image: Tensor, state: BallState, setup: PairSetup) -> bool:
    """Whether ``image`` (1, h, w) shows the limb of a speckled ball where the ball was, as of a ball in its place."""
    circle, covariance = limb_fit.fit(image, state.circle[None], ignore=setup.ignore, camera=setup.options.camera)
    sd = covariance[0].diagonal().clamp_min(0).sqrt()
    off = (circle[0] - state.circle).abs()
    return bool(circle.isfinite().all() and (sd < MAX_LIMB_SD_PX).all() and (off < RESTART_RADIUS * state.radius).all())
