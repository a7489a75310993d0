"""Phantom CINE files.

The layout is public: three fixed structures, a table of offsets, images each behind an annotation. Real files of three
software versions confirm the offsets below. As in FFmpeg, pims and pycine, rows of unpacked images run from the bottom
up (as in a Windows bitmap of positive height), rows of packed images from the top down.
"""

from __future__ import annotations

import struct
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np
from numpy.typing import NDArray

from torchsphere.recording import image_times
from torchsphere.recording.facts import stated
from torchsphere.recording.image_times import Clock
from torchsphere.recording.levels import GREY_NOTE, TABLE_NOTE, linear_12_bit, to_grey, unpack_10, unpack_12
from torchsphere.recording.orientation import after_another
from torchsphere.recording.recording import MAX_PIXELS, Reader, Recording
from torchsphere.recording.refusal import look_of

_FILE_HEADER = struct.Struct("<2sHHHiIiIIII")  # Type ... OffImageOffsets; the trigger's date follows
_BITMAP_HEADER = struct.Struct("<IiiHHIIii")  # biSize ... biYPelsPerMeter
_PACKED_10, _PACKED_12 = 256, 1024  # biCompression
_UNINTERPOLATED = 2  # Compression in the file header: the colours are a mosaic

# Mosaics by the code of the field CFA, from the top row: Bayer's, and the same flipped. Others are four pixels wide.
_PATTERNS = {3: "GBRG", 4: "RGGB", 5: "GRBG", 6: "BGGR"}

# Codes of `torchsphere.recording.orientation` for two mirrors (left to right, top to bottom) and an angle.
_MIRRORED = {(False, False): 1, (True, False): 2, (False, True): 4, (True, True): 3}
_ROTATED = {0: 1, 90: 8, -90: 6, 180: 3, -180: 3, 270: 6, -270: 8}  # positive counterclockwise, deg

# Fields of SETUP: offset in bytes, format.
_MARK, _LENGTH = (140, "2s"), (142, "H")
_RATE_16, _SHUTTER_16_US = (0, "H"), (2, "H")
_FLIP_H, _FLIP_V, _RATE, _SHUTTER_US = (756, "i"), (760, "i"), (768, "I"), (772, "I")
_MOSAIC, _ROTATE, _REAL_BITS, _RATE_STEPS, _SHUTTER_NS = (808, "I"), (884, "i"), (896, "I"), (1048, "I"), (1568, "I")
_SETUP_BYTES = 1572

_HEAD = struct.Struct("<IHH")  # size with this head, type, reserved
_TIMES, _EXPOSURES = 1002, 1003
_ORIGIN = "CINE block 1002"

#: Times and exposures count in this part of a second; two lowest bits of a time are flags of IRIG and event.
_TICK_S, _FLAGS = 2.0**-32, np.uint64(3)

#: Difference from the set-up's exposure, as a share of it, from which the images' own is stated.
_SAME_EXPOSURE = 0.01


@dataclass(frozen=True)
class _Images:
    """Layout of the images in the file."""

    path: Path
    shape: tuple[int, int, int]
    table: int  # offset of the table of offsets
    pointer: str  # type of its entries
    bits: int  # per pixel in the file, all channels
    compression: int
    row_bytes: int
    top_down: bool

    @property
    def is_colour(self) -> bool:
        return self.bits in (24, 48)

    @property
    def image_bytes(self) -> int:
        return self.row_bytes * self.shape[1]


