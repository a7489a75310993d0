"""Photron recordings: raw images (.mraw) with a header beside them (.cih as text, .cihx as XML)."""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass, field
from math import isfinite
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import numpy as np
from numpy.typing import NDArray

from torchsphere.recording.levels import unpack_12
from torchsphere.recording.recording import Reader, Recording
from torchsphere.recording.refusal import library_failures, look_of

HEADER_SUFFIXES = (".cihx", ".cih")
# Headers have 10 to 20 kB, more with thumbnails.
_MAX_HEADER_BYTES = 16 * 2**20
# Headers have some hundred tags; the tree of a tag takes a hundred times the bytes of the tag.
_MAX_TAGS = 20_000
#: Bytes that are unpacked at once (docs/constants.md).
_CHUNK_BYTES = 3 * 2**17

# Fields of the header: name in a text header, path in an XML header.
_FIELDS = {
    "format": ("File Format", "imageFileInfo/fileFormat"),
    "width": ("Image Width", "imageDataInfo/resolution/width"),
    "height": ("Image Height", "imageDataInfo/resolution/height"),
    "colour": ("Color Type", "imageDataInfo/colorInfo/type"),
    "bits": ("Color Bit", "imageDataInfo/colorInfo/bit"),
    "depth": ("EffectiveBit Depth", "imageDataInfo/effectiveBit/depth"),
    "side": ("EffectiveBit Side", "imageDataInfo/effectiveBit/side"),
    "frames": ("Total Frame", "frameInfo/totalFrame"),
    "start": ("Start Frame", "frameInfo/startFrame"),
    "step": ("Save Step", "frameInfo/skipFrame"),
    "rate": ("Record Rate(fps)", "recordInfo/recordRate"),
    "shutter": ("Shutter Speed(s)", "recordInfo/shutterSpeed"),
    "shutter_ns": ("Shutter Type2(nsec)", "recordInfo/shutterSpeedNsec"),
    "trigger": ("Trigger Mode", "recordInfo/triggerMode/mode"),
    "camera": ("Camera Type", "deviceInfo/deviceName"),
}


@dataclass(frozen=True)
class _Header:
    path: Path
    values: Mapping[str, str]
    names: Mapping[str, str] = field(repr=False)

    def whole(self, key: str) -> int:
        """A required whole number."""
        text = self.values.get(key, "")
        if not re.fullmatch(r"[+-]?\d{1,18}", text):
            raise ValueError(
                f"{self.path}: {self.names[key]} is {text!r} in the header, expected a whole number; "
                "the header is incomplete, copy or export it again"
            )
        return int(text)

    def number(self, key: str) -> float | None:
        """A positive number, or None."""
        try:
            value = float(self.values.get(key, ""))
        except ValueError:
            return None
        return value if isfinite(value) and value > 0 else None


def open_photron(path: Path) -> Recording:
    """Open a Photron recording by its header or its raw file; the other file lies beside it with the same name."""
    header_path = path if path.suffix.lower() in HEADER_SUFFIXES else _partner(path, HEADER_SUFFIXES)
    header = _read_header(header_path)
    _require_grey_mraw(header)
    raw_path = path if header_path != path else _partner(path, (".mraw",))
    shape = (header.whole("frames"), header.whole("height"), header.whole("width"))
    bits, depth, depth_notes = _depth(header)
    if bits not in (8, 12, 16) or not 1 <= depth <= bits:
        raise ValueError(
            f"{header.path}: {depth} bits in {bits} are stated; expected 8, 12 (packed) or 16 bits per pixel, "
            "save the recording with one of these"
        )
    shift = bits - depth if header.values.get("side", "").lower() == "higher" else 0
    _require_size(raw_path, header_path, shape, bits)
    exposure, exposure_origin = _exposure(header)
    offset, trigger_notes = _trigger_offset(header)
    facts = {
        "bit_depth": (depth, header.names["depth"]),
        "frame_rate": (header.number("rate"), header.names["rate"]),
        "exposure_s": (exposure, exposure_origin),
        "trigger_offset_frames": (offset, header.names["start"]),
    }
    return Recording(
        path=path,
        kind=f"Photron MRAW, {bits} bit{' packed' if bits == 12 else ''}",
        shape=shape,
        bit_depth=depth,
        frame_rate=header.number("rate"),
        exposure_s=exposure,
        trigger_offset_frames=offset,
        origins={key: origin for key, (value, origin) in facts.items() if value is not None},
        notes=depth_notes + trigger_notes + _step_notes(header),
        files=(header_path, raw_path),
        _reader=_reader(raw_path, shape, bits, shift),
    )


