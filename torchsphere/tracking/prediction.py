"""Where the ball will be: it is expected to go on from where it was last seen as it moved there.

Images that repeat the one before although the ball moves: a copy is no measurement.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

#: Motion of the ball's front per frame, px, from which two images of it cannot be the same bit for bit.
MOVES_PX = 0.05


@dataclass(frozen=True)
class Seen:
    """The ball in the last frame in which it was seen, and how it moves on from there.

    Attributes
    ----------
    frame : int
    image : Tensor
        Of that frame (1, h, w).
    centre : Tensor
        (2,), px, float64, on the CPU.
    radius : float
        px.
    increment : Tensor
        Motion (5,) that is expected to the next frame, px and rad, float64.
    trend : Tensor
        Change (5,) of the increment from each frame to the next.
    growth : float
        Relative change of the radius from each frame to the next.
    """

    frame: int
    image: Tensor
    centre: Tensor
    radius: float
    increment: Tensor
    trend: Tensor
    growth: float

    @property
    def ball(self) -> Tensor:
        """Centre and radius (3,), px, float64."""
        return torch.cat((self.centre, self.centre.new_tensor([self.radius])))

    @property
    def moves(self) -> bool:
        """Whether the ball is expected to move by so much that no image of it repeats the one before."""
        dx, dy, wx, wy, wz = self.increment.tolist()
        front = math.hypot(dx - self.radius * wy, dy + self.radius * wx, self.radius * wz)
        return max(front, math.hypot(dx, dy)) > MOVES_PX

    def ahead(self, count: int, in_place: bool) -> tuple[Tensor, Tensor]:
        """Increments (m, 5) of the next ``count`` pairs, px and rad, and the ball (m + 1, 3) from this frame on, px."""
        steps = torch.arange(count + 1, dtype=torch.float64)[:, None]
        increments = self.increment + steps[1:] * self.trend
        moving = torch.zeros_like(increments[:, :2]) if in_place else increments[:, :2]
        centres = self.centre + torch.cat((torch.zeros_like(moving[:1]), moving.cumsum(0)))
        return increments, torch.cat((centres, self.radius * (1 + self.growth) ** steps), -1)

    def share_in_image(self, centre: Tensor) -> float:
        """Share of the ball's disc around ``centre`` (2,) that lies in the image."""
        height, width = self.image.shape[-2:]
        steps = torch.linspace(-1, 1, 41, dtype=torch.float64)
        y, x = torch.meshgrid(steps, steps, indexing="ij")
        disc = x**2 + y**2 <= 1
        x, y = centre[0] + self.radius * x[disc], centre[1] + self.radius * y[disc]
        return float(((x >= 0) & (x <= width - 1) & (y >= 0) & (y <= height - 1)).double().mean())


def trend(increments: NDArray[np.float64]) -> tuple[Tensor, Tensor]:
    """Increment (5,) at the last of ``increments`` (m, 5) and its change from one to the next, by a straight line."""
    slope, last = np.polyfit(np.arange(1 - len(increments), 1), increments, 1)
    return torch.from_numpy(last), torch.from_numpy(slope)


def path(first: Tensor, steps: Tensor, growth: Tensor) -> Tensor:
    """The ball (m + 1, 3) where ``steps`` (m, 2), px, and relative ``growth`` (m,) lead it from ``first`` (3,)."""
    centres = first[:2] + steps.cumsum(0)
    radii = first[2] * (1 + growth).cumprod(0)
    return torch.cat((first[None], torch.cat((centres, radii[:, None]), -1)))


#: Rows of the images between those that are compared first: two images that differ do so in some of these.
SPARSE = 16


def repeats(images: Tensor, seen: Seen) -> NDArray[np.bool_]:
    """Which of the images (m + 1, h, w) after the first repeat the one before (m,), while the ball moves."""
    if not seen.moves:
        return np.zeros(len(images) - 1, dtype=bool)
    same = (images[1:, ::SPARSE] == images[:-1, ::SPARSE]).flatten(1).all(-1)
    if bool(same.any()):
        same = (images[1:] == images[:-1]).flatten(1).all(-1)
    return same.cpu().numpy()
