"""Reasons why a file cannot be read: the type of its content, and failures of decoding libraries."""

from __future__ import annotations

import codecs
import re
import struct
from collections import Counter
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from pathlib import Path

TIFF_SIGNATURES = (b"II*\0", b"MM\0*", b"II+\0", b"MM\0+")
PNG_SIGNATURE = b"\x89PNG\r\n\x1a\n"

HDF5_SIGNATURE = b"\x89HDF\r\n\x1a\n"

#: Bytes of a file by which its type is told: a text is known from data by several lines.
HEAD_BYTES = 4096

#: The types that a look at the first bytes names and a recording may have.
MATLAB, HDF5, ZIP, NPZ = "a MATLAB file (MAT)", "an HDF5 file", "a ZIP archive", "a ZIP archive (NPZ)"
MATROSKA, ISO_VIDEO = "a Matroska or WebM video", "an MP4 or MOV video"
#: First bytes, and types of files.
_STARTS: tuple[tuple[bytes, str], ...] = (
    *((magic, "a TIFF image") for magic in TIFF_SIGNATURES),
    (PNG_SIGNATURE, "a PNG image"),
    (b"CI\x2c\0", "a Phantom CINE"),
    (b"\x93NUMPY", "a NumPy array (NPY)"),
    (b"PK\x05\x06", "an empty ZIP archive"),
    (b"#Camera Information Header", "a Photron header (CIH)"),
    (b"\xef\xbb\xbf#Camera Information Header", "a Photron header (CIH)"),
    (b"!!! This file can not be edited", "a Photron header (CIHX)"),
    (b"MATLAB 5.0 MAT-file", MATLAB),
    (b"MATLAB 7.3 MAT-file", MATLAB),
    (HDF5_SIGNATURE, HDF5),
    (b"\xff\xd8\xff", "a JPEG image"),
    (b"\0\0\0\x0cjP  \r\n", "a JPEG 2000 image"),
    (b"GIF8", "a GIF image"),
    (b"\x0e\x03\x13\x01", "an HDF4 file"),
    (b"SIMPLE  =", "a FITS file"),
    (b"TDSm", "a TDMS file of measured values"),
    (b"%PDF", "a PDF document"),
    (b"\xd0\xcf\x11\xe0\xa1\xb1\x1a\xe1", "an Office document of before 2007"),
    (b"\x1f\x8b", "a gzip archive"),
    (b"7z\xbc\xaf\x27\x1c", "a 7z archive"),
    (b"Rar!\x1a\x07", "a RAR archive"),
    (b"\x30\x26\xb2\x75\x8e\x66\xcf\x11", "a Windows Media video (WMV)"),
    (b"FLV\x01", "a Flash video (FLV)"),
    (b"OggS", "an Ogg file"),
    (b"\0\0\x01\xba", "an MPEG video"),
    (b"\0\0\x01\xb3", "an MPEG video"),
)
#: Later bytes, which a text may have by chance.
_LATER: tuple[tuple[int, bytes, str], ...] = (
    (8, b"AVI ", "an AVI video"),
    (8, b"WEBP", "a WebP image"),
    (8, b"WAVE", "a sound (WAV)"),
    *((4, magic, ISO_VIDEO) for magic in (b"moov", b"mdat", b"wide", b"free", b"skip")),
    *((at, HDF5_SIGNATURE, HDF5) for at in (512, 1024, 2048)),
    (257, b"ustar", "a TAR archive"),
)

#: Kinds of files that a sentence on a folder names.
_KINDS = 6

#: Bytes of the header of a matrix in a MAT file of level 4.
_OLD_MATLAB_BYTES = 20

#: Bytes within which the header of an EBML file states its type.
_EBML_BYTES = 128

#: Least share of letters, digits and blanks in a text: tables of numbers have 0.6, levels of an image seldom so many.
_TEXT_SHARE = 0.5
#: Largest share of letters beyond ASCII in a text that is not UTF-8, as of a file from an older program.
_FOREIGN_SHARE = 0.3


def look_of(path: Path) -> str:
    """Name, with article, the type of a file by its content."""
    with path.open("rb") as file:
        return looks_like(file.read(HEAD_BYTES))


def looks_like(head: bytes) -> str:
    """Name, with article, the type of a file by its first `HEAD_BYTES` bytes."""
    if not head:
        return "an empty file"
    for magic, name in _STARTS:
        if head.startswith(magic):
            return name
    if re.match(rb"P[1-6](?:\s|#.*\n)+\d", head):
        return "a PGM or PPM image"
    if _is_text(head):
        return "text"
    for offset, magic, name in _LATER:
        if head[offset : offset + len(magic)] == magic:
            return name
    for magic, tell in ((b"PK\x03\x04", _zip), (b"\x1aE\xdf\xa3", _ebml)):
        if head.startswith(magic):
            return tell(head)
    if head[4:8] == b"ftyp":
        return _iso(head)
    # Bytes 6 to 9 are reserved: the two letters alone may begin any data.
    if head.startswith(b"BM") and head[6:10] == bytes(4):
        return "a BMP image"
    return MATLAB if _is_old_matlab(head) else f"unknown data (first bytes {head[:8].hex(' ')})"


