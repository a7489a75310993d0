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

import functools
import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

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
    matrix : ndarray
        (n, c, t - 1, 5, 5) of the state. Jerk and snap are no part of it in flight.
    rough, smooth : ndarray
        Covariance (n, c, t - 1, 5, 5) that the contact adds, per unit intensity of its white snap, or white crackle.
    flight : ndarray
        Covariance (n, 1, t - 1, 5, 5) that white jerk adds, per unit intensity, in flight and contact.
    idle : ndarray
        (n, c, t - 1), True where jerk and snap mean nothing after the transition and may have any variance.
    """

    matrix: Array
    rough: Array
    smooth: Array
    flight: Array
    idle: NDArray[np.bool_]


@dataclass(frozen=True)
class Passages:
    """How contact intervals, c of each of n recordings, lie among the transitions between t frames.

    Attributes
    ----------
    whole : ndarray
        (n, c, t - 1), True where the contact lasts throughout.
    edges : ndarray
        (n, c, t - 1), True where it begins or ends meanwhile: e places.
    matrix, rough, smooth : ndarray
        Of those places (e, 5, 5), as in `Transitions`.
    """

    whole: NDArray[np.bool_]
    edges: NDArray[np.bool_]
    matrix: Array
    rough: Array
    smooth: Array

    @classmethod
    def of(cls, times: Array, windows: Array) -> Passages:
        """Of frames at ``times`` (n, t) and the intervals ``windows`` (n, c, 2)."""
        before, after = times[:, None, :-1], times[:, None, 1:]
        start, end = windows[..., :1], windows[..., 1:]
        touching = touches(times, windows)
        edges = touching & ((start >= before) | (end <= after))
        before, after, start, end = (np.broadcast_to(v, edges.shape)[edges] for v in (before, after, start, end))
        starts, ends = start >= before, end <= after
        duration = np.minimum(end, after) - np.maximum(start, before)
        inside, none = integrator(duration), np.eye(STATES)
        begin = np.where(starts[:, None, None], steady(start - before), none)
        finish = np.where(ends[:, None, None], steady(after - end), none)
        size = np.where(starts, end - start, 0.0)

        def added(order: int) -> Array:
            within = white_noise(duration, order) + inside @ _first_size(size, order) @ inside.swapaxes(-1, -2)
            return np.asarray(finish @ within @ finish.swapaxes(-1, -2))

        return cls(touching & ~edges, edges, finish @ inside @ begin, added(ROUGH), added(STATES))


def touches(times: Array, windows: Array) -> NDArray[np.bool_]:
    """Which intervals ``windows`` (n, c, 2) touch what is between a frame and the next (n, c, t - 1)."""
    before, after = times[:, None, :-1], times[:, None, 1:]
    return np.asarray(np.minimum(windows[..., 1:], after) > np.maximum(windows[..., :1], before))


def transitions(times: Array, windows: Array) -> Transitions:
    """Transitions between ``times`` (n, t), frames, with the contact intervals ``windows`` (n, c, 2), start and end.

    An interval may start and end between frames; one that ends where it starts is no contact.
    """
    duration = np.diff(times)[:, None]
    passages = Passages.of(times, windows)
    whole = passages.whole[..., None, None]
    matrix = np.where(whole, integrator(duration), steady(duration))
    rough, smooth = (np.where(whole, white_noise(duration, order), 0.0) for order in (ROUGH, STATES))
    for all_of_them, edges in ((matrix, passages.matrix), (rough, passages.rough), (smooth, passages.smooth)):
        all_of_them[passages.edges] = edges
    idle = (windows[..., 1:] <= times[:, None, 1:]) | ~(passages.whole | passages.edges)
    return Transitions(matrix, rough, smooth, white_noise(duration, STEADY), idle)


def _first_size(length: Array, order: int) -> Array:
    """Covariance (..., 5, 5), per unit intensity, of the states that a contact of so many frames (...) starts with.

    The size of the first jerk and snap is tied to the intensity by the contact's own duration: no number of its own to
    find.
    """
    size = np.zeros((*length.shape, STATES, STATES))
    for i in range(STEADY, order):
        size[..., i, i] = length ** (2 * (order - i) - 1)
    return size


def steady(duration: Array) -> Array:
    """As `integrator`, of flight: without jerk and snap, before and after."""
    return integrator(duration) * (np.arange(STATES) < STEADY)


def integrator(duration: Array) -> Array:
    """State after ``duration`` (...) per state before, (..., 5, 5): Taylor's series."""
    powers, factors = _taylor()
    return _powers(duration)[..., powers] * factors


def white_noise(duration: Array, order: int) -> Array:
    """Covariance (..., 5, 5) that white noise of unit intensity adds to ``order`` integrals over ``duration`` (...)."""
    powers, factors = _noise(order)
    return _powers(duration)[..., powers] * factors


@functools.cache
def _taylor() -> tuple[NDArray[np.int64], Array]:
    """Powers of the duration in `integrator`, and their factors (5, 5)."""
    powers, factors = np.zeros((STATES, STATES), dtype=np.int64), np.zeros((STATES, STATES))
    for i in range(STATES):
        for j in range(i, STATES):
            powers[i, j], factors[i, j] = j - i, 1 / math.factorial(j - i)
    return powers, factors


@functools.cache
def _noise(order: int) -> tuple[NDArray[np.int64], Array]:
    """Powers of the duration in `white_noise`, and their factors (5, 5)."""
    powers, factors = np.zeros((STATES, STATES), dtype=np.int64), np.zeros((STATES, STATES))
    for i in range(order):
        for j in range(order):
            powers[i, j] = power = 2 * order - 1 - i - j
            factors[i, j] = 1 / (math.factorial(order - 1 - i) * math.factorial(order - 1 - j) * power)
    return powers, factors


def _powers(duration: Array) -> Array:
    """From the power of 0 to that of 9 (..., 10)."""
    found = np.ones((*duration.shape, 2 * STATES))
    found[..., 1:] = duration[..., None]
    return np.multiply.accumulate(found, -1)
