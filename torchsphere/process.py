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

What the smooth process states of the force of a half-sine is still 1.4 times what it is off by. White noise in an
m-th derivative leaves room for errors of smoothing that so even a force has none of: of the variance that is stated
of the k-th derivative the share (2 m - 2 k - 1) / 2 m is noise, for the acceleration (m = 5, k = 2) a half. The edges
are the rest (`torchsphere.weigh.SHARED_SHAPE`). By their medians, forces drawn from the smooth process are stated 1.1
and 1.4 times too wide, from the rough one 1.2 times too narrow (24 each, noise of 1.5 and 7.5 um). A half-sine of
unknown height beside the rough process takes two thirds of the errors from a half-sine, and was rejected: the best
half-sine is but 15 in chi squared from a triangle and 3 from Hertz' law (at 7.5 um), and was taken for them, with
peaks off by 4 and 0.8 kN and bands that held a quarter of their forces at most.

Known to be 0 at either end, the smooth process' snap leaves sums of sines, ``sin(k pi s)`` of variances as ``k^-6``,
the same backwards. Half-sines of 14 frames then have edges without bias, and forces right to 80 and 213 N instead of
116 and 285 N (64 shots each, noise of 1.5 and 7.5 um), but hardly narrower bands: 1.7 and 2.0 times too wide instead of
1.4. It was rejected, as no size of the first jerk suits all. A variance of a fifth of intensity times cubed duration
makes the forces of 5 frames worse by 18 % (7.5 um), where the rough process is then taken too often; one of a 45th, the
sines' own, takes two peaks for smooth, and the bands of their spins hold 84 instead of 91 % (1.5 um).
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
    unit = torch.eye(STATES, dtype=times.dtype, device=times.device)
    steady_states = torch.diag((torch.arange(STATES, device=times.device) < STEADY).to(times))

    def steady(duration: Tensor, where: Tensor) -> Tensor:
        return torch.where(where[..., None, None], integrator(duration) @ steady_states, unit)

    # Most frames are in flight in any interval, and alike: the rest is computed for the others alone.
    bound = touching.any(1).any(0)
    starts, idle = starts | ~touching, ends | ~touching
    first = torch.where(touching, first, after - before)
    begin, finish = (steady(v[..., bound], where[..., bound]) for v, where in ((first, starts), (last, idle)))
    middle = integrator(inside[..., bound])
    matrix = (integrator(after - before) @ steady_states).repeat(1, windows.shape[1], 1, 1, 1)
    matrix[:, :, bound] = finish @ middle @ begin
    length = torch.where(starts & touching, end - start, 0.0)[..., bound]

    def added(order: int) -> Tensor:
        within = white_noise(inside[..., bound], order) + middle @ _first_size(length, order) @ middle.mT
        found = torch.zeros_like(matrix)
        found[:, :, bound] = finish @ within @ finish.mT
        return found

    return Transitions(
        matrix=matrix,
        rough=added(ROUGH),
        smooth=added(STATES),
        flight=white_noise(after - before, STEADY),
        idle=idle,
        touching=bound.tolist(),
    )


def _first_size(length: Tensor, order: int) -> Tensor:
    """Covariance (..., 5, 5), per unit intensity, of the states that a contact of so many frames (...) starts with.

    The size of the first jerk and snap is tied to the intensity by the contact's own duration: no number of its own to
    find.
    """
    size = length.new_zeros(*length.shape, STATES)
    for i in range(STEADY, order):
        size[..., i] = length ** (2 * (order - i) - 1)
    return torch.diag_embed(size)


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