def open_phantom(path: Path) -> Recording:
    """Open a CINE file; 10-bit packed images are linearised to 12 bit, colour images become grey."""
    size = path.stat().st_size
    with path.open("rb") as file:
        head = _at(path, file, 0, _FILE_HEADER.size)
        mark, _, compression, version, _, _, first, n, bitmap_at, setup_at, table_at = _FILE_HEADER.unpack(head)
        if mark != b"CI":
            raise ValueError(f"{path}: looks like {look_of(path)}, expected a Phantom CINE; check the name")
        bitmap = _BITMAP_HEADER.unpack(_at(path, file, bitmap_at, _BITMAP_HEADER.size))
        setup = _setup(path, file, setup_at)
        if compression == 1 or version not in (0, 1):
            raise ValueError(
                f"{path}: is a CINE with {'JPEG images' if compression == 1 else f'version {version}'}, "
                "expected uncompressed or packed images of version 0 or 1; save it again as raw CINE"
            )
        images = _layout(path, n, bitmap, table_at, "<u8" if version == 1 else "<u4")
        _require_whole(images, file, size)
    pattern = _pattern(path, setup(_MOSAIC) & 0xFFFFFF) if compression == _UNINTERPOLATED else None
    rate, exposure, exposure_origin = _rate_and_exposure(setup)
    own = read_times(path, setup_at + setup(_LENGTH), table_at, n, rate)
    across, down = bitmap[-2:]
    aspect = down / across if across > 0 and down > 0 else None
    code = _orientation(setup)
    known = {
        "bit_depth": _depth(images, setup(_REAL_BITS)),
        "trigger_offset_frames": (first, "CINE FirstImageNo"),
        "frame_rate": own.frame_rate(rate),
        "exposure_s": own.exposure(exposure, exposure_origin),
        "pixel_aspect": (aspect, "CINE biXPelsPerMeter and biYPelsPerMeter"),
        "bayer": (pattern, "CINE SETUP CFA"),
        "orientation": (None if code == 1 else code, "CINE SETUP bFlipH, bFlipV and Rotate"),
    }
    packed, colour = " packed" if images.compression else "", ", colour" if images.is_colour else ""
    return Recording(
        path=path,
        kind=f"Phantom CINE, {images.bits} bit{packed}{colour}",
        shape=images.shape,
        **stated(known),
        times=None if own.clock is None else own.clock.times,
        notes=_notes(images, setup, has_times=own.clock is not None) + own.notes,
        files=(path,),
        _reader=_reader(images),
    )


def _at(path: Path, file: BinaryIO, offset: int, count: int) -> bytes:
    file.seek(offset)
    data = file.read(count)
    if len(data) < count:
        raise OSError(
            f"{path}: ends before byte {offset + count}, where the CINE header places data; it is cut, copy it again"
        )
    return data


def _setup(path: Path, file: BinaryIO, offset: int) -> Callable[[tuple[int, str]], int]:
    """The function that reads a field of the camera's settings, 0 where an older, shorter SETUP ends before it."""
    file.seek(offset)
    data = file.read(_SETUP_BYTES)
    if data[_MARK[0] : _MARK[0] + 2] != b"ST" or len(data) < 144:
        raise OSError(
            f"{path}: has no camera settings (SETUP) where the CINE header places them; it is damaged, copy it again"
        )
    length = min(len(data), struct.unpack_from("<" + _LENGTH[1], data, _LENGTH[0])[0])

    def field(place: tuple[int, str]) -> int:
        offset, code = place
        is_there = offset + struct.calcsize("<" + code) <= length
        return int(struct.unpack_from("<" + code, data, offset)[0]) if is_there else 0

    return field


