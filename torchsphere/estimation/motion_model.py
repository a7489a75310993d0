"""Motion between frames under contact intervals: transitions of the smoother's states, and the force between frames.

The states are those of `rts`. Where no recording is in contact a degree of freedom has three of them instead of five.
"""

from __future__ import annotations

import itertools
from typing import Any, NamedTuple

import numpy as np
import torch
from torch import Tensor

from torchsphere.estimation import force_forms
from torchsphere.estimation.contact_search import Contact
from torchsphere.estimation.measurements import FREEDOMS, Poses
from torchsphere.estimation.process_model import FLIGHT_STATES, STATES, flight_matrix, overlaps, transitions
from torchsphere.estimation.process_noise import contact_intensities, flight_noise, with_idle
from torchsphere.runtime.arrays import Array

#: Size of the state in flight, and of the part of each state that is reported.
FLIGHT_SIZE = FLIGHT_STATES * FREEDOMS

#: Degrees of freedom in the image plane.
IN_PLANE = 2

#: Points in the shortest contact at which the force is read off, and most of them in a frame (docs/constants.toml).
POINTS_IN_CONTACT, MAX_SUBSTEPS = 2400, 32


class Steps(NamedTuple):
    """Transitions of f frames with states of size s to the next frames with states of size s'."""

    matrix: Array  # (f, n, c, s', s), in flight (f, n, 1, s', s)
    offset: Array  # (f, n, 1, s')
    noise: Array  # covariance (f, n, c, s', s')


