"""Images that hold a part of the images beside them: averaged or blended video.

The noise of the still background shows it: what a camera sees anew in each image differs as much from the image before
as from one much earlier.
"""

from __future__ import annotations

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from torchsphere.recording.frame_source import Source

#: Images apart whose noise has nothing in common, and pairs of images that are looked at (docs/constants.md).
FAR_APART, LOOKS = 8, 6

#: Distance from the ball's centre beyond which a pixel is background, radii, and side of a block of them, px.
CLEAR_RADII, BLOCK_PX = 1.4, 8

#: Smallest number of blocks, and smallest memory that is more than chance (docs/constants.md).
MIN_BLOCKS, MIN_MEMORY = 12, 0.15

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
        path = position[[i, i + FAR_APART]]
        is_still = _background(images[0], path, radius)
        if ignore is not None:
            is_still &= ~ignore.to(is_still.device)
        near.append(_mean_squares(images[1] - images[0], is_still))
        far.append(_mean_squares(images[2] - images[0], is_still))
    by_near, by_far = torch.cat(near), torch.cat(far)
    if len(by_far) < MIN_BLOCKS or float(by_far.median()) == 0:
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


def _background(image: Tensor, path: Array, radius: float) -> Tensor:
    """True (h, w) for pixels far from the ball at the places ``path`` (2, 2) and between them."""
    height, width = image.shape
    x, y = torch.arange(width, device=image.device), torch.arange(height, device=image.device)[:, None]
    is_far = torch.ones(height, width, dtype=torch.bool, device=image.device)
    for share in np.linspace(0, 1, FAR_APART + 1):
        centre = (1 - share) * path[0] + share * path[1]
        is_far &= (x - float(centre[0])).square() + (y - float(centre[1])).square() > (CLEAR_RADII * radius) ** 2
    return is_far


def _mean_squares(difference: Tensor, is_still: Tensor) -> Tensor:
    """Variance of the ``difference`` (h, w) in each block (k,) that is background as a whole."""

    def blocks(values: Tensor) -> Tensor:
        return values.unfold(0, BLOCK_PX, BLOCK_PX).unfold(1, BLOCK_PX, BLOCK_PX).flatten(2).flatten(0, 1)

    chosen = blocks(difference)[blocks(is_still).all(1)]
    # Flicker changes a block as a whole.
    return chosen.var(1) if len(chosen) else chosen.new_zeros(0)
