"""The next batch of images, looked at while the last one is measured.

To measure takes twice as long as to look (`successive_pairs`), and the look at one batch tells where the next one
begins to within some hundredths of a px. So a second core reads, cuts, filters and brings near the next batch in the
meantime. The numbers are the same without a second core: then the same look is taken later.
"""

from __future__ import annotations

import torch
from torch import Tensor

from torchsphere.recording.frame_source import KEPT_BYTES, Source
from torchsphere.runtime import threads
from torchsphere.runtime.threads import Begun
from torchsphere.tracking.prediction import Seen, trend
from torchsphere.tracking.successive_pairs import PREDICTION_TOLERANCE, Look, Setup, look


class Ahead:
    """Looks at batch after batch of a recording; to be closed, since one may be under way."""

    def __init__(self, source: Source, setup: Setup) -> None:
        self._source, self._setup = source, setup
        #: The first frame and the pairs of the batch that is being looked at.
        self._begun: tuple[int, int, Begun[Look]] | None = None
        #: Memory for the images of this batch and of the next, in turns.
        self._rooms = torch.empty(0), torch.empty(0)

    def look(self, seen: Seen, count: int) -> Look:
        """Look at the next ``count`` pairs from where the ball was ``seen``; once that `begin` was called, from there.

        What was begun with other frames is dropped. The images of a look stay until the next one.
        """
        begun, self._begun = self._begun, None
        if begun is not None:
            frame, pairs, call = begun
            if (frame, pairs) == (seen.frame, count):
                try:
                    return call.result()
                except BaseException:
                    # An interrupt, perhaps: nothing reads on while the recording is closed.
                    call.settle()
                    raise
            call.settle()
        return self._take(seen, count)

    def begin(self, seen: Seen, last: Look, count: int) -> None:
        """Begin to look at ``count`` pairs behind those of the ``last`` look, which began where the ball was ``seen``.

        Where the last look may have gone astray, or found nothing, nothing is begun; nor where two batches are too
        large to keep, or a ball that stays in its place comes nearer: look upon look would lead its radius astray.
        """
        steps, near = last.approach.steps, last.approach.near.to("cpu", torch.float64)
        if count < 1 or last.images.nbytes > KEPT_BYTES or not bool((last.approach.at_rest & (steps > 0)).all()):
            return
        if self._setup.in_place and near.shape[-1] == 6:
            return
        balls = last.balls if self._setup.in_place else last.led(seen.ball)
        if bool(((balls - last.balls)[:, :2].norm(dim=-1) >= PREDICTION_TOLERANCE * seen.radius).any()):
            return
        moved = torch.zeros(len(near), 5, dtype=torch.float64)
        moved[:, : min(5, near.shape[-1])] = near[:, :5]
        increment, change = trend(moved.numpy())
        growth = float(near[:, 5].mean()) if near.shape[-1] == 6 else 0.0
        frame = seen.frame + len(near)
        there = Seen(frame, last.images[-1:], balls[-1, :2], float(balls[-1, 2]), increment, change, growth)
        self._begun = frame, count, threads.beside(self._source.device, self._take, there, count)

    def _take(self, seen: Seen, count: int) -> Look:
        # The last image is read once more: to put it in front of the others would copy all of them.
        stop = seen.frame + 1 + count
        if self._source.fills_rooms:
            images = self._source.images_in(self._room(seen.image, count + 1), seen.frame, stop)
        else:
            images = self._source.images(seen.frame, stop)
        expected, predicted = seen.ahead(count, self._setup.in_place)
        return look(images, predicted, expected, self._setup)

    def _room(self, image: Tensor, count: int) -> Tensor:
        """Room for so many images like ``image`` (1, h, w), where those of the last look are not."""
        last, room = self._rooms
        if len(room) < count:
            room = image.new_empty(count, *image.shape[1:])
        self._rooms = room, last
        return room

    def close(self) -> None:
        """Wait for what is under way."""
        if self._begun is not None:
            self._begun[2].settle()
            self._begun = None