class MotionModel:
    """Transitions of the states of n recordings, under c contact intervals each.

    Where no recording is in contact there are three states instead of five, so that most frames cost a fifth.
    """

    def __init__(self, poses: Poses, contact: Contact) -> None:
        step, unit = poses.step.swapaxes(0, 1), poses.unit
        turn, jacobian = _turning(step[..., 2:])
        self._turn = turn.numpy()[:, :, None]
        # The step of the rotation is a vector, here in the tangent space at its end.
        self._jacobian = np.tile(np.eye(FREEDOMS), (*step.shape[:2], 1, 1, 1))
        self._jacobian[..., 2:, 2:] = jacobian.numpy()[:, :, None]
        self._step = (step / unit).numpy()[:, :, None]
        self._drift = (poses.drift.swapaxes(0, 1) / unit[:, :, None] / unit[:, None]).numpy()[:, :, None]
        flight, in_contact = ((contact.noise**2 * v).numpy() for v in (contact.flight, contact.contact))
        self._intensities = [flight, *contact_intensities(in_contact, contact.formed.numpy())]
        self._duration = poses.times.diff(dim=-1).T[:, :, None].numpy()
        times, windows = poses.times.numpy(), contact.windows.numpy()
        touching = np.asarray(overlaps(times, windows).any((0, 1)))
        touched = np.flatnonzero(touching).tolist() or [0]
        self._first = touched[0]
        times = times[:, touched[0] : touched[-1] + 2]
        self._rough, self._formed = (transitions(times, windows, v) for v in (None, contact.forms.numpy()))
        self._is_formed = contact.formed.numpy()  # (n, c, 5)
        self.touching = [bool(is_touching) for is_touching in touching]
        # States of a degree of freedom in each frame.
        self._states = [FLIGHT_STATES, *(STATES if is_touching else FLIGHT_STATES for is_touching in self.touching)]
        # (t, n, c, 5), what the height of a force adds to the acceleration.
        self._envelope = np.moveaxis(self._formed.envelope, 2, 0)[..., None] * self._is_formed
        self.fractions, self._between = self._between_frames(times, contact)
        # (t, n, c)
        self._is_inside = np.moveaxis((times[:, None] > windows[..., :1]) & (times[:, None] < windows[..., 1:]), 2, 0)

    def _between_frames(self, times: Array, contact: Contact) -> tuple[Array, Array]:
        """Shares (j,) of a step at which a force is read off, and the envelopes (t - 1, n, c, j) there."""
        windows, forms = contact.windows.numpy(), contact.forms.numpy()
        length = windows[..., 1] - windows[..., 0]
        shortest = length[length > 0].min(initial=np.inf)
        count = int(np.clip(np.ceil(POINTS_IN_CONTACT / shortest), 2, MAX_SUBSTEPS))
        fractions = np.arange(1, count) / count
        moments = times[:, :-1, None] + np.diff(times)[..., None] * fractions
        passed = (moments[:, None] - windows[..., :1, None]) / np.where(length > 0, length, np.inf)[..., None, None]
        envelope = force_forms.envelope(passed.reshape(*length.shape, -1), forms).reshape(passed.shape)
        return fractions, np.moveaxis(np.where(length[..., None, None] > 0, envelope, 0.0), 2, 0)

    def bulge(self, frame: int, own: Array, later: Array) -> Array:
        """Accelerations x and y (n, c, j, 2, s) between a frame and the next, less the straight line.

        ``own`` (2, n, c, 2, s) are heights of the forces x and y in the frame and their rates, ``later`` those in the
        next frame, each of which may lie outside the contact.
        """
        at = frame - self._first
        inside, is_next_inside = (self._is_inside[i][..., None, None] for i in (at, at + 1))
        step = self._duration[frame][..., None, None]
        first = np.where(inside, own[0], later[0] - step * later[1])[:, :, None]
        last = np.where(is_next_inside, later[0], own[0] + step * own[1])[:, :, None]
        rises = [
            (step * np.where(i, rate, other))[:, :, None]
            for i, rate, other in ((inside, own[1], later[1]), (is_next_inside, later[1], own[1]))
        ]
        share = self.fractions[:, None, None]
        # The mean of a rate of white noise between two states is Hermite's cubic.
        cubic = share**2 * (3 - 2 * share)
        bend = share * (1 - share) * ((1 - share) * rises[0] - share * rises[1])
        height = (1 - cubic) * first + cubic * last + bend
        before, after = (self._envelope[i][:, :, None, :IN_PLANE, None] for i in (at, at + 1))
        bulge = self._between[at][..., None, None] * height - (1 - share) * before * first - share * after * last
        formed = self._is_formed[:, :, None, :IN_PLANE, None] & (inside | is_next_inside)[:, :, None]
        return np.asarray(np.where(formed, bulge, 0.0))

    def moving(self, frame: int, states: Array) -> Array:
        """Pose, rate and acceleration (n, c, 15, ...) of the ``states`` (n, c, s, ...) of a frame, with the force."""
        if states.shape[2] == FLIGHT_SIZE:
            return states
        moving = states[:, :, :FLIGHT_SIZE].copy()
        envelope = self._envelope[frame - self._first]
        envelope = envelope.reshape(*envelope.shape, *[1] * (states.ndim - 3))
        moving[:, :, 2 * FREEDOMS :] += envelope * states[:, :, FLIGHT_SIZE : FLIGHT_SIZE + FREEDOMS]
        return moving

    def blocks(self, at_once: int) -> list[slice]:
        """Up to so many successive transitions at once, between states of the same sizes."""
        pairs = enumerate(itertools.pairwise(self._states))
        found = []
        for _, group in itertools.groupby(pairs, key=lambda pair: (pair[1], self.touching[pair[0]])):
            numbers = [i for i, _ in group]
            found += [slice(i, min(i + at_once, numbers[-1] + 1)) for i in numbers[::at_once]]
        return found

    def steps(self, block: slice) -> Steps:
        """Transitions from the frames of one of the `blocks`."""
        before, after = self._states[block.start : block.start + 2]
        jacobian, duration = self._jacobian[block], self._duration[block]
        if self.touching[block.start]:
            own = slice(block.start - self._first, block.stop - self._first)
            matrices = [_frames(v.matrix, own)[..., :after, :before] for v in (self._rough, self._formed)]
            covariances = (self._rough.flight, self._rough.contact, self._formed.contact)
            noises, idle = [_frames(v, own) for v in covariances], _frames(self._rough.idle, own)
        else:
            matrices = [flight_matrix(duration)[..., :after, :before]]
            noises, idle = [flight_noise(duration)], np.array(True)
        shape = matrices[0].shape
        matrix = np.zeros((*shape[:-2], after, FREEDOMS, before, FREEDOMS))
        noise = np.zeros((*shape[:2], *self._intensities[0].shape[1:2], after, FREEDOMS, after, FREEDOMS))
        for k in range(FREEDOMS):
            is_formed = self._is_formed[..., k, None, None]
            matrix[..., k, :, k] = matrices[0] if len(matrices) == 1 else np.where(is_formed, *matrices[::-1])
            for unit_noise, intensity in zip(noises, self._intensities, strict=False):
                noise[..., k, :, k] += unit_noise[..., :after, :after] * intensity[..., k, None, None]
        matrix = matrix.reshape(*shape[:-2], after * FREEDOMS, before * FREEDOMS)
        noise = noise.reshape(*noise.shape[:-4], after * FREEDOMS, after * FREEDOMS)
        matrix[..., :FREEDOMS, :] = jacobian @ matrix[..., :FREEDOMS, :]
        noise[..., :FREEDOMS, :] = jacobian @ noise[..., :FREEDOMS, :]
        noise[..., :FREEDOMS] = noise[..., :FREEDOMS] @ jacobian.swapaxes(-1, -2)
        matrix[..., 2:FREEDOMS, 2:FREEDOMS] = self._turn[block]
        noise[..., :FREEDOMS, :FREEDOMS] += self._drift[block]
        offset = np.zeros((*jacobian.shape[:3], after * FREEDOMS))
        offset[..., :FREEDOMS] = -self._step[block]
        return Steps(matrix, offset, with_idle(noise, FLIGHT_SIZE, idle))


def _frames(values: Any, part: slice) -> Any:
    """Some frames (f, n, c, ...) of values (n, c, t, ...)."""
    return np.moveaxis(values[:, :, part], 2, 0)


def _turning(step: Tensor) -> tuple[Tensor, Tensor]:
    """Rotation and left Jacobian (..., 3, 3) of rotation vectors (..., 3), rad."""
    x, y, z = step.unbind(-1)
    zero = torch.zeros_like(x)
    cross = torch.stack((zero, -z, y, z, zero, -x, -y, x, zero), -1).unflatten(-1, (3, 3))
    angle = step.norm(dim=-1)[..., None, None]
    identity = torch.eye(3, dtype=step.dtype, device=step.device)
    half = torch.sinc(angle / (2 * torch.pi)) ** 2 / 2
    # (t - sin t) / t^3 loses its digits at small angles; there the series' next term is below 1e-9.
    third = torch.where(angle > 1e-2, (angle - angle.sin()) / angle.clamp_min(1e-2) ** 3, (1 - angle**2 / 20) / 6)
    return torch.linalg.matrix_exp(cross), identity + half * cross + third * cross @ cross
