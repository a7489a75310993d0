"""How a ball may move between frames: nearly steady in flight, a smooth force in contact.

A degree of freedom has the state (pose, rate, acceleration, jerk). In flight its jerk is white noise of small
intensity: the acceleration stays nearly what it is. From the start of the contact the jerk is a state of its own, of
unknown size, and its derivative is white noise; at the end it is gone. White jerk in contact, too, leaves each frame's
force too free of its neighbours': measured on the half-sine pulse of 29 kN and 14 frames, its bands were 2 to 4 times
too wide (all samples within 95 %), and the data less likely by 2 to 4 in the logarithm.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import torch
from torch import Tensor

#: Pose, rate and acceleration, which flight has, too; and jerk.
STEADY, STATES = 3, 4


@dataclass(frozen=True)
class Transitions:
    """From each frame to the next, for n recordings and c contact intervals each; units of frames.

    Attributes
    ----------
    matrix : Tensor
        (n, c, t - 1, 4, 4) of the state. The jerk is no part of it in flight.
    contact : Tensor
        Covariance (n, c, t - 1, 4, 4) that the contact adds, per unit intensity of its white snap.
    flight : Tensor
        Covariance (n, 1, t - 1, 4, 4) that white jerk adds, per unit intensity, in flight and contact.
    idle : Tensor
        (n, c, t - 1), True where the jerk means nothing after the transition and may have any variance.
    """

    matrix: Tensor
    contact: Tensor
    flight: Tensor
    idle: Tensor


def transitions(times: Tensor, windows: Tensor) -> Transitions:
    """Transitions between ``times`` (n, t), frames, with the contact intervals ``windows`` (n, c, 2), start and end.

    An interval may start and end between frames; one that ends where it starts is no contact.
    """
    before, after = times[:, None, :-1], times[:, None, 1:]
    start, end = windows[..., :1], windows[..., 1:]
    first = (torch.minimum(start, after) - before).clamp_min(0.0)
    last = (after - torch.maximum(end, before)).clamp_min(0.0)
    inside = torch.minimum(end, after) - torch.maximum(start, before)
    touching = inside > 0
    starts, ends = touching & (start >= before), touching & (end <= after)
    inside = inside.clamp_min(0.0)
    first, last = torch.where(starts, first, 0.0), torch.where(ends, last, 0.0)
    first = torch.where(touching, first, after - before)
    unit = torch.eye(STATES, dtype=times.dtype, device=times.device)
    steady_states = torch.diag((torch.arange(STATES, device=times.device) < STEADY).to(times))

    def steady(duration: Tensor, where: Tensor) -> Tensor:
        return torch.where(where[..., None, None], integrator(duration) @ steady_states, unit)

    middle, finish = integrator(inside), steady(last, ends | ~touching)
    matrix = finish @ middle @ steady(first, starts | ~touching)
    # The size of the first jerk is tied to the intensity by the contact's own duration: no number of its own to find.
    powers = 2 * (STATES - torch.arange(STATES, device=times.device)) - 1
    size = torch.where(starts, end - start, 0.0)[..., None] ** powers
    jump = torch.diag_embed(size) @ (unit - steady_states)
    added = white_noise(inside, STATES) + middle @ jump @ middle.mT
    return Transitions(
        matrix=matrix,
        contact=finish @ added @ finish.mT,
        flight=white_noise(after - before, STEADY),
        idle=ends | ~touching,
    )


def integrator(duration: Tensor) -> Tensor:
    """State after ``duration`` (...) per state before, (..., 4, 4): Taylor's series."""
    result = torch.zeros(*duration.shape, STATES, STATES, dtype=duration.dtype, device=duration.device)
    for i in range(STATES):
        for j in range(i, STATES):
            result[..., i, j] = duration ** (j - i) / math.factorial(j - i)
    return result


def white_noise(duration: Tensor, order: int) -> Tensor:
    """Covariance (..., 4, 4) that white noise of unit intensity adds to ``order`` integrals over ``duration`` (...)."""
    result = torch.zeros(*duration.shape, STATES, STATES, dtype=duration.dtype, device=duration.device)
    for i in range(order):
        for j in range(order):
            power = 2 * order - 1 - i - j
            factor = math.factorial(order - 1 - i) * math.factorial(order - 1 - j) * power
            result[..., i, j] = duration**power / factor
    return result
