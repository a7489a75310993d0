"""Find the ball's circle: silhouettes -> disc filter -> outline; and check a circle that was given.

A speckled ball has edges everywhere. Therefore `silhouette` separates the ball from its background and `disc_filter`
finds a disc in the silhouette first. Then `outline_fit` fits the outline, and `limb_fit` that of a speckled ball.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Iterator
from typing import NamedTuple

import torch
from torch import Tensor

from torchsphere.detection import blurred_limb, disc_filter, limb_fit, outline_fit
from torchsphere.detection.blurred_limb import LimbBlur
from torchsphere.detection.silhouette import Images, saturated, silhouettes, still_background
from torchsphere.geometry.camera import Camera
from torchsphere.geometry.circle import Circle
from torchsphere.recording.level_scale import alike
from torchsphere.settings.arrays import check_finite_around
from torchsphere.settings.limits import SettingError

#: Least share of the rays whose edge lies on the circle of an outline.
MIN_SUPPORT = 0.4

#: Largest distance of the likeliest limb from the circle through the edges, px and share of the radius.
MAX_LIMB_SHIFT_PX, MAX_LIMB_SHIFT = 2.0, 0.04

#: Size, in radii of the ball, of other objects that may be the ball, least distance of their centres, in radii, and
#: least score, as a share of that of the ball (docs/constants.md).
OTHER_SIZES, OTHER_DISTANCE, OTHER_SCORE = (0.6, 1.67), 1.0, 0.6

#: Largest number of frames in which the ball is searched.
MAX_TRIES = 40

#: Largest difference of a given circle from the outline, in standard deviations and as a share of the radius: 2 % is
#: the error of a circle that was drawn by hand with care.
MAX_CIRCLE_SDS, MAX_CIRCLE_ERROR = 4.0, 0.03

#: Advice for a circle in doubt.
CHECK_ADVICE = (
    "See figures/path.png: if the circle is not the ball's outline, lengths and speeds are wrong in proportion to its "
    "radius."
)


def find(images: Images, count: int, ignore: Tensor | None = None) -> Circle:
    """The circle of the ball in the first of ``count`` frames in which it is wholly in view; raises without one.

    ``ignore`` (h, w): True where the images are not to be used.
    """
    background = still_background(images, count)
    for frame in _frames_to_try(count):
        found = _find_in(images, frame, count, background, ignore)
        if found is not None:
            return found
    ignored = 0.0 if ignore is None else 100 * float(ignore.double().mean())
    masked = f"; or correct `ignore`, which leaves out {ignored:.0f} % of the image: a mask is black where it is used"
    raise SettingError(
        f"no ball was found in {count} frames: expected a round object that differs from its background, wholly in "
        "view in at least one frame; give its outline with `circle` as x, y, radius in px of the first frame to track"
        f"{masked if ignored else ''}"
    )


def refine_circle(image: Tensor, circle: Circle, window: float | None = None, camera: Camera | None = None) -> Circle:
    """The circle fitted to the outline in ``image`` (h, w), from a circle that is right to ``window`` px.

    With a camera, circles are projected centres and radii at their depth. Raises if the image shows no outline there.
    """
    guess = torch.tensor([[circle.x, circle.y, circle.radius]], dtype=torch.float64)
    reach = max(2.0, 0.06 * circle.radius) if window is None else window
    check_finite_around(image, circle.x, circle.y, circle.radius + outline_fit.OUTWARDS * reach)
    plain = outline_fit.is_plain(image, guess[0])
    fit = outline_fit.refine(image[None], guess, window=reach, plain=plain, patterned=not plain, camera=camera)
    difference = (image - _around(image, fit.circle[0]).median()).abs()
    silhouette = saturated(difference, _around(difference, fit.circle[0]))
    explained = disc_filter.explained_by(silhouette, fit.circle[0])
    if float(fit.support[0]) < MIN_SUPPORT or explained < disc_filter.MIN_EXPLAINED:
        raise ValueError(
            f"no outline was found near the circle ({circle.x:g}, {circle.y:g}, {circle.radius:g}): give one that is "
            f"right to {reach:.1f} px, or track with the circle as given"
        )
    rough = _as_circle(fit.circle[0], fit.covariance[0], circle.frame)
    if plain:
        return rough
    return unblurred(image, at_limb(image[None], rough, camera=camera), camera=camera)[0]


def at_limb(views: Tensor, circle: Circle, ignore: Tensor | None = None, camera: Camera | None = None) -> Circle:
    """The circle at the likeliest limb of a speckled ball, from a ``circle`` that is right to about a px.

    ``views`` (m, h, w): one image as recorded and minus its background, of which the most certain one counts. Where
    every limb is too far from the circle, the circle is returned with that distance as a guessed standard deviation.
    """
    guess = torch.tensor([[circle.x, circle.y, circle.radius]], dtype=torch.float64)
    fitted, covariance = limb_fit.fit(views, guess.expand(len(views), -1), ignore=ignore, camera=camera)
    far = max(MAX_LIMB_SHIFT_PX, MAX_LIMB_SHIFT * circle.radius)
    variance = covariance.diagonal(dim1=1, dim2=2).sum(-1)
    near = ((fitted - guess).abs() < far).all(-1) & variance.isfinite()
    if not bool(near.any()):
        return dataclasses.replace(circle, sd_x=far, sd_y=far, sd_radius=far, sd_guessed=True)
    best = int(variance.where(near, torch.inf).argmin())
    return dataclasses.replace(_as_circle(fitted[best], covariance[best], circle.frame), others=circle.others)


def unblurred(
    image: Tensor,
    circle: Circle,
    *,
    motion: Tensor | None = None,
    ignore: Tensor | None = None,
    camera: Camera | None = None,
) -> tuple[Circle, LimbBlur | None]:
    """The ``circle`` of `at_limb` where the limb in ``image`` (h, w) is blurred, with the blur; as it is where not.

    ``motion`` (2,) of the ball from frame to frame, px.
    """
    if circle.sd_guessed:
        return circle, None
    guess = torch.tensor([[circle.x, circle.y, circle.radius]], dtype=torch.float64)
    moves = None if motion is None else motion[None]
    found = blurred_limb.fit_if_blurred(image[None], guess, motion=moves, ignore=ignore, camera=camera)
    if found is None:
        return circle, None
    fitted, covariance, blur = found
    far = max(MAX_LIMB_SHIFT_PX, MAX_LIMB_SHIFT * circle.radius, 1.5 * math.sqrt(blur.variance))
    if bool(((fitted - guess).abs() > far).any()):
        return circle, None
    return dataclasses.replace(_as_circle(fitted[0], covariance[0], circle.frame), others=circle.others), blur


def _as_circle(values: Tensor, covariance: Tensor, frame: int) -> Circle:
    """A `Circle` of the ``values`` (3,) and their ``covariance`` (3, 3)."""
    x, y, radius, sd_x, sd_y, sd_radius = torch.cat((values, covariance.diagonal().sqrt())).tolist()
    return Circle(x, y, radius, sd_x, sd_y, sd_radius, frame)


def _frames_to_try(count: int) -> Iterator[int]:
    """The first frames one by one, then in growing steps."""
    if count <= MAX_TRIES:
        yield from range(count)
        return
    head = MAX_TRIES // 2
    yield from range(head)
    tail = torch.logspace(math.log10(head), math.log10(count - 1), MAX_TRIES - head).round().long()
    yield from sorted(set(tail.tolist()) - set(range(head)))


def _find_in(images: Images, frame: int, count: int, background: Tensor | None, ignore: Tensor | None) -> Circle | None:
    image = images(frame, frame + 1)[0]
    if bool(alike(image, image[0, 0]).all()):
        # A blank image differs from the background where the ball is in other images.
        return None
    seen = list(silhouettes(images, frame, count, background, ignore))
    candidates = _candidates(seen)
    if not candidates:
        return None
    best = max(candidates, key=lambda c: c.score)
    circle = _as_circle(best.fit.circle[0], best.fit.covariance[0], frame)
    if not best.plain:
        # A slow ball is part of the median background: the image alone may show its limb better.
        views = image[None] if best.contrast.equal(image) else torch.stack((best.contrast, image))
        circle = at_limb(views, circle, ignore)
    return dataclasses.replace(circle, others=_others(candidates, best))


class _Candidate(NamedTuple):
    """An outline in a silhouette, which may be the ball's."""

    score: float
    fit: outline_fit.OutlineFit
    plain: bool
    silhouette: Tensor
    contrast: Tensor


