"""Reasons why a file cannot be read: the type of its content, and failures of decoding libraries."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

TIFF_SIGNATURES = (b"II*\0", b"MM\0*", b"II+\0", b"MM\0+")
PNG_SIGNATURE = b"\x89PNG\r\n\x1a\n"

_SIGNATURES: tuple[tuple[int, bytes, str], ...] = (
    *((0, magic, "a TIFF image") for magic in TIFF_SIGNATURES),
    (0, PNG_SIGNATURE, "a PNG image"),
    (0, b"CI\x2c\0", "a Phantom CINE"),
    (0, b"\x93NUMPY", "a NumPy array (NPY)"),
    (0, b"PK\x03\x04", "a ZIP archive (NPZ)"),
    (0, b"PK\x05\x06", "an empty ZIP archive"),
    (8, b"AVI ", "an AVI video"),
    *((4, magic, "an MP4 or MOV video") for magic in (b"ftyp", b"moov", b"mdat", b"wide", b"free", b"skip")),
    (0, b"\x1aE\xdf\xa3", "a Matroska or WebM video"),
    (0, b"#Camera Information Header", "a Photron header (CIH)"),
    (0, b"\xef\xbb\xbf#Camera Information Header", "a Photron header (CIH)"),
    (0, b"!!! This file can not be edited", "a Photron header (CIHX)"),
    (0, b"\xff\xd8\xff", "a JPEG image"),
    (0, b"GIF8", "a GIF image"),
    (0, b"BM", "a BMP image"),
    (0, b"\x89HDF\r\n\x1a\n", "an HDF5 file"),
    (0, b"%PDF", "a PDF document"),
    (0, b"\x1f\x8b", "a gzip archive"),
)


def looks_like(head: bytes) -> str:
    """Name, with article, the type of a file by its first bytes (a few dozen)."""
    for offset, magic, name in _SIGNATURES:
        if head[offset : offset + len(magic)] == magic:
            return name
    text = head.decode("latin-1")
    if text and all(letter.isprintable() or letter in "\r\n\t" for letter in text):
        return "text"
    return f"unknown data (first bytes {head[:8].hex(' ')})"


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
