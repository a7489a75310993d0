"""Images and residual maps of a few frames, for the result folder: a report can be drawn from them again.

A residual map is the image minus the image before it, moved with the ball. The number of frames has a limit, whatever
the length of the recording. Images are read a few at a time, so that memory stays constant.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import torch
import torch.nn.functional as F  # noqa: N812  (torch's convention)
from numpy.typing import NDArray
from torch import Tensor

from torchsphere.correlation import znssd
from torchsphere.correlation.frame_status import TRANSLATION_KNOWN
from torchsphere.correlation.options import Options, margin
from torchsphere.correlation.reference import Filtered, build_reference
from torchsphere.correlation.warp import warp
from torchsphere.geometry import motion_models
from torchsphere.geometry.camera import Camera
from torchsphere.imaging import crop, interlacing, interpolation
from torchsphere.imaging.colour_mosaic import without_mosaic
from torchsphere.motion.track import Track
from torchsphere.recording.frame_range import spread
from torchsphere.recording.frame_source import Source
from torchsphere.results.sampled_frames import NO_RESIDUAL, Sampled, encode_webp, rows_to_keep
from torchsphere.runtime import threads
from torchsphere.tracking.follow import BATCH

#: Size of all images together, bytes (docs/constants.toml).
BUDGET_BYTES = 1_150_000

#: Longest side and area of an image at most, px.
LONGEST_PX, AREA_PX = 640, 160_000

#: First and least quality of WebP; at the least quality images are made smaller instead.
QUALITY, LEAST_QUALITY = 60, 25

#: Half the width of the part that is kept around the ball's path, radii.
PATH_MARGIN = 1.5

#: Number of images that give the range of grey levels, and the share of their pixels below and above the range, %.
LEVEL_IMAGES, LEVEL_TAIL = 5, 0.2

#: Unit of residual maps, share of the range of grey levels: 1/4 of 254 levels, so that int8 reaches to 32 levels.
RESIDUAL_STEP = 1 / 1016

#: Radius of a large ball in its map, px: its pixels are binned by the nearest whole number (docs/constants.toml).
BINNED_RADIUS_PX = 48.0


@dataclass(frozen=True)
class Pairs:
    """m pairs of images (h, w) of the ball; all values are finite."""

    before: Sequence[Tensor]
    after: Sequence[Tensor]
    circles: Tensor  # (x, y, radius) of the ball (m, 3) in the first image, px
    motion: Tensor  # (dx, dy, wx, wy, wz, growth) to the second image (m, 6), px, rad and a share of the radius


def sample(recording: object, track: Track, ignore: Tensor | None = None) -> Sampled:
    """Images and residual maps of the frames of ``recording`` that `rows_to_keep` chooses."""
    source = Source.open(recording, "cpu")
    if track.findings.mosaic:
        source, _ = without_mosaic(source)
    rows = rows_to_keep(track.status, track.zncc)
    box = _path_box(track, source.images(0, 1).shape[-2:])
    interlaced = track.findings.interlaced
    levels = black_and_white(lambda row: source.images(row, row + 1)[0].numpy(), rows)
    encoding = _encoding(box, levels, len(rows))
    few = rows[np.linspace(0, len(rows) - 1, 4).round().astype(int)]
    encoding = encoding.within_budget([source.images(int(row), int(row) + 1)[0].numpy() for row in few])
    images: list[bytes] = []
    maps: list[NDArray[np.int8]] = []
    step = (levels[1] - levels[0]) * RESIDUAL_STEP
    for start in range(0, len(rows), BATCH):
        batch = rows[start : start + BATCH]
        read = _read(source, batch)
        images += threads.parallel_map(encoding.webp, [read[int(row)].numpy() for row in batch], at_most=None)
        measured = (
            {row: interlacing.of_even_rows(image[None])[0] for row, image in read.items()} if interlaced else read
        )
        maps.append(_maps(measured, batch, track, ignore, step))
    side = max(m.shape[-1] for m in maps)
    residual = np.concatenate([_padded(m, side) for m in maps])
    x0, y0, x1, y1 = box
    edges = (x0 - 0.5, y0 - 0.5, float(x1 - x0), float(y1 - y0))
    return Sampled(rows, tuple(images), edges, residual, step, bin_size(float(np.nanmax(track.radius))))


def _path_box(track: Track, shape: tuple[int, ...]) -> tuple[int, int, int, int]:
    """Left, top, right, bottom of the pixels around the ball's path; of the whole image if no path is known."""
    height, width = shape
    known = np.isfinite(track.position[:, 0]) & np.isfinite(track.radius)
    if known.sum() < 2:
        return 0, 0, width, height
    position, margin = track.position[known], PATH_MARGIN * track.radius[known, None]
    low = np.floor((position - margin).min(0)).clip(0, [width - 1, height - 1]).astype(int)
    high = np.ceil((position + margin).max(0) + 1).clip(low + 1, [width, height]).astype(int)
    return int(low[0]), int(low[1]), int(high[0]), int(high[1])


