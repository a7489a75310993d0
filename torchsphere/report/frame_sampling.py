"""Some images of a recording, small, with residual maps: kept in the result folder so that a report can be redrawn.

At most `LIMIT` frames, whatever the recording's length: the first and the last, the worst, those that were not
measured, and between them evenly. Images are read a few at a time, so that memory stays flat.
"""

from __future__ import annotations

import dataclasses
import io
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from torchsphere.recording.frame_source import Source
from torchsphere.report.residual_maps import Pairs, binning, options_of, residual_maps
from torchsphere.results.reader import TRANSLATION_KNOWN
from torchsphere.results.sampled_frames import LIMIT, NOTHING, Sampled, chosen
from torchsphere.runtime import threads
from torchsphere.tracking.follow import BATCH
from torchsphere.tracking.track import Track

#: Bytes of all images together, so that a report with its residual maps and numbers stays below 3 MB; longest side and
#: area of an image, px; WebP's quality at first and at least.
BUDGET_BYTES, LONGEST_PX, AREA_PX, QUALITY, LEAST_QUALITY = 1_150_000, 640, 160_000, 60, 25

#: Room around the ball's path, in radii.
ROOM = 1.5

#: Images that tell the grey levels to show, and the share of their pixels below black and above white, %.
LEVEL_IMAGES, LEVEL_TAIL = 5, 0.2

#: Residual maps are kept as whole numbers of this share of the shown range of grey levels: 1/4 level of 256, up to 32.
RESIDUAL_STEP = 1 / 1016

Array = NDArray[np.float64]


def sample(recording: object, track: Track, ignore: Tensor | None = None, limit: int = LIMIT) -> Sampled:
    """Read the chosen frames of ``recording`` and make their residual maps with the increments of ``track``."""
    source = Source.open(recording, "cpu")
    rows = chosen(track.status, track.zncc, limit)
    box = _box(track, source.images(0, 1).shape[-2:])
    levels = _levels(source, rows)
    shrunk = _Shrink.of(box, levels, len(rows))
    shrunk = shrunk.within_budget(lambda row: source.images(row, row + 1)[0].numpy(), rows)
    images: list[bytes] = []
    maps: list[NDArray[np.int8]] = []
    step = (levels[1] - levels[0]) * RESIDUAL_STEP
    for start in range(0, len(rows), BATCH):
        batch = rows[start : start + BATCH]
        read = _read(source, batch)
        images += threads.each(shrunk.webp, [read[int(row)].numpy() for row in batch], at_most=None)
        maps.append(_maps(read, batch, track, ignore, step))
    side = max(m.shape[-1] for m in maps)
    residual = np.concatenate([_padded(m, side) for m in maps])
    x0, y0, x1, y1 = box
    shown = (x0 - 0.5, y0 - 0.5, float(x1 - x0), float(y1 - y0))
    return Sampled(rows, tuple(images), shown, residual, step, binning(float(np.nanmax(track.radius))))


def _box(track: Track, shape: tuple[int, ...]) -> tuple[int, int, int, int]:
    """Left, top, right, bottom of the pixels around the ball's path; the whole image where no path is known."""
    height, width = shape
    known = np.isfinite(track.position[:, 0]) & np.isfinite(track.radius)
    if known.sum() < 2:
        return 0, 0, width, height
    position, room = track.position[known], ROOM * track.radius[known, None]
    low = np.floor((position - room).min(0)).clip(0, [width - 1, height - 1]).astype(int)
    high = np.ceil((position + room).max(0) + 1).clip(low + 1, [width, height]).astype(int)
    return int(low[0]), int(low[1]), int(high[0]), int(high[1])


def _levels(source: Source, rows: NDArray[np.int64]) -> tuple[float, float]:
    """Grey levels to show as black and white."""
    picks = rows[np.unique(np.linspace(0, len(rows) - 1, LEVEL_IMAGES).round().astype(int))]
    tails = (LEVEL_TAIL, 100 - LEVEL_TAIL)
    found = np.array([np.percentile(source.images(int(r), int(r) + 1)[0, ::2, ::2].numpy(), tails) for r in picks])
    low, high = float(found[:, 0].min()), float(found[:, 1].max())
    return low, max(high, low + 1.0)


