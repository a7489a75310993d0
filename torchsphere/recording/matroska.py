"""The elements of a Matroska or WebM file: how many images it holds, and whether it is cut or damaged.

Readers of video skip what they do not understand, and look for the next part that they know. Images in between are lost
without an error. Here every element has to follow the one before (RFC 8794; RFC 9559 for the identifiers).
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Collection, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import BinaryIO

_EBML, _SEGMENT, _TRACKS, _CLUSTER = 0x1A45DFA3, 0x18538067, 0x1654AE6B, 0x1F43B675
_TRACK, _NUMBER, _TYPE, _VIDEO = 0xAE, 0xD7, 0x83, 1
_PLAIN = frozenset((_NUMBER, _TYPE))
_VOID, _CHECKSUM = 0xEC, 0xBF
_SIMPLE_BLOCK, _GROUP, _BLOCK = 0xA3, 0xA0, 0xA1

#: Elements of a segment: seek head, information, tracks, cues, attachments, chapters and tags, beside the clusters.
_OF_SEGMENT = frozenset(
    (0x114D9B74, 0x1549A966, _TRACKS, _CLUSTER, 0x1C53BB6B, 0x1941A469, 0x1043A770, 0x1254C367, _VOID, _CHECKSUM)
)
#: Elements of a cluster: time, silent tracks, position, size of the cluster before, encrypted and other blocks.
_OF_CLUSTER = frozenset((0xE7, 0x5854, 0xA7, 0xAB, 0xAF, _SIMPLE_BLOCK, _GROUP, _VOID, _CHECKSUM))

#: Most bytes of the identifier and the size of an element, and of the head of a block.
_HEAD_BYTES, _BLOCK_BYTES = 12, 12


@dataclass(frozen=True)
class Contents:
    """What the elements of a file say, without its images being read."""

    images: int = 0  # of the first track of video
    end: int | None = None  # byte at which the segment ends; None where that is not stated, as in a live stream
    damaged_at: int | None = None  # first byte that no element explains; None where there is none


def contents(path: Path) -> Contents:
    """Walk over the elements of a file."""
    images, types = Counter[int](), dict[int, int]()
    size, end, damaged_at = path.stat().st_size, None, None
    with path.open("rb", buffering=0) as file:
        try:
            header = _element(file, 0, size)
            segment = _element(file, header.stop or size, size, may_be_cut=True)
            end = segment.stop
            for element in _within(file, segment.first, min(end or size, size), _OF_SEGMENT):
                if element.code == _TRACKS:
                    types |= _track_types(file, element)
                if element.code == _CLUSTER:
                    images += _images(file, element, types)
            if (header.code, segment.code) != (_EBML, _SEGMENT):
                damaged_at = 0
        except _DamageError as damage:
            damaged_at = damage.at
    video = next((number for number, kind in types.items() if kind == _VIDEO), -1)
    return Contents(images[video], end, damaged_at)


class _DamageError(Exception):
    """A place that no element explains."""

    def __init__(self, at: int) -> None:
        super().__init__(at)
        self.at = at


@dataclass(frozen=True)
class _Element:
    code: int
    at: int
    first: int  # byte of its contents
    stop: int | None  # byte behind its contents; None where its size is not stated


def _element(file: BinaryIO, at: int, limit: int, *, may_be_cut: bool = False) -> _Element:
    """The element at a place, which ends before ``limit`` unless it ``may_be_cut``."""
    file.seek(at)
    head = file.read(_HEAD_BYTES)
    width = 9 - head[0].bit_length() if head else 0
    length = 9 - head[width].bit_length() if 0 < width <= 4 and len(head) > width else 9
    first = at + width + length
    if length > 8 or len(head) < width + length or first > limit:
        raise _DamageError(at)
    # The size has its own width in front; a size of ones alone means that it is not known.
    ones = (1 << 7 * length) - 1
    value = int.from_bytes(head[width : width + length], "big") & ones
    stop = None if value == ones else first + value
    if stop is not None and stop > limit and not may_be_cut:
        raise _DamageError(at)
    return _Element(int.from_bytes(head[:width], "big"), at, first, stop)


def _within(file: BinaryIO, at: int, limit: int, known: frozenset[int]) -> Iterator[_Element]:
    """The elements of a segment, one behind the other; those of a cluster of unknown size are read to its end."""
    while at < limit:
        element = _element(file, at, limit)
        if element.code not in known:
            raise _DamageError(at)
        if element.stop is None:
            if element.code != _CLUSTER:
                raise _DamageError(at)
            element = _Element(element.code, element.at, element.first, _cluster_end(file, element.first, limit))
        yield element
        at = element.stop or limit


def _cluster_end(file: BinaryIO, at: int, limit: int) -> int:
    """The end of a cluster of unknown size: where an element of the segment begins."""
    while at < limit:
        element = _element(file, at, limit)
        if element.code in _OF_SEGMENT - _OF_CLUSTER:
            return at
        if element.code not in _OF_CLUSTER or element.stop is None:
            raise _DamageError(at)
        at = element.stop
    return limit


def _track_types(file: BinaryIO, tracks: _Element) -> dict[int, int]:
    """The type of each track by its number."""
    found = {}
    for track in _inside(file, tracks):
        if track.code == _TRACK:
            values = {element.code: _value(file, element) for element in _inside(file, track) if element.code in _PLAIN}
            if not values.keys() >= _PLAIN:
                raise _DamageError(track.at)
            found[values[_NUMBER]] = values[_TYPE]
    return found


def _images(file: BinaryIO, cluster: _Element, tracks: Collection[int]) -> Counter[int]:
    """Numbers of images in a cluster, by track; an image of a track that the file does not have is damage."""
    found = Counter[int]()
    for element in _within(file, cluster.first, cluster.stop or cluster.first, _OF_CLUSTER):
        if element.code in (_SIMPLE_BLOCK, _GROUP):
            is_group = element.code == _GROUP
            block = next((b for b in _inside(file, element) if b.code == _BLOCK), None) if is_group else element
            track, count = _block_head(file, block) if block is not None else (-1, 0)
            if track not in tracks:
                raise _DamageError(element.at)
            found[track] += count
    return found


def _inside(file: BinaryIO, parent: _Element) -> Iterator[_Element]:
    """The elements of a parent of known size, whatever they are."""
    at, stop = parent.first, parent.stop or parent.first
    while at < stop:
        element = _element(file, at, stop)
        yield element
        at = element.stop or stop


def _value(file: BinaryIO, element: _Element) -> int:
    file.seek(element.first)
    return int.from_bytes(file.read(min(8, (element.stop or element.first) - element.first)), "big")


def _block_head(file: BinaryIO, block: _Element) -> tuple[int, int]:
    """Track and number of images of a block: bits 1 and 2 of its flags say whether several were laced together."""
    file.seek(block.first)
    head = file.read(min(_BLOCK_BYTES, (block.stop or block.first) - block.first))
    width = 9 - head[0].bit_length() if head else 9
    is_laced = width <= 8 and len(head) >= width + 3 and bool(head[width + 2] & 0x06)
    if width > 8 or len(head) < width + 3 + is_laced:
        raise _DamageError(block.at)
    track = int.from_bytes(head[:width], "big") & ((1 << 7 * width) - 1)
    return track, 1 + head[width + 3] if is_laced else 1
