"""Times and exposures of the single images of a Phantom CINE, in tagged blocks behind its SETUP."""

from __future__ import annotations

import struct
from dataclasses import dataclass
from pathlib import Path
from typing import BinaryIO

import numpy as np
from numpy.typing import NDArray

from torchsphere.recording import image_times
from torchsphere.recording.image_times import Clock

_HEAD = struct.Struct("<IHH")  # size with this head, type, reserved
_TIMES, _EXPOSURES = 1002, 1003
_ORIGIN = "CINE block 1002"

#: Times and exposures count in this part of a second; two lowest bits of a time are flags of IRIG and event.
_TICK_S, _FLAGS = 2.0**-32, np.uint64(3)

#: Difference from the set-up's exposure, as a share of it, from which the images' own is stated.
_SAME_EXPOSURE = 0.01


@dataclass(frozen=True)
class ImageTimes:
    """What the images of a CINE say of their times."""

    clock: Clock | None = None
    exposure_s: float | None = None  # of the images, by their median
    notes: tuple[str, ...] = ()

    def frame_rate(self, stated: float | None) -> tuple[float | None, str]:
        """The frame rate and its source, where the set-up has ``stated`` one."""
        if self.clock is None or not self.clock.counts_beside(stated):
            return stated, "CINE SETUP FrameRate"
        return self.clock.frame_rate, f"CINE image times ({_ORIGIN.removeprefix('CINE ')})"

    def exposure(self, stated: float | None, origin: str) -> tuple[float | None, str]:
        """The exposure and its source, where the set-up has ``stated`` one."""
        own = self.exposure_s
        if own is None or (stated is not None and abs(own / stated - 1) <= _SAME_EXPOSURE):
            return stated, origin
        return own, "CINE image exposures (block 1003)"


def read_times(path: Path, start: int, end: int, count: int, stated: float | None) -> ImageTimes:
    """Times and exposures of ``count`` images from the blocks between two bytes; the set-up has ``stated`` a rate."""
    with path.open("rb") as file:
        blocks = _blocks(file, start, end)
    stamps = np.frombuffer(blocks.get(_TIMES, b""), "<u8")
    if not len(stamps):
        return ImageTimes()
    clock = image_times.clock_of(_seconds(stamps)) if len(stamps) == count else None
    if count == 1:
        return ImageTimes()
    if clock is None:
        why = "cannot be those of one recording" if len(stamps) == count else f"are {len(stamps)} for {count} images"
        return ImageTimes(notes=(f"The images' own times ({_ORIGIN}) {why}, and were not used.",))
    notes = image_times.frame_rate_note(clock, stated, _ORIGIN) + image_times.spacing_notes(clock)
    return ImageTimes(clock, _exposure(blocks.get(_EXPOSURES, b""), count, 1 / clock.frame_rate), notes)


def _blocks(file: BinaryIO, start: int, end: int) -> dict[int, bytes]:
    """Contents of the blocks by their types; a block that does not fit ends the list."""
    found: dict[int, bytes] = {}
    at = start
    while at + _HEAD.size <= end:
        file.seek(at)
        size, kind, _ = _HEAD.unpack(file.read(_HEAD.size))
        if size < _HEAD.size or at + size > end:
            break
        if kind in (_TIMES, _EXPOSURES):
            found.setdefault(kind, file.read(size - _HEAD.size))
        at += size
    return found


def _seconds(stamps: NDArray[np.uint64]) -> NDArray[np.float64]:
    """Times since the first image, s, from times in fixed point."""
    ticks = (stamps & ~_FLAGS).astype(np.int64)
    seconds: NDArray[np.float64] = (ticks - ticks[0]) * _TICK_S
    return seconds


def _exposure(data: bytes, count: int, interval: float) -> float | None:
    """Median exposure of ``count`` images, s; None where it is not stated, or longer than the ``interval``."""
    values = np.frombuffer(data[: len(data) // 4 * 4], "<u4")
    if len(values) != count:
        return None
    exposure = float(np.median(values)) * _TICK_S
    return exposure if 0 < exposure <= interval else None
