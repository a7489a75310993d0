"""Headers of Photron recordings: .cih as text, .cihx as XML."""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass, field
from math import isfinite
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

from torchsphere.recording.refusal import library_failures, look_of
from torchsphere.runtime.warning_levels import severe

HEADER_SUFFIXES = (".cihx", ".cih")
# Headers have 10 to 20 kB, more with thumbnails.
_MAX_HEADER_BYTES = 16 * 2**20
# Headers have some hundred tags; the tree of a tag takes a hundred times the bytes of the tag.
_MAX_TAGS = 20_000
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
class Header:
    """Fields of a header as texts, and their names in it."""

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


def read_header(path: Path) -> Header:
    """Read a header; raises ValueError or OSError for other files."""
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
    return Header(path, values, {key: f"CIH {text}" for key, (text, _) in _FIELDS.items()})


def _read_xml(path: Path, data: bytes) -> Header:
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
    return Header(path, {key: text for key, text in texts.items() if text}, names)


def facts_of(header: Header) -> tuple[dict[str, tuple[Any, str]], tuple[str, ...]]:
    """Frame rate, exposure and trigger, each with the name of its field, None where not stated, and notes."""
    offset, notes = _trigger_offset(header)
    facts = {
        "frame_rate": (header.number("rate"), header.names["rate"]),
        "exposure_s": _exposure(header),
        "trigger_offset_frames": (offset, header.names["start"]),
    }
    return facts, notes + _step_notes(header)


def _exposure(header: Header) -> tuple[float | None, str]:
    """Exposure, s, and the name of its field."""
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


def _trigger_offset(header: Header) -> tuple[int | None, tuple[str, ...]]:
    """Number of the first image from the trigger, and a note where the header does not tell it."""
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


def _step_notes(header: Header) -> tuple[str, ...]:
    """A warning where only every so many-th image was saved."""
    step, rate = header.number("step"), header.number("rate")
    if step is None or step <= 1 or rate is None:
        return ()
    sentence = (
        f"The header says that only one of {step:g} recorded images was saved ({header.names['step']}); if this is "
        f"true, the images are {step:g} recording intervals apart, and the frame rate is not {rate:g} but "
        f"{rate / step:g}: give it as `fps`."
    )
    return (severe(sentence),)
