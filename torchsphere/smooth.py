"""Rauch-Tung-Striebel smoother on positions and orientations together, batched over recordings and contact intervals.

The state of a frame is pose, rate and acceleration of the five degrees of freedom (x, y, wx, wy, wz), in contact also
jerk and snap. The pose is the difference to a reference trajectory, for the rotation as a vector in the tangent space:
``A = exp([phi]x) A_ref``. As the reference goes through the measured poses themselves, the differences are as small as
the errors (1e-4 rad), and one pass is exact to their square: nothing has to be linearised again.

From frame to frame ``phi' = Ad phi + J (v dt + a dt^2 / 2 + j dt^3 / 6) - s``, with the reference's step ``s``, its
rotation ``Ad`` and left Jacobian ``J``. What the turning of the axis within a step adds, ``dt^3/12 a x w``, is below
1e-6 rad for a ball that is spun up to 3 deg per frame in ten frames.

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
from torchsphere.likelihood import UNKNOWN, Series
from torchsphere.process import ABSENT, STATES, STEADY, Transitions, transitions

#: Degrees of freedom (x, y, wx, wy, wz), and numbers in the state of a flight and of a contact.
FREEDOMS = 5
FLIGHT, SIZE = STEADY * FREEDOMS, STATES * FREEDOMS


@dataclass(frozen=True)
class Poses:
    """Measured poses of n recordings of t frames; a shorter recording ends in frames that were not seen.

    Attributes
    ----------
    times : Tensor
        (n, t), frames, rising.
    step : Tensor
        Of the reference from each frame to the next (n, t - 1, 5): px and rad.
    covariance : Tensor
        Of the error of each frame's pose (n, t, 5, 5).
    drift : Tensor
        Variance (n, t - 1, 5) of the errors of the steps that stay in all later poses.
    seen : Tensor
        (n, t, 5), True where the pose was measured.
    """

    times: Tensor
    step: Tensor
    covariance: Tensor
    drift: Tensor
    seen: Tensor

    @property
    def unit(self) -> Tensor:
        """Size (n, 5) of the errors: px, the same for both, and rad, the same for all three."""
        variance = torch.where(self.seen, self.covariance.diagonal(dim1=-2, dim2=-1), torch.nan)
        shared = [variance[..., part].flatten(1).nanmedian(1).values for part in (slice(0, 2), slice(2, 5))]
        px, rad = (torch.where(v > 0, v, 1.0).sqrt() for v in shared)
        return torch.stack((px, px, rad, rad, rad), -1)

    def series(self) -> Series:
        """The same as independent degrees of freedom, in units of the errors and without their mean motion.

        Rotations add up like vectors here, which is right for a search of when they change.
        """
        unit = self.unit[:, None]
        step = self.step / unit
        rate = step / self.times.diff(dim=-1)[..., None]
        step = step - rate.median(1, keepdim=True).values * self.times.diff(dim=-1)[..., None]
        value = torch.cat((torch.zeros_like(step[:, :1]), step.cumsum(1)), 1)
        variance = self.covariance.diagonal(dim1=-2, dim2=-1) / unit**2
        columns = (value, variance, self.drift / unit**2, self.seen)
        value, variance, drift, seen = (v.mT for v in columns)
        return Series(self.times, value, torch.where(seen, variance, 1.0), drift, seen)


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
    moves = _Moves(poses, contact, transitions(poses.times, contact.windows), c)
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


class _Moves:
    """Matrix, offset and covariance of the transition from frame i to the next, of all n c rows.

    Where none of the rows is in contact the states have no jerk and snap: most frames cost a fifth.
    """

    def __init__(self, poses: Poses, contact: Contact, moves: Transitions, c: int) -> None:
        self._step = (poses.step / poses.unit[:, None]).repeat_interleave(c, 0)
        self._turn, self._jacobian = (v.repeat_interleave(c, 0) for v in _turning(poses.step[..., 2:]))
        self._moves, self._c = moves, c
        intensity = (contact.noise**2 * contact.contact).flatten(0, 1)
        smooth = contact.smooth.flatten(0, 1)
        self._rough = torch.where(smooth, 0.0, intensity)
        self._smooth = torch.where(smooth, intensity, ABSENT)
        self._flight = (contact.noise**2 * contact.flight).flatten(0, 1)
        self._drift = (poses.drift / poses.unit[:, None] ** 2).repeat_interleave(c, 0)
        #: Kinds of state that each frame has: its own if the transition to it touches.
        self._kinds = [STEADY, *(STATES if touching else STEADY for touching in moves.touching)]

    def at(self, i: int) -> tuple[Tensor, Tensor, Tensor]:
        """Matrix (b, s', s), offset (b, s'), covariance (b, s', s'), with s and s' the sizes of both states."""
        before, after = self._kinds[i : i + 2]
        block = self._moves.matrix[:, :, i, :after, :before].flatten(0, 1)
        flight = self._moves.flight[:, :, i, :after, :after].expand(-1, self._c, -1, -1).flatten(0, 1)
        whole, added = _spread_out(block, torch.ones_like(self._flight)), _spread_out(flight, self._flight)
        if after > STEADY:
            for kind, intensity in ((self._moves.rough, self._rough), (self._moves.smooth, self._smooth)):
                added = added + _spread_out(kind[:, :, i].flatten(0, 1), intensity)
        # The rotation's step is that of a vector, seen from the tangent space at its end.
        along = torch.eye(after * FREEDOMS, dtype=whole.dtype, device=whole.device).repeat(len(whole), 1, 1)
        along[:, 2:FREEDOMS, 2:FREEDOMS] = self._jacobian[:, i]
        whole, added = along @ whole, along @ added @ along.mT
        whole[:, 2:FREEDOMS, 2:FREEDOMS] = self._turn[:, i]
        added[:, :FREEDOMS, :FREEDOMS] += torch.diag_embed(self._drift[:, i])
        later = torch.arange(FLIGHT, after * FREEDOMS)
        added[:, later, later] += self._moves.idle[:, :, i].flatten(0, 1)[:, None].to(whole)
        offset = torch.zeros(len(whole), after * FREEDOMS, dtype=whole.dtype, device=whole.device)
        offset[:, :FREEDOMS] = -self._step[:, i]
        return whole, offset, added


