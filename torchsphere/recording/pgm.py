"""PGM and PPM images: a header in text and plain levels, high byte first."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from torchsphere.recording.image_header import ImageHeader, ImageKind, require_size
from torchsphere.recording.refusal import HEAD_BYTES, look_of
from torchsphere.recording.tiff import Page

# Kind (5: grey, 6: colour), width, height and largest level, parted by blanks and comments, then one blank.
_HEADER = re.compile(rb"P([56])" + 3 * rb"(?:\s|#[^\r\n]*[\r\n])+(\d{1,9})" + rb"\s")


def _read_header(file: Path) -> tuple[ImageHeader, int]:
    """The header, and the byte at which the levels begin."""
    with file.open("rb") as stream:
        head = stream.read(HEAD_BYTES)
    found = _HEADER.match(head)
    if found is None:
        text = re.match(rb"P[1-4]\s", head) is not None
        raise ValueError(
            f"{file}: {'holds its levels as text or as single bits' if text else f'looks like {look_of(file)}'}, "
            "expected a binary PGM or PPM image (P5, P6); save it so"
        )
    kind, width, height, white = (int(group) for group in found.groups())
    if not 1 <= white <= 65535:
        raise ValueError(f"{file}: states {white} as its largest level, expected 1 to 65535; save it again")
    samples, size = (3 if kind == 6 else 1), (2 if white > 255 else 1)
    needed, there = width * height * samples * size, file.stat().st_size - found.end()
    require_size(file, height, width, needed)
    if there < needed:
        raise OSError(f"{file}: is cut: {there} of the {needed} bytes of its levels are present; copy it again")
    if there > needed:
        with file.open("rb") as stream:
            stream.seek(found.end() + needed)
            if re.match(rb"\s*P[1-6]\s", stream.read(16)):
                raise ValueError(f"{file}: holds several images, expected one image per file; part them")
    page = Page(height, width, samples, white.bit_length(), f"u{size}", 2 if samples == 3 else 1, False)
    return ImageHeader(page, f"largest level {white}"), found.end()


def _describe(file: Path) -> ImageHeader:
    return _read_header(file)[0]


def _load(file: Path, expected: ImageHeader) -> NDArray[Any]:
    header, at = _read_header(file)
    if header != expected:
        raise OSError(f"{file}: changed since the folder was opened; open it again")
    page = header.page
    count = page.height * page.width * page.samples
    return np.fromfile(file, f">{page.dtype}", count, offset=at)


_PLACES = {"bit_depth": "PGM largest level"}
PGM = ImageKind("PGM", (".pgm", ".ppm", ".pnm"), _describe, _load, "a PGM or PPM image", _PLACES)
