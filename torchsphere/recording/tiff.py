"""Multi-page TIFF, and the pages of single TIFF images."""

from __future__ import annotations

import struct
import threading
from collections.abc import Iterator
from dataclasses import dataclass
from math import prod
from pathlib import Path
from typing import Any

import numpy as np
import tifffile
from numpy.typing import NDArray

from torchsphere.recording import orientation
from torchsphere.recording.facts import stated
from torchsphere.recording.levels import ALPHA_NOTE, GREY_NOTE, to_grey
from torchsphere.recording.recording import MAX_IMAGE_BYTES, MAX_PIXELS, Reader, Recording
from torchsphere.recording.refusal import TIFF_SIGNATURES, library_failures, look_of
from torchsphere.recording.tiff_metadata import MOSAIC, bayer_of, clock_of, orientation_of, pixel_aspect_of, stated_axes

_GREY, _RGB, _YCBCR = (0, 1), 2, 6  # PhotometricInterpretation
# Deflate compresses 1032 to 1 at most; a header that needs more than this ratio states missing images.
_MAX_RATIO = 5000

#: Facts of a recording, and the tags that state them.
PLACES = {
    "bit_depth": "TIFF BitsPerSample",
    "pixel_aspect": "TIFF XResolution and YResolution",
    "orientation": "TIFF Orientation",
    "bayer": "TIFF CFAPattern",
}

#: Tags without effect on the storage of an image: description, maker, model, resolution, software, date, artist, host.
_FREE_TAGS = frozenset((270, 271, 272, 282, 283, 296, 305, 306, 315, 316))
_STRIP_OFFSETS = 273

#: Bytes of a page beside its image, its tags and their values, that count as used (docs/constants.toml).
PAGE_BYTES = 1024

#: Codes of the types of a place in the file: 16, 32 and 64 bit.
_PLACE_FORMATS = {3: "H", 4: "I", 16: "Q"}


@dataclass(frozen=True)
class Page:
    """Properties that all images of a recording share."""

    height: int
    width: int
    samples: int
    bits: int
    dtype: str
    photometric: int
    planar: bool
    orientation: int = 1
    bayer: str | None = None

    def __str__(self) -> str:
        turned = "" if self.orientation == 1 else f", {orientation.WORDS[self.orientation]}"
        mosaic = "" if self.bayer is None else f", mosaic {self.bayer}"
        return f"{self.width} x {self.height} px, {self.samples} x {self.bits} bit{turned}{mosaic}"


def open_tiff(path: Path) -> Recording:
    """Open a multi-page TIFF, also an ImageJ stack over 4 GB, which has one page for all images.

    The frame rate is known only where ImageJ's ``finterval`` states it with a unit of time, or OME does.
    """
    size = path.stat().st_size
    count, places = _image_places(path)
    with library_failures(path, "a TIFF"):
        # OME files may name other files, which stay closed.
        tif = tifffile.TiffFile(path, _multifile=False)
    try:
        page = describe(path, tif, 0)
        with library_failures(path, "a TIFF"):
            imagej = dict(tif.imagej_metadata or {})
            axes = stated_axes(tif, page.samples, page.height * page.width * page.samples)
            aspect, aspect_origin = pixel_aspect_of(tif)
            ome = tif.ome_metadata
        n, read, used = _stack(path, tif, page, count, size, places)
        axes.require_plain(path, n)
    except BaseException:
        tif.close()
        raise
    clock = clock_of(imagej, ome, n)
    notes = clock.notes + axes.notes() + _unused_bytes(n, size, used)
    facts = {name: (value, PLACES[name]) for name, value in page_facts(page).items()}
    facts |= {"frame_rate": (clock.frame_rate, clock.origin), "pixel_aspect": (aspect, aspect_origin)}
    return Recording(
        path=path,
        kind=f"multi-page TIFF, {page.bits} bit{', colour' if page.samples >= 3 else ''}",
        shape=(n, page.height, page.width),
        times=clock.times,
        **stated(facts),
        notes=notes + page_notes(page),
        files=(path,),
        _reader=read,
        _closer=tif.close,
    )


def describe(path: Path, tif: tifffile.TiffFile, number: int) -> Page:
    """The properties of a page; raises ValueError for unsupported kinds, OSError where the size does not fit."""
    with library_failures(path, "a TIFF"):
        page = tif.pages[number].aspage()
        dtype, photometric = page.dtype, int(page.photometric)
        height, width, samples = int(page.imagelength), int(page.imagewidth), int(page.samplesperpixel)
        code = "" if dtype is None else dtype.str[1:]
        planar = int(page.planarconfig) == 2 and samples > 1
        kind = (height, width, samples, int(page.bitspersample), code, photometric, planar)
        result = Page(*kind, orientation_of(page), bayer_of(page))
        packed = page.compression != 1
        stored = sum(page.databytecounts)
        end = max((at + n for at, n in zip(page.dataoffsets, page.databytecounts, strict=True)), default=0)
    colour = photometric in (_RGB, _YCBCR) and samples in (3, 4)
    grey = photometric in _GREY and samples in (1, 2)
    mosaic = photometric == MOSAIC and samples == 1 and result.bayer is not None
    if not (colour or grey or mosaic) or result.dtype[:1] not in ("u", "i", "f"):
        raise ValueError(
            f"{path}: page {number} is {result} with photometric code {photometric}; "
            "expected grey or RGB levels, save it as one of these"
        )
    needed = height * width * samples * result.bits // 8
    most = min(MAX_IMAGE_BYTES, stored * (_MAX_RATIO if packed else 1))
    if min(height, width) < 1 or height * width > MAX_PIXELS or needed > most:
        raise OSError(
            f"{path}: page {number} states {result}, but has {stored} bytes of data; it is damaged, copy it again"
        )
    if end > path.stat().st_size:
        raise OSError(f"{path}: the data of page {number} end at byte {end}, after the file; it is cut, copy it again")
    return result


