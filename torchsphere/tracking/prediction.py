"""Prediction of the ball's motion from its last known state, and detection of repeated images.

An image that repeats the image before, although the ball moves, is a copy and no measurement.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from torchsphere.recording.level_scale import alike

#: Motion of the ball's front per frame, px, from which two images cannot be identical (docs/constants.toml).
MIN_MOTION_PX = 0.05

#: Distance of the rows in which two images are compared first.
ROW_STEP = 16


@dataclass(frozen=True)
class BallState:
    """The ball in the last frame that shows it, and its expected motion from there."""

    frame: int
    image: Tensor  # of that frame (1, h, w)
    centre: Tensor  # (2,), px, float64, on the CPU
    radius: float  # px
    increment: Tensor  # motion (5,) expected in the next frame interval, px and rad, float64
    trend: Tensor  # change (5,) of the increment from each interval to the next
    growth: float  # relative change of the radius from each interval to the next
    explained: Tensor | None = None  # share (c, c) of each cell that the ball's motion explained; None: the whole ball

    @property
    def circle(self) -> Tensor:
        """Centre and radius (3,), px, float64."""
        return torch.cat((self.centre, self.centre.new_tensor([self.radius])))

    @property
    def is_moving(self) -> bool:
        """Whether the expected motion is so large that no image of the ball can repeat the image before."""
        dx, dy, wx, wy, wz = self.increment.tolist()
        front = math.hypot(dx - self.radius * wy, dy + self.radius * wx, self.radius * wz)
        return max(front, math.hypot(dx, dy)) > MIN_MOTION_PX

    def predict(self, durations: NDArray[np.float64], in_place: bool) -> tuple[Tensor, Tensor]:
        """Increments (m, 5) of the next pairs, px and rad, and circles (m + 1, 3) from this frame on, px.

        ``durations`` (m,) are the times from image to image, in frame intervals.
        """
        each = torch.from_numpy(durations)[:, None]
        steps = torch.cat((torch.zeros_like(each[:1]), each.cumsum(0)))
        increments = each * (self.increment + steps[1:] * self.trend)
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


def linear_trend(increments: NDArray[np.float64], durations: NDArray[np.float64]) -> tuple[Tensor, Tensor]:
    """Increment (5,) per frame interval at the last of ``increments`` (m, 5), and its change, by a straight line.

    ``durations`` (m,) are the times of the increments, in frame intervals.
    """
    ends = durations.cumsum()
    slope, last = np.polyfit(ends - ends[-1], increments / durations[:, None], 1)
    return torch.from_numpy(last), torch.from_numpy(slope)


def circle_path(first: Tensor, steps: Tensor, growth: Tensor) -> Tensor:
    """Circles (m + 1, 3) from ``first`` (3,) on, after ``steps`` (m, 2), px, and relative ``growth`` (m,)."""
    centres = first[:2] + steps.cumsum(0)
    radii = first[2] * (1 + growth).cumprod(0)
    return torch.cat((first[None], torch.cat((centres, radii[:, None]), -1)))


def repeats_previous(images: Tensor, state: BallState) -> NDArray[np.bool_]:
    """True (m,) for images (m + 1, h, w), after the first, that repeat the image before while the ball moves."""
    if not state.is_moving:
        return np.zeros(len(images) - 1, dtype=bool)
    same = alike(images[1:, ::ROW_STEP], images[:-1, ::ROW_STEP]).flatten(1).all(-1)
    if bool(same.any()):
        same = alike(images[1:], images[:-1]).flatten(1).all(-1)
    return same.cpu().numpy()
