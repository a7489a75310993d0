"""Rauch-Tung-Striebel smoother on positions and orientations together, batched over recordings and contact intervals.

The state of a frame is pose, rate and acceleration of the five degrees of freedom (x, y, wx, wy, wz), in contact also
jerk and snap. The pose is the difference to a reference trajectory, for the rotation as a vector in the tangent space:
``A = exp([phi]x) A_ref``. As the reference goes through the measured poses themselves, the differences are as small as
the errors (1e-4 rad), and one pass is exact to their square: nothing has to be linearised again.

How the state moves on from frame to frame is in `torchsphere.moves`.

Source: Rauch, Tung and Striebel, AIAA Journal 3 (1965) 1445, DOI 10.2514/3.3166; error states on SO(3) as in Sola,
Deray and Atchuthan, arXiv 1812.01537, equations 143 to 146.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import NamedTuple

import torch
from torch import Tensor

from torchsphere.contact import Contact
from torchsphere.entries import UNKNOWN
from torchsphere.moves import FLIGHT, SIZE, Moves
from torchsphere.poses import FREEDOMS, Poses
from torchsphere.process import STEADY, transitions

#: Least variance of a combination of states that is not taken for rounding, of the largest, all being of one size.
SINGULAR = 1e-10


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


class _State(NamedTuple):
    """A frame's states of all b = n c rows, in units of the errors; in contact they are larger.

    Attributes
    ----------
    mean, spread : Tensor
        (b, s) and (b, s, s), given all data.
    gain, rest : Tensor
        What the next frame's state, of the size s', says of this one (b, s, s'), and the covariance (b, s, s) that it
        leaves; of the last frame none, and its covariance.
    """

    mean: Tensor
    spread: Tensor
    gain: Tensor
    rest: Tensor


def smooth(poses: Poses, contact: Contact, draws: int, span: slice, seed: int = 0) -> Smoothed:
    """States of all frames from the measured poses, the contact intervals and the intensities.

    Of the frames ``span`` so many ``draws`` are made as well. What each interval says of a frame is kept until the
    frame before it is done: memory grows by the filter's own states alone.
    """
    n, c, _ = contact.noise.shape
    moves = Moves(poses, contact, transitions(poses.times, contact.windows), c)
    scale = poses.unit.repeat(1, STEADY)
    means, covariances = [], []
    drawn = _Draws(draws, n, c, seed)
    first, stop, _ = span.indices(poses.times.shape[1])
    for i, state in _backward(*_forward(poses, contact, moves, c), moves):
        mean, covariance = _average(state, c)
        means.append(mean * scale)
        covariances.append(covariance * scale[:, :, None] * scale[:, None])
        if first <= i < stop:
            drawn.add(state)
    return Smoothed(
        mean=torch.stack(means[::-1], 1).unflatten(-1, (STEADY, FREEDOMS)),
        covariance=torch.stack(covariances[::-1], 1),
        drawn=(drawn.states() * scale[:, None]).unflatten(-1, (STEADY, FREEDOMS)),
        drawn_windows=contact.windows[torch.arange(n), drawn.place],
        span=slice(first, stop),
        windows=contact.windows,
        unit=poses.unit,
    )


def _average(state: _State, c: int) -> tuple[Tensor, Tensor]:
    """Mean (n, 15) and covariance (n, 15, 15) of pose, rate and acceleration over the contact intervals."""
    each = state.mean[:, :FLIGHT].unflatten(0, (-1, c))
    mean = each.mean(1)
    off = each - mean[:, None]
    spread = state.spread[:, :FLIGHT, :FLIGHT].unflatten(0, (-1, c))
    return mean, (spread + off[..., :, None] * off[..., None, :]).mean(1)


class _Draws:
    """States drawn frame by frame, from the last to the first."""

    def __init__(self, count: int, n: int, c: int, seed: int) -> None:
        self._generator = torch.Generator().manual_seed(seed)
        #: Which interval each belongs to, (count, n); all take part equally often.
        self.place = (torch.arange(count) % c)[:, None].expand(-1, n)
        self._rows = torch.arange(n) * c + self.place
        self._found: list[Tensor] = []
        self._off = torch.empty(0)

    def add(self, state: _State) -> None:
        """The states of the frame before the one that was added last."""
        rows = self._rows
        # Of the frame that comes first nothing is known but what the data say.
        known = root(state.rest if self._found else state.spread)
        size = (*rows.shape, known.shape[-1], 1)
        noise = torch.randn(size, generator=self._generator, dtype=torch.float64).to(known.device)
        off = known[rows] @ noise
        if self._found:
            off = off + state.gain[rows] @ self._off
        self._found.append((state.mean[rows] + off[..., 0])[..., :FLIGHT])
        self._off = off

    def states(self) -> Tensor:
        """Pose, rate and acceleration (count, n, m, 15) of all frames added, the earliest first."""
        none = torch.empty(*self.place.shape, 0, FLIGHT, dtype=torch.float64)
        return torch.stack(self._found[::-1], 2) if self._found else none


def _forward(poses: Poses, contact: Contact, moves: Moves, c: int) -> tuple[list[Tensor], list[Tensor]]:
    """Kalman filter: means (b, s) and covariances (b, s, s) of every frame given all frames up to it."""
    unit = (poses.unit[:, None] / contact.noise).flatten(0, 1)
    noise = poses.covariance.repeat_interleave(c, 0) / unit[:, None, :, None] / unit[:, None, None, :]
    both = (poses.seen[..., :, None] & poses.seen[..., None, :]).repeat_interleave(c, 0)
    noise = torch.where(both, noise, torch.eye(FREEDOMS, dtype=noise.dtype, device=noise.device))
    seen = poses.seen.to(noise).repeat_interleave(c, 0)
    rows, t = seen.shape[:2]
    mean = torch.zeros(rows, FLIGHT, dtype=noise.dtype, device=noise.device)
    spread = UNKNOWN * torch.eye(FLIGHT, dtype=noise.dtype, device=noise.device).repeat(rows, 1, 1)
    unity = torch.eye(SIZE, dtype=noise.dtype, device=noise.device)
    means, spreads = [], []
    for i in range(t):
        if i:
            matrix, offset, added = moves.at(i - 1)
            mean = (matrix @ mean[..., None])[..., 0] + offset
            spread = matrix @ spread @ matrix.mT + added
        size = mean.shape[-1]
        observed = unity[:FREEDOMS, :size] * seen[:, i, :, None]
        total = observed @ spread @ observed.mT + noise[:, i]
        gain = torch.linalg.solve(total, observed @ spread).mT
        # The reference goes through the measured pose: what was observed of the difference is 0.
        mean = mean - (gain @ (observed @ mean[..., None]))[..., 0]
        keep = unity[:size, :size] - gain @ observed
        spread = keep @ spread @ keep.mT + gain @ noise[:, i] @ gain.mT
        means.append(mean)
        spreads.append(spread)
    return means, spreads


def _backward(means: list[Tensor], spreads: list[Tensor], moves: Moves) -> Iterator[tuple[int, _State]]:
    """States given all data with their frames' numbers, from the last frame to the first; the lists become empty."""
    mean, spread = means.pop(), spreads.pop()
    yield len(means), _State(mean, spread, torch.empty(0), spread)
    unity = torch.eye(SIZE, dtype=mean.dtype, device=mean.device)
    while means:
        own, known = means.pop(), spreads.pop()
        matrix, offset, added = moves.at(len(means))
        expected = (matrix @ own[..., None])[..., 0] + offset
        ahead = matrix @ known @ matrix.mT + added
        gain = _solve(ahead, matrix @ known).mT
        keep = unity[: gain.shape[1], : gain.shape[1]] - gain @ matrix
        # A sum of squares: a difference of covariances would lose what the unknown start makes large.
        rest = keep @ known @ keep.mT + gain @ added @ gain.mT
        mean = own + (gain @ (mean - expected)[..., None])[..., 0]
        spread = rest + gain @ spread @ gain.mT
        yield len(means), _State(mean, spread, gain, rest)


def _solve(matrix: Tensor, right: Tensor) -> Tensor:
    """Solution for a symmetric positive matrix whose rows differ by many orders of magnitude."""
    size = matrix.diagonal(dim1=-2, dim2=-1).sqrt()
    even = matrix / size[..., :, None] / size[..., None, :]
    factor, failed = torch.linalg.cholesky_ex(even)
    solution = torch.cholesky_solve(right / size[..., None], factor)
    if failed.any():
        # Behind a contact of a frame or less pose, rate and acceleration may be one number, but for rounding.
        values, vectors = torch.linalg.eigh(even[failed > 0])
        values = torch.maximum(values, SINGULAR * values[..., -1:])
        solution[failed > 0] = vectors @ ((vectors.mT @ (right / size[..., None])[failed > 0]) / values[..., None])
    return solution / size[..., None]


def root(covariance: Tensor) -> Tensor:
    """Symmetric square root (..., d, d) of a covariance that may be singular."""
    size = covariance.diagonal(dim1=-2, dim2=-1).clamp_min(1e-300).sqrt()
    values, vectors = torch.linalg.eigh(covariance / size[..., :, None] / size[..., None, :])
    return size[..., :, None] * (vectors * values.clamp_min(0.0).sqrt()[..., None, :])
