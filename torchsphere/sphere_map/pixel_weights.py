"""Weights of the pixels: residual variance by distance from the outline, hidden parts, gain and offset.

Near the outline the texture is foreshortened to less than the map's cells, and the edge crosses pixels. The residual
there is more than camera noise; its variance is measured from the residuals themselves.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import torch
import torch.nn.functional as F  # noqa: N812  (torch's own custom)
from torch import Tensor

from torchsphere.sphere_map.forward_model import Pose
from torchsphere.sphere_map.window import Window

#: Limits of the rings in which the residual variance is measured, px from the outline (docs/constants.md).
RING_LIMITS_PX = (-6.0, -4.0, -3.0, -2.0, -1.5, -1.0, -0.5, 0.0, 0.5, 1.0)

#: Side of the square over which squared residuals are averaged to find hidden parts, px (docs/constants.md).
NEIGHBOURHOOD_PX = 5

#: Mean squared residual of the square, in variances of the ring, from which visibility falls (docs/constants.md).
HIDDEN_FROM = 3.0

#: Variance that rounding to whole grey levels leaves, grey levels squared.
ROUNDING_VARIANCE = 1 / 12


@dataclass(frozen=True)
class ResidualProfile:
    """Variance of the residual by the distance from the outline."""

    limits: Tensor  # limits (m - 1,) of the rings, px from the ball's centre
    variance: Tensor  # variance (m,) in each ring, grey levels squared

    def at(self, window: Window, centre: Tensor) -> Tensor:
        """Variance (p,) at a window's pixels, with the ball's ``centre`` (2,)."""
        return self.variance.to(window.levels)[_ring_numbers(window, centre, self.limits)]


def _ring_limits(radius: float) -> Tensor:
    """`ResidualProfile.limits` around a ball of that ``radius``."""
    return radius + torch.tensor(RING_LIMITS_PX, dtype=torch.float64)


def _ring_numbers(window: Window, centre: Tensor, limits: Tensor) -> Tensor:
    """Number (p,) of the ring around ``centre`` (2,) in which each pixel lies."""
    distance = window.offsets_from(centre).norm(dim=-1)
    return torch.bucketize(distance, limits.to(distance))


def uniform_profile(radius: float) -> ResidualProfile:
    """Profile with variance 1 in all rings, before any residual is known."""
    limits = _ring_limits(radius)
    return ResidualProfile(limits, torch.ones(len(limits) + 1, dtype=torch.float64))


def measure_profile(windows: list[Window], poses: list[Pose], levels: list[Tensor], radius: float) -> ResidualProfile:
    """Mean squared residual of the visible pixels per ring; ``levels`` (p,) are the model's for each window."""
    limits = _ring_limits(radius)
    total, count = torch.zeros(2, len(limits) + 1, dtype=torch.float64)
    for window, pose, model_levels in zip(windows, poses, levels, strict=True):
        ring = _ring_numbers(window, pose.centre, limits)
        total.index_add_(0, ring, (window.visibility * (window.levels - model_levels).square()).double())
        count.index_add_(0, ring, window.visibility.double())
    return ResidualProfile(limits, (total / count.clamp_min(1)).clamp_min(ROUNDING_VARIANCE))


def weights(window: Window, pose: Pose, profile: ResidualProfile) -> Tensor:
    """Weight (p,) of each pixel: visibility over the variance of its ring."""
    return window.visibility / profile.at(window, pose.centre)


def estimate_visibility(window: Window, pose: Pose, profile: ResidualProfile, levels: Tensor) -> Window:
    """The window with lower visibility where a pixel's neighbourhood does not fit the model's ``levels`` (p,)."""
    misfit = (window.levels - levels).square() / profile.at(window, pose.centre)
    column, row = (window.pixels - window.pixels.amin(0)).long().unbind(-1)
    shape = (int(row.max()) + 1, int(column.max()) + 1)
    usable = (window.visibility > 0).to(misfit)
    grid, count = misfit.new_zeros(2, *shape)
    grid[row, column], count[row, column] = misfit * usable, usable
    padding = NEIGHBOURHOOD_PX // 2
    sums = F.avg_pool2d(torch.stack((grid, count))[:, None], NEIGHBOURHOOD_PX, stride=1, padding=padding)[:, 0]
    local = (sums[0] / sums[1].clamp_min(1e-6))[row, column]
    return replace(window, visibility=usable * (HIDDEN_FROM / local.clamp_min(HIDDEN_FROM)).square())


def with_initial_gains(windows: list[Window], poses: list[Pose]) -> list[Pose]:
    """The poses with gains from the mean grey levels around the ball, before a map exists."""
    means = torch.stack([(w.visibility * w.levels).sum() / w.visibility.sum().clamp_min(1) for w in windows])
    gains = means / means.mean().clamp_min(1e-6)
    return [replace(pose, gain=max(float(gain), 0.1)) for pose, gain in zip(poses, gains, strict=True)]


def fit_brightness(window: Window, pose: Pose, profile: ResidualProfile, levels: Tensor) -> Pose:
    """The pose with the gain and offset that fit the image best; ``levels`` (p,) are the model's at ``pose``."""
    unit_levels = (levels - pose.offset) / pose.gain
    design = torch.stack((unit_levels, torch.ones_like(unit_levels)), -1)
    weighted = design * weights(window, pose, profile)[:, None]
    normal, right = (weighted.T @ design).double(), (weighted.T @ window.levels).double()
    gain, offset = torch.linalg.solve(normal + 1e-9 * normal.trace() * torch.eye(2), right)
    return replace(pose, gain=float(gain), offset=float(offset))
