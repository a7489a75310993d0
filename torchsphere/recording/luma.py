"""Where a decoded frame of a video holds the brightness of its pixels."""

from __future__ import annotations

import re
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

if TYPE_CHECKING:
    import av

#: Layouts that mix brightness and colour in one plane, by FFmpeg's names: bytes of a word, word of the first pixel,
#: words from pixel to pixel, bits below the level.
_MIXED = {
    "yuyv422": (1, 0, 2, 0),
    "yvyu422": (1, 0, 2, 0),
    "uyvy422": (1, 1, 2, 0),
    "y210": (2, 0, 2, 6),
    "y212": (2, 0, 2, 4),
    "y216": (2, 0, 2, 0),
    "vyu444": (1, 1, 3, 0),
    "uyva": (1, 1, 4, 0),
    "ayuv": (1, 1, 4, 0),
    "vuya": (1, 2, 4, 0),
    "vuyx": (1, 2, 4, 0),
    "ayuv64": (2, 1, 4, 0),
    "xv36": (2, 1, 4, 4),
    "xv48": (2, 1, 4, 0),
    "xv30": (4, 0, 1, 10),
    "v30x": (4, 0, 1, 12),
    "ya8": (1, 0, 2, 0),
    "ya16": (2, 0, 2, 0),
}
#: Names of the layouts whose first plane is the brightness: grey, YUV in planes, and YUV in two planes.
_OWN_PLANE = re.compile(r"gray\d*(msb)?|yuv.*|nv\d+|p[024]\d\d")


@dataclass(frozen=True)
class Luma:
    """The words of a frame's first plane that hold brightness."""

    dtype: str
    bits: int  # of a level
    first: int = 0  # word of the first pixel of a row
    step: int = 1  # words from pixel to pixel
    shift: int = 0  # bits below the level

    @classmethod
    def of(cls, layout: str, bits: int) -> Luma | None:
        """The brightness in FFmpeg's ``layout`` with levels of that many bits; None where there is none, as in RGB."""
        name, order = layout.removesuffix("le").removesuffix("be"), ">" if layout.endswith("be") else "<"
        if name in _MIXED:
            size, first, step, shift = _MIXED[name]
            return cls(f"{order}u{size}", bits, first, step, shift)
        if _OWN_PLANE.fullmatch(name) is None or not 8 <= bits <= 16:
            return None
        # Some layouts fill the high bits of a word.
        shift = 16 - bits if name.startswith("p") or "msb" in name else 0
        return cls(f"{order}u{1 if bits == 8 else 2}", bits, shift=shift)

    def levels(self, frame: av.VideoFrame) -> NDArray[Any]:
        """The levels (h, w) of a frame, whose rows are padded to line_size bytes."""
        plane = frame.planes[0]
        rows = np.frombuffer(plane, np.uint8)[: plane.line_size * frame.height].reshape(frame.height, plane.line_size)  # type: ignore[call-overload]
        used = self.step * frame.width * np.dtype(self.dtype).itemsize
        words = np.ascontiguousarray(rows[:, :used]).view(self.dtype)[:, self.first :: self.step]
        if self.dtype.endswith(("1", "2")) and not self.shift:
            return words
        return ((words >> self.shift) & ((1 << self.bits) - 1)).astype("u2")
