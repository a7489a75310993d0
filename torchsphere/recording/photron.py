"""Photron recordings: raw images (.mraw) with a header beside them (.cih as text, .cihx as XML)."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from torchsphere.recording.facts import stated
from torchsphere.recording.levels import unpack_12
from torchsphere.recording.photron_header import HEADER_SUFFIXES, Header, facts_of, read_header
from torchsphere.recording.recording import Reader, Recording

#: Bytes that are unpacked at once (docs/constants.toml).
_CHUNK_BYTES = 3 * 2**17

#: What readers note where no frame rate is stated.
NO_RATE = "no frame rate"


def open_photron(path: Path) -> Recording:
    """Open a Photron recording by its header or its raw file; the other file lies beside it with the same name."""
    header_path = path if path.suffix.lower() in HEADER_SUFFIXES else _partner(path, HEADER_SUFFIXES)
    header = read_header(header_path)
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
    facts, notes = facts_of(header)
    return Recording(
        path=path,
        kind=f"Photron MRAW, {bits} bit{' packed' if bits == 12 else ''}",
        shape=shape,
        **stated({"bit_depth": (depth, header.names["depth"])} | facts),
        notes=depth_notes + notes,
        files=(header_path, raw_path),
        _reader=_reader(raw_path, shape, bits, shift),
    )


def _depth(header: Header) -> tuple[int, int, tuple[str, ...]]:
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


def _require_grey_mraw(header: Header) -> None:
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


def with_header_beside(recording: Recording) -> Recording:
    """The recording with the facts of the header of its export; unchanged without one."""
    path = _header_of(recording.path)
    if recording.frame_rate is not None or path is None:
        return recording
    try:
        header = read_header(path)
    except (ValueError, OSError) as error:
        return recording.changed(
            notes=(*recording.notes, f"The Photron header beside the images was not used: {error}.")
        )
    reason = _misfit(header, recording)
    if reason:
        note = f"The Photron header {path.name} beside the images was not used, as {reason}."
        return recording.changed(notes=(*recording.notes, note))
    return _with_facts(recording, header)


def _header_of(place: Path) -> Path | None:
    """The one header in a folder of images, or that with the name of the folder or the file beside it."""
    inside = [file for file in place.iterdir() if file.suffix.lower() in HEADER_SUFFIXES] if place.is_dir() else []
    endings = [end for suffix in HEADER_SUFFIXES for end in (suffix, suffix.upper())]
    beside = [place.parent / f"{name}{end}" for name in (place.name, place.stem) for end in endings]
    for candidates in (inside, beside):
        # A header with raw images of its own name belongs to these.
        found = [file for file in candidates if file.is_file() and not _has_raw_images(file)]
        if len({file.stem for file in found}) == 1:
            return min(found, key=lambda file: HEADER_SUFFIXES.index(file.suffix.lower()))
    return None


def _has_raw_images(header: Path) -> bool:
    return any(header.with_suffix(suffix).is_file() for suffix in (".mraw", ".MRAW"))


def _misfit(header: Header, recording: Recording) -> str:
    """Why a header is not that of the images; empty where it is."""
    for key, number, name in (("width", 2, "wide"), ("height", 1, "high")):
        stated = header.number(key)
        if stated is not None and stated != recording.shape[number]:
            return f"it states images {stated:g} px {name}, and these have {recording.shape[number]}"
    return "" if header.number("rate") else "it states no frame rate"


def _with_facts(recording: Recording, header: Header) -> Recording:
    count, notes = header.number("frames"), [note for note in recording.notes if NO_RATE not in note]
    if count is not None and count != len(recording):
        notes.append(
            f"The Photron header {header.path.name} states {count:g} images, and {len(recording)} are here: if single "
            "images are missing, motion across a gap comes out too fast."
        )
    facts, header_notes = facts_of(header)
    found = stated({name: (value, f"{field}, {header.path.name}") for name, (value, field) in facts.items()})
    return recording.changed(
        **found | {"origins": dict(recording.origins) | found["origins"]},
        notes=(*notes, *header_notes),
        files=(*recording.files, header.path),
    )
