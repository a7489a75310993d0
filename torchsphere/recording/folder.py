"""A folder of images: TIFF, PNG, BMP, PGM, JPEG or WebP."""

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

from torchsphere.recording.facts import stated
from torchsphere.recording.image_header import ImageHeader, ImageKind, require_size
from torchsphere.recording.orientation import turned
from torchsphere.recording.pgm import PGM
from torchsphere.recording.pillow_images import BMP, JPEG, WEBP, exif_orientation
from torchsphere.recording.recording import Reader, Recording
from torchsphere.recording.refusal import PNG_SIGNATURE, library_failures, look_of, what_lies_in
from torchsphere.recording.tiff import PLACES, Page, count_pages, describe, page_facts, page_image, page_notes
from torchsphere.recording.tiff_metadata import pixel_aspect_of
from torchsphere.runtime import steps
from torchsphere.runtime.warning_levels import severe

_PNG_SAMPLES = {0: 1, 2: 3, 4: 2, 6: 4}  # colour type: channels; 3 is a palette
# Deflate, which PNG uses, compresses 1032 to 1 at most.
_PNG_MAX_RATIO = 1100

# What the format allows to Exif in other images.
_MAX_EXIF_BYTES = 65536

LOSSY_NOTE = "{} images have lost fine detail to compression; images without losses measure more precisely."


def open_folder(path: Path) -> Recording:
    """Open a folder of images of one size and kind, in the natural order of their names (img2 before img10)."""
    kind, files, notes = _image_files(path)
    steps.tell_if_large(files, "opening the %d images in %s", len(files), path)
    first = kind.describe(files[0])
    for file in files[1:]:
        header = kind.describe(file)
        if header != first:
            raise ValueError(
                f"{file}: is {header}, but {files[0].name} is {first}; expected images of one size and kind, "
                "move those of the recording to a folder of their own"
            )
    page = first.page
    facts = page_facts(page) | {"pixel_aspect": first.pixel_aspect}
    notes = (LOSSY_NOTE.format(kind.name),) * first.has_losses + notes
    return Recording(
        path=path,
        kind=f"folder of {kind.name} images, {page.bits} bit{', colour' if page.samples >= 3 else ''}",
        shape=(len(files), page.height, page.width),
        **stated({name: (value, kind.places.get(name, "")) for name, value in facts.items()}),
        notes=(f"{kind.name} images carry no frame rate.", *page_notes(page), *notes),
        files=files,
        _reader=_reader(files, first, kind),
    )


def read_image(file: Path) -> NDArray[np.float32]:
    """Grey levels (h, w) of one image of a kind in `KINDS`, without losses; raises ValueError or OSError for others."""
    if not file.is_file():
        raise FileNotFoundError(f"{file}: there is no such file; check the name")
    kind = _kind_of(file) or _TIFF
    header = kind.describe(file)
    if header.has_losses:
        raise ValueError(
            f"{file}: is a {kind.name} image, whose levels the compression has changed; save the original as PNG"
        )
    return np.asarray(turned(_reader((file,), header, kind)(0, 1), header.page.orientation)[0], np.float32)


def natural_key(name: str) -> tuple[tuple[int, int, str], ...]:
    """Sort digits as numbers: img2 comes before img10."""
    parts = re.findall(r"([0-9]+)|([^0-9]+)", name)
    return tuple((0, int(digits[:4000]), digits) if digits else (1, 0, text.lower()) for digits, text in parts)


def _kind_of(file: Path) -> ImageKind | None:
    return next((kind for kind in KINDS if file.suffix.lower() in kind.suffixes), None)


def _image_files(path: Path) -> tuple[ImageKind, tuple[Path, ...], tuple[str, ...]]:
    """The kind of the images, their files in order, and notes on what else lies in the folder."""
    visible = [entry for entry in path.iterdir() if not entry.name.startswith(".")]
    names = sorted((entry.name for entry in visible if entry.is_file()), key=natural_key)
    present: dict[ImageKind, list[Path]] = {}
    for file in map(path.joinpath, names):
        kind_of_file = _kind_of(file)
        if kind_of_file is not None:
            present.setdefault(kind_of_file, []).append(file)
    if not present:
        held = what_lies_in(names, len(visible) - len(names))
        raise ValueError(
            f"{path}: {f'holds {held}' if held else 'holds no images'}; expected the images of one recording "
            f"({', '.join(kind.name for kind in KINDS)}) "
            f"{'in a folder, or name one file of it' if held else 'in this folder, which is empty'}"
        )
    kind, *others = sorted(present, key=lambda k: k.is_lossy)
    files = present[kind]
    for other in others:
        # Smaller images for a quick look lie beside many recordings.
        if not other.is_lossy or kind.is_lossy or len(present[other]) > len(files):
            raise ValueError(
                f"{present[other][0]}: is of another kind than {files[0].name}; expected images of one kind, and the "
                f"folder holds {what_lies_in(names)}: move those of the recording to a folder of their own"
            )
    known = {suffix for other in others for suffix in other.suffixes} | set(_OTHER_IMAGES)
    ignored = Counter(suffix for suffix in (Path(name).suffix.lower() for name in names) if suffix in known)
    notes = tuple(f"{count} {suffix} files in the folder were ignored." for suffix, count in sorted(ignored.items()))
    return kind, tuple(files), notes + _gaps(files)


