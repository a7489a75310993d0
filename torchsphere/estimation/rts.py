"""Rauch-Tung-Striebel smoother on positions and orientations together, batched over recordings and contact intervals.

The state of a frame is pose, rate and acceleration of the five degrees of freedom (x, y, wx, wy, wz), in contact also
jerk and snap. The pose is the difference to a reference trajectory, for the rotation as a vector in the tangent space:
``A = exp([phi]x) A_ref``. As the reference goes through the measured poses themselves, the differences are as small as
the errors (1e-4 rad), and one pass is exact to their square: nothing has to be linearised again.

How the state moves on from frame to frame is in `torchsphere.estimation.transitions`, the passes over all frames in
`torchsphere.estimation.passes`.

Source: Rauch, Tung and Striebel, AIAA Journal 3 (1965) 1445, DOI 10.2514/3.3166; error states on SO(3) as in Sola,
Deray and Atchuthan, arXiv 1812.01537, equations 143 to 146.

The two passes of the Rauch-Tung-Striebel smoother (see `torchsphere.estimation.rts`), forward and backward.

Forward each frame waits for the one before. Backward, what a frame says of the one before follows from the filter's
covariances alone: it is computed for some frames at once, and two products of matrices per frame are left.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import torch
from torch import Tensor

from torchsphere.estimation.contact_search import Contact
from torchsphere.estimation.filter_bank import UNKNOWN, Array
from torchsphere.estimation.measurements import FREEDOMS, Poses
from torchsphere.estimation.process_model import STEADY
from torchsphere.estimation.transitions import FLIGHT, Moves

#: Least variance of a combination of states that is not taken for rounding, of the largest, all being of one size.
SINGULAR = 1e-10

#: Covariances that are worked on at once: as many as stay near the processor.
AT_ONCE = 512


class State(NamedTuple):
    """A frame's states under c intervals in n recordings, in units of the errors; in contact they are larger.

    Attributes
    ----------
    mean, spread : ndarray
        (n, c, s) and (n, c, s, s), given all data.
    gain, rest : ndarray
        What the next frame's state, of the size s', says of this one (n, c, s, s'), and the covariance (n, c, s, s)
        that it leaves; of the last frame none, and its covariance.
    """

    mean: Array
    spread: Array
    gain: Array
    rest: Array


def forward(poses: Poses, contact: Contact, moves: Moves) -> tuple[list[Array], list[Array]]:
    """Kalman filter: means (n, c, s) and covariances (n, c, s, s) of every frame given all frames up to it."""
    n, c, _ = contact.noise.shape
    seen = poses.seen.swapaxes(0, 1).numpy()[:, :, None]
    both = seen[..., :, None] & seen[..., None, :]
    unit = poses.unit.numpy()[:, None]
    stated = poses.covariance.swapaxes(0, 1).numpy()[:, :, None] / unit[..., :, None] / unit[..., None, :]
    stated = np.where(both, stated, 0.0)
    missing = np.where(both, 0.0, np.eye(FREEDOMS))
    # Each of the separate errors has a factor of its own.
    separate = poses.separation.numpy()[:, None]
    factor = np.linalg.solve(separate, contact.noise.numpy()[..., None] * separate)

    def noise(i: int) -> Array:
        return np.asarray(np.where(both[i], factor @ stated[i] @ factor.swapaxes(-1, -2), 0.0) + missing[i])

    mean, spread = np.zeros((n, c, FLIGHT)), np.tile(UNKNOWN * np.eye(FLIGHT), (n, c, 1, 1))
    first = _updated(mean, spread, noise(0), seen[0], both[0])
    means, spreads = [first[0]], [first[1]]
    for part in moves.alike(max(1, AT_ONCE // (n * c))):
        for i, (matrix, offset, added) in enumerate(zip(*moves.at(part), strict=True), part.start + 1):
            mean = (matrix @ means[-1][..., None])[..., 0] + offset
            spread = matrix @ spreads[-1] @ matrix.swapaxes(-1, -2)
            spread += added
            mean, spread = _updated(mean, spread, noise(i), seen[i], both[i])
            means.append(mean)
            spreads.append(spread)
    return means, spreads


def _updated(mean: Array, spread: Array, noise: Array, seen: Array, both: Array) -> tuple[Array, Array]:
    """Means and covariances with what was ``seen`` (n, 1, 5) of the poses, with errors of covariance ``noise``."""
    total = torch.from_numpy(spread[..., :FREEDOMS, :FREEDOMS] * both + noise)
    observed = spread[..., :FREEDOMS, :] * seen[..., None]
    gain = torch.linalg.solve(total, torch.from_numpy(observed)).mT.numpy()
    # The reference goes through the measured pose: what was observed of the difference is 0.
    mean = mean - (gain @ (mean[..., :FREEDOMS] * seen)[..., None])[..., 0]
    keep = np.tile(np.eye(spread.shape[-1]), (*spread.shape[:-2], 1, 1))
    keep[..., :FREEDOMS] -= gain * seen[..., None, :]
    return mean, keep @ spread @ keep.swapaxes(-1, -2) + gain @ noise @ gain.swapaxes(-1, -2)


def backward(means: list[Array], spreads: list[Array], moves: Moves) -> Iterator[tuple[int, State]]:
    """States given all data with their frames' numbers, from the last frame to the first; the lists become empty."""
    mean, spread = means.pop(), spreads.pop()
    yield len(means), State(mean, spread, np.empty(0), spread)
    at_once = max(1, AT_ONCE // mean[..., 0].size)
    for part in reversed(moves.alike(at_once)):
        matrix, offset, added = moves.at(part)
        own, known = np.stack(means[part]), np.stack(spreads[part])
        del means[part], spreads[part]
        expected = (matrix @ own[..., None])[..., 0] + offset
        along = matrix @ known
        gain = np.ascontiguousarray(_solve(along @ matrix.swapaxes(-1, -2) + added, along).swapaxes(-1, -2))
        keep = np.eye(known.shape[-1]) - gain @ matrix
        # A sum of squares: a difference of covariances would lose what the unknown start makes large.
        rest = keep @ known @ keep.swapaxes(-1, -2) + gain @ added @ gain.swapaxes(-1, -2)
        for i in reversed(range(len(own))):
            mean = own[i] + (gain[i] @ (mean - expected[i])[..., None])[..., 0]
            spread = gain[i] @ spread @ gain[i].swapaxes(-1, -2)
            spread += rest[i]
            yield part.start + i, State(mean, spread, gain[i], rest[i])


def _solve(matrix: Array, right: Array) -> Array:
    """Solution for a symmetric positive matrix whose rows differ by many orders of magnitude."""
    size = np.sqrt(np.diagonal(matrix, axis1=-2, axis2=-1))
    even = torch.from_numpy(matrix / size[..., :, None] / size[..., None, :])
    known = torch.from_numpy(right / size[..., None])
    factor, failed = torch.linalg.cholesky_ex(even)
    solution = torch.cholesky_solve(known, factor)
    if failed.any():
        # Behind a contact of a frame or less pose, rate and acceleration may be one number, but for rounding.
        values, vectors = torch.linalg.eigh(even[failed > 0])
        values = torch.maximum(values, SINGULAR * values[..., -1:])
        solution[failed > 0] = vectors @ ((vectors.mT @ known[failed > 0]) / values[..., None])
    return solution.numpy() / size[..., None]


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
