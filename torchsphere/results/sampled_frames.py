"""Images and residual maps that a result folder keeps: chosen, saved and loaded without torch."""

from __future__ import annotations

import io
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from torchsphere.runtime.arrays import Array

if TYPE_CHECKING:
    from PIL.Image import Image

#: Most frames that a result keeps (docs/constants.toml).
MAX_FRAMES = 300

#: Value of a pixel without a residual.
NO_RESIDUAL = -128


@dataclass(frozen=True)
class Sampled:
    """Images of m frames with their residual maps."""

    row: NDArray[np.int64]  # rows (m,) of ``track.csv``, rising
    webp: tuple[bytes, ...]  # images as WebP, all of the same part of the frame
    # Left, top, width and height of this part, px of the recording, from pixel edge to pixel edge.
    box: tuple[float, float, float, float]
    residual: NDArray[np.int8]  # maps (m, s, s) in units of `residual_step`; `NO_RESIDUAL` where there is no residual
    residual_step: float  # grey levels of the recording per unit
    residual_bin: int  # side of a map's pixel, px of the recording

    @property
    def has_residual(self) -> NDArray[np.bool_]:
        """Which of the m frames have a residual map."""
        return (self.residual != NO_RESIDUAL).any((1, 2))

    def residual_levels(self, i: int) -> NDArray[np.float32]:
        """Residual map ``i`` (s, s) in grey levels; NaN where there is no residual."""
        units = self.residual[i].astype(np.float32)
        units[self.residual[i] == NO_RESIDUAL] = np.nan
        return units * np.float32(self.residual_step)

    def image(self, i: int) -> Image:
        """Image ``i``, decoded."""
        from PIL import Image

        return Image.open(io.BytesIO(self.webp[i]))


def encode_webp(image: Image, **options: Any) -> bytes:
    """The image as WebP, with the ``options`` of Pillow's encoder."""
    stream = io.BytesIO()
    image.save(stream, "WEBP", **options)
    return stream.getvalue()


def rows_to_keep(status: NDArray[np.str_], zncc: Array) -> NDArray[np.int64]:
    """Rows of the frames to keep, rising: all rows up to `MAX_FRAMES`.

    More rows give the first, the last, the row of lowest correlation, rows that are not "ok" (up to half of the kept
    rows, at even distances), and other rows at even distances.
    """
    n = len(status)
    if n <= MAX_FRAMES:
        return np.arange(n)
    bad = np.flatnonzero(status != "ok")
    if len(bad) > MAX_FRAMES // 2:
        bad = bad[np.linspace(0, len(bad) - 1, MAX_FRAMES // 2).round().astype(np.int64)]
    measured = np.where(np.isfinite(zncc), zncc, np.inf)
    required = np.unique(np.concatenate((bad, [0, n - 1, int(measured.argmin())])))
    others = np.setdiff1d(np.arange(n), required)
    even = others[np.linspace(0, len(others) - 1, MAX_FRAMES - len(required)).round().astype(np.int64)]
    return np.sort(np.concatenate((required, even)))


def save(path: Path, sampled: Sampled) -> None:
    """Write ``.npz`` for `load`, without compression: images are compressed, and maps are mostly noise."""
    names = ("row", "box", "residual", "residual_step", "residual_bin")
    arrays: dict[str, Any] = {name: getattr(sampled, name) for name in names}
    arrays["webp_size"] = np.array([len(image) for image in sampled.webp], dtype=np.int64)
    arrays["webp"] = np.frombuffer(b"".join(sampled.webp), dtype=np.uint8)
    np.savez(path, **arrays)


def load(path: Path) -> Sampled:
    """Read a file of `save`; raises ValueError if the file is damaged."""
    try:
        # numpy would leave a damaged file open.
        with path.open("rb") as stream, np.load(stream, allow_pickle=False) as file:
            sizes, data = file["webp_size"], file["webp"].tobytes()
            images = tuple(data[end - size : end] for end, size in zip(sizes.cumsum(), sizes, strict=True))
            left, top, width, height = (float(v) for v in file["box"])
            step, side = float(file["residual_step"]), int(file["residual_bin"])
            return Sampled(file["row"], images, (left, top, width, height), file["residual"], step, side)
    except Exception as error:
        # A damaged archive raises nearly every type: BadZipFile, NotImplementedError, zlib.error, KeyError.
        raise ValueError(f"{path}: the kept images are damaged ({error}); track the recording again") from error
