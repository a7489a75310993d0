"""A place in a video, from which images are decoded in order.

Where to seek in compressed video lands is not certain. Only a landing on the very key image that was asked for, by its
time, is believed; from there images are decoded in order. Anything else, and the video is decoded from its start.
"""

from __future__ import annotations

import contextlib
import itertools
import threading
from bisect import bisect_right
from collections import deque
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from torchsphere.recording.refusal import LibraryMissingError, library_failures

if TYPE_CHECKING:
    import av
    from av.container import InputContainer

#: The last images, which are held so that a batch that is measured a second time is not decoded from the start: with
#: none, 2000 images took 30 s to follow where their TIFF takes 5. So many are more than a first look at a recording
#: takes (`torchsphere.tracking.circle_calibration.FRAMES`), which goes over them in several ways.
HELD = 80

#: Images are kept up to this many bytes in all: 2000 of 512 x 256 px in 8 bit. The search for the ball, the track, the
#: background and the report each go over the recording: without, those 2000 were decoded four times, in 12 of 18 s.
KEPT_BYTES = 2**28

#: The library's number for an image that needs no other; some encoders call an image a key that only ends a refresh.
INTRA = 1


class Cursor:
    """Decodes forwards from image to image, and from a key image where that is nearer."""

    def __init__(self, path: Path, reader: str) -> None:
        self._path, self._reader = path, reader
        self._container: InputContainer | None = None
        self._frames: Iterator[av.VideoFrame] = iter(())
        self._next = self._count = 0
        self._size = (0, 0)
        # The last images, in order; the newest is the one before `_next`.
        self._held: deque[NDArray[Any]] = deque(maxlen=HELD)
        self._decode: Callable[[av.VideoFrame], NDArray[Any]] | None = None
        # Images by their numbers, as many as there is room for.
        self._kept: dict[int, NDArray[Any]] = {}
        self._kept_bytes = 0
        # Times of all images, and numbers of those that begin with themselves; none where that is not known.
        self._times: list[int] = []
        self._keys: list[int] = []
        self._jumped = False
        self.codec = ""
        # Two threads would move the same position.
        self._lock = threading.Lock()

    def survey(self) -> tuple[int, float | None]:
        """Count the images and give the playback rate, without decoding."""
        with self._open() as container:
            if not container.streams.video:
                return 0, None
            stream = container.streams.video[0]
            self.codec = stream.codec_context.name
            rate = stream.average_rate or stream.guessed_rate
            times: list[int | None] = []
            keys = set()
            whole = 0
            for packet in container.demux(stream):
                if packet.size and not packet.is_corrupt:
                    whole += 1
                    if not packet.is_discard:
                        times.append(packet.pts)
                        keys |= {packet.pts} if packet.is_keyframe else set()
            # AVI and MP4 state how many images they should hold; other kinds give 0.
            if stream.frames > whole:
                raise EOFError(f"{whole} of {stream.frames} images are present")
            known = [time for time in times if time is not None]
            if len(set(known)) == len(times):
                self._times = sorted(known)
                self._keys = [number for number, time in enumerate(self._times) if time in keys]
            return len(times), float(rate) if rate else None

    def first(self) -> av.VideoFrame:
        """Decode the first image."""
        with self._open() as container:
            return next(iter(container.decode(video=0)))

    def expect(self, count: int, size: tuple[int, int], decode: Callable[[av.VideoFrame], NDArray[Any]]) -> None:
        """Fix what every image must be."""
        self._count, self._size, self._decode = count, size, decode

    def read(self, start: int, stop: int) -> NDArray[np.float32]:
        """Images ``start`` to ``stop - 1``, float32."""
        with self._lock:
            images = {number: self._kept[number] for number in range(start, stop) if number in self._kept}
            lacking = [number for number in range(start, stop) if number not in images]
            if lacking:
                images |= self._decoded(lacking[0], lacking[-1] + 1)
            return np.stack([images[number] for number in range(start, stop)]).astype(np.float32)

    def _decoded(self, start: int, stop: int) -> dict[int, NDArray[Any]]:
        """Images ``start`` to ``stop - 1`` by their numbers."""
        before = bisect_right(self._keys, start)
        key = self._keys[before - 1] if before else 0
        is_back = self._container is None or start < self._next - len(self._held)
        if key and (is_back or key > self._next):
            self._jump(key)
        elif is_back:
            self._restart()
        held = self._next - len(self._held)
        images = {held + i: image for i, image in enumerate(self._held) if start <= held + i < stop}
        while self._next < stop:
            image = self._grey(self._advance())
            self._held.append(image)
            images[self._next - 1] = image
            self._keep(self._next - 1, image)
        return images

    def _keep(self, number: int, image: NDArray[Any]) -> None:
        """Keep an image for those who come back to it, as long as there is room."""
        if number not in self._kept and self._kept_bytes + image.nbytes <= KEPT_BYTES:
            self._kept[number] = image
            self._kept_bytes += image.nbytes

    def _forget(self) -> None:
        self._kept.clear()
        self._kept_bytes = 0

    def _restart(self) -> None:
        """Make the first image the next one."""
        self._let_go()
        with library_failures(self._path, "a video"):
            self._container = self._open()
            self._container.streams.video[0].thread_type = "AUTO"
            self._frames = iter(self._container.decode(video=0))
        self._next, self._jumped = 0, False

    def _jump(self, key: int) -> None:
        """Make the key image of that number the next one, or the first image where that cannot be had."""
        if self._container is None:
            self._restart()
        assert self._container is not None
        time, frames, frame = self._times[key], self._frames, None
        # Some videos can only be read in order, and what is damaged is found and named on that way, too.
        with contextlib.suppress(OSError), library_failures(self._path, "a video"):
            self._container.seek(time, stream=self._container.streams.video[0])
            frames = iter(self._container.decode(video=0))
            frame = next((f for f in frames if f.pts is None or f.pts >= time), None)
        if frame is None or frame.pts != time or int(frame.pict_type) != INTRA:
            self._keys = []
            self._restart()
            return
        self._frames, self._next, self._jumped = itertools.chain((frame,), frames), key, True
        self._held.clear()

    def close(self) -> None:
        """Let go of the file and of all images."""
        self._let_go()
        self._forget()

    def _let_go(self) -> None:
        if self._container is not None:
            self._container.close()
        self._container, self._frames = None, iter(())
        self._held.clear()

    def _advance(self) -> av.VideoFrame:
        with library_failures(self._path, "a video"):
            frame = next(self._frames, None)
        if frame is None:
            present = self._next
            self._let_go()
            raise OSError(
                f"{self._path}: gives {present} images when decoded, its packets promise {self._count}; "
                "it is cut or damaged, export it again"
            )
        if self._keys and frame.pts != self._times[self._next]:
            # Images do not come at the times of their packets: their numbers are by counting alone.
            self._keys = []
            self._forget()
            if self._jumped:
                number = self._next
                self._restart()
                while self._next < number:
                    self._advance()
                return self._advance()
        self._next += 1
        return frame

    def _grey(self, frame: av.VideoFrame) -> NDArray[Any]:
        if (frame.height, frame.width) != self._size:
            raise OSError(
                f"{self._path}: image {self._next - 1} is {frame.width} x {frame.height} px, the first is "
                f"{self._size[1]} x {self._size[0]}; expected one size, export the video again"
            )
        with library_failures(self._path, "a video"):
            if self._decode is None:
                raise LookupError("not opened")
            # A copy, for the frame's memory belongs to the decoder.
            return np.array(self._decode(frame))

    def _open(self) -> InputContainer:
        try:
            # Imported here: most recordings need no video library.
            import av
        except ImportError as error:
            raise LibraryMissingError(
                f'{self._path}: reading video needs PyAV, which is not installed; run: pip install "torchsphere[video]"'
            ) from error
        return av.open(str(self._path), mode="r", format=self._reader)