def _layout(path: Path, n: int, bitmap: tuple[int, ...], table_at: int, pointer: str) -> _Images:
    _, width, signed_height, _, bits, compression, stated, _, _ = bitmap
    height = abs(signed_height)
    if min(n, width, height) < 1 or width * height > MAX_PIXELS:
        raise ValueError(
            f"{path}: {n} images of {width} x {height} px are stated; the header is damaged, copy it again"
        )
    packed = {_PACKED_10: 10, _PACKED_12: 12}
    if compression in packed and bits <= 16:
        bits = packed[compression]
    elif compression != 0 or bits not in (8, 16, 24, 48):
        raise ValueError(
            f"{path}: images with {bits} bits and compression code {compression}; expected 8 or 16 bits grey, "
            "24 or 48 bits colour, or packed 10 or 12 bits; save the recording as one of these"
        )
    # Packed images have no padding; bitmaps may pad rows to four bytes.
    row = width * bits // 8
    padded = -(-row // 4) * 4
    if width * height * bits % 8 == 0 and stated in (0, width * height * bits // 8) and (width * bits % 8 == 0):
        row_bytes = row
    elif compression == 0 and stated == padded * height:
        row_bytes = padded
    else:
        raise ValueError(
            f"{path}: {stated} bytes per image are stated, but {width} x {height} px of {bits} bits take "
            f"{width * height * bits // 8}; the header is damaged, copy it again"
        )
    return _Images(
        path, (n, height, width), table_at, pointer, bits, compression, row_bytes, compression != 0 or signed_height < 0
    )


def _require_whole(images: _Images, file: BinaryIO, size: int) -> None:
    n = images.shape[0]
    width = np.dtype(images.pointer).itemsize
    if n * (images.image_bytes + 8 + width) > size:
        present = max(0, (size - images.table - n * width) // (images.image_bytes + 8))
        raise OSError(
            f"{images.path}: is cut: about {present} images of {images.image_bytes} bytes are present, the header "
            f"states {n}; copy the file again"
        )
    table = np.frombuffer(_at(images.path, file, images.table, n * width), images.pointer)
    whole = table <= size - images.image_bytes - 8
    if not whole.all():
        raise OSError(
            f"{images.path}: is cut or damaged: {int(whole.sum())} of {n} images lie inside the file; copy it again"
        )


def _depth(images: _Images, real_bits: int) -> tuple[int, str]:
    if images.compression == _PACKED_10:
        return 12, "12 bit after the table for packed 10-bit CINE"
    channel_bits = images.bits // 3 if images.is_colour else images.bits
    if 1 <= real_bits <= channel_bits:
        return real_bits, "CINE SETUP RealBPP"
    return channel_bits, "CINE biBitCount"


def _rate_and_exposure(setup: Callable[[tuple[int, str]], int]) -> tuple[float | None, float | None, str]:
    """Frame rate, 1/s, and exposure, s, of the set-up, and the field of the exposure."""
    rate = float(setup(_RATE) or setup(_RATE_16)) or None
    exposure = setup(_SHUTTER_NS) / 1e9 or (setup(_SHUTTER_US) or setup(_SHUTTER_16_US)) / 1e6 or None
    return rate, exposure, "CINE SETUP ShutterNs" if setup(_SHUTTER_NS) else "CINE SETUP Shutter"


def _pattern(path: Path, code: int) -> str | None:
    """The mosaic of a sensor by its code, None for a grey sensor; ValueError for other mosaics than Bayer's."""
    if code and code not in _PATTERNS:
        raise ValueError(
            f"{path}: holds a colour mosaic of code {code} (SETUP CFA), expected one of 2 x 2 pixels, codes 3 to 6; "
            "save it from the camera's software with the colours interpolated, or as grey"
        )
    return _PATTERNS.get(code)


def _orientation(setup: Callable[[tuple[int, str]], int]) -> int:
    """How the camera's software shows the images: mirrored, then rotated."""
    mirrored = _MIRRORED[bool(setup(_FLIP_H)), bool(setup(_FLIP_V))]
    return after_another(mirrored, _ROTATED.get(setup(_ROTATE), 1))


def _notes(images: _Images, setup: Callable[[tuple[int, str]], int], *, has_times: bool) -> tuple[str, ...]:
    notes = []
    if images.compression == _PACKED_10:
        notes.append(TABLE_NOTE)
    if images.is_colour:
        notes.append(GREY_NOTE)
    if setup(_ROTATE) not in _ROTATED:
        notes.append(
            f"The camera's software shows these images rotated by {setup(_ROTATE)} deg (SETUP Rotate), which is no "
            "right angle; here they are not rotated."
        )
    if 1 <= setup(_RATE_STEPS) <= 16 and not has_times:
        notes.append(
            "The frame rate changed during the recording (SETUP FRPSteps); frame_rate is its main setting only."
        )
    return tuple(notes)


def _reader(images: _Images) -> Reader:
    _, height, width = images.shape
    pointer = np.dtype(images.pointer)
    table = linear_12_bit().astype(np.float32)

    def decode(data: NDArray[np.uint8]) -> NDArray[Any]:
        if images.compression:
            codes = unpack_10(data) if images.bits == 10 else unpack_12(data)
            return (table[codes] if images.bits == 10 else codes).reshape(height, width)
        rows = data.reshape(height, images.row_bytes)[:, : width * images.bits // 8]
        levels = np.ascontiguousarray(rows).view("<u2" if images.bits in (16, 48) else "u1")
        return to_grey(levels.reshape(height, width, 3), reverse=True) if images.is_colour else levels

    def read(start: int, stop: int) -> NDArray[Any]:
        path, result = images.path, np.empty((stop - start, height, width), np.float32)
        with path.open("rb") as file:
            places = _at(path, file, images.table + start * pointer.itemsize, (stop - start) * pointer.itemsize)
            for row, place in enumerate(np.frombuffer(places, pointer).tolist()):
                annotation, *_ = struct.unpack("<I", _at(path, file, place, 4))
                data = _at(path, file, place + max(annotation, 8), images.image_bytes)
                image = decode(np.frombuffer(data, np.uint8))
                result[row] = image if images.top_down else image[::-1]
        return result

    return read


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
