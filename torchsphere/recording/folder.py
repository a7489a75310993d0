"""A folder of TIFF or PNG images."""

from __future__ import annotations

import itertools
import re
import struct
from collections import Counter
from pathlib import Path
from typing import Any

import numpy as np
import tifffile
from numpy.typing import NDArray

from torchsphere.recording.recording import MAX_IMAGE_BYTES, MAX_PIXELS, Reader, Recording
from torchsphere.recording.refusal import PNG_SIGNATURE, library_failures, looks_like
from torchsphere.recording.tiff import Page, count_pages, describe, page_image, page_notes
from torchsphere.runtime import steps

_TIFF, _PNG = (".tif", ".tiff"), (".png",)
_OTHER_IMAGES = (".jpg", ".jpeg", ".bmp", ".gif", ".webp", ".jp2", ".raw", ".dng")
_PNG_SAMPLES = {0: 1, 2: 3, 4: 2, 6: 4}  # colour type: channels; 3 is a palette
# Deflate, which PNG uses, compresses 1032 to 1 at most.
_PNG_MAX_RATIO = 1100


def open_folder(path: Path) -> Recording:
    """Open a folder of images of one size and kind, in the natural order of their names (img2 before img10)."""
    files, notes = _image_files(path)
    steps.tell_if_large(files, "opening the %d images in %s", len(files), path)
    is_png = files[0].suffix.lower() in _PNG
    describe_file = _png_page if is_png else _tiff_page
    first = describe_file(files[0])
    for file in files[1:]:
        page = describe_file(file)
        if page != first:
            raise ValueError(
                f"{file}: is {page}, but {files[0].name} is {first}; expected images of one size and kind, "
                "move those of the recording to a folder of their own"
            )
    kind = "PNG" if is_png else "TIFF"
    depth = first.bits if first.dtype[0] == "u" else None
    return Recording(
        path=path,
        kind=f"folder of {kind} images, {first.bits} bit{', colour' if first.samples >= 3 else ''}",
        shape=(len(files), first.height, first.width),
        bit_depth=depth,
        origins={"bit_depth": "PNG header" if is_png else "TIFF BitsPerSample"} if depth else {},
        notes=(f"{kind} images carry no frame rate.", *page_notes(first), *notes),
        files=files,
        _reader=_reader(files, first, is_png),
    )


def read_image(file: Path) -> NDArray[np.float32]:
    """Grey levels (h, w) of one TIFF or PNG image; raises ValueError or OSError for other files."""
    if not file.is_file():
        raise FileNotFoundError(f"{file}: there is no such file; check the name")
    is_png = file.suffix.lower() in _PNG
    page = _png_page(file) if is_png else _tiff_page(file)
    return np.asarray(_reader((file,), page, is_png)(0, 1)[0], np.float32)


def natural_key(name: str) -> tuple[tuple[int, int, str], ...]:
    """Sort digits as numbers: img2 comes before img10."""
    parts = re.findall(r"([0-9]+)|([^0-9]+)", name)
    return tuple((0, int(digits[:4000]), digits) if digits else (1, 0, text.lower()) for digits, text in parts)


def _image_files(path: Path) -> tuple[tuple[Path, ...], tuple[str, ...]]:
    visible = [file for file in path.iterdir() if not file.name.startswith(".") and file.is_file()]
    files = sorted((file for file in visible if file.suffix.lower() in _TIFF + _PNG), key=lambda f: natural_key(f.name))
    if not files:
        raise ValueError(
            f"{path}: holds no TIFF or PNG images; expected the images of one recording "
            f"{'in a folder, or name one file of it' if visible else 'in this folder, which is empty'}"
        )
    other = next((f for f in files if (f.suffix.lower() in _PNG) != (files[0].suffix.lower() in _PNG)), None)
    if other is not None:
        raise ValueError(
            f"{other}: is of another kind than {files[0].name}; expected images of one kind, "
            "move those of the recording to a folder of their own"
        )
    others = Counter(f.suffix.lower() for f in visible if f.suffix.lower() in _OTHER_IMAGES)
    notes = tuple(f"{count} {suffix} files in the folder were ignored." for suffix, count in sorted(others.items()))
    return tuple(files), notes + _gaps(files)