def _zip(head: bytes) -> str:
    """The kind of a ZIP archive, by the name of its first file."""
    length = int.from_bytes(head[26:28], "little")
    name = head[30 : 30 + length]
    if name.endswith(b".npy"):
        return NPZ
    if name.startswith((b"[Content_Types].xml", b"_rels/", b"docProps/", b"word/", b"xl/", b"ppt/")):
        return "an Office document"
    return "an OpenDocument or EPUB file" if name == b"mimetype" else ZIP


def _ebml(head: bytes) -> str:
    """The kind of an EBML file, which Matroska is one of; a file without a type is a Matroska file (RFC 8794)."""
    # The element of the type: its code, its length with a bit in front, and a name.
    found = re.search(rb"\x42\x82([\x81-\x9f])", head[:_EBML_BYTES])
    kind = b"matroska" if found is None else head[found.end() : found.end() + (found[1][0] & 0x1F)]
    return MATROSKA if kind in (b"matroska", b"webm") else f"an EBML file of the type {kind.decode('latin-1')!r}"


def _iso(head: bytes) -> str:
    """The kind of a file that begins as MP4 does, by its brand."""
    brand = head[8:12]
    if brand in (b"heic", b"heix", b"mif1", b"msf1", b"avif", b"avis"):
        return "a HEIC or AVIF image"
    return {b"M4A ": "a sound (M4A)", b"crx ": "a raw image of a photo camera (CR3)"}.get(brand, ISO_VIDEO)


def _is_old_matlab(head: bytes) -> bool:
    """Whether a file begins with the header of a MAT file of level 4: type, size, and the name of a matrix."""
    for order in "<>":
        if len(head) >= _OLD_MATLAB_BYTES:
            kind, rows, columns, imaginary, length = struct.unpack(order + "5i", head[:_OLD_MATLAB_BYTES])
            # The digits of the kind: machine, 0, type of the values, type of the matrix.
            digits = f"{kind:04d}"
            fits = re.fullmatch("[0-4]0[0-5][0-2]", digits) is not None and min(rows, columns) >= 0
            name = head[_OLD_MATLAB_BYTES : _OLD_MATLAB_BYTES + length] if 0 < length <= 64 else b""
            if fits and imaginary in (0, 1) and re.fullmatch(rb"[A-Za-z]\w*\0", name):
                return True
    return False


def _is_text(head: bytes) -> bool:
    """Whether bytes are lines of text; levels of an image may all be letters, but hold no line's end."""
    try:
        # The last letter may be cut.
        wide = head.startswith((codecs.BOM_UTF16_LE, codecs.BOM_UTF16_BE))
        text = codecs.getincrementaldecoder("utf-16" if wide else "utf-8")().decode(head)
    except UnicodeDecodeError:
        text = head.decode("latin-1")
        if sum(letter > "\x7f" for letter in text) > _FOREIGN_SHARE * len(text):
            return False
    if not text or not all(letter.isprintable() or letter in "\r\n\t\f\ufeff" for letter in text):
        return False
    usual = sum(letter.isalnum() or letter.isspace() for letter in text)
    has_lines = "\n" in text or "\r" in text or (len(head) < HEAD_BYTES and " " in text)
    return has_lines and usual >= _TEXT_SHARE * len(text)


def what_lies_in(names: Iterable[str], folders: int = 0) -> str:
    """Say what a folder holds: "12 .jpg, 3 .txt and 2 folders"; ``names`` are those of the files."""
    suffixes = Counter(Path(name).suffix.lower() for name in names).most_common()
    parts = [f"{count} {suffix or 'without a suffix'}" for suffix, count in suffixes[:_KINDS]]
    others = sum(count for _, count in suffixes[_KINDS:])
    parts += [f"{others} of other kinds"] if others else []
    parts += [f"{folders} folders" if folders > 1 else "a folder"] if folders else []
    return " and ".join(part for part in (", ".join(parts[:-1]), *parts[-1:]) if part)


class LibraryMissingError(OSError):
    """A library that reading needs is not installed: nothing is wrong with the file."""


@contextmanager
def library_failures(path: Path, expected: str) -> Iterator[None]:
    """Turn any exception of a decoding library into one ``OSError`` about the file.

    Decoders of damaged files raise nearly every type (struct.error, KeyError, zlib.error, EOFError). Only calls of
    libraries stand within this context, not the checks of this package.
    """
    try:
        yield
    except (FileNotFoundError, PermissionError, LibraryMissingError):
        raise
    except Exception as error:
        reason = " ".join(str(error).split())[:160].rstrip(".") or type(error).__name__
        raise OSError(
            f"{path}: cannot be read as {expected} ({reason}); the file is cut or damaged, copy or export it again"
        ) from error