def black_and_white(image: Callable[[int], NDArray[np.float32]], rows: NDArray[np.int64]) -> tuple[float, float]:
    """Grey levels that become black and white, by the ``image`` (h, w) of a few ``rows`` (m,).

    All but the darkest and brightest pixels lie between.
    """
    tails = (LEVEL_TAIL, 100 - LEVEL_TAIL)
    found = np.array([np.percentile(image(row)[::2, ::2], tails) for row in spread(rows, LEVEL_IMAGES).tolist()])
    low, high = float(found[:, 0].min()), float(found[:, 1].max())
    return low, high if high > low else low + 1.0


@dataclass(frozen=True)
class _Encoding:
    """Encoding of an image as a small WebP."""

    box: tuple[int, int, int, int]  # part of the image: x0, y0, x1, y1
    levels: tuple[float, float]  # grey levels that become black and white
    size: tuple[int, int]
    quality: int
    budget: float  # bytes per image

    def within_budget(self, images: list[NDArray[np.float32]]) -> _Encoding:
        """An encoding that keeps the ``images`` within the budget: first of lower quality, then smaller."""
        if min(self.size) <= 32 or sum(len(self.webp(image)) for image in images) <= len(images) * self.budget:
            return self
        if self.quality > LEAST_QUALITY:
            smaller = dataclasses.replace(self, quality=max(self.quality - 15, LEAST_QUALITY))
        else:
            smaller = dataclasses.replace(self, size=(round(0.85 * self.size[0]), round(0.85 * self.size[1])))
        return smaller.within_budget(images)

    def webp(self, image: NDArray[np.float32]) -> bytes:
        from PIL import Image

        x0, y0, x1, y1 = self.box
        low, high = self.levels
        grey = ((image[y0:y1, x0:x1] - low) * (255 / (high - low))).clip(0, 255).astype(np.uint8)
        picture = Image.fromarray(grey)
        if picture.size != self.size:
            picture = picture.resize(self.size, Image.Resampling.BOX)
        return encode_webp(picture, quality=self.quality, method=1)


def _encoding(box: tuple[int, int, int, int], levels: tuple[float, float], count: int) -> _Encoding:
    """The encoding of ``count`` images at full quality, within `LONGEST_PX` and `AREA_PX`."""
    width, height = box[2] - box[0], box[3] - box[1]
    factor = min(1.0, LONGEST_PX / max(width, height), (AREA_PX / (width * height)) ** 0.5)
    size = max(round(width * factor), 1), max(round(height * factor), 1)
    return _Encoding(box, levels, size, QUALITY, BUDGET_BYTES / max(count, 100))


def _read(source: Source, rows: NDArray[np.int64]) -> dict[int, Tensor]:
    """Images of the rows and of the rows before them, read in runs."""
    wanted = np.unique(np.concatenate((rows, rows[rows > 0] - 1)))
    images: dict[int, Tensor] = {}
    for run in np.split(wanted, np.flatnonzero(np.diff(wanted) > 1) + 1):
        first = int(run[0])
        images |= {first + i: image for i, image in enumerate(source.images(first, int(run[-1]) + 1))}
    return images


