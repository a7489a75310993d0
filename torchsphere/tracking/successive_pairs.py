"""Correlate successive images of a recording in one batch; each image is cut and filtered once, for both its pairs."""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from torchsphere.correlation.gauss_newton import CoarseSolution
from torchsphere.correlation.options import Options, margin
from torchsphere.correlation.reference import SLACK_PX, Filtered, Pairs
from torchsphere.correlation.result import Correlation
from torchsphere.correlation.solve import average_both_ways, explain, solve, solve_coarsely
from torchsphere.imaging import crop, interlacing
from torchsphere.runtime import threads
from torchsphere.tracking.prediction import circle_path

#: Error of a prediction, as a share of the radius, that ends its batch (docs/constants.toml).
PREDICTION_TOLERANCE = 0.1

#: Largest decrease of the radius from frame to frame, as a share of it (docs/constants.toml).
MOST_SHRINKING = 0.5


@dataclass(frozen=True)
class PairSetup:
    """Settings that all pairs of a recording share."""

    options: Options
    ignore: Tensor | None  # (h, w), True where the images are not to be used
    in_place: bool  # the ball turns without leaving its place: the region stays on the circle
    shared: threads.RowRunner  # shares rows out among threads: see `torchsphere.runtime.threads.row_runner`


@dataclass(frozen=True)
class PreparedBatch:
    """m pairs of successive images, filtered and coarsely correlated."""

    images: Tensor  # grey levels (m + 1, h, w)
    circles: Tensor  # expected circles (m + 1, 3), px, float64, on the CPU
    start: Tensor  # expected increments (m, 5), px and rad
    filtered: Filtered  # the images around the circles, by one of their fields where ``interlaced``
    interlaced: bool
    coarse: CoarseSolution  # coarse solution of the increments
    is_exact: bool  # circles and start are better than a coarse solution, which errs by a px and more at an occluder

    def circles_from(self, first: Tensor) -> Tensor:
        """Circles (m + 1, 3) from ``first`` (3,) on by the coarse solution, px, float64.

        Where something hides the ball, a wrong solution may even have a size below 0.
        """
        steps = self.coarse.q.to("cpu", torch.float64)
        growth = steps[:, 5].clamp_min(-MOST_SHRINKING) if steps.shape[-1] == 6 else torch.zeros_like(steps[:, 0])
        return circle_path(first, steps[:, :2], growth)


def prepare(
    images: Tensor, circles: Tensor, start: Tensor, setup: PairSetup, *, is_exact: bool = False
) -> PreparedBatch:
    """Prepare successive ``images`` (m + 1, h, w) of a ball expected at ``circles`` (m + 1, 3), moving by ``start``."""
    crops = _cut(images, circles, setup)
    interlaced = interlacing.is_interlaced(crops)
    filtered = _filter(crops, setup, interlaced)
    start = start.to(filtered.c)
    if is_exact:
        return PreparedBatch(images, circles, start, filtered, interlaced, CoarseSolution.none(start), is_exact)
    pairs = _pairs(filtered, circles)

    def solve_rows(a: int, b: int) -> CoarseSolution:
        return solve_coarsely(pairs.rows(a, b), start[a:b], setup.options)

    coarse = CoarseSolution.joined(setup.shared(solve_rows, len(start)))
    return PreparedBatch(images, circles, start, filtered, interlaced, coarse, is_exact)


def correlate_successive(batch: PreparedBatch, circle: Tensor, setup: PairSetup) -> tuple[Correlation, Tensor]:
    """Correlate a prepared batch, the ``circle`` (3,) known in its first image.

    Returns the motion of the first pairs, as many as are plausible, and the circles that their regions lay on.
    """
    filtered, circles = batch.filtered, batch.circles
    if not (batch.is_exact or setup.in_place):
        # The expected path errs by up to a few px at its end; the region has to be on the ball.
        circles, expected = batch.circles_from(circle), circles
        count = _count_plausible(batch.coarse, circles - expected, float(circle[2]))
        circles, expected = circles[: count + 1], expected[: count + 1]
        filtered = filtered.rows(0, count + 1)
        filtered = _filter_where_off(filtered, batch.images, circles, expected, setup, interlaced=batch.interlaced)
    pairs = _pairs(filtered, circles)
    coarse, start, targets = batch.coarse.q, batch.start, circles[1:]

    def measure(a: int, b: int) -> Correlation:
        return _measure(pairs.rows(a, b), coarse[a:b], start[a:b], targets[a:b], setup)

    found = Correlation.joined(setup.shared(measure, len(targets)))
    return dataclasses.replace(found, iterations=found.iterations + batch.coarse.iterations[: len(targets)]), circles


