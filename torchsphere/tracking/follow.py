"""Follow the ball from frame to frame: predict, correlate in batches, recover frames that a batch cannot confirm.

A batch of pairs is correlated at once from the predicted increments (`prediction`, `successive_pairs`), and confirmed
pairs are stored (`record`). Where a batch fails, the next frame is measured by itself (`recovery`).
"""

from __future__ import annotations

import contextlib
import dataclasses
import math
from collections.abc import Callable

import numpy as np
import torch
from kornia.geometry.liegroup import So3
from numpy.typing import NDArray
from torch import Tensor

from torchsphere.correlation.explained import is_same_part
from torchsphere.correlation.frame_status import OK, OUT_OF_FRAME, WEAK_TEXTURE, of_frame, without_rotation
from torchsphere.correlation.options import Options
from torchsphere.correlation.result import Correlation
from torchsphere.detection import outline_fit
from torchsphere.geometry.circle import Circle
from torchsphere.recording.frame_source import Source
from torchsphere.runtime import threads
from torchsphere.runtime.arrays import Array
from torchsphere.tracking import recovery
from torchsphere.tracking.prediction import BallState, circle_path, linear_trend, repeats_previous
from torchsphere.tracking.prefetch import Prefetcher
from torchsphere.tracking.record import Record
from torchsphere.tracking.successive_pairs import (
    PREDICTION_TOLERANCE,
    PairSetup,
    correlate_successive,
    count_leading,
    explain_one,
    prepare,
)

#: Pairs correlated at once (docs/constants.toml).
BATCH = 32

#: Number of pairs of a batch from which the trend of the increments is extrapolated (docs/constants.toml).
TREND_FROM = 16

#: Error of the centre times the rotation, px rad, from which a pair is correlated again (docs/constants.toml).
CENTRE_TOLERANCE_PX_RAD = 0.005

#: Weight of an error of the radius relative to one of the centre (docs/constants.toml).
RADIUS_WEIGHT = 10.0

#: Memory that the process keeps from batch to batch, bytes (docs/constants.toml).
KEPT_BYTES = 2**24

#: Number of frames without the ball from which its outline alone is enough to go on (docs/constants.toml).
RESTART_AFTER = 3

Progress = Callable[[int, int], None]

#: Called as ``watch(record, done)``: the record, of which the first ``done`` frames are filled and may only be read.
Watch = Callable[[Record, int], None]

#: Share of the disc in the image below which the ball has left the image (docs/constants.toml).
MIN_IN_FRAME = 0.5

#: Numbers of last positions that tell the flight: few after a contact, many of a slow ball (docs/constants.toml).
POSITIONS = (3, 16)

#: Errors of a predicted position that are allowed for, standard deviations (docs/constants.toml).
MARGIN_SD = 3.0


