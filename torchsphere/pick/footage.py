"""The frames of a recording for a page: read one at a time, with the grey levels that become black and white."""

from __future__ import annotations

import functools
import io
import threading
from collections import OrderedDict
from collections.abc import Callable
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray

from torchsphere.recording import Recording
from torchsphere.recording.frame_source import Source
from torchsphere.report.frame_sampling import black_and_white

#: Frames that stay in memory, as a page asks for one of them again and again while a circle is dragged.
KEPT_FRAMES = 4


class Footage:
    """A recording that several threads read, one at a time."""

    def __init__(self, recording: Recording) -> None:
        """Show an open ``recording``; the caller closes it."""
        self.recording = recording
        self._lock, self._closed = threading.Lock(), False
        self._kept: OrderedDict[int, NDArray[np.float32]] = OrderedDict()

    @property
    def count(self) -> int:
        """Number of frames."""
        return len(self.recording)

    @property
    def shape(self) -> tuple[int, int]:
        """Height and width, px."""
        return self.recording.shape[1:]

    def images(self, start: int, stop: int) -> NDArray[np.float32]:
        """Grey levels (stop - start, h, w); raises ValueError or OSError as `Recording.images`."""
        with self._lock:
            if self._closed:
                raise OSError("the page was closed; start torchsphere pick again")
            return self.recording.images(start, stop)

    def close(self) -> None:
        """Wait until a frame that is being read is there; no further one is read."""
        with self._lock:
            self._closed = True

    def image(self, frame: int) -> NDArray[np.float32]:
        """Grey levels (h, w) of one frame, which must not be written to; ValueError for a frame that is not there."""
        if not 0 <= frame < self.count:
            raise ValueError(f"frame {frame}: the recording has the frames 0 to {self.count - 1}; choose one of these")
        with self._lock:
            if frame in self._kept:
                self._kept.move_to_end(frame)
                return self._kept[frame]
        image = self.images(frame, frame + 1)[0]
        with self._lock:
            self._kept[frame] = image
            while len(self._kept) > KEPT_FRAMES:
                self._kept.popitem(last=False)
        return image

    def source(self, start: int, stop: int, check: Callable[[], None] = lambda: None) -> Source:
        """The frames ``start`` to ``stop - 1`` as a measurement reads them; ``check`` may raise before each reading."""

        def read(a: int, b: int) -> NDArray[np.float32]:
            check()
            return self.images(start + a, start + b)

        return Source(read, stop - start, torch.device("cpu"), torch.float32)

    @functools.cached_property
    def levels(self) -> tuple[float, float]:
        """Grey levels that become black and white."""
        return black_and_white(self.image, np.arange(self.count))

    def grey(self, values: NDArray[Any], black: float | None = None, white: float | None = None) -> NDArray[np.uint8]:
        """Values in grey levels of the recording as 8 bit; the limits are `levels` where none are given."""
        low, high = self.levels
        low, high = (low if black is None else black), (high if white is None else white)
        span = max(high - low, 1e-6)
        return ((values - low) * (255 / span)).clip(0, 255).astype(np.uint8)

    def png(self, frame: int, black: float | None = None, white: float | None = None) -> bytes:
        """A frame as PNG, without losses: an edge is to be judged in it."""
        from PIL import Image

        buffer = io.BytesIO()
        Image.fromarray(self.grey(self.image(frame), black, white)).save(buffer, "PNG", compress_level=1)
        return buffer.getvalue()
