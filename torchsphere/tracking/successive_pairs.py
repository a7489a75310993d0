"""Correlate successive images of a recording in one batch; each is cut and filtered once, for both of its pairs."""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from torchsphere.correlation.forward_backward import both_ways
from torchsphere.correlation.gauss_newton import Approach
from torchsphere.correlation.options import Options, margin
from torchsphere.correlation.pairs import Pairs
from torchsphere.correlation.reference import SLACK_PX, Filtered
from torchsphere.correlation.result import Correlation
from torchsphere.correlation.solve import approach, solve
from torchsphere.imaging import crop, interlacing
from torchsphere.runtime import threads
from torchsphere.tracking.prediction import path

#: A prediction that is off by more than this share of the radius ends its batch.
PREDICTION_TOLERANCE = 0.1


@dataclass(frozen=True)
class Setup:
    """What all pairs of a recording are measured with.

    Attributes
    ----------
    options : Options
    ignore : Tensor or None
        (h, w), True where the images are not to be used.
    in_place : bool
        The ball turns where it is: its region stays on the circle, whatever the increments add up to.
    shared : callable
        Shares rows out among threads: see `torchsphere.runtime.threads.sharing`.
    """

    options: Options
    ignore: Tensor | None
    in_place: bool
    shared: threads.Run


@dataclass(frozen=True)
class Look:
    """A rough look at m pairs of successive images.

    Attributes
    ----------
    images : Tensor
        Grey levels (m + 1, h, w).
    balls : Tensor
        Where the ball was expected (m + 1, 3), px, float64, on the CPU.
    start : Tensor
        Increments (m, 5) that were expected, px and rad.
    filtered : Filtered
        The images around the expected balls, by one of their fields where they are ``interlaced``. Every image but the
        first and the last serves as deformed image and then as reference: it is filtered once.
    interlaced : bool
    approach : Approach
        From the expected increments to near those sought.
    approached : bool
        Balls and start were known well, and better than a rough look can tell: an occluder deceives that by a px and
        more. ``approach`` is where it started.
    """

    images: Tensor
    balls: Tensor
    start: Tensor
    filtered: Filtered
    interlaced: bool
    approach: Approach
    approached: bool

    def led(self, ball: Tensor) -> Tensor:
        """The ball (m + 1, 3) where the look leads it, from ``ball`` (3,) in the first image on: px, float64."""
        steps = self.approach.near.to("cpu", torch.float64)
        return path(ball, steps[:, :2], steps[:, 5] if steps.shape[-1] == 6 else torch.zeros_like(steps[:, 0]))


def look(images: Tensor, balls: Tensor, start: Tensor, setup: Setup, *, approached: bool = False) -> Look:
    """Look at successive ``images`` (m + 1, h, w), the ball expected at ``balls`` (m + 1, 3) and to move by ``start``.

    With ``approached`` they are filtered and taken as they are: see `Look.approached`.
    """
    crops = _cut(images, balls, setup)
    interlaced = interlacing.is_interlaced(crops)
    filtered = _filtered(crops, setup, interlaced)
    start = start.to(filtered.c)
    approach = Approach.none(start) if approached else _brought_near(_pairs(filtered, balls), start, setup)
    return Look(images, balls, start, filtered, interlaced, approach, approached)


def correlate_successive(seen: Look, ball: Tensor, setup: Setup) -> tuple[Correlation, Tensor]:
    """Correlate the images that a `look` was taken at, with the ``ball`` (3,) known in the first of them.

    Returns the motion of those pairs that are worth it, the first ones, and the circles that the regions lay on in the
    end.
    """
    filtered, balls, approach = seen.filtered, seen.balls, seen.approach
    if not (seen.approached or setup.in_place):
        # The path that was expected is off by up to a few px at its end; the region has to be on the ball.
        balls, before = seen.led(ball), balls
        count = _worth_solving(approach, balls - before, float(ball[2]))
        balls, before = balls[: count + 1], before[: count + 1]
        filtered = filtered.rows(0, count + 1)
        filtered = _filtered_where_off(filtered, seen.images, balls, before, setup, interlaced=seen.interlaced)
    pairs = _pairs(filtered, balls)
    near, start, there = approach.near, seen.start, balls[1:]

    def measured(a: int, b: int) -> Correlation:
        return _measured(pairs.rows(a, b), near[a:b], start[a:b], there[a:b], setup)

    found = Correlation.joined(setup.shared(measured, len(there)))
    return dataclasses.replace(found, iterations=found.iterations + approach.steps[: len(there)]), balls


