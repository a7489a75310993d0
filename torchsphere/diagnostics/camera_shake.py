"""Whether what is behind the ball stands still: where a hit shakes the camera, the ball seems to move as well.

Squares of the images outside the ball are compared with those of the first image; their displacements, each by one step
of Gauss-Newton with gain and offset free, are told by their median, which a target or a hand in a part of the image
does not change.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import torch
from numpy.typing import NDArray

from torchsphere.imaging import interpolation
from torchsphere.recording import Recording
from torchsphere.tracking.track import Track

#: Side of the squares, px, how many of them at most, and how few tell nothing.
SIDE, MOST, FEWEST = 32, 32, 6

#: Images that are compared with the first, and the distance of the squares from the ball's outline, px.
IMAGES, CLEARANCE_PX = 12, 6.0

#: Blur of the squares, px, and what it takes from them at each border.
BLUR_PX, BORDER = 1.0, 4

#: Standard deviation of a square's displacement from which its texture is too weak to tell one, px.
WEAK_PX = 0.05

#: Displacement that is told, px; times the spread of the squares' median, and over the squares' own spread.
LEAST_PX, SIGNIFICANT, TOGETHER = 0.1, 6.0, 2.0

Array = NDArray[np.float64]


class Shaken(NamedTuple):
    """How far the background has moved, px, and in which of the tracked frames."""

    px: float
    frame: int


def shaken(recording: Recording, tracked: Track, start: int) -> Shaken | None:
    """The largest displacement of the still background against the first tracked image, where there is one.

    ``start`` is the number of the first tracked frame in the recording.
    """
    known = np.flatnonzero(np.isfinite(tracked.position[:, 0]))
    if len(known) < 2:
        return None
    first, others = int(known[0]), known[1:]
    chosen = others[np.unique(np.linspace(0, len(others) - 1, min(IMAGES, len(others))).round().astype(int))]

    def image(i: int) -> Array:
        return torch.as_tensor(recording.images(start + i, start + i + 1)[0]).double().numpy()

    reference = image(first)
    corners = _corners(reference.shape, tracked, np.append(first, chosen))
    if len(corners) < FEWEST:
        return None
    squares = _Squares(_cut(reference, corners))
    found = [Shaken(_together(squares.displacements(_cut(image(int(i)), corners))), int(i)) for i in chosen]
    most = max(found)
    return most if most.px >= LEAST_PX else None


def _corners(shape: tuple[int, ...], tracked: Track, frames: NDArray[np.int64]) -> NDArray[np.int64]:
    """First row and column (s, 2) of squares that the ball is in none of the ``frames`` near to, evenly spread."""
    rows, columns = (np.arange(0, size - SIDE + 1, SIDE) for size in shape)
    corners = np.stack(np.meshgrid(rows, columns, indexing="ij"), -1).reshape(-1, 2)
    # The place of each square nearest to the ball's centre, as (x, y).
    centres = tracked.position[frames][:, None]
    low = corners[None, :, ::-1]
    away = np.clip(centres, low, low + SIDE - 1) - centres
    clear = (np.hypot(away[..., 0], away[..., 1]) > tracked.circle.radius + CLEARANCE_PX).all(0)
    corners = corners[clear]
    return corners[np.unique(np.linspace(0, len(corners) - 1, min(MOST, len(corners))).round().astype(int))]


def _cut(image: Array, corners: NDArray[np.int64]) -> Array:
    """Blurred squares (s, m, m) of an image, without their borders."""
    steps = np.arange(SIDE)
    cut = image[corners[:, :1, None] + steps[:, None], corners[:, 1:, None] + steps]
    return interpolation.blur(torch.from_numpy(cut), BLUR_PX).numpy()[:, BORDER:-BORDER, BORDER:-BORDER]


class _Squares:
    """Squares (s, m, m) of the reference image."""

    def __init__(self, squares: Array) -> None:
        down, right = np.gradient(squares, axis=(1, 2))
        parts = np.stack((right, down, squares, np.ones_like(squares)), -1).reshape(len(squares), -1, 4)
        self._levels, self._slopes = squares.reshape(len(squares), -1), parts
        normal = parts.swapaxes(1, 2) @ parts
        size = np.sqrt(np.diagonal(normal, axis1=1, axis2=2)).clip(1e-9)
        even = normal / size[:, :, None] / size[:, None] + 1e-9 * np.eye(4)
        self._inverse = np.linalg.inv(even) / size[:, :, None] / size[:, None]

    def displacements(self, squares: Array) -> Array:
        """Of the squares (s, m, m) of another image against these: (k, 2) as (x, y), px, of those that tell it."""
        change = squares.reshape(self._levels.shape) - self._levels
        fitted = self._inverse @ (self._slopes.swapaxes(1, 2) @ change[..., None])
        rest = change - (self._slopes @ fitted)[..., 0]
        sd = np.sqrt(np.diagonal(self._inverse, axis1=1, axis2=2)[:, :2] * rest.var(1)[:, None])
        return np.asarray(-fitted[(sd < WEAK_PX).all(1), :2, 0])


def _together(displacements: Array) -> float:
    """How far squares (k, 2) have moved together, px; 0 where they have not, or are too few to tell."""
    if len(displacements) < FEWEST:
        return 0.0
    middle = np.median(displacements, axis=0)
    spread = 1.4826 * float(np.median(np.hypot(*(displacements - middle).T)))
    size = float(np.hypot(*middle))
    significant = size > SIGNIFICANT * spread / np.sqrt(len(displacements))
    return size if significant and size > TOGETHER * spread else 0.0
