"""Videos (AVI, MP4, MOV, MKV, WebM) through PyAV.

Where to seek in compressed video lands is not certain. Only a landing on the very key image that was asked for, by its
time, is believed; from there images are decoded in order. Anything else, and the video is decoded from its start.
"""

from __future__ import annotations

import contextlib
import itertools
import threading
from bisect import bisect_right
from collections import deque
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from torchsphere.recording.grey import GREY_NOTE, to_grey
from torchsphere.recording.recording import Recording
from torchsphere.recording.refusal import LibraryMissingError, library_failures, looks_like

if TYPE_CHECKING:
    import av
    from av.container import InputContainer

#: Images that are held, so that a batch that is measured a second time is not decoded from the start: with none, 2000
#: images took 30 s to follow where their TIFF takes 5. So many are more than a first look at a recording takes
#: (`torchsphere.calibrate.FRAMES`), which goes over them in several ways.
HELD = 80

#: The library's number for an image that needs no other; some encoders call an image a key that only ends a refresh.
INTRA = 1

# The reader of each kind is named, so that the file's content cannot choose another one.
_READERS = {"an AVI video": "avi", "an MP4 or MOV video": "mov", "a Matroska or WebM video": "matroska"}


def open_video(path: Path) -> Recording:
    """Open a video.

    Parameters
    ----------
    path : Path

    Returns
    -------
    Recording
        Never with a frame rate: a container states how fast to play, not how fast the camera recorded.

    Raises
    ------
    ValueError
        Where the file is no video, or its pixels are of a kind that is not supported.
    OSError
        Where it is cut or damaged, or PyAV is not installed.
    """
    with path.open("rb") as file:
        head = file.read(64)
    reader = _READERS.get(looks_like(head))
    if reader is None:
        raise ValueError(f"{path}: looks like {looks_like(head)}, expected a video; check the name")
    cursor = _Cursor(path, reader)
    with library_failures(path, "a video"):
        n, playback = cursor.survey()
    if n < 1:
        raise OSError(f"{path}: holds no images; the video is cut or was not finished, copy or export it again")
    with library_failures(path, "a video"):
        frame = cursor.first()
    height, width = frame.height, frame.width
    decode, depth, notes = _decoder(path, frame)
    cursor.expect(n, (height, width), decode)
    if playback:
        notes += (f"The container plays at {playback:g} frames/s; that is not known to be the rate of recording.",)
    return Recording(
        path=path,
        kind=f"video, {cursor.codec}, {frame.format.name}",
        shape=(n, height, width),
        bit_depth=depth,
        origins={"bit_depth": f"pixel format {frame.format.name}"},
        notes=notes,
        files=(path,),
        _reader=cursor.read,
        _closer=cursor.close,
    )


class _Decoder:
    """Turns one decoded frame into grey levels (h, w)."""

    def __init__(self, *, colour: bool, dtype: str) -> None:
        self._colour, self._dtype = colour, np.dtype(dtype)

    def __call__(self, frame: av.VideoFrame) -> NDArray[Any]:
        if self._colour:
            return to_grey(frame.to_ndarray(format="rgb48le" if self._dtype.itemsize == 2 else "rgb24"))
        plane = frame.planes[0]
        # Rows are padded to line_size bytes.
        rows = np.frombuffer(plane, np.uint8)[: plane.line_size * frame.height].reshape(frame.height, plane.line_size)  # type: ignore[call-overload]
        used = np.ascontiguousarray(rows[:, : frame.width * self._dtype.itemsize])
        levels: NDArray[Any] = used.view(self._dtype)
        return levels


def _decoder(path: Path, frame: av.VideoFrame) -> tuple[_Decoder, int, tuple[str, ...]]:
    name, components = frame.format.name, frame.format.components
    bits = components[0].bits if components else 0
    dtype = "u1" if bits <= 8 else ">u2" if name.endswith("be") else "<u2"
    if name.startswith("gray") and 8 <= bits <= 16:
        return _Decoder(colour=False, dtype=dtype), bits, ()
    if name.startswith(("yuv", "nv12", "nv21", "nv16")) and not name.startswith("yuyv") and 8 <= bits <= 16:
        note = "The grey levels are the luma plane as decoded; the colour planes were ignored."
        return _Decoder(colour=False, dtype=dtype), bits, (note,)
    if frame.format.is_rgb or name == "pal8":
        wide = bits > 8
        return _Decoder(colour=True, dtype="<u2" if wide else "u1"), 16 if wide else 8, (GREY_NOTE,)
    raise ValueError(
        f"{path}: the pixels are {name}, expected grey, YUV in planes, or RGB; convert the video, for example to gray"
    )


class _Cursor:
    """Decodes forwards from image to image, and from a key image where that is nearer."""

    def __init__(self, path: Path, reader: str) -> None:
        self._path, self._reader = path, reader
        self._container: InputContainer | None = None
        self._frames: Iterator[av.VideoFrame] = iter(())
        self._next = self._count = 0
        self._size = (0, 0)
        # The last images, in order; the newest is the one before `_next`.
        self._held: deque[NDArray[Any]] = deque(maxlen=HELD)
        self._decode: _Decoder | None = None
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

    def expect(self, count: int, size: tuple[int, int], decode: _Decoder) -> None:
        """Fix what every image must be."""
        self._count, self._size, self._decode = count, size, decode

    def read(self, start: int, stop: int) -> NDArray[Any]:
        with self._lock:
            before = bisect_right(self._keys, start)
            key = self._keys[before - 1] if before else 0
            is_back = self._container is None or start < self._next - len(self._held)
            if key and (is_back or key > self._next):
                self._jump(key)
            elif is_back:
                self._restart()
            if self._next < start:
                self._held.clear()
            while self._next < start:
                self._advance()
            images = list(self._held)[start - self._next + len(self._held) :][: stop - start]
            while self._next < stop:
                images.append(self._grey(self._advance()))
                self._held.append(images[-1])
            return np.stack(images).astype(np.float32)

    def _restart(self) -> None:
        """Make the first image the next one."""
        self.close()
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
        if self._container is not None:
            self._container.close()
        self._container, self._frames = None, iter(())
        self._held.clear()

    def _advance(self) -> av.VideoFrame:
        with library_failures(self._path, "a video"):
            frame = next(self._frames, None)
        if frame is None:
            present = self._next
            self.close()
            raise OSError(
                f"{self._path}: gives {present} images when decoded, its packets promise {self._count}; "
                "it is cut or damaged, export it again"
            )
        if self._keys and frame.pts != self._times[self._next]:
            # Images do not come at the times of their packets: their numbers are by counting alone.
            self._keys = []
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
