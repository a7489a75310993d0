"""Videos (AVI, MP4, MOV, MKV, WebM) through PyAV."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from torchsphere.recording.cursor import Cursor
from torchsphere.recording.grey import GREY_NOTE, to_grey
from torchsphere.recording.recording import Recording
from torchsphere.recording.refusal import library_failures, looks_like

if TYPE_CHECKING:
    import av

# The reader of each kind is named, so that the file's content cannot choose another one.
_READERS = {"an AVI video": "avi", "an MP4 or MOV video": "mov", "a Matroska or WebM video": "matroska"}


def open_video(path: Path) -> Recording:
    """Open a video.

    Parameters
    ----------
    path : Path

    Returns
    -------
    Recording
        Never with a frame rate: a container states how fast to play, not how fast the camera recorded.

    Raises
    ------
    ValueError
        Where the file is no video, or its pixels are of a kind that is not supported.
    OSError
        Where it is cut or damaged, or PyAV is not installed.
    """
    with path.open("rb") as file:
        head = file.read(64)
    reader = _READERS.get(looks_like(head))
    if reader is None:
        raise ValueError(f"{path}: looks like {looks_like(head)}, expected a video; check the name")
    cursor = Cursor(path, reader)
    with library_failures(path, "a video"):
        n, playback = cursor.survey()
    if n < 1:
        raise OSError(f"{path}: holds no images; the video is cut or was not finished, copy or export it again")
    with library_failures(path, "a video"):
        frame = cursor.first()
    height, width = frame.height, frame.width
    decode, depth, notes = _decoder(path, frame)
    cursor.expect(n, (height, width), decode)
    if playback:
        notes += (f"The container plays at {playback:g} frames/s; that is not known to be the rate of recording.",)
    return Recording(
        path=path,
        kind=f"video, {cursor.codec}, {frame.format.name}",
        shape=(n, height, width),
        bit_depth=depth,
        origins={"bit_depth": f"pixel format {frame.format.name}"},
        notes=notes,
        files=(path,),
        _reader=cursor.read,
        _closer=cursor.close,
    )


class _Decoder:
    """Turns one decoded frame into grey levels (h, w)."""

    def __init__(self, *, colour: bool, dtype: str) -> None:
        self._colour, self._dtype = colour, np.dtype(dtype)

    def __call__(self, frame: av.VideoFrame) -> NDArray[Any]:
        if self._colour:
            return to_grey(frame.to_ndarray(format="rgb48le" if self._dtype.itemsize == 2 else "rgb24"))
        plane = frame.planes[0]
        # Rows are padded to line_size bytes.
        rows = np.frombuffer(plane, np.uint8)[: plane.line_size * frame.height].reshape(frame.height, plane.line_size)  # type: ignore[call-overload]
        used = np.ascontiguousarray(rows[:, : frame.width * self._dtype.itemsize])
        levels: NDArray[Any] = used.view(self._dtype)
        return levels


def _decoder(path: Path, frame: av.VideoFrame) -> tuple[_Decoder, int, tuple[str, ...]]:
    name, components = frame.format.name, frame.format.components
    bits = components[0].bits if components else 0
    dtype = "u1" if bits <= 8 else ">u2" if name.endswith("be") else "<u2"
    if name.startswith("gray") and 8 <= bits <= 16:
        return _Decoder(colour=False, dtype=dtype), bits, ()
    if name.startswith(("yuv", "nv12", "nv21", "nv16")) and not name.startswith("yuyv") and 8 <= bits <= 16:
        note = "The grey levels are the luma plane as decoded; the colour planes were ignored."
        return _Decoder(colour=False, dtype=dtype), bits, (note,)
    if frame.format.is_rgb or name == "pal8":
        wide = bits > 8
        return _Decoder(colour=True, dtype="<u2" if wide else "u1"), 16 if wide else 8, (GREY_NOTE,)
    raise ValueError(
        f"{path}: the pixels are {name}, expected grey, YUV in planes, or RGB; convert the video, for example to gray"
    )
