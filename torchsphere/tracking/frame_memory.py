"""Images that hold a part of the images beside them: averaged or blended video.

The noise of the still background shows it: what a camera sees anew in each image differs as much from the image before
as from one much earlier.
"""

from __future__ import annotations

import math

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from torchsphere.recording.frame_source import Source

#: Images apart whose noise has nothing in common, and pairs of images that are looked at (docs/constants.md).
FAR_APART, LOOKS = 8, 6

#: Distance from the ball's centre beyond which a pixel is background, radii, and side of a block of them, px.
CLEAR_RADII, BLOCK_PX = 1.4, 8

#: Fewest blocks and number that is enough, and smallest memory that is more than chance (docs/constants.md).
MIN_BLOCKS, ENOUGH_BLOCKS, MIN_MEMORY = 12, 1000, 0.15

#: Largest lag of the ball behind the images, frames: half of an image is another one (docs/constants.md).
MAX_LAG = 1.0

Array = NDArray[np.float64]


def noise_memory(source: Source, position: Array, radius: float, ignore: Tensor | None) -> float:
    """Share of the background's noise that each image has in common with the one before, 0 to 1; 0 if unknown.

    ``position`` (n, 2) of the ball, px, NaN where unknown; ``ignore`` (h, w) is True for pixels that do not count.
    """
    first = np.flatnonzero(np.isfinite(position[:-FAR_APART, 0]) & np.isfinite(position[FAR_APART:, 0]))
    if not len(first):
        return 0.0
    near, far = [], []
    for i in first[np.unique(np.linspace(0, len(first) - 1, LOOKS).round().astype(int))].tolist():
        images = torch.cat([source.images(k, k + 1) for k in (i, i + 1, i + FAR_APART)])
        blocks = _background_blocks(images, position[[i, i + FAR_APART]], radius, ignore)
        near.append(blocks[1] - blocks[0])
        far.append(blocks[2] - blocks[0])
    if sum(map(len, far)) < MIN_BLOCKS:
        return 0.0
    # Flicker changes a block as a whole.
    by_near, by_far = torch.cat(near).var(1), torch.cat(far).var(1)
    if float(by_far.median()) == 0:
        return 0.0
    memory = 1 - float(by_near.median() / by_far.median())
    return memory if memory > MIN_MEMORY else 0.0


def lag_of(memory: float) -> float:
    """Frames by which the ball in the images is behind, or before, that of the camera: `MAX_LAG` at most.

    A filter that keeps the share m of the image before, m of that before it, and so on, lags by m / (1 - m).
    """
    return min(memory / (1 - memory), MAX_LAG) if memory < 1 else MAX_LAG


def widened(increment: Array, covariance: Array, memory: float) -> Array:
    """The ``covariance`` (n - 1, 5, 5) with the error of a lag: a lag of a steady motion shows in its changes.

    Before the first and after the last step of ``increment`` (n - 1, 5) the images hold no motion.
    """
    steps = np.pad(np.nan_to_num(increment), ((1, 1), (0, 0)))
    changes = np.abs(np.diff(steps, axis=0))
    error = lag_of(memory) * np.maximum(changes[:-1], changes[1:])
    return covariance + np.einsum("ni,ij->nij", np.square(error), np.eye(5))


def _background_blocks(images: Tensor, path: Array, radius: float, ignore: Tensor | None) -> Tensor:
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
