"""Footage of any length with known motion: a ball that turns steadily, or to and fro, and moves along an ellipse.

The motion is periodic, so that the images of one period are enough for a recording of any length. A period holds whole
turns, so that no jump divides it from the next. The noise of every image is new.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import numpy as np
import torch
from kornia.geometry.liegroup import So3
from numpy.typing import NDArray

from torchsphere.synthetic import ray_caster

Array = NDArray[Any]

#: Oblique axis of the rotation (x, y, z), of length 1.
AXIS = torch.tensor([2.0, 5.0, 2.0], dtype=torch.float64) / math.sqrt(33)

#: Half axes of the ellipse, px, and margin around the ball's path, px.
REACH_PX, MARGIN_PX = (150.0, 10.0), 20

#: Grey levels: background, and standard deviation of the noise. Rays per pixel and axis.
BACKGROUND, NOISE, SUBSAMPLES = 90.0, 2.0, 4

#: Full width at half maximum of the speckle at R = 50 px, px. It grows with the ball, but is no finer than this share.
SPECKLE_PX, FINEST_SHARE = 4.0, 0.7

#: Images without noise that are kept.
KEPT = 2048


@dataclass(frozen=True)
class Motion:
    """A steady turn about `AXIS`, or a swing about it, while the ball moves along the ellipse."""

    per_turn: int  # frames of a whole turn, or of a swing to and fro
    per_path: int  # frames of one round of the ellipse
    swing_rad: float = 0.0  # turn to either side; 0 for a steady turn

    @property
    def deg_per_frame(self) -> float:
        """Turn per frame, deg; the largest one of a swing."""
        return math.degrees(self.swing_rad or 1.0) * 2 * math.pi / self.per_turn

    @property
    def period(self) -> int:
        """Frames after which ball and place repeat."""
        return math.lcm(self.per_turn, self.per_path)

    def angle(self, i: int) -> float:
        """Turn about `AXIS` since frame 0, rad, without whole turns."""
        phase = 2 * math.pi * (i % self.per_turn) / self.per_turn
        return self.swing_rad * math.sin(phase) if self.swing_rad else phase


#: A ball that hardly turns (0.02 deg per frame), one that spins (0.57 deg), and one that spins fast (3 deg).
CALM, SPIN, FAST = Motion(18_000, 600), Motion(630, 630), Motion(120, 600)

#: A ball that swings by 1.1 rad to either side, at most 0.57 deg per frame.
SWING = Motion(700, 700, 1.1)


@dataclass(frozen=True)
class Footage:
    """A recording without end of a ball in that motion; its images (h, w) are made on request."""

    motion: Motion
    radius: float = 50.0
    given_shape: tuple[int, int] | None = None

    @property
    def shape(self) -> tuple[int, int]:
        """Height and width of the images, px; by default as the ball needs."""
        width, height = (math.ceil(2 * (self.radius + reach + MARGIN_PX)) for reach in REACH_PX)
        return self.given_shape or (height, width)

    def position(self, frames: Any) -> Array:
        """True centres (n, 2) as (x, y), px, in the images of these numbers."""
        phase = 2 * math.pi * (np.asarray(frames) % self.motion.per_path) / self.motion.per_path
        middle = np.array([self.shape[1] / 2 + 0.3, self.shape[0] / 2 + 0.2])
        return middle + np.stack((REACH_PX[0] * np.sin(phase), -REACH_PX[1] * np.cos(phase)), -1)

    def circle(self) -> tuple[float, float, float]:
        """The true outline in the first image."""
        x, y = self.position([0])[0].tolist()
        return x, y, self.radius

    def image(self, i: int) -> NDArray[np.uint8]:
        """Image (h, w) number ``i``; its noise depends on the number alone."""
        noise = np.random.default_rng(i).standard_normal(self.shape, np.float32)
        grey = BACKGROUND + NOISE * noise
        ball, (left, top) = _ball(self, i % self.motion.period)
        grey[top : top + len(ball), left : left + len(ball)] += ball - BACKGROUND
        return np.asarray(grey.round().clip(0, 255), dtype=np.uint8)

    def images(self, count: int) -> NDArray[np.uint8]:
        """The first ``count`` images (count, h, w)."""
        return np.stack([self.image(i) for i in range(count)])


@lru_cache(maxsize=KEPT)
def _ball(footage: Footage, i: int) -> tuple[Array, tuple[int, int]]:
    """Square around the ball in image ``i`` without noise, and its first pixel (x, y)."""
    half = math.ceil(footage.radius) + 4
    centre = footage.position([i])
    corner = np.floor(centre[0]).astype(int) - half
    turned = So3.exp(footage.motion.angle(i) * AXIS[None]).matrix()
    drawn = ray_caster.render(
        _pattern(footage.radius),
        torch.from_numpy(centre - corner).float(),
        footage.radius,
        turned.float(),
        BACKGROUND,
        shape=(2 * half, 2 * half),
        subsamples=SUBSAMPLES,
    )
    return drawn[0].numpy(), (int(corner[0]), int(corner[1]))


@lru_cache(maxsize=1)
def _pattern(radius: float) -> ray_caster.Pattern:
    """The ball's speckle, which grows with the ball."""
    return ray_caster.speckle(0, radius_px=radius, speckle_px=SPECKLE_PX * max(radius / 50, FINEST_SHARE))
