"""How far each pixel is believed: residual against the distance from the outline, hidden parts, gain and offset.

Near the outline the texture is foreshortened beyond what a map can carry, and pixels straddle the edge; what is left
there is no camera noise. The residuals themselves say how much it is.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import torch
import torch.nn.functional as F  # noqa: N812  (torch's own custom)
from torch import Tensor

from torchsphere import parallel, view
from torchsphere.view import Ball, Pose
from torchsphere.window import Window

#: Limits of the rings that the residual is taken over, px from the outline.
RINGS_PX = (-6.0, -4.0, -3.0, -2.0, -1.5, -1.0, -0.5, 0.0, 0.5, 1.0)

#: Side of the square that a pixel's residual is averaged over, px, and the multiple of its ring's variance from which
#: the square is doubted: noise alone gives 25 pixels a mean of more than 2.5 once in a million.
NEIGHBOURS, DOUBTED = 5, 3.0


@dataclass(frozen=True)
class Profile:
    """Variance of the residual by the distance from the outline.

    Attributes
    ----------
    limits : Tensor
        Of the rings (m - 1,), px from the ball's centre.
    variance : Tensor
        (m,), grey levels squared.
    """

    limits: Tensor
    variance: Tensor


def level_profile(radius: float) -> Profile:
    """One variance everywhere, where nothing is known yet."""
    limits = radius + torch.tensor(RINGS_PX, dtype=torch.float64)
    return Profile(limits, torch.ones(len(limits) + 1, dtype=torch.float64))


def profile(windows: list[Window], poses: list[Pose], ball: Ball) -> Profile:
    """Mean square of the trusted residuals per ring."""
    limits = ball.radius + torch.tensor(RINGS_PX, dtype=torch.float64)
    total, count = torch.zeros(len(limits) + 1, dtype=torch.float64), torch.zeros(len(limits) + 1, dtype=torch.float64)
    levels = parallel.each(lambda window, pose: view.appearance(window, pose, ball), windows, poses)
    for window, pose, seen in zip(windows, poses, levels, strict=True):
        ring = torch.bucketize((window.pixels - pose.centre).norm(dim=-1), limits)
        total.index_add_(0, ring, window.trust * (window.levels - seen).square())
        count.index_add_(0, ring, window.trust)
    floor = 1 / 12  # what rounding alone leaves
    return Profile(limits, (total / count.clamp_min(1)).clamp_min(floor))


def weights(window: Window, pose: Pose, ball: Ball, profile: Profile) -> Tensor:
    """Weight (p,) of each pixel: its trust over the variance of its ring."""
    distance = (window.pixels - pose.centre).norm(dim=-1)
    return window.trust / profile.variance[torch.bucketize(distance, profile.limits)]


def all_doubted(windows: list[Window], poses: list[Pose], ball: Ball, profile: Profile) -> list[Window]:
    """`doubt` of each window."""
    return list(parallel.each(lambda window, pose: doubt(window, pose, ball, profile), windows, poses))


def doubt(window: Window, pose: Pose, ball: Ball, profile: Profile) -> Window:
    """The window without the pixels whose neighbourhood does not fit the model: something is in front of the ball."""
    distance = (window.pixels - pose.centre).norm(dim=-1)
    rest = window.levels - view.appearance(window, pose, ball)
    odd = rest.square() / profile.variance[torch.bucketize(distance, profile.limits)]
    column, row = (window.pixels - window.pixels.amin(0)).long().unbind(-1)
    shape = (int(row.max()) + 1, int(column.max()) + 1)
    grid, there = torch.zeros(shape, dtype=torch.float64), torch.zeros(shape, dtype=torch.float64)
    usable = (window.trust > 0).double()
    grid[row, column], there[row, column] = odd * usable, usable
    sums = F.avg_pool2d(torch.stack((grid, there))[:, None], NEIGHBOURS, stride=1, padding=NEIGHBOURS // 2)[:, 0]
    local = (sums[0] / sums[1].clamp_min(1e-6))[row, column]
    return replace(window, trust=usable * (DOUBTED / local.clamp_min(DOUBTED)).square())


def first_gains(windows: list[Window], poses: list[Pose]) -> list[Pose]:
    """The poses with gains from the images' mean grey levels around the ball, before there is a map."""
    means = torch.stack([(w.trust * w.levels).sum() / w.trust.sum().clamp_min(1) for w in windows])
    gains = means / means.mean().clamp_min(1e-6)
    return [replace(pose, gain=max(float(gain), 0.1)) for pose, gain in zip(poses, gains, strict=True)]


def all_levelled(windows: list[Window], poses: list[Pose], ball: Ball, profile: Profile) -> list[Pose]:
    """`levelled` of each pose."""
    return list(parallel.each(lambda window, pose: levelled(window, pose, ball, profile), windows, poses))


def levelled(window: Window, pose: Pose, ball: Ball, profile: Profile) -> Pose:
    """The pose with the gain and offset that fit its image best."""
    model = (view.appearance(window, pose, ball) - pose.offset) / pose.gain
    design = torch.stack((model, torch.ones_like(model)), -1)
    weighted = design * weights(window, pose, ball, profile)[:, None]
    normal = weighted.T @ design
    gain, offset = torch.linalg.solve(normal + 1e-9 * normal.trace() * torch.eye(2), weighted.T @ window.levels)
    return replace(pose, gain=float(gain), offset=float(offset))
