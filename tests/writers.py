"""Small writers of camera formats: tests compare values and orientation with known arrays."""

from __future__ import annotations

import struct
from collections.abc import Sequence
from fractions import Fraction
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

SETUP_BYTES = 5692


def pack(values: NDArray[np.integer], bits: int) -> bytes:
    """Pack values of 10 or 12 bits without gaps, most significant bit first, one bit at a time."""
    flat = values.astype(np.uint16).ravel()
    planes = [(flat >> (bits - 1 - k)) & 1 for k in range(bits)]
    return np.packbits(np.stack(planes, axis=-1).astype(np.uint8).ravel()).tobytes()


def stored(images: NDArray[np.integer], bits: int) -> bytes:
    """Bytes of images as a camera stores them: 8 bit, packed, or 16 bit little-endian."""
    if bits in (10, 12):
        return pack(images, bits)
    return images.astype("u1" if bits in (8, 24) else "<u2").tobytes()


def write_mraw(
    path: Path,
    images: NDArray[np.integer],
    *,
    bits: int,
    depth: int,
    side: str = "Lower",
    text: bool = False,
    **more: str,
) -> Path:
    """Write a Photron recording; ``more`` replaces values of the text header by name."""
    n, height, width = images.shape
    shifted = images << (bits - depth) if side == "Higher" else images
    path.with_suffix(".mraw").write_bytes(stored(shifted, bits))
    values = {
        "Record Rate(fps)": "20000",
        "Shutter Speed(s)": "1/15371",
        "Trigger Mode": "Start",
        "Total Frame": str(n),
        "Start Frame": "12",
        "Save Step": "1",
        "Image Width": str(width),
        "Image Height": str(height),
        "Color Type": "Mono",
        "Color Bit": str(bits),
        "File Format": "MRaw",
        "EffectiveBit Depth": str(depth),
        "EffectiveBit Side": side,
    } | {name.replace("_", " "): value for name, value in more.items()}
    if text:
        lines = "".join(f"{name} : {value}\r\n" for name, value in values.items())
        header = path.with_suffix(".cih")
        header.write_text("#Camera Information Header\r\n" + lines, "latin-1")
        return header
    header = path.with_suffix(".cihx")
    size = f"<resolution><width>{width}</width><height>{height}</height></resolution>"
    header.write_bytes(
        b"!!! This file can not be edited. !!!".ljust(100, b"\0")
        + f"""<?xml version="1.0" encoding="utf-8"?><cih>
        <imageFileInfo><fileFormat>{values["File Format"]}</fileFormat>{size}</imageFileInfo>
        <imageDataInfo>{size}<colorInfo><type>{values["Color Type"]}</type><bit>{bits}</bit></colorInfo>
        <effectiveBit><depth>{depth}</depth><side>{side}</side></effectiveBit></imageDataInfo>
        <frameInfo><totalFrame>{n}</totalFrame><startFrame>-7</startFrame><skipFrame>1</skipFrame></frameInfo>
        <recordInfo><recordRate>20000</recordRate><shutterSpeed>50000</shutterSpeed></recordInfo></cih>""".encode()
        + b"\0" * 50
    )
    return header


