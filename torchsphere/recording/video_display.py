"""What a player does with a video beside decoding: it turns images, gives pixels their sides, and leaves images out."""

from __future__ import annotations

import struct
from pathlib import Path
from typing import TYPE_CHECKING

from torchsphere.recording import orientation
from torchsphere.recording.refusal import library_failures

if TYPE_CHECKING:
    import av

#: Numbers of a display matrix in fixed point, row by row; the first two of the first two rows turn and mirror.
_MATRIX = struct.Struct("=9i")


def orientation_of(frame: av.VideoFrame) -> tuple[int, tuple[str, ...]]:
    """The code of a frame's display matrix, 1 without one, and a note on one that does not turn by right angles."""
    stated = frame.side_data.get("DISPLAYMATRIX")
    data = b"" if stated is None else bytes(stated)  # type: ignore[call-overload]
    if len(data) < _MATRIX.size:
        return 1, ()
    a, b, _, c, d, *_ = _MATRIX.unpack(data[: _MATRIX.size])
    # A point (x, y) is shown at (a x + c y, b x + d y).
    code = orientation.code_of_matrix([[a, c], [b, d]])
    if code is None:
        return 1, ("The video states a display matrix that does not turn by right angles; it was not used.",)
    return code, ()


def pixel_aspect_of(stream: av.VideoStream) -> float | None:
    """Width over height of a pixel by the container or else the codec; None where neither states it."""
    ratio = stream.sample_aspect_ratio
    return float(ratio) if ratio else None


def images_in_file(path: Path, reader: str) -> int:
    """Number of images of an MP4 or MOV file, those that its edit list hides from a player included."""
    import av

    with library_failures(path, "a video"), av.open(str(path), format=reader, options={"ignore_editlist": "1"}) as file:
        return sum(1 for packet in file.demux(file.streams.video[0]) if packet.size and not packet.is_corrupt)


def hidden_note(shown: int, in_file: int) -> tuple[str, ...]:
    """A sentence where a player leaves images out."""
    if in_file <= shown:
        return ()
    return (
        f"The video was trimmed: its edit list hides {in_file - shown} of the {in_file} images in the file from "
        "players. They are left out here, too; export the whole video to measure them.",
    )