def _gaps(files: list[Path]) -> tuple[str, ...]:
    """A note on missing numbers in the names of the files."""
    found = [re.search(r"([0-9]{1,18})\D*$", file.stem) for file in files]
    numbers = [int(match.group(1)) for match in found if match is not None]
    steps = [after - before for before, after in itertools.pairwise(numbers)]
    if len(numbers) < len(files) or not steps or min(steps) < 1:
        return ()
    usual = min(steps)
    first = next((i for i, step in enumerate(steps) if step > usual), None)
    if first is None:
        return ()
    missing = sum(step // usual - 1 for step in steps)
    gap = (
        f"{missing} of the numbered images are missing, the first of them"
        if missing > 1
        else "1 of the numbered images is missing,"
    )
    return (
        f"{gap} between {files[first].name} and {files[first + 1].name}; the images count as successive, so "
        "motion across a gap comes out too fast.",
    )


def _tiff_page(file: Path) -> Page:
    pages = count_pages(file)
    if pages > 1:
        raise ValueError(f"{file}: holds {pages} pages, expected one image per file; open this file by itself")
    with library_failures(file, "a TIFF"):
        tif = tifffile.TiffFile(file, _multifile=False)
    with tif:
        return describe(file, tif, 0)


def _png_page(file: Path) -> Page:
    with file.open("rb") as stream:
        head = stream.read(33)
    if head[:8] != PNG_SIGNATURE:
        raise ValueError(
            f"{file}: looks like {looks_like(head) if head else 'an empty file'}, expected a PNG image; check the name"
        )
    if len(head) < 33 or head[12:16] != b"IHDR":
        raise OSError(f"{file}: ends within its header; the PNG is cut, copy it again")
    width, height, bits, colour = struct.unpack(">IIBB", head[16:26])
    if colour not in _PNG_SAMPLES or bits not in (8, 16):
        raise ValueError(
            f"{file}: has {bits} bits and colour type {colour}; expected 8 or 16 bits, grey or RGB; save it so"
        )
    samples = _PNG_SAMPLES[colour]
    stated = width * height * samples * bits // 8
    most = min(MAX_IMAGE_BYTES, _PNG_MAX_RATIO * file.stat().st_size)
    if min(width, height) < 1 or width * height > MAX_PIXELS or stated > most:
        raise OSError(
            f"{file}: states {width} x {height} px, but has {file.stat().st_size} bytes; it is damaged, copy it again"
        )
    return Page(height, width, samples, bits, f"u{bits // 8}", 2 if samples >= 3 else 1, False)


def _reader(files: tuple[Path, ...], page: Page, is_png: bool) -> Reader:
    load = _load_png if is_png else _load_tiff

    def read(start: int, stop: int) -> NDArray[Any]:
        images = np.empty((stop - start, page.height, page.width), np.float32)
        for row, file in enumerate(files[start:stop]):
            data = load(file, page)
            with library_failures(file, "an image of the same size as the first"):
                images[row] = page_image(page, data)
        return images

    return read


def _load_tiff(file: Path, page: Page) -> NDArray[Any]:
    with library_failures(file, "a TIFF"), tifffile.TiffFile(file, _multifile=False) as tif:
        return np.asarray(tif.pages[0].aspage().asarray(maxworkers=1))


def _load_png(file: Path, page: Page) -> NDArray[Any]:
    if _png_page(file) != page:
        raise OSError(f"{file}: changed since the folder was opened; open it again")
    with library_failures(file, "a PNG"):
        from imagecodecs import png_decode

        return np.asarray(png_decode(file.read_bytes()))
