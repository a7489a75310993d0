"""How a ball may move between frames: nearly steady in flight, a rough or a smooth force in contact.

A degree of freedom has the state (pose, rate, acceleration, jerk, snap). In flight its jerk is white noise of small
intensity: the acceleration stays nearly what it is. From the start of the contact the jerk is a state of its own, of
unknown size, and is gone at the end. In the rough process its derivative, the snap, is white noise. In the smooth one
the snap is a state, too, and its derivative, the crackle, is white.

Which of the two it is, the data say: of a half-sine of 14 frames the smooth one is likelier by 1 and 3 in the logarithm
(noise of 7.5 and 1.5 um at 29 kN), of one of 40 frames by 5 and 9; of a triangle, a plateau, two peaks, a fast rise and
Hertz' law of contact the rough one by 2 to 6. The smooth one alone held but 64 to 87 % of the forces of the first four,
the rough one alone stated bands of a half-sine 1.8 times too wide (contact's edges known, 16 shots each). White jerk in
contact leaves each frame's force too free of its neighbours': of the half-sines less likely by 3 to 30, with bands 2 to
4 times too wide; a process smoother still is less likely, too.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import torch
from torch import Tensor

#: Pose, rate and acceleration, which flight has, too; jerk; and snap, which the rough process has not.
STEADY, ROUGH, STATES = 3, 4, 5

#: Intensity of the white crackle of a rough process, noise variance per frame^9: a smoother cannot do with a state that
#: is known exactly, and this one moves no pose by 1e-6 of the noise within a thousand frames.
ABSENT = 1e-40


@dataclass(frozen=True)
class Transitions:
    """From each frame to the next, for n recordings and c contact intervals each; units of frames.

    Attributes
    ----------
    matrix : Tensor
        (n, c, t - 1, 5, 5) of the state. Jerk and snap are no part of it in flight.
    rough, smooth : Tensor
        Covariance (n, c, t - 1, 5, 5) that the contact adds, per unit intensity of its white snap, or white crackle.
    flight : Tensor
        Covariance (n, 1, t - 1, 5, 5) that white jerk adds, per unit intensity, in flight and contact.
    idle : Tensor
        (n, c, t - 1), True where jerk and snap mean nothing after the transition and may have any variance.
    touching : list of bool
        Whether between frame i and the next there is any contact.
    """

    matrix: Tensor
    rough: Tensor
    smooth: Tensor
    flight: Tensor
    idle: Tensor
    touching: list[bool]


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

    def added(order: int) -> Tensor:
        # The size of the first jerk and snap is tied to the intensity by the contact's own duration: no number of its
        # own to find.
        size = torch.zeros(*starts.shape, STATES, dtype=times.dtype, device=times.device)
        for i in range(STEADY, order):
            size[..., i] = torch.where(starts, end - start, 0.0) ** (2 * (order - i) - 1)
        within = white_noise(inside, order) + middle @ torch.diag_embed(size) @ middle.mT
        return finish @ within @ finish.mT

    return Transitions(
        matrix=matrix,
        rough=added(ROUGH),
        smooth=added(STATES),
        flight=white_noise(after - before, STEADY),
        idle=ends | ~touching,
        touching=touching.any(1).any(0).tolist(),
    )


def integrator(duration: Tensor) -> Tensor:
    """State after ``duration`` (...) per state before, (..., 5, 5): Taylor's series."""
    result = torch.zeros(*duration.shape, STATES, STATES, dtype=duration.dtype, device=duration.device)
    for i in range(STATES):
        for j in range(i, STATES):
            result[..., i, j] = duration ** (j - i) / math.factorial(j - i)
    return result


def white_noise(duration: Tensor, order: int) -> Tensor:
    """Covariance (..., 5, 5) that white noise of unit intensity adds to ``order`` integrals over ``duration`` (...)."""
    result = torch.zeros(*duration.shape, STATES, STATES, dtype=duration.dtype, device=duration.device)
    for i in range(order):
        for j in range(order):
            power = 2 * order - 1 - i - j
            factor = math.factorial(order - 1 - i) * math.factorial(order - 1 - j) * power
            result[..., i, j] = duration**power / factor
    return result
