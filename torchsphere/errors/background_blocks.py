"""Blocks of the still background, in images that follow each other and far apart: what noise and video do to them."""

from __future__ import annotations

import math

import numpy as np
import torch
from torch import Tensor

from torchsphere.recording.frame_range import spread
from torchsphere.recording.frame_source import Source
from torchsphere.runtime.arrays import Array

#: Images apart whose noise has nothing in common, and groups of images that are looked at (docs/constants.toml).
FAR_APART, LOOKS = 8, 6

#: Distance from the ball's centre beyond which a pixel is background, radii, and side of a block of them, px.
CLEAR_RADII, BLOCK_PX = 1.4, 8

#: Fewest blocks that say something, and number that is enough (docs/constants.toml).
MIN_BLOCKS, ENOUGH_BLOCKS = 12, 1000


def background_blocks(source: Source, position: Array, radius: float, ignore: Tensor | None) -> list[Tensor]:
    """Grey levels (3, k, p) of k blocks beside the ball in an image, in the next and in one `FAR_APART`, `LOOKS` times.

    ``position`` (n, 2) of the ball, px, NaN where unknown; ``ignore`` (h, w) is True for pixels that do not count.
    """
    first = np.flatnonzero(np.isfinite(position[:-FAR_APART, 0]) & np.isfinite(position[FAR_APART:, 0]))
    if not len(first):
        return []
    looks = []
    for i in spread(first, LOOKS).tolist():
        images = torch.cat([source.images(k, k + 1) for k in (i, i + 1, i + FAR_APART)])
        looks.append(_beside(images, position[[i, i + FAR_APART]], radius, ignore))
    return looks


def _beside(images: Tensor, path: Array, radius: float, ignore: Tensor | None) -> Tensor:
    """Blocks (n, k, p) of ``images`` (n, h, w) beside the ball's straight way between the places ``path`` (2, 2).

    Of large images about `ENOUGH_BLOCKS` are looked at, evenly spread.
    """
    height, width = images.shape[1:]
    spacing = BLOCK_PX * max(1, math.isqrt(height * width // (BLOCK_PX**2 * ENOUGH_BLOCKS)))
    half = (BLOCK_PX - 1) / 2
    x = torch.arange(0, width - BLOCK_PX + 1, spacing) + half - float(path[0, 0])
    y = torch.arange(0, height - BLOCK_PX + 1, spacing)[:, None] + half - float(path[0, 1])
    way_x, way_y = (path[1] - path[0]).tolist()
    share = ((x * way_x + y * way_y) / max(way_x**2 + way_y**2, 1.0)).clamp(0, 1)
    distance = (x - share * way_x).hypot(y - share * way_y)
    is_clear = (distance > CLEAR_RADII * radius + BLOCK_PX).flatten().to(images.device)
    if ignore is not None:
        is_clear &= ~_blocks(ignore[None].to(images.device), spacing)[0].any(-1)
    return _blocks(images, spacing)[:, is_clear]


def _blocks(values: Tensor, spacing: int) -> Tensor:
    """Squares of `BLOCK_PX` of ``values`` (n, h, w), as (n, k, p)."""
    return values.unfold(1, BLOCK_PX, spacing).unfold(2, BLOCK_PX, spacing).flatten(3).flatten(1, 2)