def page_facts(page: Page) -> dict[str, Any]:
    """The facts of a recording that one page states."""
    depth = page.bits if page.dtype[0] == "u" else None
    facts = {"bit_depth": depth, "orientation": page.orientation, "bayer": page.bayer}
    return {name: value for name, value in facts.items() if value is not None and (name, value) != ("orientation", 1)}


def page_notes(page: Page) -> tuple[str, ...]:
    """Sentences on the grey levels of a page."""
    conditions = (
        (page.samples >= 3, GREY_NOTE),
        (page.samples in (2, 4), ALPHA_NOTE),
        (page.photometric == 0, "The file says that 0 is white; the levels are as stored."),
        (
            page.dtype[0] == "u" and page.bits == 16,
            "The levels are stored in 16 bits; the camera's own depth may be lower.",
        ),
    )
    return tuple(note for applies, note in conditions if applies)


def page_image(page: Page, data: NDArray[Any]) -> NDArray[Any]:
    """The grey image (h, w) of a decoded page."""
    if page.planar:
        data = np.moveaxis(data.reshape(page.samples, page.height, page.width), 0, -1)
    data = data.reshape(page.height, page.width, page.samples)
    return to_grey(data) if page.samples >= 3 else data[..., 0]


def _unused_bytes(count: int, size: int, used: int) -> tuple[str, ...]:
    """A note where the file has room for images that its chain of pages does not name."""
    unused = size - used - PAGE_BYTES * count
    more = unused * count // max(used, 1)
    if more < 1:
        return ()
    return (
        f"The file has {unused} bytes beside its {count} images, as many as {more} more would take: if images are "
        "missing, its chain of pages is damaged; copy or export it again.",
    )


