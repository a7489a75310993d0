"""Follow the ball from frame to frame: predict, correlate in batches, rescue what a batch cannot confirm.

The ball is expected to go on as it did, so a batch of pairs is correlated at once from the last increment, and what the
batch confirms is kept. Where it fails, at an impact, at the start, in a blank image, the one pair that comes next is
rescued: the ball is sought over the whole image, and the correlation tries several first guesses on small images.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from torchsphere import circle, crop, interlace, locate, motion, outline, parallel, search
from torchsphere.circle import MIN_SUPPORT, Circle
from torchsphere.correlate import STATUSES, Correlation, Pairs
from torchsphere.joint import ALONE, Solver
from torchsphere.newton import Approach
from torchsphere.options import Options, margin
from torchsphere.reference import SLACK_PX, Filtered
from torchsphere.rescue import ranked
from torchsphere.source import Source
from torchsphere.symmetric import both_ways

#: Pairs correlated at once. Measured on one thread: 8, 16 and 32 are within a tenth of each other, 64 leaves the
#: processor's cache; on two, which share a batch out, 32 takes 2.2 ms per frame and 16 takes 2.9.
BATCH = 32

#: Pairs of a batch from which the change of the increment from one to the next is believed as well. Fewer pairs of a
#: ball that trembles by 0.3 px would lead the path further astray than it goes without.
TREND_FROM = 16

#: First guesses that a search over rotations may try at full size.
TRIED = 3

#: Searches in vain from which the next one waits, and for which share of the frames since: a search takes up to
#: seconds, and in footage of no such ball each frame would have one.
PATIENT, WAITS = 4, 0.25

#: The reference's centre may be off by this much, times the rotation, before a pair is correlated again around the
#: right one: an error of 1 px changes the increment by 0.001 to 0.002 px at 0.01 rad, and as the rotation.
CENTRE_TOLERANCE_PX_RAD = 0.005

#: An error of the radius counts as much as this many times one of the centre.
RADIUS_COUNTS = 10.0

#: Motion of the ball's front per frame, px, from which two images of it cannot be the same bit for bit: one of them is
#: then a repetition and no measurement.
MOVES_PX = 0.05

#: Rows of the images between those that are compared first: two images that differ do so in some of these.
SPARSE = 16

#: A prediction that is off by more than this share of the radius ends its batch.
PREDICTION_TOLERANCE = 0.1

#: Height of the outline's step, against that of the last frame, below which the ball is not believed to be there.
MIN_CONTRAST = 0.4

#: Frames since the ball was last seen from which its outline alone will do, and how well its radius must be met.
RESTART_AFTER, RESTART_RADIUS = 3, 0.06

#: Share of the disc in the image below which a ball that was not measured counts as out of the frame.
MIN_IN_FRAME = 0.5

Progress = Callable[[int, int], None]


class Follower:
    """One pass over a recording: what has been measured, and the last frame in which the ball was seen.

    Attributes
    ----------
    position, increment, covariance, zncc, iterations, status
        As in `torchsphere.track.Track`.
    in_place : bool
        The ball turns where it is: its region stays on the circle, whatever the increments add up to.
    size : ndarray
        Radius (n,) of the ball in each frame, px; the same throughout but with the model `pinhole6`.
    sd_growth : ndarray
        Standard deviation (n - 1,) of its relative change from each frame to the next.
    uneven_light : ndarray
        (n,), True for a frame into which an object took light from one side of the ball.
    repeated : list of int
        Frames that repeat the image before them although the ball moves.
    rotation : ndarray
        Rotation vector (n, 3) of each frame since the frame in which the ball was seen before, rad.
    """

    def __init__(
        self,
        source: Source,
        first: Circle,
        ignore: Tensor | None,
        options: Options,
        *,
        progress: Progress | None = None,
        in_place: bool = False,
        searches: float = math.inf,
        solver: Solver = ALONE,
    ) -> None:
        self.in_place, self._solver = in_place, solver
        self.source, self.ignore, self.options, self.progress = source, ignore, options, progress
        n = source.count
        self.position: NDArray[np.float64] = np.full((n, 2), np.nan)
        self.increment: NDArray[np.float64] = np.full((n - 1, 5), np.nan)
        self.covariance: NDArray[np.float64] = np.full((n - 1, 5, 5), np.nan)
        self.rotation: NDArray[np.float64] = np.full((n, 3), np.nan)
        self.zncc: NDArray[np.float64] = np.full(n, np.nan)
        self.iterations: NDArray[np.int64] = np.zeros(n, dtype=np.int64)
        self.status: NDArray[np.str_] = np.full(n, "lost", dtype=f"<U{max(map(len, STATUSES))}")
        self.size: NDArray[np.float64] = np.full(n, np.nan)
        self.sd_growth: NDArray[np.float64] = np.full(n - 1, np.nan)
        self.uneven_light: NDArray[np.bool_] = np.zeros(n, dtype=bool)
        self.repeated: list[int] = []
        self.position[first.frame] = first.x, first.y
        self.size[first.frame] = first.radius
        self.status[first.frame] = "ok"
        self._searches = searches
        #: Frames that were searched in vain since the ball was seen.
        self._in_vain: list[int] = []
        self._shared: parallel.Run = lambda part, rows: [part(0, rows)]
        self._first = self._last = first.frame
        self._image = source.images(first.frame, first.frame + 1)
        self._expected = self._trend = torch.zeros(5, dtype=torch.float64)
        self._growth = 0.0
        outline_circle = torch.tensor([first.x, first.y, first.radius], dtype=torch.float64)
        self._plain = outline.is_plain(self._image[0], outline_circle)

    @property
    def radius(self) -> float:
        """Radius of the ball where it was last seen, px."""
        return float(self.size[self._last])

    def run(self, stop: int) -> Follower:
        """Measure frame after frame up to ``stop``, in batches that grow while they succeed."""
        with parallel.sharing(self.source.device) as self._shared:
            return self._run(stop)

    def _run(self, n: int) -> Follower:
        at, size = self._last + 1, 1
        while at < n:
            asked = min(size, n - at)
            confirmed = self._advance(asked) if size > 1 else 0
            if confirmed:
                size = min(2 * size, BATCH) if confirmed == asked else max(2, confirmed)
            else:
                self._rescue(at)
                confirmed = 1
                # After a frame that was not measured there is no pair of successive images to go on from.
                size = 2 if self.status[at] == "ok" else 1
            at += confirmed
            if self.progress is not None:
                self.progress(at, n)
        return self

    def _advance(self, count: int) -> int:
        """Correlate the next ``count`` pairs from the expected increments -> how many of the first ones succeeded."""
        # The last image is read once more: to put it in front of the others would copy all of them.
        images = self.source.images(self._last, self._last + 1 + count)
        steps = torch.arange(count + 1, dtype=torch.float64)[:, None]
        expected = self._expected + steps[1:] * self._trend
        moving = torch.zeros_like(expected[:, :2]) if self.in_place else expected[:, :2]
        path = torch.from_numpy(self.position[self._last]) + torch.cat((torch.zeros_like(moving[:1]), moving.cumsum(0)))
        predicted = torch.cat((path, self.radius * (1 + self._growth) ** steps), -1)
        found, centred = self._correlate(images, predicted, expected)
        actual = self._arrived(found)
        images, predicted = images[: len(actual)], predicted[: len(actual)]
        strayed = (actual - predicted)[:-1, :2].norm(dim=-1) >= PREDICTION_TOLERANCE * self.radius
        believed = ~(strayed.numpy() | self._repeats(images))
        good = _leading((found.status == "ok") & believed)
        away = actual[:-1] - centred[:-1]
        off = away[:, :2].norm(dim=-1) + RADIUS_COUNTS * away[:, 2].abs()
        turn = found.q[:, 2:].norm(dim=-1).double().cpu().clamp_min(0.01)
        if good and float((off * turn)[:good].max()) > CENTRE_TOLERANCE_PX_RAD:
            again = found.q[:good].double().cpu()
            found, _ = self._correlate(images[: good + 1], actual[: good + 1], again, approached=True)
            good = _leading(found.status == "ok")
        if good:
            self._keep(found, good, images[good : good + 1])
        return good

    def _correlate(
        self, images: Tensor, circles: Tensor, start: Tensor, *, approached: bool = False
    ) -> tuple[Correlation, Tensor]:
        """Correlate successive ``images`` (m + 1, h, w) of the ball at ``circles``, from increments ``start`` (m, 5).

        Returns the motion of those pairs that are worth it, the first ones, and the circles that the regions lay on in
        the end. Every image but the first and the last serves as deformed image and then as reference: it is filtered
        once. With ``approached`` circles and start are known well, and better than a rough look can tell: an occluder
        deceives that by a px and more.
        """
        filtered = self._filtered(images, circles)
        pairs, start = _pairs(filtered, circles), start.to(filtered.c)
        approach = Approach.none(start)
        if not approached:
            approach = self._brought_near(pairs, start)
            if not self.in_place:
                # The path that was expected is off by up to a few px at its end; the region has to be on the ball.
                circles, before = self._path(circles[0], approach.near), circles
                count = self._worth_solving(approach, circles - before)
                circles = circles[: count + 1]
                if float((circles - before[: count + 1]).abs().max()) > SLACK_PX:
                    filtered = self._filtered(images[: count + 1], circles)
                pairs = _pairs(filtered, circles)
        near, there = approach.near, circles[1:]

        def measured(a: int, b: int) -> Correlation:
            return self._measured(pairs.rows(a, b), near[a:b], start[a:b], there[a:b])

        found = Correlation.joined(self._shared(measured, len(there)))
        return dataclasses.replace(found, iterations=found.iterations + approach.steps[: len(there)]), circles

    def _brought_near(self, pairs: Pairs, start: Tensor) -> Approach:
        """From ``start`` (m, 5) to near the increments sought."""

        def brought_near(a: int, b: int) -> Approach:
            return self._solver.approach(pairs.rows(a, b), start[a:b], self.options)

        return Approach.joined(self._shared(brought_near, len(start)))

    def _worth_solving(self, approach: Approach, off: Tensor) -> int:
        """How many of a batch's first rows may be confirmed, the circles being ``off`` (m + 1, 3) what was expected.

        Behind an impact nothing is where it was expected. To solve those rows, and to judge what does not agree in each
        of them, took three quarters of the time of a shot of 70 frames, only to give them up.
        """
        on_path = (off[:-1, :2].norm(dim=-1) < PREDICTION_TOLERANCE * self.radius).numpy()
        # The first row that does not come to rest is tried: an occluder may be the cause, which judging leaves out.
        return min(_leading(on_path), 1 + _leading(approach.at_rest.cpu().numpy()), len(on_path))

    def _measured(self, pairs: Pairs, near: Tensor, start: Tensor, there: Tensor) -> Correlation:
        """Motion of the pairs from ``near``, in both directions where they turn fast; the ball is ``there`` (m, 3)."""
        found = self._solver.solve(pairs, near, self.options, start)
        if not self.in_place:
            # The centre that the way there found, not the one that was expected: 2 px off made errors of 0.06 px.
            centre = pairs.circles[:, :2] + found.q[:, :2].to(pairs.circles)
            size = pairs.circles[:, 2:] * (1 + found.growth[:, None].to(pairs.circles))
            arrived = torch.cat((centre, size), -1)
            there = torch.where(arrived.isfinite(), arrived, there)
        return both_ways(pairs, there, found, self.options, self._solver)

    def _filtered(self, images: Tensor, circles: Tensor) -> Filtered:
        """Crops of the images (m + 1, h, w) around ``circles`` (m + 1, 3)."""
        half = crop.half_size(float(circles[:, 2].max()), margin(self.options))
        crops = crop.cut(images, circles[:, :2], half, self.ignore)
        if interlace.is_interlaced(crops):
            crops = interlace.one_field(crops)

        def filtered(a: int, b: int) -> Filtered:
            return Filtered.of(crops.rows(a, b), self.options.pre_blur)

        return Filtered.joined(self._shared(filtered, len(crops.images)))

    def _path(self, first: Tensor, near: Tensor) -> Tensor:
        """The ball (m + 1, 3) where the unknowns ``near`` (m, k) lead it from ``first`` (3,): px, float64."""
        steps = near.to("cpu", torch.float64)
        grown = 1 + (steps[:, 5:6] if steps.shape[-1] == 6 else torch.zeros(len(steps), 1, dtype=torch.float64))
        path = torch.cat((steps[:, :2].cumsum(0) + first[:2], grown.cumprod(0) * first[2]), -1)
        return torch.cat((first[None], path))

    def _arrived(self, found: Correlation) -> Tensor:
        """The ball (m + 1, 3) where the increments lead it, from the last known frame: px, float64."""
        steps = torch.cat((torch.zeros(1, 2, dtype=torch.float64), found.q[:, :2].double().cpu()))
        if self.in_place:
            steps = torch.where(steps.isfinite(), 0.0, steps)
        path = torch.from_numpy(self.position[self._last]) + steps.cumsum(0)
        growth = torch.cat((torch.zeros(1, dtype=torch.float64), found.growth.double().cpu()))
        return torch.cat((path, self.radius * (1 + growth).cumprod(0)[:, None]), -1)

    def _keep(self, found: Correlation, count: int, image: Tensor) -> None:
        """Write ``count`` confirmed pairs down and go on from the last of them."""
        self._in_vain = []
        rows = slice(self._last, self._last + count)
        after = slice(self._last + 1, self._last + 1 + count)
        self.increment[rows] = found.q[:count].double().cpu().numpy()
        self.sd_growth[rows] = found.sd_growth[:count].double().cpu().numpy()
        self.covariance[rows] = found.covariance[:count].cpu().numpy()
        arrived = self._arrived(found)[1 : count + 1].numpy()
        self.position[after], self.size[after] = arrived[:, :2], arrived[:, 2]
        self.rotation[after] = self.increment[rows, 2:]
        self.zncc[after] = found.zncc[:count].cpu().numpy()
        self.uneven_light[after] = found.uneven_light[:count].cpu().numpy()
        self.iterations[after] = found.iterations[:count].cpu().numpy()
        self.status[after] = "ok"
        measured = self.increment[rows]
        self._go_on_from(self._last + count, image, measured[-1], float(found.growth[count - 1]))
        if count >= TREND_FROM:
            times = np.arange(1 - count, 1)
            self._trend, self._expected = (torch.from_numpy(v) for v in np.polyfit(times, measured, 1))

    def _go_on_from(self, frame: int, image: Tensor, increment: NDArray[np.float64], growth: float = 0.0) -> None:
        """Take ``frame`` as the last in which the ball was seen, and what comes next as moving by ``increment``."""
        self._last, self._image = frame, image
        self._expected, self._growth = torch.from_numpy(np.nan_to_num(increment)), growth
        self._trend = torch.zeros_like(self._expected)

    def _repeats(self, images: Tensor) -> NDArray[np.bool_]:
        """Which of the images (m + 1, h, w) after the first repeat the one before (m,), while the ball moves."""
        dx, dy, wx, wy, wz = self._expected.tolist()
        front = math.hypot(dx - self.radius * wy, dy + self.radius * wx, self.radius * wz)
        if max(front, math.hypot(dx, dy)) <= MOVES_PX:
            return np.zeros(len(images) - 1, dtype=bool)
        same = (images[1:, ::SPARSE] == images[:-1, ::SPARSE]).flatten(1).all(-1)
        if bool(same.any()):
            same = (images[1:] == images[:-1]).flatten(1).all(-1)
        return same.cpu().numpy()

    def _rescue(self, at: int) -> None:
        """Measure frame ``at`` against the last one in which the ball was seen, from scratch, and note its status."""
        target = self.source.images(at, at + 1)
        here = torch.from_numpy(self.position[self._last])
        pair = torch.cat((self._image, target))
        if self._repeats(pair)[0]:
            self.status[at] = "lost"
            self.repeated.append(at)
            return
        seen = here if self.in_place else locate.best_match(pair[0], pair[1], here, self.radius, self.ignore)
        found = self._from_scratch(at, pair, here, seen)
        status = str(found.status[0])
        self.status[at], self.zncc[at], self.iterations[at] = status, float(found.zncc[0]), int(found.iterations[0])
        if status == "ok" and at == self._last + 1:
            self._keep(found, 1, target)
        elif status == "ok":
            self._found_again(at, here + found.q[0, :2].double().cpu(), target, found)
        elif status == "weak_texture":
            # A ball with a pattern does not lose it: it is hidden, or not there. What is not plain looks like itself.
            alike = self._plain or float(found.zncc[0]) >= self.options.min_zncc
            if alike and not (self.status[1:] == "ok").any():
                self._by_outline(at, pair, here, seen)
            else:
                self.status[at] = "low_correlation"
        if np.isnan(self.position[at, 0]) and at - self._last >= RESTART_AFTER:
            self._restart(at, target)
        if np.isnan(self.position[at, 0]):
            # Where the ball should be, not where something in the image is least unlike it.
            if self._in_frame(here + self._expected[:2] * (at - self._last)) < MIN_IN_FRAME:
                self.status[at] = "out_of_frame"
            elif self.status[at] == "out_of_frame":
                self.status[at] = "lost"

    def _from_scratch(self, at: int, pair: Tensor, here: Tensor, seen: Tensor) -> Correlation:
        """Correlate one pair from the best of a few first guesses; if that fails, from a search over rotations."""
        expected = self._expected * (at - self._last)
        unturned = torch.cat((seen - here, torch.zeros(3, dtype=torch.float64)))
        turned = torch.cat((seen - here, expected[2:]))
        starts = torch.stack((unturned, turned, expected, torch.zeros_like(expected)))
        best = ranked(pair, here, self.radius, starts, self.ignore, self.options)
        found = self._correlate_one(pair, here, best[0] if len(best) else unturned)
        gone = self._in_frame(here + expected[:2]) < MIN_IN_FRAME
        # A plain ball has nothing to be sought by.
        plain = self._plain and found.status[0] == "weak_texture"
        if (
            found.status[0] == "ok"
            or gone
            or plain
            or motion.MODELS[self.options.model] not in (motion.rigid, *motion.EXACT)
            or not self._may_search(at)
        ):
            return found
        wide = search.guesses(pair[0], pair[1], here, self.radius, self.ignore)
        if self.in_place:
            wide[:, :2] = 0
        if len(wide) == 0:
            return found
        for start in ranked(pair, here, self.radius, wide, self.ignore, self.options)[:TRIED]:
            again = self._correlate_one(pair, here, start)
            if again.status[0] == "ok":
                return again
        return found

    def _may_search(self, at: int) -> bool:
        """Whether frame ``at`` is worth a search over rotations, which counts as one in vain until the ball is seen."""
        if len(self._in_vain) >= self._searches:
            return False
        if len(self._in_vain) >= PATIENT:
            first, last = self._in_vain[0], self._in_vain[-1]
            if at - last < WAITS * (last - first):
                return False
        self._in_vain.append(at)
        return True

    def _correlate_one(self, pair: Tensor, here: Tensor, start: Tensor) -> Correlation:
        path = torch.stack((here, here + start[:2]))
        return self._correlate(pair, torch.cat((path, torch.full((2, 1), self.radius)), -1), start[None])[0]

    def _found_again(self, at: int, position: Tensor, image: Tensor, found: Correlation) -> None:
        """Go on after a gap: position and orientation are known again, the increment that leads here is not."""
        self._in_vain = []
        self.position[at] = self.position[self._last] if self.in_place else position.numpy()
        self.size[at] = self.radius * (1 + float(found.growth[0]))
        self.rotation[at] = found.q[0, 2:].double().cpu().numpy()
        self.status[at] = "lost"
        self._go_on_from(at, image, found.q[0].double().cpu().numpy() / (at - self._last))

    def _restart(self, at: int, image: Tensor) -> None:
        """Go on with a ball that shows another side by now: its outline tells the position, nothing the rotation."""
        if self.in_place:
            return
        try:
            found = circle.find(lambda start, stop: image[start:stop], 1, self.ignore)
        except ValueError:
            return
        if abs(found.radius - self.radius) > RESTART_RADIUS * self.radius:
            return
        guess = torch.tensor([[found.x, found.y, self.radius]], dtype=torch.float64)
        fit = outline.refine(
            image,
            guess,
            ignore=self.ignore,
            window=outline.STEP_BLUR_PX,
            fixed_radius=True,
            camera=self.options.camera,
        )
        if float(fit.support[0]) >= MIN_SUPPORT:
            self.position[at], self.size[at] = fit.circle[0, :2].numpy(), self.radius
            self.status[at] = "lost"
            self._go_on_from(at, image, np.full(5, np.nan))

    def _by_outline(self, at: int, pair: Tensor, here: Tensor, seen: Tensor) -> None:
        """Translation of a ball whose texture cannot carry the modes, from the outlines of both images."""
        guesses = torch.cat((torch.stack((here, seen)), torch.full((2, 1), self.radius)), -1)
        fit = outline.refine(
            pair,
            guesses,
            ignore=self.ignore,
            window=max(2.0, 0.06 * self.radius),
            fixed_radius=True,
            plain=self._plain,
            camera=self.options.camera,
        )
        there = (fit.support >= MIN_SUPPORT).all() and fit.contrast[1] > MIN_CONTRAST * fit.contrast[0]
        if not bool(there):
            self.status[at] = "lost"
            return
        step, covariance = outline.centre_step(fit)
        consecutive = at == self._last + 1
        increment = np.full(5, np.nan)
        increment[:2] = step.numpy()
        if consecutive:
            self.increment[at - 1] = increment
            self.covariance[at - 1, :2, :2] = covariance.numpy()
        self.position[at], self.size[at] = (here if self.in_place else here + step).numpy(), self.radius
        self.status[at] = "weak_texture" if consecutive else "lost"
        if self._last == self._first:
            self.status[self._first] = "weak_texture"
        self._go_on_from(at, pair[1:], increment / (at - self._last))

    def _in_frame(self, centre: Tensor) -> float:
        """Share of the disc around ``centre`` that lies in the image."""
        height, width = self._image.shape[-2:]
        steps = torch.linspace(-1, 1, 41, dtype=torch.float64)
        y, x = torch.meshgrid(steps, steps, indexing="ij")
        disc = x**2 + y**2 <= 1
        x, y = centre[0] + self.radius * x[disc], centre[1] + self.radius * y[disc]
        return float(((x >= 0) & (x <= width - 1) & (y >= 0) & (y <= height - 1)).double().mean())


def _pairs(images: Filtered, circles: Tensor) -> Pairs:
    """Each of the first images with the next; ``circles`` (m + 1, 3) of the ball in them."""
    m = len(circles) - 1
    return Pairs(images.rows(0, m), images.rows(1, m + 1), circles[:-1])


def _leading(good: NDArray[np.bool_]) -> int:
    """How many of the first rows are all good."""
    return int(good.cumprod().sum())
