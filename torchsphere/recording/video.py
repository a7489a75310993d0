"""Videos (AVI, MP4, MOV, MKV, WebM) through PyAV."""

from __future__ import annotations

import contextlib
import itertools
import re
import threading
from bisect import bisect_right
from collections import deque
from collections.abc import Callable, Iterator
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from torchsphere.recording.facts import stated
from torchsphere.recording.levels import GREY_NOTE, to_grey
from torchsphere.recording.luma import Luma
from torchsphere.recording.matroska import Contents, contents
from torchsphere.recording.recording import Recording
from torchsphere.recording.refusal import ISO_VIDEO, MATROSKA, LibraryMissingError, library_failures, look_of
from torchsphere.recording.video_display import hidden_note, images_in_file, orientation_of, pixel_aspect_of
from torchsphere.runtime.warning_levels import Warned

if TYPE_CHECKING:
    import av
    from av.container import InputContainer

# PyAV's reader of each type; a named reader keeps the content of the file from choosing another.
_READERS = {"an AVI video": "avi", ISO_VIDEO: "mov", MATROSKA: "matroska"}

#: Number of the latest images that are held for a batch that is read again (docs/constants.toml).
RECENT_IMAGES = 80

#: Bytes of decoded images that are kept for later passes over the recording (docs/constants.toml).
CACHE_BYTES = 2**28

#: PyAV's picture type of an image that needs no other image; some encoders mark other images as key images.
INTRA = 1


def open_video(path: Path) -> Recording:
    """Open a video, always without a frame rate: a container states the rate of playback, not of the camera."""
    look = look_of(path)
    reader = _READERS.get(look)
    if reader is None:
        raise ValueError(f"{path}: looks like {look}, expected a video; check the name")
    cursor = Cursor(path, reader)
    with library_failures(path, "a video"):
        n, playback = cursor.survey()
        present = cursor.completeness(n) if n else ()
    if n < 1:
        raise OSError(f"{path}: holds no images; the video is cut or incomplete, copy or export it again")
    with library_failures(path, "a video"):
        frame = cursor.first()
    height, width = frame.height, frame.width
    decode, depth, notes = _decoder(path, frame)
    code, matrix_notes = orientation_of(frame)
    notes += present + matrix_notes + hidden_note(n, cursor.in_file)
    cursor.expect(n, (height, width), decode)
    if playback:
        notes += (f"The container plays at {playback:g} frames/s; the rate of recording is not known.",)
    return Recording(
        path=path,
        kind=f"video, {cursor.codec}, {frame.format.name}",
        shape=(n, height, width),
        **stated(
            {
                "bit_depth": (depth, f"pixel format {frame.format.name}"),
                "pixel_aspect": (cursor.pixel_aspect, "sample aspect ratio"),
                "orientation": (None if code == 1 else code, "display matrix"),
            }
        ),
        notes=notes,
        files=(path,),
        _reader=cursor.read,
        _closer=cursor.close,
    )


def _stated_duration(container: InputContainer, stream: av.VideoStream) -> float | None:
    """Length of the video as a Matroska file states it, s; None where it states that of other streams as well."""
    match = re.fullmatch(r"(\d{2}):(\d{2}):(\d{2}\.\d{1,9})", stream.metadata.get("DURATION", ""))
    if match is not None:
        return 3600.0 * int(match[1]) + 60.0 * int(match[2]) + float(match[3])
    is_alone = len(container.streams) == 1 and container.format.name.startswith("matroska")
    return 1e-6 * container.duration if is_alone and container.duration else None


def _colour_levels(form: str, frame: av.VideoFrame) -> NDArray[Any]:
    return to_grey(frame.to_ndarray(format=form))


def _decoder(path: Path, frame: av.VideoFrame) -> tuple[Callable[[av.VideoFrame], NDArray[Any]], int, tuple[str, ...]]:
    """The function that turns a frame into grey levels (h, w), their depth in bits, and notes."""
    name, components = frame.format.name, frame.format.components
    bits = components[0].bits if components else 0
    luma = Luma.of(name, bits)
    if luma is not None:
        note = "The grey levels are the brightness (luma) as decoded; the colour was ignored."
        return luma.levels, bits, () if name.startswith("gray") else (note,)
    if frame.format.is_rgb or name == "pal8":
        wide = bits > 8
        return partial(_colour_levels, "rgb48le" if wide else "rgb24"), 16 if wide else 8, (GREY_NOTE,)
    raise ValueError(
        f"{path}: the pixels are {name}, expected grey, YUV or RGB; convert the video, for example to gray"
    )


