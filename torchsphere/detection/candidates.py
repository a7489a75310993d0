"""Outlines in an image that may be the ball's: the best disc of each silhouette, fitted to the image.

A speckled ball has edges everywhere. Therefore `silhouette` separates the ball from its background and `disc_filter`
finds a disc in the silhouette first. Then `outline_fit` fits the outline.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import torch
from torch import Tensor

from torchsphere.detection import disc_filter, outline_fit
from torchsphere.detection.outline_arcs import arcs_of
from torchsphere.detection.outline_fit import OutlineFit
from torchsphere.detection.scene import Scene
from torchsphere.detection.silhouette import silhouettes
from torchsphere.recording.level_scale import alike

#: Least share of the rays whose edge lies on the circle of an outline.
MIN_SUPPORT = 0.4

#: Least share of the arcs that show an outline, and slack of the circle in the silhouette (docs/constants.toml).
MIN_PART, SLACK = 0.5, 2.5

#: Size, in radii of the ball, of other objects that may be the ball, least distance of their centres, in radii, and
#: least score, as a share of that of the ball (docs/constants.toml).
OTHER_SIZES, OTHER_DISTANCE, OTHER_SCORE = (0.6, 1.67), 1.0, 0.6


@dataclass(frozen=True)
class Candidate:
    """An outline in a silhouette, which may be the ball's."""

    score: float  # share of the silhouette's variance that the disc explains, times that of the rays that support it
    fit: OutlineFit
    plain: bool  # whether it has no pattern
    silhouette: Tensor  # (h, w), from 0 (background) to 1 (ball)
    contrast: Tensor  # image (h, w) for the edges: as recorded, or minus the still background

    @property
    def circle(self) -> Tensor:
        """The circle (3,), px."""
        return self.fit.circle[0]

    def rest(self) -> tuple[Tensor, Tensor]:
        """The silhouette without this outline, and the contrast."""
        x, y, radius = self.circle.tolist()
        rows, columns = (torch.arange(size, device=self.contrast.device) for size in self.contrast.shape)
        is_disc = (rows[:, None] - y) ** 2 + (columns - x) ** 2 < (disc_filter.RING * radius) ** 2
        return self.silhouette.masked_fill(is_disc, 0.0), self.contrast


def candidates_in(scene: Scene, frame: int) -> list[Candidate]:
    """The best outlines in a frame, the one with the highest score first."""
    image = scene.image(frame)
    if bool(alike(image, image[0, 0]).all()):
        # A blank image differs from the background where the ball is in other images.
        return []
    seen = list(silhouettes(scene.images, frame, scene.count, scene.background, scene.ignore))
    found = _candidates(seen, scene.ignore)
    # Where the ball stood or will be, a silhouette may show more of a disc than at the ball itself.
    partial = [candidate for candidate in found if not scene.arcs(frame, candidate.circle).are_all_round]
    found += _candidates([candidate.rest() for candidate in partial], scene.ignore)
    return sorted(found, key=lambda c: -c.score)


def others(
    scene: Scene, frame: int, candidates: list[Candidate], best: Candidate
) -> tuple[tuple[float, float, float], ...]:
    """Circles of other objects that may be the ball: those in other silhouettes, and that beside the ``best`` one."""
    x, y, radius = best.circle.tolist()
    sizes = OTHER_SIZES[0] * radius, OTHER_SIZES[1] * radius
    beside = _candidates([best.rest()], scene.ignore, sizes)
    found: list[tuple[float, float, float]] = []
    for candidate in sorted(candidates + beside, key=lambda c: -c.score):
        at_x, at_y, size = candidate.circle.tolist()
        apart = all(math.hypot(at_x - u, at_y - v) > OTHER_DISTANCE * radius for u, v, _ in [(x, y, radius), *found])
        like_ball = OTHER_SIZES[0] < size / radius < OTHER_SIZES[1] and candidate.score > OTHER_SCORE * best.score
        if apart and like_ball and scene.arcs(frame, candidate.circle).are_all_round:
            found.append((at_x, at_y, size))
    return tuple(found)


def _candidates(
    seen: list[tuple[Tensor, Tensor]], ignore: Tensor | None, radii: tuple[float, float] = (0.0, math.inf)
) -> list[Candidate]:
    """The best outline in each of the silhouettes, ``seen`` with their contrasts, where one is good enough."""
    candidates: list[Candidate] = []
    if not seen:
        return candidates
    guesses = disc_filter.best_discs(torch.stack([silhouette for silhouette, _ in seen]), radii)
    for (silhouette, contrast), guess in zip(seen, guesses, strict=True):
        found = None if guess is None else _outline_of(silhouette, contrast, guess, ignore)
        if found is not None:
            fit, plain = found
            explained = disc_filter.explained_by(silhouette, fit.circle[0])
            if explained > disc_filter.MIN_EXPLAINED:
                candidates.append(Candidate(explained * float(fit.support[0]), fit, plain, silhouette, contrast))
    return candidates


def _outline_of(
    silhouette: Tensor, contrast: Tensor, guess: Tensor, ignore: Tensor | None
) -> tuple[OutlineFit, bool] | None:
    """The outline from a ``guess`` (1, 3), first in the silhouette, then in the image; True if the ball is plain."""
    coarse = outline_fit.refine(silhouette[None], guess, window=max(2.0, 0.08 * float(guess[0, 2])))
    if float(coarse.support[0]) < MIN_SUPPORT or not within(coarse.circle[0], silhouette.shape):
        return None
    if arcs_of(contrast, coarse.circle[0], ignore, slack=SLACK).share < MIN_PART:
        return None
    plain = outline_fit.is_plain(contrast, coarse.circle[0])
    fine = outline_fit.refine(contrast[None], coarse.circle, window=outline_fit.STEP_BLUR_PX, plain=plain)
    if float(fine.support[0]) < MIN_SUPPORT or not within(fine.circle[0], silhouette.shape):
        return None
    moved = float((fine.circle - coarse.circle).abs().max())
    if moved >= max(3.0, 0.04 * float(guess[0, 2])):
        return None
    return fine, plain


def within(circle: Tensor, shape: torch.Size) -> bool:
    """Whether the ``circle`` (3,) lies in an image of this ``shape`` (h, w), to about a pixel."""
    x, y, radius = circle.tolist()
    height, width = shape
    return min(x, y, width - 1 - x, height - 1 - y) > radius - 1.5
