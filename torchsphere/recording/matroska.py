"""The end of a Matroska or WebM file as its header states it, which tells whether the file is cut."""

from __future__ import annotations

from pathlib import Path

#: Identifiers of the two elements of a file (RFC 8794, section 11.2.1; RFC 9559, section 5.1).
_EBML, _SEGMENT = b"\x1aE\xdf\xa3", b"\x18S\x80g"


def segment_end(path: Path) -> int | None:
    """The byte at which the segment ends; None where the header does not state it, as that of a live stream."""
    with path.open("rb") as file:
        head = file.read(4096)
    if head[:4] != _EBML:
        return None
    size, at = _size(head, 4)
    if size is None or head[at + size : at + size + 4] != _SEGMENT:
        return None
    segment, start = _size(head, at + size + 4)
    return None if segment is None else start + segment


def _size(data: bytes, at: int) -> tuple[int | None, int]:
    """The size at a place, None where it is unknown, and the place behind it (RFC 8794, section 4)."""
    first = data[at] if at < len(data) else 0
    width = 9 - first.bit_length()
    field = data[at : at + width]
    if first == 0 or len(field) < width:
        return None, at
    value = int.from_bytes(field, "big") & ((1 << 7 * width) - 1)
    # A size of ones alone means that it is not known.
    return (None if value == (1 << 7 * width) - 1 else value), at + width
