"""Follow the ball from frame to frame: predict, correlate in batches, rescue what a batch cannot confirm.

The ball is expected to go on as it did (`prediction`), so a batch of pairs is correlated at once from the last
increment (`successive_pairs`), and what the batch confirms is kept (`record`). Where it fails, at an
impact, at the start, in a blank image, the one pair that comes next is measured by itself (`recovery`).
"""

from __future__ import annotations

import contextlib
import dataclasses
import math
from collections.abc import Callable

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from torchsphere.correlation.options import Options
from torchsphere.correlation.result import Correlation
from torchsphere.detection import outline_fit
from torchsphere.geometry.circle import Circle
from torchsphere.recording.frame_source import Source
from torchsphere.runtime import threads
from torchsphere.tracking import recovery
from torchsphere.tracking.prediction import Seen, path, repeats, trend
from torchsphere.tracking.prefetch import Ahead
from torchsphere.tracking.record import Record
from torchsphere.tracking.successive_pairs import PREDICTION_TOLERANCE, Setup, correlate_successive, leading
from torchsphere.tracking.successive_pairs import look as looked_at

#: Pairs correlated at once. Measured on one thread: 2,000 frames take as long in batches of 32, 64 and 96. What is
#: expected of the last of 64 is so far off that many are measured again.
BATCH = 32

#: Pairs of a batch from which the change of the increment from one to the next is believed as well. Fewer pairs of a
#: ball that trembles by 0.3 px would lead the path further astray than it goes without.
TREND_FROM = 16

#: The reference's centre may be off by this much, times the rotation, before a pair is correlated again around the
#: right one: an error of 1 px changes the increment by 0.001 to 0.002 px at 0.01 rad, and as the rotation.
CENTRE_TOLERANCE_PX_RAD = 0.005

#: An error of the radius counts as much as this many times one of the centre.
RADIUS_COUNTS = 10.0

#: Frames since the ball was last seen from which its outline alone will do.
RESTART_AFTER = 3

Progress = Callable[[int, int], None]


