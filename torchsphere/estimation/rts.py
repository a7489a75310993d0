"""Rauch-Tung-Striebel smoother on positions and orientations together, batched over recordings and contact intervals.

The state of a frame is pose, rate and acceleration of the five degrees of freedom (x, y, wx, wy, wz), in contact also
the two of the force (`process_model`). The pose is the difference to a reference trajectory, for the rotation a vector
in the tangent space: ``A = exp([phi]x) A_ref``. The reference goes through the measured poses, so that the differences
are as small as the errors (1e-4 rad), and one pass without a new linearisation is exact to their square.

A step is ``phi' = Ad phi + J (v dt + a dt^2 / 2 + j dt^3 / 6) - s``, with the reference's step ``s``, its rotation
``Ad`` and left Jacobian ``J``. The neglected turn of the axis within a step, ``dt^3 / 12 a x w``, is below 1e-6 rad for
a ball that is spun up to 3 deg per frame in ten frames.

Source: Rauch, Tung and Striebel, AIAA Journal 3 (1965) 1445, DOI 10.2514/3.3166; error states on SO(3) as in Sola,
Deray and Atchuthan, arXiv 1812.01537, equations 143 to 146.
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
from torchsphere.estimation.measurements import FREEDOMS, Poses
from torchsphere.estimation.motion_model import FLIGHT_SIZE, IN_PLANE, MotionModel
from torchsphere.estimation.process_model import FLIGHT_STATES, PRIOR_VARIANCE, STATES
from torchsphere.runtime.arrays import Array

#: Least eigenvalue of a scaled covariance that is not taken for rounding, share of the largest (docs/constants.toml).
MIN_EIGENVALUE = 1e-10

#: Covariances that are computed at once (docs/constants.toml).
COVARIANCES_AT_ONCE = 512


class State(NamedTuple):
    """States of one frame, of size s, under c intervals in n recordings; in units of the errors."""

    mean: Array  # (n, c, s), given all data
    covariance: Array  # (n, c, s, s), given all data
    gain: Array  # smoother gain (n, c, s, s') from the next frame's state of size s'; empty in the last frame
    residual: Array  # covariance (n, c, s, s) given the next frame's state


@dataclass(frozen=True)
class Smoothed:
    """States of n recordings given all data, over c equally likely contact intervals; px, rad and frames."""

    mean: Tensor  # pose, rate and acceleration (n, t, 3, 5)
    covariance: Tensor  # (n, t, 15, 15)
    samples: Tensor  # states (s, n, m, 3, 5) drawn from the posterior, of the frames `span`
    sample_windows: Tensor  # contact intervals (s, n, 2) of the samples
    # Accelerations x and y (s, n, m, j, 2) of the samples after each frame, less the straight line to the next frame,
    # at the shares `fractions` (j,) of the step.
    between: Tensor
    fractions: Array
    span: slice  # frames of the samples
    windows: Tensor  # intervals (n, c, 2) in frames
    unit: Tensor  # size of the errors (n, 5), px and rad


def smooth(poses: Poses, contact: Contact, samples: int, span: slice, seed: int = 0) -> Smoothed:
    """States of all frames, and samples of those in ``span``, from the poses, the intervals and the intensities.

    A frame's states under all intervals are averaged at once, so that only the filter's states need memory.
    """
    n, c, _ = contact.noise.shape
    model = MotionModel(poses, contact)
    means: list[Array] = []
    covariances: list[Array] = []
    sampler = _Sampler(samples, n, c, seed)
    first, stop, _ = span.indices(poses.times.shape[1])
    for i, state in backward(*forward(poses, contact, model), model):
        across = model.moving(i, state.covariance).swapaxes(-1, -2)
        for averages, average in zip(
            (means, covariances), _average(model.moving(i, state.mean), model.moving(i, across)), strict=True
        ):
            averages.append(average)
        if first <= i < stop:
            sampler.add(state, i, model)
    scale = poses.unit.repeat(1, FLIGHT_STATES)[:, None]
    covariance = torch.from_numpy(np.stack(covariances[::-1], 1))
    return Smoothed(
        mean=(torch.from_numpy(np.stack(means[::-1], 1)) * scale).unflatten(-1, (FLIGHT_STATES, FREEDOMS)),
        covariance=covariance * scale[..., :, None] * scale[..., None, :],
        samples=(sampler.states() * scale).unflatten(-1, (FLIGHT_STATES, FREEDOMS)),
        sample_windows=contact.windows[torch.arange(n), sampler.interval],
        between=sampler.between(poses.unit[:, :IN_PLANE]),
        fractions=model.fractions,
        span=slice(first, stop),
        windows=contact.windows,
        unit=poses.unit,
    )


def forward(poses: Poses, contact: Contact, model: MotionModel) -> tuple[list[Array], list[Array]]:
    """Kalman filter: means (n, c, s) and covariances (n, c, s, s) of every frame given all frames up to it."""
    n, c, _ = contact.noise.shape
    seen = poses.seen.swapaxes(0, 1).numpy()[:, :, None]
    both = seen[..., :, None] & seen[..., None, :]
    unit = poses.unit.numpy()[:, None]
    stated = poses.covariance.swapaxes(0, 1).numpy()[:, :, None] / unit[..., :, None] / unit[..., None, :]
    stated = np.where(both, stated, 0.0)
    missing = np.where(both, 0.0, np.eye(FREEDOMS))
    # Each of the separated errors has its own factor.
    separation = poses.separation.numpy()[:, None]
    factor = np.linalg.solve(separation, contact.noise.numpy()[..., None] * separation)

    def noise(i: int) -> Array:
        return np.asarray(np.where(both[i], factor @ stated[i] @ factor.swapaxes(-1, -2), 0.0) + missing[i])

    mean, covariance = np.zeros((n, c, FLIGHT_SIZE)), np.tile(PRIOR_VARIANCE * np.eye(FLIGHT_SIZE), (n, c, 1, 1))
    first = _updated(mean, covariance, noise(0), seen[0], both[0])
    means, covariances = [first[0]], [first[1]]
    for block in model.blocks(max(1, COVARIANCES_AT_ONCE // (n * c))):
        for i, (matrix, offset, added) in enumerate(zip(*model.steps(block), strict=True), block.start + 1):
            mean = (matrix @ means[-1][..., None])[..., 0] + offset
            covariance = matrix @ covariances[-1] @ matrix.swapaxes(-1, -2)
            covariance += added
            mean, covariance = _updated(mean, covariance, noise(i), seen[i], both[i])
            means.append(mean)
            covariances.append(covariance)
    return means, covariances


def _updated(mean: Array, covariance: Array, noise: Array, seen: Array, both: Array) -> tuple[Array, Array]:
    """Means and covariances after the poses ``seen`` (n, 1, 5), with errors of the covariance ``noise``."""
    total = torch.from_numpy(covariance[..., :FREEDOMS, :FREEDOMS] * both + noise)
    observed = covariance[..., :FREEDOMS, :] * seen[..., None]
    gain = torch.linalg.solve(total, torch.from_numpy(observed)).mT.numpy()
    # The reference goes through the measured pose: the observed difference is 0.
    mean = mean - (gain @ (mean[..., :FREEDOMS] * seen)[..., None])[..., 0]
    keep = np.tile(np.eye(covariance.shape[-1]), (*covariance.shape[:-2], 1, 1))
    keep[..., :FREEDOMS] -= gain * seen[..., None, :]
    return mean, keep @ covariance @ keep.swapaxes(-1, -2) + gain @ noise @ gain.swapaxes(-1, -2)


def backward(means: list[Array], covariances: list[Array], model: MotionModel) -> Iterator[tuple[int, State]]:
    """States given all data with their frames' numbers, from the last frame to the first; the lists become empty.

    The gains follow from the filter's covariances alone and are computed for several frames at once.
    """
    mean, covariance = means.pop(), covariances.pop()
    yield len(means), State(mean, covariance, np.empty(0), covariance)
    at_once = max(1, COVARIANCES_AT_ONCE // mean[..., 0].size)
    for block in reversed(model.blocks(at_once)):
        matrix, offset, noise = model.steps(block)
        own, known = np.stack(means[block]), np.stack(covariances[block])
        del means[block], covariances[block]
        expected = (matrix @ own[..., None])[..., 0] + offset
        moved = matrix @ known
        gain = np.ascontiguousarray(_solve(moved @ matrix.swapaxes(-1, -2) + noise, moved).swapaxes(-1, -2))
        keep = np.eye(known.shape[-1]) - gain @ matrix
        # Joseph's form: a difference of covariances would lose digits to the large prior variance.
        residual = keep @ known @ keep.swapaxes(-1, -2) + gain @ noise @ gain.swapaxes(-1, -2)
        for i in reversed(range(len(own))):
            mean = own[i] + (gain[i] @ (mean - expected[i])[..., None])[..., 0]
            covariance = gain[i] @ covariance @ gain[i].swapaxes(-1, -2)
            covariance += residual[i]
            yield block.start + i, State(mean, covariance, gain[i], residual[i])


def _solve(matrix: Array, right: Array) -> Array:
    """Solution for a symmetric positive matrix whose rows differ by many orders of magnitude."""
    size = np.sqrt(np.diagonal(matrix, axis1=-2, axis2=-1))
    scaled = torch.from_numpy(matrix / size[..., :, None] / size[..., None, :])
    known = torch.from_numpy(right / size[..., None])
    factor, failed = torch.linalg.cholesky_ex(scaled)
    solution = torch.cholesky_solve(known, factor)
    if failed.any():
        # After a contact of a frame or less, pose, rate and acceleration may be one number but for rounding.
        values, vectors = torch.linalg.eigh(scaled[failed > 0])
        values = torch.maximum(values, MIN_EIGENVALUE * values[..., -1:])
        solution[failed > 0] = vectors @ ((vectors.mT @ known[failed > 0]) / values[..., None])
    return solution.numpy() / size[..., None]


def _average(each: Array, covariance: Array) -> tuple[Array, Array]:
    """Mean (n, 15) and covariance (n, 15, 15) over the contact intervals, from those (n, c, ...) of each."""
    mean = each.mean(1)
    off = each - mean[:, None]
    return mean, (covariance.sum(1) + off.swapaxes(-1, -2) @ off) / each.shape[1]


class _Sampler:
    """Trajectories drawn from the posterior frame by frame, from the last to the first."""

    def __init__(self, count: int, n: int, c: int, seed: int) -> None:
        self._generator = torch.Generator().manual_seed(seed)
        # Index (count, n) of each sample's interval; all intervals have the same number of samples.
        self.interval = (torch.arange(count) % c)[:, None].expand(-1, n)
        self._found: list[Array] = []
        self._bulges: list[Array | None] = []
        self._off, self._later = np.empty(0), np.empty(0)
        self._shape = (-(-count // c), c)

    def add(self, state: State, frame: int, model: MotionModel) -> None:
        """Draw the states of a ``frame``, the one before the last one added."""
        covariance = state.residual if self._found else state.covariance
        known = covariance_root(torch.from_numpy(covariance)).numpy()
        noise = torch.randn((*self.interval.shape, known.shape[-1], 1), generator=self._generator, dtype=torch.float64)
        # The samples of one interval are one product: (n, c, s, each).
        each = np.zeros((math.prod(self._shape), *noise.shape[1:3]))
        each[: len(noise)] = noise[..., 0]
        off = known @ each.reshape(*self._shape, *each.shape[1:]).transpose(2, 1, 3, 0)
        if self._found:
            off += state.gain @ self._off
        states = state.mean[..., None] + off
        self._found.append(model.moving(frame, states))
        self._bulges.append(self._bulge(frame, states, model))
        self._off = off

    def _bulge(self, frame: int, states: Array, model: MotionModel) -> Array | None:
        """What `MotionModel.bulge` gives after the frame; None in flight."""
        shape = (*states.shape[:2], STATES - FLIGHT_STATES, FREEDOMS, states.shape[-1])
        own = states[:, :, FLIGHT_SIZE:]
        own = np.moveaxis(
            (own if own.size else np.zeros((*own.shape[:2], math.prod(shape[2:4]), shape[-1]))).reshape(shape), 2, 0
        )
        later, self._later = self._later, own[:, :, :, :IN_PLANE]
        if frame >= len(model.touching) or not model.touching[frame] or not later.size:
            return None
        return model.bulge(frame, self._later, later)

    def between(self, unit: Tensor) -> Tensor:
        """Bulges (count, n, m, j, 2) after all frames, the earliest first, times the ``unit`` (n, 2); 0 in flight."""
        count, n = self.interval.shape
        steps = next((bulge.shape[2] for bulge in self._bulges if bulge is not None), 0)
        # Most frames are in flight: memory of zeros costs nothing until it is written.
        found = np.zeros((math.prod(self._shape), n, len(self._found), steps, IN_PLANE))
        for i, bulge in enumerate(self._bulges[::-1]):
            if bulge is not None:
                # (n, c, j, 2, each) to (each, c, n, j, 2).
                ordered = bulge.transpose(4, 1, 0, 2, 3) * unit.numpy()[:, None]
                found[:, :, i] = ordered.reshape(-1, *ordered.shape[2:])
        return torch.from_numpy(found[:count])

    def states(self) -> Tensor:
        """Pose, rate and acceleration (count, n, m, 15) of all frames added, the earliest first."""
        count, n = self.interval.shape
        if not self._found:
            return torch.empty(count, n, 0, FLIGHT_SIZE, dtype=torch.float64)
        found = np.stack(self._found[::-1]).transpose(4, 2, 1, 0, 3)
        return torch.from_numpy(found.reshape(-1, n, len(self._found), FLIGHT_SIZE)[:count])


def covariance_root(covariance: Tensor) -> Tensor:
    """A matrix (..., d, d) that times its transpose is a covariance, which may be singular.

    A regular covariance takes Cholesky's root, which rounding changes little, so that samples are reproducible; the
    eigenvectors of equal eigenvalues turn at random.
    """
    size = covariance.diagonal(dim1=-2, dim2=-1).clamp_min(1e-300).sqrt()
    scaled = covariance / size[..., :, None] / size[..., None, :]
    factor, failed = torch.linalg.cholesky_ex(scaled)
    if failed.any():
        values, vectors = torch.linalg.eigh(scaled[failed > 0])
        factor[failed > 0] = vectors * values.clamp_min(0.0).sqrt()[..., None, :]
    return size[..., :, None] * factor
