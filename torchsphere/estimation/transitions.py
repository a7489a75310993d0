"""How the state of all degrees of freedom moves on from frame to frame: matrix, offset and covariance of each step.

From frame to frame ``phi' = Ad phi + J (v dt + a dt^2 / 2 + j dt^3 / 6) - s``, with the reference's step ``s``, its
rotation ``Ad`` and left Jacobian ``J``. What the turning of the axis within a step adds, ``dt^3/12 a x w``, is below
1e-6 rad for a ball that is spun up to 3 deg per frame in ten frames.
"""

from __future__ import annotations

import itertools
from typing import Any, NamedTuple

import numpy as np
import torch
from torch import Tensor

from torchsphere.estimation.contact_search import Contact
from torchsphere.estimation.filter_bank import Array
from torchsphere.estimation.measurements import FREEDOMS, Poses
from torchsphere.estimation.process_model import ABSENT, STATES, STEADY, steady, touches, transitions, white_noise

#: Numbers in the state of a flight and of a contact.
FLIGHT = STEADY * FREEDOMS


class Steps(NamedTuple):
    """Some f transitions of n recordings with c intervals each, from states of the size s to the size s'.

    Attributes
    ----------
    matrix : ndarray
        (f, n, c, s', s), or (f, n, 1, s', s) in flight, where all intervals have the same.
    offset : ndarray
        (f, n, 1, s').
    added : ndarray
        Covariance (f, n, c, s', s').
    """

    matrix: Array
    offset: Array
    added: Array


class Moves:
    """How the states of n recordings move on, under c contact intervals each.

    Where none of the rows is in contact the states have no jerk and snap: most frames cost a fifth.
    """

    def __init__(self, poses: Poses, contact: Contact) -> None:
        step, unit = poses.step.swapaxes(0, 1), poses.unit
        turn, jacobian = _turning(step[..., 2:])
        self._turn = turn.numpy()[:, :, None]
        #: The rotation's step is that of a vector, seen from the tangent space at its end.
        self._along = np.tile(np.eye(FREEDOMS), (*step.shape[:2], 1, 1, 1))
        self._along[..., 2:, 2:] = jacobian.numpy()[:, :, None]
        self._step = (step / unit).numpy()[:, :, None]
        self._drift = (poses.drift.swapaxes(0, 1) / unit**2).numpy()[:, :, None]
        intensity = contact.noise**2 * contact.contact
        kinds = (contact.noise**2 * contact.flight, torch.where(contact.smooth, 0.0, intensity))
        self._intensities = [v.numpy() for v in (*kinds, torch.where(contact.smooth, intensity, ABSENT))]
        self._duration = poses.times.diff(dim=-1).T[:, :, None].numpy()
        times, windows = poses.times.numpy(), contact.windows.numpy()
        touching = np.asarray(touches(times, windows).any((0, 1)))
        places = np.flatnonzero(touching).tolist() or [0]
        #: The first transition that is touched, and those from it to the last that is.
        self._first = places[0]
        times = times[:, places[0] : places[-1] + 2]
        self._rough, self._smooth = (transitions(times, windows, v) for v in (None, contact.springs.numpy()))
        #: Which process each has, (n, c, 5).
        self._is_smooth = contact.smooth.numpy()
        self.touching = [bool(any_of_them) for any_of_them in touching]
        #: Kinds of state that each frame has: its own if the transition to it touches.
        self._kinds = [STEADY, *(STATES if touching else STEADY for touching in self.touching)]

    def alike(self, at_once: int) -> list[slice]:
        """Transitions one after the other between states of the same sizes, up to so many at once."""
        pairs = enumerate(itertools.pairwise(self._kinds))
        found = []
        for _, group in itertools.groupby(pairs, key=lambda pair: (pair[1], self.touching[pair[0]])):
            numbers = [i for i, _ in group]
            found += [slice(i, min(i + at_once, numbers[-1] + 1)) for i in numbers[::at_once]]
        return found

    def at(self, part: slice) -> Steps:
        """Transitions of the frames ``part``, of one of the slices of `alike`, to those after them."""
        before, after = self._kinds[part.start : part.start + 2]
        along, duration = self._along[part], self._duration[part]
        if self.touching[part.start]:
            own = slice(part.start - self._first, part.stop - self._first)
            blocks = [_frames(v.matrix, own)[..., :after, :before] for v in (self._rough, self._smooth)]
            kept = (self._rough.flight, self._rough.contact, self._smooth.contact)
            noises = [_frames(v, own) for v in kept]
            idle = _frames(self._rough.idle, own)
        else:
            blocks = [steady(duration)[..., :after, :before]]
            noises, idle = [white_noise(duration, STEADY)], np.array(1.0)
        block = blocks[0]
        matrix = np.zeros((*block.shape[:-2], after, FREEDOMS, before, FREEDOMS))
        added = np.zeros((*block.shape[:2], *self._intensities[0].shape[1:2], after, FREEDOMS, after, FREEDOMS))
        for k in range(FREEDOMS):
            is_smooth = self._is_smooth[..., k, None, None]
            matrix[..., k, :, k] = block if len(blocks) == 1 else np.where(is_smooth, blocks[1], block)
            for noise, intensity in zip(noises, self._intensities, strict=False):
                added[..., k, :, k] += noise[..., :after, :after] * intensity[..., k, None, None]
        matrix = matrix.reshape(*block.shape[:-2], after * FREEDOMS, before * FREEDOMS)
        added = added.reshape(*added.shape[:-4], after * FREEDOMS, after * FREEDOMS)
        matrix[..., :FREEDOMS, :] = along @ matrix[..., :FREEDOMS, :]
        added[..., :FREEDOMS, :] = along @ added[..., :FREEDOMS, :]
        added[..., :FREEDOMS] = added[..., :FREEDOMS] @ along.swapaxes(-1, -2)
        matrix[..., 2:FREEDOMS, 2:FREEDOMS] = self._turn[part]
        poses, later = np.arange(FREEDOMS), np.arange(FLIGHT, after * FREEDOMS)
        added[..., poses, poses] += self._drift[part]
        added[..., later, later] += idle[..., None]
        offset = np.zeros((*along.shape[:3], after * FREEDOMS))
        offset[..., :FREEDOMS] = -self._step[part]
        return Steps(matrix, offset, added)


def _frames(values: Any, part: slice) -> Any:
    """Values (n, c, t, ...) of some frames (f, n, c, ...)."""
    return np.moveaxis(values[:, :, part], 2, 0)


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