def correlate_one(pair: Tensor, circle: Tensor, start: Tensor, setup: PairSetup) -> Correlation:
    """Correlate two images (2, h, w), the ``circle`` (3,) known in the first, from ``start`` (5,)."""
    circles = torch.stack((circle, circle))
    circles[1, :2] += start[:2]
    return correlate_successive(prepare(pair, circles, start[None], setup), circle, setup)[0]


def explain_one(pair: Tensor, circle: Tensor, q: Tensor, setup: PairSetup) -> Tensor:
    """Share (2, c, c) of each cell of the ball that the motion ``q`` (5,) explains, before and after it."""
    circles = torch.stack((circle, circle))
    circles[1, :2] += q[:2].to(circles)
    batch = prepare(pair, circles, q[None], setup, is_exact=True)
    return explain(_pairs(batch.filtered, circles), batch.start, setup.options)[0]


def count_leading(good: NDArray[np.bool_]) -> int:
    """Number of rows before the first that is not good."""
    return int(good.cumprod().sum())


def _cut(images: Tensor, circles: Tensor, setup: PairSetup) -> crop.Crops:
    """Crops of the images (m + 1, h, w) around ``circles`` (m + 1, 3)."""
    half = crop.half_size(float(circles[:, 2].max()), margin(setup.options))
    return crop.cut(images, circles[:, :2], half, setup.ignore)


def _filter(crops: crop.Crops, setup: PairSetup, interlaced: bool) -> Filtered:
    """The filtered crops, reduced to one of their fields if ``interlaced``."""
    if interlaced:
        crops = interlacing.one_field(crops)

    def filter_rows(a: int, b: int) -> Filtered:
        return Filtered.of(crops.rows(a, b), setup.options.pre_blur)

    return Filtered.joined(setup.shared(filter_rows, len(crops.images)))


def _filter_where_off(
    filtered: Filtered, images: Tensor, circles: Tensor, expected: Tensor, setup: PairSetup, *, interlaced: bool
) -> Filtered:
    """``filtered`` images around ``expected`` circles (m + 1, 3), filtered anew from the first misplaced circle on.

    Images that were ``interlaced`` stay so: both images of a pair are reduced to a field, or neither.
    """
    off = (circles - expected).abs().amax(-1) > SLACK_PX
    first = count_leading(~off.numpy())
    if first == len(circles):
        return filtered
    again = _filter(_cut(images[first : len(circles)], circles[first:], setup), setup, interlaced)
    if again.c.shape[-1] != filtered.c.shape[-1]:
        # A ball that comes nearer needs larger crops, and all crops have one size.
        return _filter(_cut(images[: len(circles)], circles, setup), setup, interlaced)
    return Filtered.joined([filtered.rows(0, first), again])


def _pairs(images: Filtered, circles: Tensor) -> Pairs:
    """Each image but the last with the next; ``circles`` (m + 1, 3) in them."""
    m = len(circles) - 1
    return Pairs(images.rows(0, m), images.rows(1, m + 1), circles[:-1])


def _count_plausible(coarse: CoarseSolution, off: Tensor, radius: float) -> int:
    """Number of a batch's first pairs that may be confirmed; ``off`` (m + 1, 3) of the circles from the expected ones.

    After an impact no circle is at its expected place. To solve those pairs, only to discard them, would take most of
    the time of a short shot.
    """
    on_path = (off[:-1, :2].norm(dim=-1) < PREDICTION_TOLERANCE * radius).numpy()
    # The first pair that does not converge is tried: the full solution leaves out an occluder that may be the cause.
    return min(count_leading(on_path), 1 + count_leading(coarse.converged.cpu().numpy()), len(on_path))


def _measure(pairs: Pairs, coarse: Tensor, start: Tensor, targets: Tensor, setup: PairSetup) -> Correlation:
    """Motion of the pairs from ``coarse``, in both directions if fast; ``targets`` (m, 3) in images g."""
    found = solve(pairs, coarse, setup.options, start)
    if not setup.in_place:
        # The measured centre: an error of 2 px in the expected one makes errors of 0.06 px on the way back.
        centre = pairs.circles[:, :2] + found.q[:, :2].to(pairs.circles)
        size = pairs.circles[:, 2:] * (1 + found.growth[:, None].to(pairs.circles))
        arrived = torch.cat((centre, size), -1)
        targets = torch.where(arrived.isfinite() & (size > 0), arrived, targets)
    return average_both_ways(pairs, targets, found, setup.options)