def correlate_one(pair: Tensor, ball: Tensor, start: Tensor, setup: Setup) -> Correlation:
    """Correlate two images (2, h, w), the ball (3,) known in the first, from ``start`` (5,)."""
    balls = torch.stack((ball, ball))
    balls[1, :2] += start[:2]
    return correlate_successive(look(pair, balls, start[None], setup), ball, setup)[0]


def leading(good: NDArray[np.bool_]) -> int:
    """How many of the first rows are all good."""
    return int(good.cumprod().sum())


def _cut(images: Tensor, balls: Tensor, setup: Setup) -> crop.Crops:
    """Crops of the images (m + 1, h, w) around ``balls`` (m + 1, 3)."""
    half = crop.half_size(float(balls[:, 2].max()), margin(setup.options))
    return crop.cut(images, balls[:, :2], half, setup.ignore)


def _filtered(crops: crop.Crops, setup: Setup, interlaced: bool) -> Filtered:
    """The crops filtered, by one of their fields where they are ``interlaced``."""
    if interlaced:
        crops = interlacing.one_field(crops)

    def filtered(a: int, b: int) -> Filtered:
        return Filtered.of(crops.rows(a, b), setup.options.pre_blur)

    return Filtered.joined(setup.shared(filtered, len(crops.images)))


def _filtered_where_off(
    filtered: Filtered, images: Tensor, balls: Tensor, before: Tensor, setup: Setup, *, interlaced: bool
) -> Filtered:
    """``filtered`` around the balls ``before`` (m + 1, 3), anew from the first image on that this does not suit.

    What was ``interlaced`` for all images is so for those anew: of a pair, both images are taken by a field or none.
    """
    off = (balls - before).abs().amax(-1) > SLACK_PX
    first = leading(~off.numpy())
    if first == len(balls):
        return filtered
    again = _filtered(_cut(images[first : len(balls)], balls[first:], setup), setup, interlaced)
    if again.c.shape[-1] != filtered.c.shape[-1]:
        # A ball that comes nearer needs larger crops, and all images those of one size.
        return _filtered(_cut(images[: len(balls)], balls, setup), setup, interlaced)
    return Filtered.joined([filtered.rows(0, first), again])


def _pairs(images: Filtered, balls: Tensor) -> Pairs:
    """Each of the first images with the next; ``balls`` (m + 1, 3) in them."""
    m = len(balls) - 1
    return Pairs(images.rows(0, m), images.rows(1, m + 1), balls[:-1])


def _brought_near(pairs: Pairs, start: Tensor, setup: Setup) -> Approach:
    """From ``start`` (m, 5) to near the increments sought."""

    def brought_near(a: int, b: int) -> Approach:
        return approach(pairs.rows(a, b), start[a:b], setup.options)

    return Approach.joined(setup.shared(brought_near, len(start)))


def _worth_solving(approach: Approach, off: Tensor, radius: float) -> int:
    """How many of a batch's first rows may be confirmed, the circles being ``off`` (m + 1, 3) what was expected.

    Behind an impact nothing is where it was expected. To solve those rows, and to judge what does not agree in each of
    them, took three quarters of the time of a shot of 70 frames, only to give them up.
    """
    on_path = (off[:-1, :2].norm(dim=-1) < PREDICTION_TOLERANCE * radius).numpy()
    # The first row that does not come to rest is tried: an occluder may be the cause, which judging leaves out.
    return min(leading(on_path), 1 + leading(approach.at_rest.cpu().numpy()), len(on_path))


def _measured(pairs: Pairs, near: Tensor, start: Tensor, there: Tensor, setup: Setup) -> Correlation:
    """Motion of the pairs from ``near``, in both directions where they turn fast; the ball is ``there`` (m, 3)."""
    found = solve(pairs, near, setup.options, start)
    if not setup.in_place:
        # The centre that the way there found, not the one that was expected: 2 px off made errors of 0.06 px.
        centre = pairs.circles[:, :2] + found.q[:, :2].to(pairs.circles)
        size = pairs.circles[:, 2:] * (1 + found.growth[:, None].to(pairs.circles))
        arrived = torch.cat((centre, size), -1)
        there = torch.where(arrived.isfinite(), arrived, there)
    return both_ways(pairs, there, found, setup.options)