def _candidates(seen: list[tuple[Tensor, Tensor]], radii: tuple[float, float] = (0.0, math.inf)) -> list[_Candidate]:
    """The best outline in each of the silhouettes, ``seen`` with their contrasts, where one is good enough."""
    candidates: list[_Candidate] = []
    if not seen:
        return candidates
    guesses = disc_filter.best_discs(torch.stack([silhouette for silhouette, _ in seen]), radii)
    for (silhouette, contrast), guess in zip(seen, guesses, strict=True):
        found = None if guess is None else _outline_of(silhouette, contrast, guess)
        if found is not None:
            fit, plain = found
            explained = disc_filter.explained_by(silhouette, fit.circle[0])
            if explained > disc_filter.MIN_EXPLAINED:
                candidates.append(_Candidate(explained * float(fit.support[0]), fit, plain, silhouette, contrast))
    return candidates


def _others(candidates: list[_Candidate], best: _Candidate) -> tuple[tuple[float, float, float], ...]:
    """Circles of other objects that may be the ball: those in other silhouettes, and that beside the ``best`` one."""
    x, y, radius = best.fit.circle[0].tolist()
    rows, columns = (torch.arange(size, device=best.contrast.device) for size in best.contrast.shape)
    is_ball = (rows[:, None] - y) ** 2 + (columns - x) ** 2 < (disc_filter.RING * radius) ** 2
    rest = best.silhouette.masked_fill(is_ball, 0.0)
    beside = _candidates([(rest, best.contrast)], (OTHER_SIZES[0] * radius, OTHER_SIZES[1] * radius))
    found: list[tuple[float, float, float]] = []
    for candidate in sorted(candidates + beside, key=lambda c: -c.score):
        at_x, at_y, size = candidate.fit.circle[0].tolist()
        apart = all(math.hypot(at_x - u, at_y - v) > OTHER_DISTANCE * radius for u, v, _ in [(x, y, radius), *found])
        alike = OTHER_SIZES[0] < size / radius < OTHER_SIZES[1] and candidate.score > OTHER_SCORE * best.score
        if apart and alike:
            found.append((at_x, at_y, size))
    return tuple(found)


