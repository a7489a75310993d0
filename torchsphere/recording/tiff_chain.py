"""The chain of a TIFF's pages: their number, and the places of the images in a plain stack.

The library takes 1 ms to decode a page. In a camera's stack only the place of the image differs between pages.
"""

from __future__ import annotations

import struct
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from torchsphere.recording.refusal import TIFF_SIGNATURES, looks_like

#: Tags without effect on the storage of an image: description, maker, model, resolution, software, date, artist, host.
_FREE_TAGS = frozenset((270, 271, 272, 282, 283, 296, 305, 306, 315, 316))
_STRIP_OFFSETS = 273

#: Codes of the types of a place in the file: 16, 32 and 64 bit.
_WHOLE = {3: "H", 4: "I", 16: "Q"}


@dataclass(frozen=True)
class _Layout:
    """Formats of the numbers of a file, as in `struct`."""

    order: str
    tag_count: str
    pointer: str
    tag_bytes: int
    first_at: int  # byte of the pointer to the first page

    @classmethod
    def of(cls, head: bytes) -> _Layout:
        order = "<" if head[:2] == b"II" else ">"
        return cls(order, "Q", "Q", 20, 8) if head[2:4] in (b"+\0", b"\0+") else cls(order, "H", "I", 12, 4)


def pages(path: Path) -> Iterator[tuple[bytes, _Layout]]:
    """Tags of each page; raises ValueError for other files, and OSError where the chain leaves the file.

    The library stops without an error where a file is cut.
    """
    size = path.stat().st_size
    seen: set[int] = set()
    with path.open("rb") as file:
        head = file.read(16)
        if head[:4] not in TIFF_SIGNATURES:
            raise ValueError(f"{path}: looks like {looks_like(head)}, expected a TIFF; check the name")
        layout = _Layout.of(head)
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
                block = file.read(min(tags, size) * layout.tag_bytes)
                following = file.read(struct.calcsize("=" + layout.pointer))
                (offset,) = struct.unpack(layout.order + layout.pointer, following)
                yield block, layout
        except struct.error:
            raise OSError(f"{path}: ends within page {max(0, len(seen) - 1)}; the TIFF is cut, copy it again") from None
    if not seen:
        raise OSError(f"{path}: is an incomplete TIFF without a page; export it again")


def count_pages(path: Path) -> int:
    """Number of pages; raises as `pages` does."""
    return sum(1 for _ in pages(path))


def places_alike(path: Path) -> NDArray[np.int64] | None:
    """First byte of each page's image; None unless all pages are stored alike, each in one piece; raises as `pages`."""
    first: dict[int, bytes] = {}
    places = []
    for block, layout in pages(path):
        tags = _tags(block, layout)
        place = _single_place(tags.pop(_STRIP_OFFSETS, b""), layout)
        first = first or tags
        if place is None or tags != first:
            return None
        places.append(place)
    return np.array(places, np.int64)


def _tags(block: bytes, layout: _Layout) -> dict[int, bytes]:
    """Type, count and value of each tag that affects storage, by its code."""
    step = layout.tag_bytes
    entries = (block[i : i + step] for i in range(0, len(block), step))
    tags = {int(struct.unpack_from(layout.order + "H", entry)[0]): entry[2:] for entry in entries}
    return {code: rest for code, rest in tags.items() if code not in _FREE_TAGS}


def _single_place(entry: bytes, layout: _Layout) -> int | None:
    """The place that a tag states; None for several places."""
    if not entry:
        return None
    kind, count = struct.unpack_from(layout.order + "H" + layout.pointer, entry)
    if count != 1 or kind not in _WHOLE:
        return None
    (place,) = struct.unpack_from(layout.order + _WHOLE[kind], entry, struct.calcsize("=H" + layout.pointer))
    return int(place)