def _forward(poses: Poses, contact: Contact, moves: _Moves, c: int) -> tuple[list[Tensor], list[Tensor]]:
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


def _backward(means: list[Tensor], spreads: list[Tensor], moves: _Moves) -> Iterator[tuple[int, _State]]:
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
    factor = torch.linalg.cholesky(matrix / size[..., :, None] / size[..., None, :])
    return torch.cholesky_solve(right / size[..., None], factor) / size[..., None]


def root(covariance: Tensor) -> Tensor:
    """Symmetric square root (..., d, d) of a covariance that may be singular."""
    size = covariance.diagonal(dim1=-2, dim2=-1).clamp_min(1e-300).sqrt()
    values, vectors = torch.linalg.eigh(covariance / size[..., :, None] / size[..., None, :])
    return size[..., :, None] * (vectors * values.clamp_min(0.0).sqrt()[..., None, :])


def _spread_out(block: Tensor, factor: Tensor) -> Tensor:
    """Kronecker product (b, 5 r, 5 s) of (b, r, s) and the diagonal (b, 5)."""
    product = block[:, :, None, :, None] * torch.diag_embed(factor)[:, None, :, None, :]
    return product.flatten(3, 4).flatten(1, 2)


def _turning(step: Tensor) -> tuple[Tensor, Tensor]:
    """Rotation and left Jacobian (..., 3, 3) of rotation vectors (..., 3), rad."""
    x, y, z = step.unbind(-1)
    none = torch.zeros_like(x)
    cross = torch.stack((none, -z, y, z, none, -x, -y, x, none), -1).unflatten(-1, (3, 3))
    angle = step.norm(dim=-1)[..., None, None]
    one = torch.eye(3, dtype=step.dtype, device=step.device)
    half = torch.sinc(angle / (2 * torch.pi)) ** 2 / 2
    # (t - sin t) / t^3, which loses its digits at small angles; there the series' next term is below 1e-9.
    third = torch.where(angle > 1e-2, (angle - angle.sin()) / angle.clamp_min(1e-2) ** 3, (1 - angle**2 / 20) / 6)
    return torch.linalg.matrix_exp(cross), one + half * cross + third * cross @ cross