@dataclass(frozen=True)
class _Shrink:
    """How images become small: part, grey levels, size and quality."""

    box: tuple[int, int, int, int]
    levels: tuple[float, float]
    size: tuple[int, int]
    quality: int
    budget: float  # bytes per image

    @classmethod
    def of(cls, box: tuple[int, int, int, int], levels: tuple[float, float], count: int) -> _Shrink:
        width, height = box[2] - box[0], box[3] - box[1]
        factor = min(1.0, LONGEST_PX / max(width, height), (AREA_PX / (width * height)) ** 0.5)
        size = max(round(width * factor), 1), max(round(height * factor), 1)
        return cls(box, levels, size, QUALITY, BUDGET_BYTES / max(count, 100))

    def within_budget(self, image: Callable[[int], NDArray[np.float32]], rows: NDArray[np.int64]) -> _Shrink:
        """With lower quality, then smaller, until a few of the images are within the budget."""
        few = [image(int(row)) for row in rows[np.linspace(0, len(rows) - 1, 4).round().astype(int)]]
        made = self
        while sum(len(made.webp(one)) for one in few) > len(few) * self.budget and min(made.size) > 32:
            if made.quality > LEAST_QUALITY:
                made = dataclasses.replace(made, quality=max(made.quality - 15, LEAST_QUALITY))
            else:
                smaller = round(0.85 * made.size[0]), round(0.85 * made.size[1])
                made = dataclasses.replace(made, size=smaller)
        return made

    def webp(self, image: NDArray[np.float32]) -> bytes:
        from PIL import Image

        x0, y0, x1, y1 = self.box
        low, high = self.levels
        grey = ((image[y0:y1, x0:x1] - low) * (255 / (high - low))).clip(0, 255).astype(np.uint8)
        picture = Image.fromarray(grey)
        if picture.size != self.size:
            picture = picture.resize(self.size, Image.Resampling.BOX)
        stream = io.BytesIO()
        picture.save(stream, "WEBP", quality=self.quality, method=1)
        return stream.getvalue()


def _read(source: Source, rows: NDArray[np.int64]) -> dict[int, Tensor]:
    """Images of the rows and of those before them, read in runs."""
    wanted = np.unique(np.concatenate((rows, rows[rows > 0] - 1)))
    runs = np.split(wanted, np.flatnonzero(np.diff(wanted) > 1) + 1)
    images: dict[int, Tensor] = {}
    for run in runs:
        first = int(run[0])
        images |= {first + i: image for i, image in enumerate(source.images(first, int(run[-1]) + 1))}
    return images


def _maps(
    images: dict[int, Tensor], rows: NDArray[np.int64], track: Track, ignore: Tensor | None, step: float
) -> NDArray[np.int8]:
    """Residual maps (m, s, s) of the rows, empty where a frame's increment was not measured."""
    q = np.concatenate((np.full((1, 5), np.nan), track.increment))[rows]
    before = np.maximum(rows - 1, 0)
    growth = track.radius[rows] / track.radius[before] - 1
    # The translation model knows no rotation; for all others an unknown one is no zero.
    if track.settings["model"] == "translation":
        q[:, 2:] = np.where(np.isfinite(q[:, :1]), 0.0, q[:, 2:])
    motion = np.concatenate((q, growth[:, None]), 1)
    circles = np.concatenate((track.position[before], track.radius[before, None]), 1)
    stands = np.isin(track.status[rows], TRANSLATION_KNOWN)
    good = (rows > 0) & stands & np.isfinite(motion).all(1) & np.isfinite(circles).all(1)
    if not good.any():
        return np.full((len(rows), 1, 1), NOTHING, dtype=np.int8)
    pairs = Pairs(
        [images[int(row) - 1] for row in rows[good]],
        [images[int(row)] for row in rows[good]],
        torch.from_numpy(circles[good]),
        torch.from_numpy(motion[good]),
    )
    found = residual_maps(pairs, ignore, options_of(track.settings))
    units = np.where(np.isfinite(found), (np.nan_to_num(found) / step).round().clip(-127, 127), NOTHING)
    maps = np.full((len(rows), *units.shape[1:]), NOTHING, dtype=np.int8)
    maps[good] = units.astype(np.int8)
    return maps


def _padded(maps: NDArray[np.int8], side: int) -> NDArray[np.int8]:
    """Maps in the middle of a square of ``side``, which differs from theirs by an even number."""
    if maps.shape[-1] == side:
        return maps
    spare = (side - maps.shape[-1]) // 2
    after = side - maps.shape[-1] - spare
    return np.pad(maps, ((0, 0), (spare, after), (spare, after)), constant_values=NOTHING)