class Follower:
    """One pass over a recording: its ``record`` so far, and the last frame that shows the ball."""

    def __init__(
        self,
        source: Source,
        first: Circle,
        ignore: Tensor | None,
        options: Options,
        *,
        progress: Progress | None = None,
        watch: Watch | None = None,
        in_place: bool = False,
        searches: float = math.inf,
    ) -> None:
        """Start from the circle ``first``; after ``searches`` failed searches over rotations no further one is made."""
        self.record = Record.empty(source.count, first)
        self._source, self._progress, self._watch = source, progress, watch
        self._first, self._searches = first.frame, searches
        self._is_alone = not first.others
        self._setup = PairSetup(options, ignore, in_place, shared=lambda part, rows: [part(0, rows)])
        image = source.images(first.frame, first.frame + 1)
        self._state: BallState
        #: The last frame in which nothing hid a part of the ball.
        self._whole: BallState
        self._set_state(first.frame, image, np.zeros(5))
        self._is_plain = outline_fit.is_plain(image[0], self._state.circle)
        #: Frames whose search over rotations failed since the ball was seen.
        self._failed_searches: list[int] = []

    def run(self, stop: int) -> Record:
        """Measure frame after frame up to ``stop``, in batches that grow while they succeed."""
        # Once it has freed so much at once, the C library of Linux keeps as much for the next batch.
        torch.empty(KEPT_BYTES, dtype=torch.uint8)
        with contextlib.ExitStack() as stack:
            shared = stack.enter_context(threads.row_runner(self._source.device, (2 * self._state.radius) ** 2))
            self._setup = dataclasses.replace(self._setup, shared=shared)
            batches = stack.enter_context(contextlib.closing(Prefetcher(self._source, self._setup)))
            at, size = self._state.frame + 1, 1
            while at < stop:
                asked = min(size, stop - at)
                confirmed = self._correlate_batch(batches, asked, stop) if size > 1 else 0
                if confirmed:
                    size = min(2 * size, BATCH) if confirmed == asked else max(2, confirmed)
                else:
                    self._recover(at)
                    confirmed = 1
                    # After a frame that failed there is no pair of successive images to continue from.
                    size = 2 if self.record.is_ok[at] else 1
                at += confirmed
                if self._watch is not None:
                    self._watch(self.record, at)
                if self._progress is not None:
                    self._progress(at, stop)
        return self.record

    def _correlate_batch(self, batches: Prefetcher, count: int, stop: int) -> int:
        """Correlate ``count`` pairs from predicted increments; return the number of leading pairs that succeed."""
        state = self._state
        batch = batches.get(state, count)
        if count == BATCH:
            batches.prefetch(state, batch, min(BATCH, stop - 1 - (state.frame + count)))
        found, regions = correlate_successive(batch, state.circle, self._setup)
        actual = self._circles_after(found)
        images, predicted = batch.images[: len(actual)], batch.circles[: len(actual)]
        has_strayed = (actual - predicted)[:-1, :2].norm(dim=-1) >= PREDICTION_TOLERANCE * state.radius
        believed = ~(has_strayed.numpy() | repeats_previous(images, state))
        good = count_leading((found.status == OK) & believed & self._follow_one_part(found))
        error = actual[:-1] - regions[:-1]
        error_px = error[:, :2].norm(dim=-1) + RADIUS_WEIGHT * error[:, 2].abs()
        rotation = found.q[:, 2:].norm(dim=-1).double().cpu().clamp_min(0.01)
        if good and float((error_px * rotation)[:good].max()) > CENTRE_TOLERANCE_PX_RAD:
            start, images = found.q[:good].double().cpu(), images[: good + 1]
            batch = prepare(images, actual[: good + 1], start, self._setup, is_exact=True)
            found, _ = correlate_successive(batch, state.circle, self._setup)
            good = count_leading((found.status == OK) & self._follow_one_part(found))
        if good:
            # A copy, since the memory of the batch is used again.
            self._accept(found, good, images[good : good + 1].to(self._source.dtype, copy=True))
        return good

    def _follow_one_part(self, found: Correlation) -> NDArray[np.bool_]:
        """True (m,) where a pair follows the part of the ball that the pair before followed: no object in front."""
        first = self._state.explained
        first = torch.ones_like(found.explained[0, 1]) if first is None else first.to(found.explained)
        after = torch.cat((first[None], found.explained[:-1, 1]))
        return is_same_part(after, found.explained[:, 0]).cpu().numpy()

    def _circles_after(self, found: Correlation) -> Tensor:
        """Circles (m + 1, 3) that the increments lead to from the last known frame, px, float64."""
        steps = found.q[:, :2].double().cpu()
        if self._setup.in_place:
            steps = torch.where(steps.isfinite(), 0.0, steps)
        return circle_path(self._state.circle, steps, found.growth.double().cpu())

    def _accept(self, found: Correlation, count: int, image: Tensor) -> None:
        """Store ``count`` confirmed pairs and continue from the second ``image`` of the last pair."""
        last = self._state.frame
        measured = self.record.set_pairs(last, found, self._circles_after(found), count)
        self._failed_searches = []
        growth, explained = float(found.growth[count - 1]), found.explained[count - 1, 1]
        durations = self._source.durations(last, last + count + 1)
        self._set_state(last + count, image, measured[-1] / durations[-1], growth / durations[-1], explained)
        if count >= TREND_FROM:
            increment, trend = linear_trend(measured, durations)
            self._state = dataclasses.replace(self._state, increment=increment, trend=trend)

    def _set_state(
        self,
        frame: int,
        image: Tensor,
        increment: NDArray[np.float64],
        growth: float = 0.0,
        explained: Tensor | None = None,
    ) -> None:
        """Continue from ``frame``, where the record has the ball, with the ``increment`` expected in an interval."""
        expected = torch.from_numpy(np.nan_to_num(increment))
        centre, radius = torch.from_numpy(self.record.position[frame]), float(self.record.size[frame])
        explained = None if explained is None or bool((explained == 1).all()) else explained
        state = BallState(frame, image, centre, radius, expected, torch.zeros_like(expected), growth, explained)
        self._state = state
        if explained is None:
            self._whole = state

    def _recover(self, at: int) -> None:
        """Measure frame ``at`` by itself against the last frame that shows the ball, and store its status."""
        state, record = self._state, self.record
        target = self._source.images(at, at + 1)
        pair = torch.cat((state.image, target))
        if repeats_previous(pair, state)[0]:
            record.repeated.append(at)
            return
        expected = state.increment * self._source.elapsed(state.frame, at)
        setup = (
            self._setup if state.explained is None else recovery.without_occluder(state, state.explained, self._setup)
        )
        place = recovery.locate(pair, state, setup)
        found = self._correlate_alone(at, pair, place, expected, setup)
        status, has_step, is_plain = str(found.status[0]), at == state.frame + 1, False
        record.set_match(at, found)
        if status == OK and state.frame == self._first:
            # Nothing tells yet which part of the disc is the ball.
            found = recovery.moving_part(pair, state, expected, found, setup)
        if status == OK and state.explained is not None:
            explained = explain_one(pair, state.circle, found.q[0], self._setup)
            found = dataclasses.replace(found, explained=explained[None])
        if status == OK and has_step:
            self._accept(found, 1, target)
        elif status == OK:
            self._resume_after_gap(at, target, found)
        elif status == WEAK_TEXTURE:
            # Only the look of a plain ball confirms it.
            is_alike = self._is_plain or float(found.zncc[0]) >= self._setup.options.min_zncc
            is_plain = is_alike and not record.is_ok[1:].any()
            if is_plain:
                self._step_by_outlines(at, pair, place)
        if not record.is_placed(at) and at - state.frame >= RESTART_AFTER:
            self._restart_by_outline(at, target)
        is_placed = record.is_placed(at)
        left = not is_placed and has_left(record, state, at)
        record.status[at] = of_frame(status, is_placed=is_placed, has_step=has_step, is_plain=is_plain, has_left=left)

    def _correlate_alone(self, at: int, pair: Tensor, place: Tensor, expected: Tensor, setup: PairSetup) -> Correlation:
        """Correlate one pair from the best of a few first guesses; if these fail, from a search over rotations."""
        state = self._state
        found = recovery.correlate_from_guesses(pair, state, place, expected, setup)
        if not recovery.is_worth_a_search(found, self._is_plain, setup) or has_left(self.record, state, at):
            return found
        failed = self._failed_searches
        if len(failed) >= self._searches or not recovery.is_search_due(at, failed):
            return found
        failed.append(at)
        return recovery.correlate_by_search(pair, state, setup) or found

    def _resume_after_gap(self, at: int, image: Tensor, found: Correlation) -> None:
        """Continue after a gap: position and orientation are known again, the increment before is not."""
        state, motion = self._state, found.q[0].double().cpu()
        centre = state.centre if self._setup.in_place else state.centre + motion[:2]
        self.record.place(at, centre.numpy(), state.radius * (1 + float(found.growth[0])))
        self.record.rotation[at] = motion[2:].numpy()
        self._failed_searches = []
        increment = motion.numpy() / self._source.elapsed(state.frame, at)
        self._set_state(at, image, increment, explained=found.explained[0, 1])

    def _step_by_outlines(self, at: int, pair: Tensor, place: Tensor) -> None:
        """Continue with a ball without enough texture for the modes: its outlines give the translation alone."""
        state, record = self._state, self.record
        found = recovery.step_by_outlines(pair, state, place, self._is_plain, self._setup)
        if found is None:
            return
        step, covariance = found
        increment = np.full(5, np.nan)
        increment[:2] = step.numpy()
        if at == state.frame + 1:
            record.increment[at - 1] = increment
            record.covariance[at - 1, :2, :2] = covariance.numpy()
        if state.frame == self._first:
            record.status[[self._first]] = without_rotation(record.status[[self._first]])
        centre = state.centre if self._setup.in_place else state.centre + step
        record.place(at, centre.numpy(), state.radius)
        self._set_state(at, pair[1:], increment / self._source.elapsed(state.frame, at))

    def _restart_by_outline(self, at: int, image: Tensor) -> None:
        """Continue with a ball found by its outline: with its rotation where its texture is that of the ball.

        Where there are other balls, an outline alone does not tell which ball it is.
        """
        state, setup, whole = self._state, self._setup, self._whole
        centre = recovery.find_by_outline(image, state, setup)
        if centre is None:
            return
        since_whole = self._source.elapsed(whole.frame, at)
        motion = None if whole is state else recovery.motion_to(image, centre, whole, since_whole, setup)
        if motion is not None:
            self._place(at, centre if setup.in_place else whole.centre + motion[:2])
            since = So3.exp(torch.from_numpy(self.record.turned(whole.frame, state.frame)))
            self.record.rotation[at] = (So3.exp(motion[None, 2:]) * since.inverse()).log()[0].numpy()
            self._set_state(at, image, motion.numpy() / since_whole)
        elif setup.in_place or (self._is_alone and not recovery.is_other_object(image, centre, state, setup)):
            self._place(at, centre)
            self._set_state(at, image, np.full(5, np.nan))

    def _place(self, at: int, centre: Tensor) -> None:
        """Store the ball's place in a frame in which it is found again."""
        self.record.place(at, centre.numpy(), self._state.radius)
        self._failed_searches = []


