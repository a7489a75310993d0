"""How far each pixel is believed: residual against the distance from the outline, hidden parts, gain and offset.

Near the outline the texture is foreshortened beyond what a map can carry, and pixels straddle the edge; what is left
there is no camera noise. The residuals themselves say how much it is.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import torch
import torch.nn.functional as F  # noqa: N812  (torch's own custom)
from torch import Tensor

from torchsphere.sphere_map.projection import Pose
from torchsphere.sphere_map.window import Window

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

    def at(self, window: Window, centre: Tensor) -> Tensor:
        """Variance (p,) of a window's pixels."""
        return self.variance.to(window.levels)[rings(window, centre, self.limits)]


def rings(window: Window, centre: Tensor, limits: Tensor) -> Tensor:
    """Number (p,) of the ring around ``centre`` (2,) that a pixel lies in."""
    distance = window.around(centre).norm(dim=-1)
    return torch.bucketize(distance, limits.to(distance))


def level_profile(radius: float) -> Profile:
    """One variance everywhere, where nothing is known yet."""
    limits = radius + torch.tensor(RINGS_PX, dtype=torch.float64)
    return Profile(limits, torch.ones(len(limits) + 1, dtype=torch.float64))


def profile(windows: list[Window], poses: list[Pose], levels: list[Tensor], radius: float) -> Profile:
    """Mean square of the trusted residuals per ring, the model giving the pixels these ``levels``."""
    limits = radius + torch.tensor(RINGS_PX, dtype=torch.float64)
    total, count = torch.zeros(len(limits) + 1, dtype=torch.float64), torch.zeros(len(limits) + 1, dtype=torch.float64)
    for window, pose, seen in zip(windows, poses, levels, strict=True):
        ring = rings(window, pose.centre, limits)
        total.index_add_(0, ring, (window.trust * (window.levels - seen).square()).double())
        count.index_add_(0, ring, window.trust.double())
    floor = 1 / 12  # what rounding alone leaves
    return Profile(limits, (total / count.clamp_min(1)).clamp_min(floor))


def weights(window: Window, pose: Pose, profile: Profile) -> Tensor:
    """Weight (p,) of each pixel: its trust over the variance of its ring."""
    return window.trust / profile.at(window, pose.centre)


def doubt(window: Window, pose: Pose, profile: Profile, levels: Tensor) -> Window:
    """The window without the pixels whose neighbourhood does not fit the model: something is in front of the ball.

    ``levels`` (p,) are what the model gives the pixels.
    """
    odd = (window.levels - levels).square() / profile.at(window, pose.centre)
    column, row = (window.pixels - window.pixels.amin(0)).long().unbind(-1)
    shape = (int(row.max()) + 1, int(column.max()) + 1)
    usable = (window.trust > 0).to(odd)
    grid, there = odd.new_zeros(2, *shape)
    grid[row, column], there[row, column] = odd * usable, usable
    sums = F.avg_pool2d(torch.stack((grid, there))[:, None], NEIGHBOURS, stride=1, padding=NEIGHBOURS // 2)[:, 0]
    local = (sums[0] / sums[1].clamp_min(1e-6))[row, column]
    return replace(window, trust=usable * (DOUBTED / local.clamp_min(DOUBTED)).square())


def first_gains(windows: list[Window], poses: list[Pose]) -> list[Pose]:
    """The poses with gains from the images' mean grey levels around the ball, before there is a map."""
    means = torch.stack([(w.trust * w.levels).sum() / w.trust.sum().clamp_min(1) for w in windows])
    gains = means / means.mean().clamp_min(1e-6)
    return [replace(pose, gain=max(float(gain), 0.1)) for pose, gain in zip(poses, gains, strict=True)]


def levelled(window: Window, pose: Pose, profile: Profile, levels: Tensor) -> Pose:
    """The pose with the gain and offset that fit its image best; ``levels`` (p,) are the model's with those it has."""
    model = (levels - pose.offset) / pose.gain
    design = torch.stack((model, torch.ones_like(model)), -1)
    weighted = design * weights(window, pose, profile)[:, None]
    normal, right = (weighted.T @ design).double(), (weighted.T @ window.levels).double()
    gain, offset = torch.linalg.solve(normal + 1e-9 * normal.trace() * torch.eye(2), right)
    return replace(pose, gain=float(gain), offset=float(offset))
