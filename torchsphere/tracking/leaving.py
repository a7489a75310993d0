"""Whether a ball that is not found has left the image: only its last measured positions may say so."""

from __future__ import annotations

import numpy as np
import torch
from torch import Tensor

from torchsphere.correlation.frame_status import OUT_OF_FRAME
from torchsphere.runtime.arrays import Array
from torchsphere.tracking.prediction import BallState
from torchsphere.tracking.record import Record

#: Share of the disc in the image below which the ball has left the image (docs/constants.toml).
MIN_IN_FRAME = 0.5

#: Numbers of last positions that tell the flight: few after a contact, many of a slow ball (docs/constants.toml).
POSITIONS = (3, 16)

#: Errors of a predicted position that are allowed for, standard deviations (docs/constants.toml).
MARGIN_SD = 3.0


def has_left(record: Record, state: BallState, at: int) -> bool:
    """Whether the ball, last seen in the frame of the ``state``, has left the image in the later frame ``at``.

    A ball that has left is out of the image until it is found again.
    """
    if record.status[at - 1] == OUT_OF_FRAME:
        return True
    return any(_flies_out(record, state, at, count) for count in POSITIONS)


def _flies_out(record: Record, state: BallState, at: int, count: int) -> bool:
    """Whether the free flight through the last ``count`` measured positions leads out of the image by frame ``at``.

    Without as many positions, and steps between them, that were measured, nothing is known, nor more frames ahead than
    were measured. A ball that this flight shows wholly in the image, but that was not found there, flies otherwise.
    """
    first, later = state.frame + 1 - count, at - state.frame
    steps = slice(first, state.frame)
    if first < 0 or later > count or not np.isfinite(record.increment[steps, :2]).all():
        return False
    positions = record.position[first : state.frame + 1]
    # A step has the errors of two positions.
    variance = 0.5 * np.diagonal(record.covariance[steps, :2, :2], axis1=1, axis2=2).max(0)
    centres, errors = _continued(positions, variance, later)
    whole = np.array([state.share_in_image(centre) == 1 for centre in centres])
    # An exposure shows the ball on its way to its next place at most.
    if (whole[:-1] & whole[1:]).any():
        return False
    height, width = state.image.shape[-2:]
    inwards = torch.tensor([width / 2, height / 2]).to(centres) - centres[-1]
    return state.share_in_image(centres[-1] + inwards.clamp(-errors, errors)) < MIN_IN_FRAME


def _continued(positions: Array, variance: Array, later: int) -> tuple[Tensor, Tensor]:
    """Centres (later, 2) in the next frames, on a parabola through ``positions`` (m, 2), and the last one's error (2,).

    A position has the ``variance`` (2,), or that by which the positions leave the parabola, if it is larger.
    """
    known = np.vander(np.arange(1.0 - len(positions), 1.0), 3)
    ahead = np.vander(np.arange(1.0, later + 1.0), 3) @ np.linalg.pinv(known)
    off = positions - known @ np.linalg.pinv(known) @ positions
    scatter = (off**2).sum(0) / max(len(positions) - 3, 1)
    error = MARGIN_SD * np.linalg.norm(ahead[-1]) * np.sqrt(np.maximum(variance, scatter))
    return torch.from_numpy(ahead @ positions), torch.from_numpy(error)