def _maps(
    images: dict[int, Tensor], rows: NDArray[np.int64], track: Track, ignore: Tensor | None, step: float
) -> NDArray[np.int8]:
    """Residual maps (m, s, s) of the rows in units of ``step``; `NO_RESIDUAL` if the increment was not measured."""
    q = np.concatenate((np.full((1, 5), np.nan), track.increment))[rows]
    before = np.maximum(rows - 1, 0)
    growth = track.radius[rows] / track.radius[before] - 1
    # The rotation of the model "translation" is 0. With other models, NaN means an unknown rotation.
    if track.settings["model"] == "translation":
        q[:, 2:] = np.where(np.isfinite(q[:, :1]), 0.0, q[:, 2:])
    motion = np.concatenate((q, growth[:, None]), 1)
    circles = np.concatenate((track.position[before], track.radius[before, None]), 1)
    measured = np.isin(track.status[rows], TRANSLATION_KNOWN)
    good = (rows > 0) & measured & np.isfinite(motion).all(1) & np.isfinite(circles).all(1)
    if not good.any():
        return np.full((len(rows), 1, 1), NO_RESIDUAL, dtype=np.int8)
    pairs = Pairs(
        [images[int(row) - 1] for row in rows[good]],
        [images[int(row)] for row in rows[good]],
        torch.from_numpy(circles[good]),
        torch.from_numpy(motion[good]),
    )
    residual = residual_maps(pairs, ignore, options_of(track.settings))
    units = np.where(np.isfinite(residual), (np.nan_to_num(residual) / step).round().clip(-127, 127), NO_RESIDUAL)
    maps = np.full((len(rows), *units.shape[1:]), NO_RESIDUAL, dtype=np.int8)
    maps[good] = units.astype(np.int8)
    return maps


def _padded(maps: NDArray[np.int8], side: int) -> NDArray[np.int8]:
    """Maps (m, side, side) with the given maps in their middle; the sides differ by an even number."""
    spare = side - maps.shape[-1]
    width = (spare // 2, spare - spare // 2)
    return np.pad(maps, ((0, 0), width, width), constant_values=NO_RESIDUAL)


def bin_size(radius: float) -> int:
    """Side of the squares of pixels that are binned, px; 1 for none."""
    return max(1, math.ceil(radius / BINNED_RADIUS_PX - 0.5))


def options_of(settings: dict[str, Any]) -> Options:
    """Options of the correlation, from the ``settings`` of a `Track`."""
    names = set(Options.__dataclass_fields__)
    known = {name: value for name, value in settings.items() if name in names}
    return Options(**known | {"camera": Camera.of_settings(settings)})


def residual_maps(pairs: Pairs, ignore: Tensor | None, options: Options) -> NDArray[np.float32]:
    """Second image minus first image (m, s, s) within the region of interest, grey levels.

    The middle of a map is the ball's centre in the first image, rounded to whole pixels. Pixels outside the region and
    unusable pixels are NaN. Gain and offset are matched as in the ZNSSD, equation (3) of the paper. Images are blurred
    as in the correlation.
    """
    radius = float(pairs.circles[:, 2].max())
    k, half = bin_size(radius), crop.half_size(radius, margin(options))
    crops_f = crop.cut(pairs.before, pairs.circles[:, :2], half, ignore)
    crops_g = crop.cut(pairs.after, pairs.circles[:, :2] + pairs.motion[:, :2].to(pairs.circles), half, ignore)
    crops_f, crops_g = _binned(crops_f, k), _binned(crops_g, k)
    circles = pairs.circles.clone()
    circles[:, :2] = (circles[:, :2] - (k - 1) / 2) / k
    circles[:, 2] /= k
    camera = None if options.camera is None else options.camera.reduced(k)
    # The pattern is finer in binned pixels: without this blur the aliasing dominates the residual.
    pre_blur = max(options.pre_blur, interpolation.PRE_BLUR_PX) if k > 1 else options.pre_blur
    filtered = Filtered.of(crops_f, pre_blur)
    reference = build_reference(filtered, circles, options.roi, pre_blur, camera, blurred_every=None)
    c_g = interpolation.coefficients(crops_g.images, pre_blur)
    model = motion_models.MODELS["finite" if options.model == "rigid" else options.model]
    q = pairs.motion[:, : motion_models.degrees_of_freedom(model)].clone()
    q[:, :2] /= k
    shift = (circles[:, :2] - crops_g.origin).to(c_g)
    warped, weights = warp(reference, c_g, shift, q.to(c_g), model)
    difference = -znssd.residual(reference.values, warped, weights)
    difference = torch.where(weights > 0, difference, torch.nan)
    maps = torch.full((len(difference), reference.side * reference.side), torch.nan)
    maps[:, reference.places.cpu()] = difference.float().cpu()
    return maps.unflatten(-1, (reference.side, reference.side)).numpy()


def _binned(crops: crop.Crops, k: int) -> crop.Crops:
    """The crops with ``k`` x ``k`` pixels binned to their mean; the origin is in binned pixels."""
    if k == 1:
        return crops
    usable = crops.usable
    if usable is not None:
        usable = F.max_pool2d((~usable)[:, None].to(crops.images), k)[:, 0] == 0
    return crop.Crops(F.avg_pool2d(crops.images[:, None], k)[:, 0], usable, crops.origin / k)
