"""Preparation of the next batch of images in the background, while the present batch is measured.

The coarse solution of a batch tells the start of the next batch to some hundredths of a px. A second core can therefore
read, cut, filter and coarsely correlate the next batch. Without a second core the same work is done later.
"""

from __future__ import annotations

import torch
from torch import Tensor

from torchsphere.recording.frame_source import CACHE_BYTES, Source
from torchsphere.runtime import threads
from torchsphere.runtime.threads import Call
from torchsphere.tracking.prediction import BallState, linear_trend
from torchsphere.tracking.successive_pairs import PREDICTION_TOLERANCE, PairSetup, PreparedBatch, prepare


class Prefetcher:
    """Prepares batch after batch of a recording; `close` waits for the call that is under way."""

    def __init__(self, source: Source, setup: PairSetup) -> None:
        self._source, self._setup = source, setup
        #: First frame, number of pairs and call of the batch that is prepared in the background.
        self._begun: tuple[int, int, Call[PreparedBatch]] | None = None
        #: Memory for the images of this batch and of the next, used in turns.
        self._buffers = torch.empty(0), torch.empty(0)

    def get(self, state: BallState, count: int) -> PreparedBatch:
        """The next ``count`` pairs from ``state`` on: those of `prefetch`, if it prepared these frames.

        A batch prepared for other frames is dropped. The images of a batch stay valid until the next batch.
        """
        begun, self._begun = self._begun, None
        if begun is not None:
            frame, pairs, call = begun
            if (frame, pairs) == (state.frame, count):
                try:
                    return call.result()
                except BaseException:
                    # After an interrupt no thread may read on while the recording is closed.
                    call.stop()
                    raise
            call.stop()
        return self._prepare(state, count)

    def prefetch(self, state: BallState, last: PreparedBatch, count: int) -> None:
        """Begin to prepare ``count`` pairs after the ``last`` batch, which began at ``state``.

        Nothing is begun where the last batch is unreliable, where two batches are too large to keep, or for a ball
        that stays in place and comes nearer, whose radius would drift.
        """
        iterations, coarse = last.coarse.iterations, last.coarse.q.to("cpu", torch.float64)
        if count < 1 or last.images.nbytes > CACHE_BYTES or not bool((last.coarse.converged & (iterations > 0)).all()):
            return
        if self._setup.in_place and coarse.shape[-1] == 6:
            return
        circles = last.circles if self._setup.in_place else last.circles_from(state.circle)
        if bool(((circles - last.circles)[:, :2].norm(dim=-1) >= PREDICTION_TOLERANCE * state.radius).any()):
            return
        moved = torch.zeros(len(coarse), 5, dtype=torch.float64)
        moved[:, : min(5, coarse.shape[-1])] = coarse[:, :5]
        durations = self._source.durations(state.frame, state.frame + len(coarse) + 1)
        increment, trend = linear_trend(moved.numpy(), durations)
        growth = float(coarse[:, 5].mean()) if coarse.shape[-1] == 6 else 0.0
        frame = state.frame + len(coarse)
        at_end = BallState(frame, last.images[-1:], circles[-1, :2], float(circles[-1, 2]), increment, trend, growth)
        self._begun = frame, count, threads.submit(self._source.device, self._prepare, at_end, count)

    def _prepare(self, state: BallState, count: int) -> PreparedBatch:
        # The last image is read a second time: joined to the others, all images would be copied.
        stop = state.frame + 1 + count
        if self._source.fills_buffers:
            images = self._source.images_into(self._buffer(state.image, count + 1), state.frame, stop)
        else:
            images = self._source.images(state.frame, stop)
        expected, circles = state.predict(self._source.durations(state.frame, stop), self._setup.in_place)
        return prepare(images, circles, expected, self._setup)

    def _buffer(self, image: Tensor, count: int) -> Tensor:
        """Memory for ``count`` images like ``image`` (1, h, w), separate from that of the last batch."""
        last, buffer = self._buffers
        if len(buffer) < count:
            buffer = image.new_empty(count, *image.shape[1:])
        self._buffers = buffer, last
        return buffer

    def close(self) -> None:
        """Wait for the call that is under way."""
        if self._begun is not None:
            self._begun[2].stop()
            self._begun = None