class Cursor:
    """A position in a video, from which images are decoded forwards, or from a nearer key image.

    A seek in compressed video may land on another image than the requested key image. The time of the image tells,
    and after a wrong landing the video is decoded from its start.
    """

    def __init__(self, path: Path, reader: str) -> None:
        self.codec = ""
        self.pixel_aspect: float | None = None
        #: Number of images in the file, those that an edit list hides included.
        self.in_file = 0
        self._path, self._reader = path, reader
        self._container: InputContainer | None = None
        self._frames: Iterator[av.VideoFrame] = iter(())
        self._next = self._count = 0
        self._size = (0, 0)
        self._decode: Callable[[av.VideoFrame], NDArray[Any]] | None = None
        # The latest images in order; the last has the number `_next` - 1.
        self._recent: deque[NDArray[Any]] = deque(maxlen=RECENT_IMAGES)
        self._cache: dict[int, NDArray[Any]] = {}  # by number
        self._cached_bytes = 0
        # Times of all images and numbers of the key images; empty where the times are not known.
        self._times: list[int] = []
        self._keys: list[int] = []
        self._jumped = False
        # What the container says, s: the length of the whole video, the unit of the times, the step of playback.
        self._stated_s: float | None = None
        self._tick_s = self._playback_s = 0.0
        self._contents = Contents()
        self._lock = threading.Lock()  # threads share the position

    def survey(self) -> tuple[int, float | None]:
        """Count the images and give the playback rate, without decoding."""
        with self._open() as container:
            if not container.streams.video:
                return 0, None
            stream = container.streams.video[0]
            self.codec = stream.codec_context.name
            self.pixel_aspect = pixel_aspect_of(stream)
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
            self.in_file = whole
            if self._reader == "mov" and max(stream.frames, whole) > len(times):
                self.in_file = images_in_file(self._path, self._reader)
            # AVI and MP4 state the number of their images; for other containers it is 0.
            if stream.frames > self.in_file:
                raise EOFError(f"{self.in_file} of {stream.frames} images are present")
            if self._reader == "matroska":
                self._contents = contents(self._path)
            if self._contents.images > whole:
                raise EOFError(f"{whole} of {self._contents.images} images can be read")
            self._stated_s = _stated_duration(container, stream)
            self._tick_s = float(stream.time_base or 0)
            self._playback_s = float(1 / rate) if rate else 0.0
            known = [time for time in times if time is not None]
            if len(set(known)) == len(times):
                self._times = sorted(known)
                self._keys = [number for number, time in enumerate(self._times) if time in keys]
            return len(times), float(rate) if rate else None

    def completeness(self, count: int) -> tuple[str, ...]:
        """Compare ``count`` images with what the container states; notes on gaps, EOFError if images are missing.

        AVI and MP4 state the number of their images. Matroska and WebM state their length in time and in bytes: without
        this comparison, a file that is cut or damaged opens with fewer images.
        """
        times = self._tick_s * np.array(self._times)
        # A single image has no step but that of the rate of playback.
        step = float(np.median(np.diff(times))) if len(times) > 1 else self._playback_s
        # Matroska counts from the first image; other containers may begin at any time.
        before = [-step] if self._reader == "matroska" else []
        steps = np.diff([*before, *times])
        gaps = int((np.rint(steps / step) - 1).clip(0).sum()) if step else 0
        notes = self._damage(count, float(times[-1]) if len(times) else None, step, gaps)
        if gaps:
            first = int(np.argmax(steps > 1.5 * step)) + 1 - len(before)
            sentence = (
                f"The times of the images leave room for {gaps} more, the first before image {first}: images are "
                "missing, or were taken unevenly; they count as successive, so motion across a gap comes out too fast."
            )
            notes += (Warned(sentence),)
        return notes

    def _damage(self, count: int, last_s: float | None, step: float, gaps: int) -> tuple[str, ...]:
        """Notes on damage that cost no image; EOFError unless the stated length shows that all images are there."""
        end, damaged_at = self._contents.end, self._contents.damaged_at
        lacking = 0 if end is None else max(0, end - self._path.stat().st_size)
        late = None if self._stated_s is None or not step or last_s is None else (self._stated_s - last_s) / step - 1
        if late is not None and late > 0.5:
            raise EOFError(f"{count} images are present, and about {round(late)} images at the end are missing")
        if lacking and late is None:
            raise EOFError(f"{count} images are present, and {lacking} bytes at the end are missing")
        if lacking:
            return (f"The last {lacking} bytes of the file are missing; all images that it states are there.",)
        if damaged_at is None:
            return ()
        if gaps or late is None or late < -0.5:
            raise EOFError(f"{count} images are present, and others may be missing: it is damaged at byte {damaged_at}")
        return (f"The file is damaged at byte {damaged_at}; all images that it states are there.",)

    def first(self) -> av.VideoFrame:
        """Decode the first image."""
        with self._open() as container:
            return next(iter(container.decode(video=0)))

    def expect(self, count: int, size: tuple[int, int], decode: Callable[[av.VideoFrame], NDArray[Any]]) -> None:
        """Set the number of images, their size (h, w), and the function that turns a frame into grey levels."""
        self._count, self._size, self._decode = count, size, decode

    def read(self, start: int, stop: int) -> NDArray[np.float32]:
        """Images ``start`` to ``stop - 1``, float32."""
        with self._lock:
            images = {number: self._cache[number] for number in range(start, stop) if number in self._cache}
            missing = [number for number in range(start, stop) if number not in images]
            if missing:
                images |= self._decoded(missing[0], missing[-1] + 1)
            return np.stack([images[number] for number in range(start, stop)]).astype(np.float32)

    def _decoded(self, start: int, stop: int) -> dict[int, NDArray[Any]]:
        """Images ``start`` to ``stop - 1`` by their numbers."""
        before = bisect_right(self._keys, start)
        key = self._keys[before - 1] if before else 0
        is_back = self._container is None or start < self._next - len(self._recent)
        if key and (is_back or key > self._next):
            self._jump(key)
        elif is_back:
            self._restart()
        images = {n: image for n, image in enumerate(self._recent, self._next - len(self._recent)) if start <= n < stop}
        while self._next < stop:
            image = self._grey(self._advance())
            number = self._next - 1
            self._recent.append(image)
            images[number] = image
            if number not in self._cache and self._cached_bytes + image.nbytes <= CACHE_BYTES:
                self._cache[number] = image
                self._cached_bytes += image.nbytes
        return images

    def _clear_cache(self) -> None:
        self._cache.clear()
        self._cached_bytes = 0

    def _restart(self) -> None:
        """Go to the first image."""
        self._release()
        with library_failures(self._path, "a video"):
            self._container = self._open()
            self._container.streams.video[0].thread_type = "AUTO"
            self._frames = iter(self._container.decode(video=0))
        self._next, self._jumped = 0, False

    def _jump(self, key: int) -> None:
        """Go to the key image of that number, or to the first image where the video cannot seek to it."""
        if self._container is None:
            self._restart()
        assert self._container is not None
        time, frames, frame = self._times[key], self._frames, None
        # Some videos can only be read in order; reading in order also finds and names any damage.
        with contextlib.suppress(OSError), library_failures(self._path, "a video"):
            self._container.seek(time, stream=self._container.streams.video[0])
            frames = iter(self._container.decode(video=0))
            frame = next((f for f in frames if f.pts is None or f.pts >= time), None)
        if frame is None or frame.pts != time or int(frame.pict_type) != INTRA:
            self._keys = []
            self._restart()
            return
        self._frames, self._next, self._jumped = itertools.chain((frame,), frames), key, True
        self._recent.clear()

    def close(self) -> None:
        """Release the file and all images."""
        self._release()
        self._clear_cache()

    def _release(self) -> None:
        if self._container is not None:
            self._container.close()
        self._container, self._frames = None, iter(())
        self._recent.clear()

    def _advance(self) -> av.VideoFrame:
        with library_failures(self._path, "a video"):
            frame = next(self._frames, None)
        if frame is None:
            present = self._next
            self._release()
            raise OSError(
                f"{self._path}: gives {present} images when decoded, but has packets for {self._count}; "
                "the file is cut or damaged, export it again"
            )
        if self._keys and frame.pts != self._times[self._next]:
            # Images and packets have different times, so only counting gives the numbers of images.
            self._keys = []
            self._clear_cache()
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
            assert self._decode is not None
            # The memory of the frame belongs to the decoder, hence the copy.
            return np.array(self._decode(frame))

    def _open(self) -> InputContainer:
        try:
            import av
        except ImportError as error:
            raise LibraryMissingError(
                f'{self._path}: reading video needs PyAV, which is not installed; run: pip install "torchsphere[video]"'
            ) from error
        return av.open(str(self._path), mode="r", format=self._reader)