def _outline_of(silhouette: Tensor, contrast: Tensor, guess: Tensor) -> tuple[outline_fit.OutlineFit, bool] | None:
    """The outline from a ``guess`` (1, 3), first in the silhouette, then in the image; True if the ball is plain."""
    coarse = outline_fit.refine(silhouette[None], guess, window=max(2.0, 0.08 * float(guess[0, 2])))
    if float(coarse.support[0]) < MIN_SUPPORT or not _within(coarse.circle[0], silhouette.shape):
        return None
    plain = outline_fit.is_plain(contrast, coarse.circle[0])
    fine = outline_fit.refine(contrast[None], coarse.circle, window=outline_fit.STEP_BLUR_PX, plain=plain)
    if float(fine.support[0]) < MIN_SUPPORT or not _within(fine.circle[0], silhouette.shape):
        return None
    moved = float((fine.circle - coarse.circle).abs().max())
    if moved >= max(3.0, 0.04 * float(guess[0, 2])):
        return None
    return fine, plain


def _around(image: Tensor, circle: Tensor) -> Tensor:
    """Values (n,) of the image (h, w) in a ring around the circle; all values where the image shows no such ring."""
    x, y, radius = circle.tolist()
    rows, columns = (torch.arange(size, device=image.device) for size in image.shape)
    distance = ((rows[:, None] - y) ** 2 + (columns - x) ** 2).sqrt()
    ring = image[(distance > 1.1 * radius) & (distance < disc_filter.RING * radius)]
    return ring if len(ring) else image.flatten()


def _within(circle: Tensor, shape: torch.Size) -> bool:
    """Whether the circle lies in the image, to about a pixel."""
    x, y, radius = circle.tolist()
    height, width = shape
    return min(x, y, width - 1 - x, height - 1 - y) > radius - 1.5


def given_circle_warning(image: Tensor, given: Circle) -> str:
    """A warning where the outline in ``image`` (h, w) is not the ``given`` circle, else an empty string."""
    text = f"The circle that was given, {given.text(1)} px,"
    try:
        seen = refine_circle(image, given)
    except ValueError:
        seen = None
    if seen is None or seen.sd_guessed:
        return f"{text} was not confirmed: no limb of a speckled ball was seen along it. {CHECK_ADVICE}"
    difference = max(math.hypot(seen.x - given.x, seen.y - given.y), abs(seen.radius - given.radius))
    if difference <= max(MAX_CIRCLE_SDS * max(seen.sd_x, seen.sd_y, seen.sd_radius), MAX_CIRCLE_ERROR * seen.radius):
        return ""
    return f"{text} is not the outline that the image shows at {seen.text(1)} px; `refine` takes that. {CHECK_ADVICE}"


def refined_circle_warning(fitted: Circle) -> str:
    """A warning where a given circle, ``fitted`` to the image, may not be the ball's outline, else an empty string."""
    if not fitted.doubt:
        return ""
    return (
        f"The circle that was given was fitted by `refine`, at {fitted.text(1)} px, and may not be the ball's outline: "
        f"{fitted.doubt}. See figures/path.png: where the circle as given is better, leave out `refine`."
    )