def _gaps(files: list[Path]) -> tuple[str, ...]:
    """A warning of missing numbers in the names of the files."""
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
    sentence = (
        f"{gap} between {files[first].name} and {files[first + 1].name}; the images count as successive, so "
        "motion across a gap comes out too fast."
    )
    return (severe(sentence),)


def _tiff_header(file: Path) -> ImageHeader:
    pages = count_pages(file)
    if pages > 1:
        raise ValueError(f"{file}: holds {pages} pages, expected one image per file; open this file by itself")
    with library_failures(file, "a TIFF"):
        tif = tifffile.TiffFile(file, _multifile=False)
    with tif:
        page = describe(file, tif, 0)
        with library_failures(file, "a TIFF"):
            return ImageHeader(page, pixel_aspect=pixel_aspect_of(tif)[0])


def _png_display(file: Path) -> tuple[float | None, int]:
    """Width over height of a pixel by the chunk pHYs, and the orientation by eXIf, which may follow the image data."""
    aspect, code = None, 1
    with file.open("rb") as stream:
        stream.seek(len(PNG_SIGNATURE))
        while len(head := stream.read(8)) == 8 and head[4:] != b"IEND":
            length = int.from_bytes(head[:4], "big")
            after = stream.tell() + length + 4
            if head[4:] == b"pHYs" and length == 9:
                across, down = struct.unpack(">II", stream.read(8))
                aspect = down / across if across and down else None
            elif head[4:] == b"eXIf" and length < _MAX_EXIF_BYTES:
                code = exif_orientation(stream.read(length))
            stream.seek(after)
    return aspect, code


def _png_header(file: Path) -> ImageHeader:
    with file.open("rb") as stream:
        head = stream.read(33)
    if head[:8] != PNG_SIGNATURE:
        raise ValueError(f"{file}: looks like {look_of(file)}, expected a PNG image; check the name")
    if len(head) < 33 or head[12:16] != b"IHDR":
        raise OSError(f"{file}: ends within its header; the PNG is cut, copy it again")
    width, height, bits, colour = struct.unpack(">IIBB", head[16:26])
    if colour not in _PNG_SAMPLES or bits not in (8, 16):
        raise ValueError(
            f"{file}: has {bits} bits and colour type {colour}; expected 8 or 16 bits, grey or RGB; save it so"
        )
    samples = _PNG_SAMPLES[colour]
    stated = width * height * samples * bits // 8
    require_size(file, height, width, stated, _PNG_MAX_RATIO * file.stat().st_size)
    aspect, code = _png_display(file)
    page = Page(height, width, samples, bits, f"u{bits // 8}", 2 if samples >= 3 else 1, False, code)
    return ImageHeader(page, pixel_aspect=aspect)


def _reader(files: tuple[Path, ...], header: ImageHeader, kind: ImageKind) -> Reader:
    page = header.page

    def read(start: int, stop: int) -> NDArray[Any]:
        images = np.empty((stop - start, page.height, page.width), np.float32)
        for row, file in enumerate(files[start:stop]):
            data = kind.load(file, header)
            with library_failures(file, "an image of the same size as the first"):
                images[row] = page_image(page, data)
        return images

    return read


def _load_tiff(file: Path, _: ImageHeader) -> NDArray[Any]:
    with library_failures(file, "a TIFF"), tifffile.TiffFile(file, _multifile=False) as tif:
        return np.asarray(tif.pages[0].aspage().asarray(maxworkers=1))


def _load_png(file: Path, expected: ImageHeader) -> NDArray[Any]:
    if _png_header(file) != expected:
        raise OSError(f"{file}: changed since the folder was opened; open it again")
    with library_failures(file, "a PNG"):
        from imagecodecs import png_decode

        return np.asarray(png_decode(file.read_bytes()))


_TIFF = ImageKind("TIFF", (".tif", ".tiff"), _tiff_header, _load_tiff, "a TIFF image", PLACES)
_PNG_PLACES = {"bit_depth": "PNG header", "pixel_aspect": "PNG pHYs", "orientation": "PNG eXIf"}
_PNG = ImageKind("PNG", (".png",), _png_header, _load_png, "a PNG image", _PNG_PLACES)
#: Kinds of images that a folder may hold.
KINDS = (_TIFF, _PNG, BMP, PGM, JPEG, WEBP)
#: Suffixes of these images, and those of other images, which are noted.
IMAGE_SUFFIXES = tuple(suffix for kind in KINDS for suffix in kind.suffixes)
_OTHER_IMAGES = (".gif", ".jp2", ".raw", ".dng")