def has_left(record: Record, state: BallState, at: int) -> bool:
    """Whether the ball, last seen in the frame of the ``state``, has left the image in the later frame ``at``.

    A ball that has left is out of the image until it is found again.
    """
    if record.status[at - 1] == OUT_OF_FRAME:
        return True
    return any(_flies_out(record, state, at, count) for count in POSITIONS)


def _flies_out(record: Record, state: BallState, at: int, count: int) -> bool:
    """Whether the free flight through the last ``count`` measured positions leads out of the image by frame ``at``.

    Without as many positions, and steps between them, that were measured, nothing is known, nor more frames ahead than
    were measured. A ball that this flight shows wholly in the image, but that was not found there, flies otherwise.
    """
    first, later = state.frame + 1 - count, at - state.frame
    steps = slice(first, state.frame)
    if first < 0 or later > count or not np.isfinite(record.increment[steps, :2]).all():
        return False
    positions = record.position[first : state.frame + 1]
    # A step has the errors of two positions.
    variance = 0.5 * np.diagonal(record.covariance[steps, :2, :2], axis1=1, axis2=2).max(0)
    centres, errors = _continued(positions, variance, later)
    whole = np.array([state.share_in_image(centre) == 1 for centre in centres])
    # An exposure shows the ball on its way to its next place at most.
    if (whole[:-1] & whole[1:]).any():
        return False
    height, width = state.image.shape[-2:]
    inwards = torch.tensor([width / 2, height / 2]).to(centres) - centres[-1]
    return state.share_in_image(centres[-1] + inwards.clamp(-errors, errors)) < MIN_IN_FRAME


def _continued(positions: Array, variance: Array, later: int) -> tuple[Tensor, Tensor]:
    """Centres (later, 2) in the next frames, on a parabola through ``positions`` (m, 2), and the last one's error (2,).

    A position has the ``variance`` (2,), or that by which the positions leave the parabola, if it is larger.
    """
    known = np.vander(np.arange(1.0 - len(positions), 1.0), 3)
    ahead = np.vander(np.arange(1.0, later + 1.0), 3) @ np.linalg.pinv(known)
    off = positions - known @ np.linalg.pinv(known) @ positions
    scatter = (off**2).sum(0) / max(len(positions) - 3, 1)
    error = MARGIN_SD * np.linalg.norm(ahead[-1]) * np.sqrt(np.maximum(variance, scatter))
    return torch.from_numpy(ahead @ positions), torch.from_numpy(error)
