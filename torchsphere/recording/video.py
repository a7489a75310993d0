"""Videos (AVI, MP4, MOV, MKV, WebM) through PyAV."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
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

# PyAV's reader of each type; a named reader keeps the content of the file from choosing another.
_READERS = {"an AVI video": "avi", "an MP4 or MOV video": "mov", "a Matroska or WebM video": "matroska"}


def open_video(path: Path) -> Recording:
    """Open a video, always without a frame rate: a container states the rate of playback, not of the camera."""
    with path.open("rb") as file:
        head = file.read(64)
    reader = _READERS.get(looks_like(head))
    if reader is None:
        raise ValueError(f"{path}: looks like {looks_like(head)}, expected a video; check the name")
    cursor = Cursor(path, reader)
    with library_failures(path, "a video"):
        n, playback = cursor.survey()
    if n < 1:
        raise OSError(f"{path}: holds no images; the video is cut or incomplete, copy or export it again")
    with library_failures(path, "a video"):
        frame = cursor.first()
    height, width = frame.height, frame.width
    decode, depth, notes = _decoder(path, frame)
    cursor.expect(n, (height, width), decode)
    if playback:
        notes += (f"The container plays at {playback:g} frames/s; the rate of recording is not known.",)
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


def _colour_levels(form: str, frame: av.VideoFrame) -> NDArray[Any]:
    return to_grey(frame.to_ndarray(format=form))


def _plane_levels(dtype: str, frame: av.VideoFrame) -> NDArray[Any]:
    """Grey levels (h, w) of the first plane, whose rows are padded to line_size bytes."""
    plane = frame.planes[0]
    rows = np.frombuffer(plane, np.uint8)[: plane.line_size * frame.height].reshape(frame.height, plane.line_size)  # type: ignore[call-overload]
    levels: NDArray[Any] = np.ascontiguousarray(rows[:, : frame.width * np.dtype(dtype).itemsize]).view(dtype)
    return levels


def _decoder(path: Path, frame: av.VideoFrame) -> tuple[Callable[[av.VideoFrame], NDArray[Any]], int, tuple[str, ...]]:
    """The function that turns a frame into grey levels (h, w), their depth in bits, and notes."""
    name, components = frame.format.name, frame.format.components
    bits = components[0].bits if components else 0
    dtype = "u1" if bits <= 8 else ">u2" if name.endswith("be") else "<u2"
    if name.startswith("gray") and 8 <= bits <= 16:
        return partial(_plane_levels, dtype), bits, ()
    if name.startswith(("yuv", "nv12", "nv21", "nv16")) and not name.startswith("yuyv") and 8 <= bits <= 16:
        note = "The grey levels are the luma plane as decoded; the colour planes were ignored."
        return partial(_plane_levels, dtype), bits, (note,)
    if frame.format.is_rgb or name == "pal8":
        wide = bits > 8
        return partial(_colour_levels, "rgb48le" if wide else "rgb24"), 16 if wide else 8, (GREY_NOTE,)
    raise ValueError(
        f"{path}: the pixels are {name}, expected grey, YUV in planes, or RGB; convert the video, for example to gray"
    )
