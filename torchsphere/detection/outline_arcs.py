"""Whether an outline is there all round: arcs of a circle in which the image changes at the circle, and not beside it.

Speckles have edges at all distances from the centre, and soft light has none. In each arc the likelihood ratio of a
change of level or variance is looked at for every distance from the circle: an outline changes the image at the circle.
"""

from __future__ import annotations

from dataclasses import dataclass

import torch
from torch import Tensor

from torchsphere.imaging import polar

#: Number of arcs around a circle; each is looked at with its halves of both neighbours.
ARCS = 16

#: Share of the arcs that an outline seen all round shows, and most arcs in a row that it may lack
#: (docs/constants.toml).
MIN_SEEN, MAX_GAP = 0.8, 3

#: Least share of the arcs that must lie in the image.
MIN_KNOWN = 0.5

#: Least logarithm of the likelihood ratio of a change at the circle, and least share of the largest one beside it
#: (docs/constants.toml).
MIN_LOG_RATIO, MIN_OF_LARGEST = 2.0, 0.6

#: Distance of a change that is at the circle, px and share of the radius (docs/constants.toml).
AT_CIRCLE_PX, AT_CIRCLE = 1.0, 0.02

#: Reach to both sides, share of the radius, with its limits inwards and outwards, px, and largest share inwards.
REACH, INWARDS_PX, OUTWARDS_PX, MOST_INWARDS = 0.3, (8.0, 14.0), (7.0, 14.0), 0.8

#: Distance of the places on a ray, px, and pixels whose levels count as one: texture and interpolation join neighbours.
SPACING_PX, PIXELS_PER_VALUE = 0.5, 6.0

#: Least variance on one side, as a share of that without a change: images without noise have none.
LEAST_VARIANCE = 1e-3


@dataclass(frozen=True)
class Arcs:
    """Which arcs of a circle lie in the image, and which of them show an outline."""

    known: Tensor  # (a,) bool
    seen: Tensor  # (a,) bool

    @property
    def share(self) -> float:
        """Share of the arcs in the image that show an outline."""
        return float(self.seen.sum() / self.known.sum().clamp_min(1))

    @property
    def are_all_round(self) -> bool:
        """Whether the outline is there all round, as far as the image shows it."""
        return self.share >= MIN_SEEN and self.are_uncovered

    @property
    def are_uncovered(self) -> bool:
        """Whether no long part of the outline is missing; arcs here and there may be."""
        gap = longest = 0
        for lacks in (self.known & ~self.seen).repeat(2).tolist():
            gap = gap + 1 if lacks else 0
            longest = max(longest, gap)
        return float(self.known.double().mean()) >= MIN_KNOWN and longest <= MAX_GAP


def arcs_of(image: Tensor, circle: Tensor, ignore: Tensor | None = None, *, slack: float = 1.0) -> Arcs:
    """Arcs of the ``circle`` (3,), px, in ``image`` (h, w); with more ``slack`` the circle may be less exact."""
    radius = float(circle[2])
    inwards, outwards = (min(max(REACH * radius, least), most) for least, most in (INWARDS_PX, OUTWARDS_PX))
    inwards = min(inwards, MOST_INWARDS * radius)
    steps = torch.arange(-inwards, outwards, SPACING_PX, dtype=torch.float64)
    angles = polar.angles(radius)
    levels, inside = polar.across_edge(polar.Splines(image[None], ignore), circle[None], steps, angles, None)
    rays = _rays_of_arcs(len(angles)) * inside[0]
    counts = rays.sum(-1)
    known = counts > 0.5 * rays.shape[1] / ARCS
    shares = rays / counts.clamp_min(1)[:, None]
    levels = levels[0].double().cpu()
    mean, square = shares @ levels, shares @ levels.square()
    ratio = _log_ratios(mean, square - mean.square(), steps / (inwards + outwards))
    ratio = ratio * (counts * SPACING_PX / (2 * PIXELS_PER_VALUE))[:, None]
    change = 0.5 * (steps[1:] + steps[:-1])[EDGE - 1 : 1 - EDGE]
    at_circle = ratio[:, change.abs() <= slack * max(AT_CIRCLE_PX, AT_CIRCLE * radius)].amax(-1)
    seen = known & (at_circle > MIN_LOG_RATIO) & (at_circle > MIN_OF_LARGEST * ratio.amax(-1))
    return Arcs(known, seen)


#: Places on each side of a change that its likelihood needs.
EDGE = 4


def _rays_of_arcs(count: int) -> Tensor:
    """Share (a, count) of each ray in each arc: 1 for the rays of an arc and of the halves beside it."""
    places = (torch.arange(count) + 0.5) * (ARCS / count)
    apart = (places - torch.arange(ARCS)[:, None] - 0.5 + ARCS / 2).remainder(ARCS) - ARCS / 2
    return (apart.abs() <= 1.0).double()


def _log_ratios(mean: Tensor, scatter: Tensor, steps: Tensor) -> Tensor:
    """Logarithm (a, k) of the likelihood ratio of a change between two places, per place, for each of k changes.

    ``mean`` and ``scatter`` (a, m): mean and variance of the levels along an arc at the distances ``steps`` (m,). With
    a change, level and variance differ on both sides; with and without it, the level rises evenly across the arc.
    """
    count = len(steps)
    trend = torch.stack((torch.ones_like(steps), steps), -1)
    steady = _left_over(trend) @ mean.T  # (m, a)
    variance = (steady.square() + scatter.T).mean(0)
    least = LEAST_VARIANCE * variance
    inner = (torch.arange(count) < torch.arange(EDGE, count - EDGE + 1)[:, None]).double()  # (k, m)
    designs = torch.cat((trend.expand(len(inner), -1, -1), inner[..., None]), -1)
    squares = (_left_over(designs) @ mean.T).square() + scatter.T  # (k, m, a)
    share = inner.mean(-1, keepdim=True)
    inside = (inner[..., None] * squares).mean(1) / share
    outside = ((1 - inner)[..., None] * squares).mean(1) / (1 - share)
    inside, outside = torch.maximum(inside, least), torch.maximum(outside, least)
    ratio = variance.log() - share * inside.log() - (1 - share) * outside.log()
    return (0.5 * count * ratio).T.nan_to_num(0.0)


def _left_over(designs: Tensor) -> Tensor:
    """Matrices (..., m, m) that leave of values (m,) what a combination of the columns of (..., m, k) does not hold."""
    return torch.eye(designs.shape[-2], dtype=designs.dtype) - designs @ torch.linalg.pinv(designs)