def write_cine(
    path: Path,
    images: NDArray[np.integer],
    *,
    bits: int,
    real_bits: int = 0,
    top_down: bool = False,
    version: int = 1,
    annotation: bytes = b"",
    mosaic: int = 0,
    rate: int = 70000,
    times_s: Sequence[float] = (),
    exposures_s: Sequence[float] = (),
    pixels_per_m: tuple[int, int] = (0, 0),
    flip: tuple[int, int] = (0, 0),
    rotate: int = 0,
) -> Path:
    """Write images (n, h, w) or blue-green-red (n, h, w, 3); rows bottom-up unless packed or ``top_down``.

    Times and exposures of the single images go into blocks 1002 and 1003.
    """
    n, height, width = images.shape[:3]
    packed = bits in (10, 12)
    rows = images if packed or top_down else images[:, ::-1]
    setup = bytearray(SETUP_BYTES)
    struct.pack_into("<2sH", setup, 140, b"ST", SETUP_BYTES)
    struct.pack_into("<ii", setup, 756, *flip)
    struct.pack_into("<II", setup, 768, rate, 3)
    struct.pack_into("<i", setup, 884, rotate)
    struct.pack_into("<I", setup, 808, mosaic)
    struct.pack_into("<I", setup, 896, real_bits)
    struct.pack_into("<I", setup, 1568, 2500)
    # The two lowest bits of a time are flags.
    ticks = [(1_700_000_000 << 32) + round(2**32 * float(time)) | 3 for time in times_s]
    blocks = cine_block(1002, b"".join(struct.pack("<Q", time) for time in ticks))
    blocks += cine_block(1003, b"".join(struct.pack("<I", round(2**32 * time)) for time in exposures_s))
    table_at = 44 + 40 + SETUP_BYTES + len(blocks)
    pointer = 8 if version else 4
    bodies = [stored(image, bits) for image in rows]
    block = len(annotation) + 8 + len(bodies[0])
    compression = {10: 256, 12: 1024}.get(bits, 0)
    header = struct.pack(
        "<2sHHHiIiIIIIQ", b"CI", 44, 2 if mosaic else 0, version, -100, 200, -42, n, 44, 84, table_at, 0
    )
    signed = -height if top_down else height
    bitmap = struct.pack(
        "<IiiHHIIiiII", 40, width, signed, 1, 16 if packed else bits, compression, len(bodies[0]), *pixels_per_m, 0, 0
    )
    first = table_at + n * pointer
    table = struct.pack(f"<{n}{'Q' if version else 'I'}", *(first + k * block for k in range(n)))
    placed = (struct.pack("<I", len(annotation) + 8) + annotation + struct.pack("<I", len(b)) + b for b in bodies)
    path.write_bytes(header + bitmap + bytes(setup) + blocks + table + b"".join(placed))
    return path


def cine_block(kind: int, data: bytes) -> bytes:
    """A tagged block of a CINE, nothing where there are no data."""
    return struct.pack("<IHH", 8 + len(data), kind, 0) + data if data else b""


def write_mov(
    path: Path,
    images: NDArray[np.integer],
    *,
    matrix: tuple[int, int, int, int] = (1, 0, 0, 1),
    aspect: Fraction | None = None,
    trim: tuple[int, int] | None = None,
) -> Path:
    """Write grey images (n, h, w) of 8 bit without loss, a key image each, at 32 images/s.

    The display ``matrix`` (a, b, c, d) shows a stored point (x, y) at (a x + c y, b x + d y). ``trim`` is the first
    image and the number of images that the edit list shows.
    """
    import av

    with av.open(str(path), "w", format="mov", options={"video_track_timescale": "3200"}) as container:
        stream = container.add_stream("png", rate=32)
        stream.height, stream.width = images.shape[1:]
        stream.pix_fmt = "gray"
        if aspect is not None:
            stream.codec_context.sample_aspect_ratio = aspect
        for image in images.astype(np.uint8):
            container.mux(stream.encode(av.VideoFrame.from_ndarray(image, format="gray")))
        container.mux(stream.encode(None))
    data = bytearray(path.read_bytes())
    # The matrix stands 40 bytes behind the version of the track's header, a number per column in 16.16.
    at = data.index(b"tkhd") + 4 + 40
    a, b, c, d = (65536 * value for value in matrix)
    struct.pack_into(">9i", data, at, a, b, 0, c, d, 0, 0, 0, 1 << 30)
    if trim is not None:
        # The only entry of the edit list: its length in the time of the movie, and its start in that of the track.
        movie_scale = struct.unpack_from(">I", data, data.index(b"mvhd") + 4 + 12)[0]
        first, count = trim
        struct.pack_into(">Ii", data, data.index(b"elst") + 12, movie_scale * count // 32, 100 * first)
    path.write_bytes(data)
    return path