class Follower:
    """One pass over a recording: what has been measured, and the last frame in which the ball was seen.

    Attributes
    ----------
    record : Record
        What is known of each frame.
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
    ) -> None:
        self.record = Record.empty(source.count, first)
        self._source, self._progress, self._first, self._searches = source, progress, first.frame, searches
        self._setup = Setup(options, ignore, in_place, shared=lambda part, rows: [part(0, rows)])
        image = source.images(first.frame, first.frame + 1)
        self._seen = self._seen_in(first.frame, image, np.zeros(5))
        self._plain = outline_fit.is_plain(image[0], self._seen.ball)
        #: Frames that were searched in vain since the ball was seen.
        self._in_vain: list[int] = []

    def run(self, stop: int) -> Record:
        """Measure frame after frame up to ``stop``, in batches that grow while they succeed."""
        with contextlib.ExitStack() as stack:
            shared = stack.enter_context(threads.sharing(self._source.device, (2 * self._seen.radius) ** 2))
            self._setup = dataclasses.replace(self._setup, shared=shared)
            ahead = stack.enter_context(contextlib.closing(Ahead(self._source, self._setup)))
            at, size = self._seen.frame + 1, 1
            while at < stop:
                asked = min(size, stop - at)
                confirmed = self._advance(ahead, asked, stop) if size > 1 else 0
                if confirmed:
                    size = min(2 * size, BATCH) if confirmed == asked else max(2, confirmed)
                else:
                    self._rescue(at)
                    confirmed = 1
                    # After a frame that was not measured there is no pair of successive images to go on from.
                    size = 2 if self.record.status[at] == "ok" else 1
                at += confirmed
                if self._progress is not None:
                    self._progress(at, stop)
        return self.record

    def _advance(self, ahead: Ahead, count: int, stop: int) -> int:
        """Correlate the next ``count`` pairs from the expected increments -> how many of the first ones succeeded."""
        seen = self._seen
        look = ahead.look(seen, count)
        if count == BATCH:
            ahead.begin(seen, look, min(BATCH, stop - 1 - (seen.frame + count)))
        found, centred = correlate_successive(look, seen.ball, self._setup)
        actual = self._arrived(found)
        images, predicted = look.images[: len(actual)], look.balls[: len(actual)]
        strayed = (actual - predicted)[:-1, :2].norm(dim=-1) >= PREDICTION_TOLERANCE * seen.radius
        believed = ~(strayed.numpy() | repeats(images, seen))
        good = leading((found.status == "ok") & believed)
        away = actual[:-1] - centred[:-1]
        off = away[:, :2].norm(dim=-1) + RADIUS_COUNTS * away[:, 2].abs()
        turn = found.q[:, 2:].norm(dim=-1).double().cpu().clamp_min(0.01)
        if good and float((off * turn)[:good].max()) > CENTRE_TOLERANCE_PX_RAD:
            again, images = found.q[:good].double().cpu(), images[: good + 1]
            look = looked_at(images, actual[: good + 1], again, self._setup, approached=True)
            found, _ = correlate_successive(look, seen.ball, self._setup)
            good = leading(found.status == "ok")
        if good:
            # A copy: the others' memory is used again.
            self._keep(found, good, images[good : good + 1].clone())
        return good

    def _arrived(self, found: Correlation) -> Tensor:
        """The ball (m + 1, 3) where the increments lead it, from the last known frame: px, float64."""
        steps = found.q[:, :2].double().cpu()
        if self._setup.in_place:
            steps = torch.where(steps.isfinite(), 0.0, steps)
        return path(self._seen.ball, steps, found.growth.double().cpu())

    def _keep(self, found: Correlation, count: int, image: Tensor) -> None:
        """Write ``count`` confirmed pairs down and go on from the last of them, whose second ``image`` this is."""
        last = self._seen.frame
        measured = self.record.keep(last, found, self._arrived(found), count)
        self._in_vain = []
        self._seen = self._seen_in(last + count, image, measured[-1], float(found.growth[count - 1]))
        if count >= TREND_FROM:
            increment, change = trend(measured)
            self._seen = dataclasses.replace(self._seen, increment=increment, trend=change)

    def _seen_in(self, frame: int, image: Tensor, increment: NDArray[np.float64], growth: float = 0.0) -> Seen:
        """The ball in ``frame``, where the record has it by now, moving on by ``increment``."""
        expected = torch.from_numpy(np.nan_to_num(increment))
        centre, radius = torch.from_numpy(self.record.position[frame]), float(self.record.size[frame])
        return Seen(frame, image, centre, radius, expected, torch.zeros_like(expected), growth)

    def _rescue(self, at: int) -> None:
        """Measure frame ``at`` against the last one in which the ball was seen, from scratch, and note its status."""
        seen, record = self._seen, self.record
        target = self._source.images(at, at + 1)
        pair = torch.cat((seen.image, target))
        if repeats(pair, seen)[0]:
            record.repeated.append(at)
            return
        expected = seen.increment * (at - seen.frame)
        place = recovery.sighted(pair, seen, self._setup)
        found = self._from_scratch(at, pair, place, expected)
        status = record.note(at, found)
        if status == "ok" and at == seen.frame + 1:
            self._keep(found, 1, target)
        elif status == "ok":
            self._found_again(at, target, found)
        elif status == "weak_texture":
            # A ball with a pattern does not lose it: it is hidden, or not there. What is not plain looks like itself.
            alike = self._plain or float(found.zncc[0]) >= self._setup.options.min_zncc
            if alike and not (record.status[1:] == "ok").any():
                self._by_outlines(at, pair, place)
            else:
                record.status[at] = "low_correlation"
        if not record.is_placed(at) and at - seen.frame >= RESTART_AFTER:
            self._restart(at, target)
        if not record.is_placed(at):
            if recovery.is_gone(seen, expected):
                record.status[at] = "out_of_frame"
            elif record.status[at] == "out_of_frame":
                record.status[at] = "lost"

    def _from_scratch(self, at: int, pair: Tensor, place: Tensor, expected: Tensor) -> Correlation:
        """Correlate one pair from the best of a few first guesses; if that fails, from a search over rotations."""
        seen, setup = self._seen, self._setup
        found = recovery.from_guesses(pair, seen, place, expected, setup)
        if not recovery.is_worth_a_search(found, seen, expected, self._plain, setup):
            return found
        if len(self._in_vain) >= self._searches or not recovery.is_due(at, self._in_vain):
            return found
        self._in_vain.append(at)
        return recovery.by_search(pair, seen, setup) or found

    def _found_again(self, at: int, image: Tensor, found: Correlation) -> None:
        """Go on after a gap: position and orientation are known again, the increment that leads here is not."""
        seen, motion = self._seen, found.q[0].double().cpu()
        here = seen.centre if self._setup.in_place else seen.centre + motion[:2]
        self.record.place(at, here.numpy(), seen.radius * (1 + float(found.growth[0])))
        self.record.rotation[at] = motion[2:].numpy()
        self.record.status[at] = "lost"
        self._in_vain = []
        self._seen = self._seen_in(at, image, motion.numpy() / (at - seen.frame))

    def _by_outlines(self, at: int, pair: Tensor, place: Tensor) -> None:
        """Go on with a ball whose texture cannot carry the modes: its outlines tell the translation alone."""
        seen, record = self._seen, self.record
        found = recovery.by_outlines(pair, seen, place, self._plain, self._setup)
        record.status[at] = "lost"
        if found is None:
            return
        increment = np.full(5, np.nan)
        increment[:2] = found.step.numpy()
        if at == seen.frame + 1:
            record.increment[at - 1] = increment
            record.covariance[at - 1, :2, :2] = found.covariance.numpy()
            record.status[at] = "weak_texture"
        if seen.frame == self._first:
            record.status[self._first] = "weak_texture"
        here = seen.centre if self._setup.in_place else seen.centre + found.step
        record.place(at, here.numpy(), seen.radius)
        self._seen = self._seen_in(at, pair[1:], increment / (at - seen.frame))

    def _restart(self, at: int, image: Tensor) -> None:
        """Go on with a ball that shows another side by now: its outline tells the position, nothing the rotation."""
        centre = recovery.by_own_outline(image, self._seen, self._setup)
        if centre is not None:
            self.record.place(at, centre.numpy(), self._seen.radius)
            self.record.status[at] = "lost"
            self._seen = self._seen_in(at, image, np.full(5, np.nan))
