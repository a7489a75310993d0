"""Rauch-Tung-Striebel smoother on positions and orientations together, batched over recordings and contact intervals.

The state of a frame is pose, rate and acceleration of the five degrees of freedom (x, y, wx, wy, wz), in contact also
jerk and snap. The pose is the difference to a reference trajectory, for the rotation as a vector in the tangent space:
``A = exp([phi]x) A_ref``. As the reference goes through the measured poses themselves, the differences are as small as
the errors (1e-4 rad), and one pass is exact to their square: nothing has to be linearised again.

How the state moves on from frame to frame is in `torchsphere.estimation.transitions`, the passes over all frames in
`torchsphere.estimation.passes`.

Source: Rauch, Tung and Striebel, AIAA Journal 3 (1965) 1445, DOI 10.2514/3.3166; error states on SO(3) as in Sola,
Deray and Atchuthan, arXiv 1812.01537, equations 143 to 146.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
import torch
from torch import Tensor

from torchsphere.estimation.contact_search import Contact
from torchsphere.estimation.entries import Array
from torchsphere.estimation.measurements import FREEDOMS, Poses
from torchsphere.estimation.passes import State, backward, forward
from torchsphere.estimation.process_model import STEADY
from torchsphere.estimation.transitions import FLIGHT, Moves


@dataclass(frozen=True)
class Smoothed:
    """States of n recordings given all data, over c equally likely contact intervals; px, rad and frames.

    Attributes
    ----------
    mean, covariance : Tensor
        (n, t, 3, 5) and (n, t, 15, 15): pose, rate, acceleration of the five degrees of freedom each.
    drawn : Tensor
        States (s, n, m, 3, 5) as likely as the data leave them, of the frames `span`.
    drawn_windows : Tensor
        The contact intervals (s, n, 2) that they belong to.
    span : slice
        Frames that were drawn.
    windows : Tensor
        Intervals (n, c, 2) in frames.
    unit : Tensor
        (n, 5), px and rad.
    """

    mean: Tensor
    covariance: Tensor
    drawn: Tensor
    drawn_windows: Tensor
    span: slice
    windows: Tensor
    unit: Tensor


def smooth(poses: Poses, contact: Contact, draws: int, span: slice, seed: int = 0) -> Smoothed:
    """States of all frames from the measured poses, the contact intervals and the intensities.

    Of the frames ``span`` so many ``draws`` are made as well. What each interval says of a frame is kept until the
    frame before it is done: memory grows by the filter's own states alone.
    """
    n, c, _ = contact.noise.shape
    moves = Moves(poses, contact)
    means, covariances = [], []
    drawn = _Draws(draws, n, c, seed)
    first, stop, _ = span.indices(poses.times.shape[1])
    for i, state in backward(*forward(poses, contact, moves), moves):
        mean, covariance = _average(state)
        means.append(mean)
        covariances.append(covariance)
        if first <= i < stop:
            drawn.add(state)
    scale = poses.unit.repeat(1, STEADY)[:, None]
    spread = torch.from_numpy(np.stack(covariances[::-1], 1))
    return Smoothed(
        mean=(torch.from_numpy(np.stack(means[::-1], 1)) * scale).unflatten(-1, (STEADY, FREEDOMS)),
        covariance=spread * scale[..., :, None] * scale[..., None, :],
        drawn=(drawn.states() * scale).unflatten(-1, (STEADY, FREEDOMS)),
        drawn_windows=contact.windows[torch.arange(n), drawn.place],
        span=slice(first, stop),
        windows=contact.windows,
        unit=poses.unit,
    )


def _average(state: State) -> tuple[Array, Array]:
    """Mean (n, 15) and covariance (n, 15, 15) of pose, rate and acceleration over the contact intervals."""
    each = state.mean[..., :FLIGHT]
    mean = each.mean(1)
    off = each - mean[:, None]
    spread = state.spread[..., :FLIGHT, :FLIGHT].sum(1)
    return mean, (spread + off.swapaxes(-1, -2) @ off) / each.shape[1]


class _Draws:
    """States drawn frame by frame, from the last to the first."""

    def __init__(self, count: int, n: int, c: int, seed: int) -> None:
        self._generator = torch.Generator().manual_seed(seed)
        #: Which interval each belongs to, (count, n); all take part equally often.
        self.place = (torch.arange(count) % c)[:, None].expand(-1, n)
        self._found: list[Array] = []
        self._off = np.empty(0)
        self._shape = (-(-count // c), c)

    def add(self, state: State) -> None:
        """The states of the frame before the one that was added last."""
        # Of the frame that comes first nothing is known but what the data say.
        known = root(torch.from_numpy(state.rest if self._found else state.spread)).numpy()
        noise = torch.randn((*self.place.shape, known.shape[-1], 1), generator=self._generator, dtype=torch.float64)
        # All of one interval are one product: (n, c, s, each).
        each = np.zeros((math.prod(self._shape), *noise.shape[1:3]))
        each[: len(noise)] = noise[..., 0]
        off = known @ each.reshape(*self._shape, *each.shape[1:]).transpose(2, 1, 3, 0)
        if self._found:
            off += state.gain @ self._off
        self._found.append((state.mean[..., None] + off)[..., :FLIGHT, :])
        self._off = off

    def states(self) -> Tensor:
        """Pose, rate and acceleration (count, n, m, 15) of all frames added, the earliest first."""
        count, n = self.place.shape
        if not self._found:
            return torch.empty(count, n, 0, FLIGHT, dtype=torch.float64)
        found = np.stack(self._found[::-1]).transpose(4, 2, 1, 0, 3)
        return torch.from_numpy(found.reshape(-1, n, len(self._found), FLIGHT)[:count])


def root(covariance: Tensor) -> Tensor:
    """A matrix (..., d, d) that times its transpose is a covariance that may be singular.

    Where it is not, by Cholesky: as the covariance changes by rounding so does this root, and motions drawn are the
    same again. Eigenvectors of errors of the same size turn at random, so that 400 motions were others each time.
    """
    size = covariance.diagonal(dim1=-2, dim2=-1).clamp_min(1e-300).sqrt()
    even = covariance / size[..., :, None] / size[..., None, :]
    factor, failed = torch.linalg.cholesky_ex(even)
    if failed.any():
        values, vectors = torch.linalg.eigh(even[failed > 0])
        factor[failed > 0] = vectors * values.clamp_min(0.0).sqrt()[..., None, :]
    return size[..., :, None] * factor