def _stack(
    path: Path, tif: tifffile.TiffFile, first: Page, count: int, size: int, alike: NDArray[np.int64] | None
) -> tuple[int, Reader, int]:
    """Number of images, their reader, and the bytes that the images take in the file; ``alike`` of `_image_places`."""
    image_bytes = first.height * first.width * first.samples * np.dtype(first.dtype).itemsize
    dtype = np.dtype(tif.byteorder + first.dtype)
    with library_failures(path, "a TIFF"):
        series = tif.series[0]
        whole = prod(series.shape) * np.dtype(first.dtype).itemsize
        single, at = count == 1 and whole > image_bytes, series.dataoffset
    if single:
        if at is None or at + whole > size:
            there = max(0, size - (at or size)) // image_bytes
            raise OSError(f"{path}: is cut: {there} of {whole // image_bytes} images are present; copy it again")
        offsets = at + image_bytes * np.arange(whole // image_bytes, dtype=np.int64)
        return len(offsets), _plain_reader(path, first, dtype, offsets), whole
    with library_failures(path, "a TIFF"):
        plain = tif.pages[0].aspage().is_memmappable
    if plain and alike is not None and int(alike.max()) + image_bytes <= size:
        return count, _plain_reader(path, first, dtype, alike), count * image_bytes
    places, used = [], 0
    for number in range(count):
        page = first if number == 0 else describe(path, tif, number)
        if page != first:
            raise ValueError(
                f"{path}: page {number} is {page}, page 0 is {first}; expected pages of one kind, "
                "save the images of the recording alone"
            )
        with library_failures(path, "a TIFF"):
            full = tif.pages[number].aspage()
            places.append(full.dataoffsets[0] if full.is_memmappable else -1)
            used += sum(full.databytecounts)
    if min(places) > 0:
        return count, _plain_reader(path, first, dtype, np.array(places, np.int64)), used
    return count, _decoding_reader(path, tif, first), used


def _plain_reader(path: Path, page: Page, dtype: np.dtype[Any], offsets: NDArray[np.int64]) -> Reader:
    whole = page.samples == 1

    def read(start: int, stop: int) -> NDArray[Any]:
        images = _empty(stop - start, page, dtype)
        data = np.empty(page.height * page.width * page.samples, dtype)
        # A mapping takes twice the time; reading in place saves a copy. No memory or open file stays with the process.
        with library_failures(path, "a TIFF"), path.open("rb") as file:
            for image, at in zip(images, offsets[start:stop].tolist(), strict=True):
                into = image if whole else data
                file.seek(at)
                if file.readinto(into) < into.nbytes:  # type: ignore[arg-type]
                    raise EOFError(f"the file ends within the image at byte {at}")
                if not whole:
                    image[:] = page_image(page, data)
        return images

    return read


def _decoding_reader(path: Path, tif: tifffile.TiffFile, page: Page) -> Reader:
    lock = threading.Lock()

    def read(start: int, stop: int) -> NDArray[Any]:
        images = _empty(stop - start, page, np.dtype(page.dtype))
        with library_failures(path, "a TIFF"):
            for number, image in enumerate(images, start):
                with lock:  # threads share the position in the file
                    data = np.asarray(tif.pages[number].aspage().asarray(maxworkers=1))
                image[:] = page_image(page, data)
        return images

    return read


def _empty(count: int, page: Page, dtype: np.dtype[Any]) -> NDArray[Any]:
    """Memory for images (n, h, w), of the file's type or, for colour, float32."""
    return np.empty((count, page.height, page.width), np.float32 if page.samples >= 3 else dtype)


@dataclass(frozen=True)
class _Format:
    """Formats of the numbers of a file, as in `struct`."""

    order: str
    tag_count: str
    pointer: str
    tag_bytes: int
    first_at: int  # byte of the pointer to the first page

    @classmethod
    def of(cls, head: bytes) -> _Format:
        order = "<" if head[:2] == b"II" else ">"
        return cls(order, "Q", "Q", 20, 8) if head[2:4] in (b"+\0", b"\0+") else cls(order, "H", "I", 12, 4)


def _page_tags(path: Path) -> Iterator[tuple[bytes, _Format]]:
    """Tags of each page; raises ValueError for other files, and OSError where the chain leaves the file.

    The library takes 1 ms a page, and stops without an error where a file is cut.
    """
    size = path.stat().st_size
    seen: set[int] = set()
    walked = 0
    with path.open("rb") as file:
        head = file.read(16)
        if head[:4] not in TIFF_SIGNATURES:
            raise ValueError(f"{path}: looks like {look_of(path)}, expected a TIFF; check the name")
        layout = _Format.of(head)
        try:
            (offset,) = struct.unpack_from(layout.order + layout.pointer, head, layout.first_at)
            while offset:
                if offset in seen or offset >= size:
                    raise OSError(
                        f"{path}: page {len(seen)} lies outside the file or repeats another; "
                        "it is cut or damaged, copy it again"
                    )
                seen.add(offset)
                file.seek(offset)
                count_bytes = struct.calcsize("=" + layout.tag_count)
                (tags,) = struct.unpack(layout.order + layout.tag_count, file.read(count_bytes))
                walked += tags * layout.tag_bytes
                if walked > size:
                    raise OSError(
                        f"{path}: the tags of {len(seen)} pages take {walked} bytes, more than the file has; "
                        "it is damaged, copy it again"
                    )
                block = file.read(tags * layout.tag_bytes)
                following = file.read(struct.calcsize("=" + layout.pointer))
                (offset,) = struct.unpack(layout.order + layout.pointer, following)
                yield block, layout
        except struct.error:
            raise OSError(f"{path}: ends within page {max(0, len(seen) - 1)}; the TIFF is cut, copy it again") from None
    if not seen:
        raise OSError(f"{path}: is an incomplete TIFF without a page; export it again")


def count_pages(path: Path) -> int:
    """Number of pages; raises as `_page_tags`."""
    return sum(1 for _ in _page_tags(path))


def _image_places(path: Path) -> tuple[int, NDArray[np.int64] | None]:
    """Number of pages, and first byte of each page's image; None unless all are stored alike, each in one piece."""
    first: dict[int, bytes] = {}
    places: list[int] | None = []
    count = 0
    for block, layout in _page_tags(path):
        count += 1
        if places is None:
            continue
        tags = _tags(block, layout)
        place = _single_place(tags.pop(_STRIP_OFFSETS, b""), layout)
        first = first or tags
        if place is None or tags != first:
            places = None
        else:
            places.append(place)
    return count, None if places is None else np.array(places, np.int64)


def _tags(block: bytes, layout: _Format) -> dict[int, bytes]:
    """Type, count and value of each tag that affects storage, by its code."""
    step = layout.tag_bytes
    entries = (block[i : i + step] for i in range(0, len(block), step))
    tags = {int(struct.unpack_from(layout.order + "H", entry)[0]): entry[2:] for entry in entries}
    return {code: rest for code, rest in tags.items() if code not in _FREE_TAGS}


def _single_place(entry: bytes, layout: _Format) -> int | None:
    """The place that a tag states; None for several places."""
    if not entry:
        return None
    kind, count = struct.unpack_from(layout.order + "H" + layout.pointer, entry)
    if count != 1 or kind not in _PLACE_FORMATS:
        return None
    (place,) = struct.unpack_from(layout.order + _PLACE_FORMATS[kind], entry, struct.calcsize("=H" + layout.pointer))
    return int(place)
