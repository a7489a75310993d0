"""Scatter of the residual between parts of the ball: what an error that neighbouring pixels share does to the poses.

The covariance of a registration takes the residual for noise that differs from pixel to pixel. What a video codec, a
filter over time, moving light or a body that is not a sphere leaves is alike over many pixels, and moves a pose by more
than such noise. The scores of blocks show it without a model of the residual (the sandwich of Huber and White).
"""

from __future__ import annotations

import math

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from torchsphere.sphere_map import exposure, pixel_weights
from torchsphere.sphere_map.ball import Poses, TexturedBall
from torchsphere.sphere_map.pixel_weights import ResidualProfile
from torchsphere.sphere_map.registration import GROWING, columns_of, normal_equations
from torchsphere.sphere_map.window import Windows

#: Most frames whose residuals are examined (docs/constants.toml).
FRAMES = 16

#: Side of a block, radii (docs/constants.toml).
BLOCK = 0.3

#: Least side of a block, px (docs/constants.toml).
MIN_BLOCK_PX = 8


def spread_out(count: int) -> NDArray[np.int64]:
    """Up to `FRAMES` of ``count`` rows, evenly spread."""
    return np.linspace(0, count - 1, min(count, FRAMES)).astype(np.int64)


def widening(windows: Windows, poses: Poses, ball: TexturedBall, profile: ResidualProfile) -> Tensor:
    """Factors (6,), float64, at least 1, on the standard deviations of (dx, dy, wx, wy, wz) and the outline's radius.

    They are from n registered images; that of a radius that is no unknown is 1.

    The images have one factor together: a single one has too few blocks for its own.
    """
    model = exposure.linearise(windows, poses, ball)
    residual = windows.levels - model.levels
    seen = pixel_weights.estimate_visibility(windows, profile.at(windows, poses), residual)
    weights = profile.weights(seen, poses)
    columns = columns_of(ball)
    normal, _ = normal_equations(model, weights, residual, columns)
    scores = (weights * residual).unsqueeze(1) * model.jacobian[:, :, columns].mT.unflatten(2, residual.shape[1:])
    side = max(MIN_BLOCK_PX, math.ceil(BLOCK * float(ball.radius)))
    shares = _fading_blocks(residual.shape[-1], side).to(scores)
    sums = (shares @ scores @ shares.T).flatten(2).double()
    inverse = torch.linalg.inv_ex(normal)[0]
    found = (inverse @ (sums @ sums.mT) @ inverse).diagonal(dim1=1, dim2=2).sum(0)
    # The stated variances count each image by how well it fits.
    count = (weights > 0).sum((1, 2)).clamp_min(1)
    misfit = (weights * residual.square()).sum((1, 2)) / count
    stated = (misfit.double().unsqueeze(1) * inverse.diagonal(dim1=1, dim2=2)).sum(0)
    factors = torch.ones(len(GROWING), dtype=found.dtype, device=found.device)
    rows = torch.tensor([GROWING.index(column) for column in columns], device=found.device)
    return factors.index_copy(0, rows, (found / stated).nan_to_num(1.0).clamp_min(1.0).sqrt())[:6]


def _fading_blocks(length: int, side: int) -> Tensor:
    """Share (b, length) of each place on an axis in each block; the squares of a place's shares add up to 1.

    Blocks overlap, so that they also show sums that cancel over the whole ball.
    """
    middles = side * torch.arange(math.ceil(length / side) + 1)
    distance = (torch.arange(length) - middles[:, None]).abs() / side
    return torch.where(distance < 1, torch.cos(0.5 * math.pi * distance), 0.0)