def _depth(header: _Header) -> tuple[int, int, tuple[str, ...]]:
    """Bits of a stored pixel, bits of its levels, and a note where the camera saved fewer bits than it has."""
    bits, depth = header.whole("bits"), header.whole("depth")
    if not (bits == 8 and bits < depth <= 16):
        return bits, depth, ()
    # The header states the depth of the camera; the file holds its upper bits, whatever side is stated.
    return bits, bits, (f"The camera has {depth} bits, of which {bits} were saved; the levels are as stored.",)


def _partner(path: Path, suffixes: tuple[str, ...]) -> Path:
    for suffix in suffixes:
        for candidate in (path.with_suffix(suffix), path.with_suffix(suffix.upper())):
            if candidate.is_file():
                return candidate
    wanted = " or ".join(path.with_suffix(suffix).name for suffix in suffixes)
    raise FileNotFoundError(
        f"{path}: {wanted} is not beside it; a Photron recording is a header and a raw file of the same name, "
        "so copy both into one folder"
    )


def _read_header(path: Path) -> _Header:
    if not 0 < path.stat().st_size <= _MAX_HEADER_BYTES:
        raise ValueError(
            f"{path}: has {path.stat().st_size} bytes, expected a Photron header of some kB; copy it again"
        )
    data = path.read_bytes()
    if path.suffix.lower() == ".cihx":
        return _read_xml(path, data)
    if b"Camera Information Header" not in data[:64]:
        raise ValueError(
            f"{path}: looks like {look_of(path)}, expected a Photron header that begins with "
            "'#Camera Information Header'; check the name"
        )
    pairs = (line.split(":", 1) for line in data.decode("latin-1").splitlines() if ":" in line)
    # Later sections repeat names; the first value counts.
    found: dict[str, str] = {}
    for name, value in pairs:
        found.setdefault(name.strip(), value.strip())
    values = {key: found[text] for key, (text, _) in _FIELDS.items() if text in found}
    return _Header(path, values, {key: f"CIH {text}" for key, (text, _) in _FIELDS.items()})


def _read_xml(path: Path, data: bytes) -> _Header:
    start, stop = data.find(b"<cih>"), data.rfind(b"</cih>")
    if start < 0 or stop < start:
        raise ValueError(
            f"{path}: looks like {look_of(path)} without a whole <cih> section, expected a Photron header; "
            "it is cut or of another kind, copy or export it again"
        )
    if data.count(b"<", start, stop) > _MAX_TAGS:
        raise ValueError(
            f"{path}: has more than {_MAX_TAGS} tags, expected a Photron header of some hundred; copy it again"
        )
    with library_failures(path, "a Photron header"):
        root = ElementTree.fromstring(data[start:stop].decode("utf-8", "replace") + "</cih>")
    texts = {key: (root.findtext(place) or "").strip() for key, (_, place) in _FIELDS.items()}
    names = {key: f"CIHX {place.rsplit('/', 1)[-1]}" for key, (_, place) in _FIELDS.items()}
    return _Header(path, {key: text for key, text in texts.items() if text}, names)


def _require_grey_mraw(header: _Header) -> None:
    file_format = header.values.get("format", "MRaw")
    if file_format.lower() != "mraw":
        raise ValueError(
            f"{header.path}: the images were saved as {file_format}, expected MRAW; "
            "open the folder or the file with the images instead of the header"
        )
    colour = header.values.get("colour", "Mono")
    # Monochrome cameras may say "raw", too; the C in the type ("type 1100K-C-64GB") marks a colour mosaic.
    mosaic = colour.lower() == "raw" and re.search(r"\d+K-C\b", header.values.get("camera", ""))
    if colour.lower() not in ("mono", "raw") or mosaic:
        raise ValueError(
            f"{header.path}: the colour type is {colour}{' of a colour camera' if mosaic else ''}, "
            "expected a monochrome recording; save it as grey images (TIFF or PNG) and open their folder"
        )


