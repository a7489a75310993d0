"""The images and residual maps that a result folder keeps, without what makes them, which takes torch to import."""

from __future__ import annotations

import zipfile
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

#: Frames at most: as many as a person scrubs through, and as keep a report below 3 MB.
LIMIT = 300

#: What stands for "no residual" among the whole numbers of a map.
NOTHING = -128

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Sampled:
    """Images of m frames and what the motion leaves unexplained in them.

    Attributes
    ----------
    row : ndarray
        Rows (m,) of ``track.csv``, rising.
    webp : tuple of bytes
        The images as WebP, all of the same part of the frame.
    box : tuple of float
        That part: left, top, width and height, px of the recording; the edges are those of pixels.
    residual : ndarray
        Maps (m, s, s), int8, in units of `residual_step`, `NOTHING` where there is none.
    residual_step : float
        Grey levels of the recording per unit.
    residual_bin : int
        Side of a map's pixel, px of the recording.
    """

    row: NDArray[np.int64]
    webp: tuple[bytes, ...]
    box: tuple[float, float, float, float]
    residual: NDArray[np.int8]
    residual_step: float
    residual_bin: int

    @property
    def has_residual(self) -> NDArray[np.bool_]:
        """Which of the m frames have a map."""
        return (self.residual != NOTHING).any((1, 2))

    def residual_levels(self, i: int) -> NDArray[np.float32]:
        """Map ``i`` (s, s) in grey levels, NaN where there is none."""
        units = self.residual[i].astype(np.float32)
        units[self.residual[i] == NOTHING] = np.nan
        return units * np.float32(self.residual_step)


def chosen(status: NDArray[np.str_], zncc: Array, limit: int = LIMIT) -> NDArray[np.int64]:
    """Rows of the frames to keep, rising: all where they are at most ``limit``.

    Otherwise the first, the last, the one with the lowest correlation, those that are not "ok" (evenly picked where
    they fill more than half), and between them evenly.
    """
    n = len(status)
    if n <= limit:
        return np.arange(n)
    bad = np.flatnonzero(status != "ok")
    if len(bad) > limit // 2:
        bad = bad[np.linspace(0, len(bad) - 1, limit // 2).round().astype(np.int64)]
    measured = np.where(np.isfinite(zncc), zncc, np.inf)
    must = np.unique(np.concatenate((bad, [0, n - 1, int(measured.argmin())])))
    rest = np.setdiff1d(np.arange(n), must)
    filling = rest[np.linspace(0, len(rest) - 1, limit - len(must)).round().astype(np.int64)]
    return np.sort(np.concatenate((must, filling)))


def save(path: Path, sampled: Sampled) -> None:
    """Write as ``.npz``, which `load` reads; images are compressed already, and maps are noise that hardly would be."""
    arrays = {name: np.asarray(getattr(sampled, name)) for name in ("row", "box", "residual", "residual_step")}
    sizes = np.array([len(image) for image in sampled.webp], dtype=np.int64)
    data = np.frombuffer(b"".join(sampled.webp), dtype=np.uint8)
    arrays |= {"residual_bin": np.asarray(sampled.residual_bin), "webp_size": sizes, "webp": data}
    np.savez(path, **arrays)  # type: ignore[arg-type]


def load(path: Path) -> Sampled:
    """Read what `save` wrote.

    Raises
    ------
    ValueError
        If the file is damaged.
    """
    try:
        # Opened here, since numpy leaves a damaged file open.
        with path.open("rb") as stream, np.load(stream, allow_pickle=False) as file:
            ends = file["webp_size"].cumsum()
            data = file["webp"].tobytes()
            images = tuple(data[end - size : end] for end, size in zip(ends, file["webp_size"], strict=True))
            left, top, width, height = (float(v) for v in file["box"])
            return Sampled(
                row=file["row"],
                webp=images,
                box=(left, top, width, height),
                residual=file["residual"],
                residual_step=float(file["residual_step"]),
                residual_bin=int(file["residual_bin"]),
            )
    except (KeyError, OSError, EOFError, ValueError, zipfile.BadZipFile) as error:
        raise ValueError(f"{path}: the kept images are damaged ({error}); track the recording again") from error
