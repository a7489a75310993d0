"""Covariances of the steps between frames on a map: the noise that the map has taken up is given back."""

from __future__ import annotations

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from torchsphere.runtime.arrays import Array
from torchsphere.sphere_map.elimination import GEOMETRY, PER_IMAGE
from torchsphere.sphere_map.level import Adjustment
from torchsphere.sphere_map.registration import Registration


def without_leverage(misfit: Tensor, numbers: NDArray[np.int64], of_map: NDArray[np.int64], leverage: Tensor) -> Tensor:
    """The ``misfit`` (k,) of the frames ``numbers`` (k,) as if none of them had made the map.

    A map takes up a share h of the noise of the frames that make it, the ``leverage`` (m,) of the frames ``of_map``
    (m,): it leaves 1 - h of their noise in the residual. For any other frame the map adds h. For a frame that made the
    map it adds h - h^2, as its own share in the map does not move its pose.
    """
    of_frame = dict(zip(of_map.tolist(), leverage.tolist(), strict=True))
    share = torch.tensor([of_frame.get(number, 0.0) for number in numbers.tolist()]).to(misfit)
    return misfit / (1 - share) * (1 + share - share.square())


def step_covariances(
    n: int, numbers: NDArray[np.int64], found: Registration, keys: list[int], adjustment: Adjustment
) -> Array:
    """Covariance (n - 1, 6, 6) of the steps between frames that are both on the map; NaN elsewhere.

    Of the motion, px and rad, and of the relative growth of the outline.

    Between keyframes, the covariance is that of the adjustment. Elsewhere it is the noise of both images, scaled by
    `Registration.misfit`: the residual also holds the map's error at the frame's pixels, which cancels little in a
    step.
    """
    radius = np.full(n, np.nan)
    radius[numbers] = found.poses.radii(adjustment.state.ball.radius).cpu().numpy()
    units = np.column_stack((np.ones((n, 2)), *4 * [1 / radius]))[:-1]
    own = np.full((n, GEOMETRY, GEOMETRY), np.nan)
    own[numbers] = (found.misfit[:, None, None] * found.covariance).cpu().numpy()
    covariance = own[:-1] + own[1:]
    if adjustment.state.ball.stays:
        # Keyframes share their place: how far each may be beside it, its own image tells.
        return covariance * units[:, :, None] * units[:, None, :]
    whole = adjustment.covariance.cpu().numpy()
    for k in range(len(keys) - 1):
        if keys[k + 1] == keys[k] + 1:
            covariance[keys[k]] = _difference_covariance(whole, k, k + 1)
    return covariance * units[:, :, None] * units[:, None, :]


def _difference_covariance(covariance: Array, a: int, b: int) -> Array:
    """Covariance (6, 6) of the step from pose number ``a`` to number ``b``, from that of all poses."""
    first, second = (slice(PER_IMAGE * k, PER_IMAGE * k + GEOMETRY) for k in (a, b))
    shared = covariance[first, second]
    return covariance[first, first] + covariance[second, second] - shared - shared.T