def _exposure(header: _Header) -> tuple[float | None, str]:
    nanoseconds = header.number("shutter_ns")
    if nanoseconds is not None:
        return nanoseconds / 1e9, header.names["shutter_ns"]
    text = header.values.get("shutter", "")
    fraction = re.fullmatch(r"1\s*/\s*(\d+(?:\.\d*)?)(?:\s*s(?:ec)?)?", text)
    # The XML header holds the reciprocal: 50000 means 1/50000 s.
    reciprocal = float(fraction[1]) if fraction else None
    if reciprocal is None and header.path.suffix.lower() == ".cihx":
        reciprocal = header.number("shutter")
    return (1.0 / reciprocal if reciprocal else None), header.names["shutter"]


def _trigger_offset(header: _Header) -> tuple[int | None, tuple[str, ...]]:
    text = header.values.get("start", "")
    if not re.fullmatch(r"[+-]?\d{1,9}", text):
        return None, ()
    mode = header.values.get("trigger", "")
    # With trigger mode "start", image 0 is the trigger; negative numbers always count from the trigger.
    if mode.lower() == "start" or int(text) < 0:
        return int(text), ()
    note = (
        f"The first image is number {text} of the recording ({header.names['start']}); "
        "the header does not say how far that is from the trigger."
    )
    return None, (note,)


def _step_notes(header: _Header) -> tuple[str, ...]:
    step, rate = header.number("step"), header.number("rate")
    if step is None or step <= 1 or rate is None:
        return ()
    note = (
        f"The header says that every {step:g}th recorded image was saved ({header.names['step']}); if this is true, "
        f"the images are {step:g} recording intervals apart and the frame rate to use is {rate / step:g}."
    )
    return (note,)


def _require_size(raw: Path, header: Path, shape: tuple[int, int, int], bits: int) -> None:
    n, height, width = shape
    if height * width * bits % 8:
        raise ValueError(
            f"{header}: {width} x {height} px of {bits} bits do not fill whole bytes; it is damaged, export again"
        )
    image_bytes = height * width * bits // 8
    size = raw.stat().st_size
    if size < n * image_bytes:
        raise OSError(
            f"{raw}: is cut: {size // image_bytes} whole images of {image_bytes} bytes are present, "
            f"{header.name} states {n}; copy the file again"
        )
    if size > n * image_bytes:
        raise OSError(
            f"{raw}: has {size} bytes, but {n} images of {width} x {height} px and {bits} bits as {header.name} states "
            f"take {n * image_bytes}; the two files do not belong together, find the right header"
        )


def _reader(raw: Path, shape: tuple[int, int, int], bits: int, shift: int) -> Reader:
    _, height, width = shape
    image_bytes = height * width * bits // 8

    def read(start: int, stop: int) -> NDArray[Any]:
        with raw.open("rb") as file:
            data = np.fromfile(file, np.uint8, (stop - start) * image_bytes, offset=start * image_bytes)
        if data.size != (stop - start) * image_bytes:
            raise OSError(f"{raw}: became shorter while it was read; copy it again")
        if bits == 12:
            return _unpack(data, shift).reshape(stop - start, height, width)
        levels: NDArray[Any] = data if bits == 8 else data.view("<u2")
        return (levels >> shift if shift else levels).reshape(stop - start, height, width)

    return read


def _unpack(data: NDArray[np.uint8], shift: int) -> NDArray[np.float32]:
    levels = np.empty(data.size // 3 * 2, np.float32)
    for first in range(0, data.size, _CHUNK_BYTES):
        piece = unpack_12(data[first : first + _CHUNK_BYTES])
        levels[first // 3 * 2 : first // 3 * 2 + piece.size] = piece >> shift if shift else piece
    return levels
