"""How a ball may move between frames: nearly steady in flight, a rough or a smooth force in contact.

A degree of freedom has the state (pose, rate, acceleration, jerk, snap). In flight its jerk is white noise of small
intensity: the acceleration stays nearly what it is. From the start of the contact the jerk is a state of its own, of
unknown size, and is gone at the end. In the rough process its derivative, the snap, is white noise. In the smooth one
the snap is a state, too, and its derivative, the crackle, is white noise beside what a spring adds: minus the jerk
times the square of a circular frequency, of none to two half turns within the contact (`SPRINGS`). Without noise the
force is then a parabola, a half-sine (a ball on a linear spring), a squared sine, or one between them.

Which of them it is, the data say, with the edges of the contact that each would have (`contact_models`). At a
noise of 7.5 and 1.5 um forces of 14 frames and 29 kN so are right to 138 and 29 N where they are half-sines, to 172 and
80 N by Hertz' law, 152 and 43 N as squared sines, root mean square over the contact. With a parabola alone it was 213
and 67, 343 and 161, 399 and 188 N, and a half-sine was like a parabola of a shorter contact. The bands hold 92 to 99 %
of them, but of Hertz' law at 1.5 um 71 %: its force begins without a slope, as no spring's does. A triangle, a plateau,
two peaks and a fast rise are rough: errors and bands are those without springs, except of triangles of 6 frames, which
the data cannot tell from a half-sine. Their bands hold 78 instead of 96 % (1.5 um).

White noise in an m-th derivative leaves room for errors of smoothing that a force without noise has none of: of the
variance that is stated of the k-th derivative the share (2 m - 2 k - 1) / 2 m is noise, for the acceleration (m = 5,
k = 2) a half. So the bands of a half-sine at 1.5 um are 1.3 times too wide. White jerk in contact leaves each frame's
force too free of its neighbours': of half-sines less likely by 3 to 30 in the logarithm, with bands 2 to 4 times too
wide.

What a unit of snap becomes where the jerk is pulled back as by a spring: series without sines of small angles.
"""

from __future__ import annotations

import functools
import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

#: Integrals of the snap down to the pose.
INTEGRALS = 4

#: Terms of the series, and nodes of the integrals over squares of it: exact of a parabola, and right to 1e-9 of a swing
#: over a frame of three.
TERMS, NODES = 14, 6


def swung(duration: Array, frequency: Array) -> Array:
    """Pose, rate, acceleration, jerk and snap (..., 5) that a unit of snap has become after ``duration`` (...).

    The snap's derivative is minus the jerk times the square of the circular ``frequency`` (...). With ``x`` the angle
    turned, the states are powers of the duration times ``sum (-x^2)^m / (p + 2 m)!``, p from 4 to 0.
    """
    square = -((duration * frequency) ** 2)
    found = np.empty((*square.shape, INTEGRALS + 1))
    for power in (INTEGRALS, INTEGRALS - 1):
        total = np.zeros_like(square)
        for factor in _series(power):
            total = total * square + factor
        found[..., INTEGRALS - power] = total
    for power in reversed(range(INTEGRALS - 1)):
        found[..., INTEGRALS - power] = 1 / math.factorial(power) + square * found[..., INTEGRALS - 2 - power]
    found *= np.broadcast_to(duration, square.shape)[..., None] ** np.arange(INTEGRALS, -1, -1)
    return found


@functools.cache
def nodes() -> tuple[Array, Array]:
    """Places between 0 and 1 and weights (q,) by which Gauss integrates."""
    places, weights = np.polynomial.legendre.leggauss(NODES)
    return 0.5 * (places + 1), 0.5 * weights


@functools.cache
def _series(power: int) -> tuple[float, ...]:
    """Factors of the series, the last first; of angles up to two half turns they leave 1e-10."""
    return tuple(1 / math.factorial(power + 2 * m) for m in reversed(range(TERMS)))


#: Pose, rate and acceleration, which flight has, too; jerk; and snap, which the rough process has not.
STEADY, ROUGH, STATES = 3, 4, 5

#: Intensity of the white crackle of a rough process, noise variance per frame^9: a smoother cannot do with a state that
#: is known exactly, and this one moves no pose by 1e-6 of the noise within a thousand frames.
ABSENT = 1e-40

#: Springs of the smooth process, half turns of the swing within the contact: forces that a parabola, a half-sine and a
#: squared sine cost nothing, and those between.
SPRINGS = (0.0, 0.5, 0.8, 1.0, 1.2, 1.4, 1.6, 1.8, 2.0)

#: Variance of the height of such a force, per unit intensity of the white crackle and fifth power of the contact's
#: duration: the higher, the less may forces differ from those of the springs. With 0.04 those of a squared sine are off
#: by 252 instead of 171 N (7.5 um), the bands of Hertz' law hold 82 instead of 72 % of its forces (1.5 um). Without
#: this, that is with a first jerk and snap of any kind alike, springs hardly mattered.
HEIGHT = 0.2


@dataclass(frozen=True)
class Transitions:
    """From each frame to the next, for n recordings and c contact intervals each; units of frames.

    Attributes
    ----------
    matrix : ndarray
        (n, c, t - 1, 5, 5) of the state. Jerk and snap are no part of it in flight.
    contact : ndarray
        Covariance (n, c, t - 1, 5, 5) that the contact adds, per unit intensity of its white snap, or white crackle.
    flight : ndarray
        Covariance (n, 1, t - 1, 5, 5) that white jerk adds, per unit intensity, in flight and contact.
    idle : ndarray
        (n, c, t - 1), True where jerk and snap mean nothing after the transition and may have any variance.
    """

    matrix: Array
    contact: Array
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
    matrix, contact : ndarray
        Of those places (e, 5, 5), as in `Transitions`.
    inside, within : ndarray
        The same where the contact lasts throughout, (n, c or 1, t - 1 or 1, 5, 5): what they differ by.
    """

    whole: NDArray[np.bool_]
    edges: NDArray[np.bool_]
    matrix: Array
    contact: Array
    inside: Array
    within: Array

    @classmethod
    def of(cls, times: Array, windows: Array, springs: Array | None) -> Passages:
        """Of frames at ``times`` (n, t) and the intervals ``windows`` (n, c, 2), as `transitions`."""
        before, after = times[:, None, :-1], times[:, None, 1:]
        start, end = windows[..., :1], windows[..., 1:]
        touching = touches(times, windows)
        edges = touching & ((start >= before) | (end <= after))
        length = end - start
        bent = None if springs is None else np.broadcast_to(springs[..., None], edges.shape)
        whole = _within(_even(after - before), length, None if springs is None else springs[..., None])
        before, after, start, end, length = (
            np.broadcast_to(v, edges.shape)[edges] for v in (before, after, start, end, length)
        )
        bent = bent if bent is None else bent[edges]
        starts, ends = start >= before, end <= after
        duration = np.minimum(end, after) - np.maximum(start, before)
        inside, within = _within(duration, length, bent)
        none = np.eye(STATES)
        begin = np.where(starts[:, None, None], steady(start - before), none)
        finish = np.where(ends[:, None, None], steady(after - end), none)
        first = _first(np.where(starts, length, 0.0), bent)
        within = finish @ (within + inside @ first @ inside.swapaxes(-1, -2)) @ finish.swapaxes(-1, -2)
        return cls(touching & ~edges, edges, finish @ inside @ begin, within, *whole)


def touches(times: Array, windows: Array) -> NDArray[np.bool_]:
    """Which intervals ``windows`` (n, c, 2) touch what is between a frame and the next (n, c, t - 1)."""
    before, after = times[:, None, :-1], times[:, None, 1:]
    return np.asarray(np.minimum(windows[..., 1:], after) > np.maximum(windows[..., :1], before))


def transitions(times: Array, windows: Array, springs: Array | None) -> Transitions:
    """Transitions between ``times`` (n, t), frames, with the contact intervals ``windows`` (n, c, 2), start and end.

    An interval may start and end between frames; one that ends where it starts is no contact. The process is the
    smooth one, with the ``springs`` (n, c) of each interval; None for the rough one.
    """
    duration = np.diff(times)[:, None]
    passages = Passages.of(times, windows, springs)
    whole = passages.whole[..., None, None]
    matrix = np.where(whole, passages.inside, steady(duration))
    contact = np.where(whole, passages.within, 0.0)
    matrix[passages.edges], contact[passages.edges] = passages.matrix, passages.contact
    idle = (windows[..., 1:] <= times[:, None, 1:]) | ~(passages.whole | passages.edges)
    return Transitions(matrix, contact, white_noise(duration, STEADY), idle)


def _even(duration: Array) -> Array:
    """Durations (n, 1, t - 1), or the one that all have (n, 1, 1)."""
    return duration[..., :1] if (duration == duration[..., :1]).all() else duration


def _within(duration: Array, length: Array, springs: Array | None) -> tuple[Array, Array]:
    """Matrix of the state, and what white noise adds (..., 5, 5), over a ``duration`` (...) of contacts of a length."""
    if springs is None:
        return integrator(duration), white_noise(duration, ROUGH)
    frequency = np.pi * springs / np.where(length > 0, length, np.inf)
    return swing(duration, frequency), swing_noise(duration, frequency)


def _first(length: Array, springs: Array | None) -> Array:
    """Covariance (..., 5, 5), per unit intensity, of the states that a contact of so many frames (...) starts with.

    The size of the first jerk and snap is tied to the intensity by the contact's own duration: no number of its own to
    find. In the smooth process that of a force without noise comes to them, which begins and ends at 0: of this height.
    """
    size = np.zeros((*length.shape, STATES, STATES))
    order = ROUGH if springs is None else STATES
    for i in range(STEADY, order):
        size[..., i, i] = length ** (2 * (order - i) - 1)
    if springs is not None:
        own = start(springs) * np.stack((length**1.5, length**0.5), -1)
        size[..., STEADY:, STEADY:] += HEIGHT * own[..., :, None] * own[..., None, :]
    return size


def start(springs: Array) -> Array:
    """Jerk and snap (..., 2) that a contact of length 1 begins with where its force has no noise and the height 1.

    With ``a`` the angle of the swing within the contact it is ``(cos(a (s - 1/2)) - cos(a / 2)) / (1 - cos(a / 2))``.
    """
    # Below this angle it is a parabola to 1e-6.
    angle = np.pi * np.maximum(springs, 1e-3)
    snap = -(angle**2) * np.cos(angle / 2) / (1 - np.cos(angle / 2))
    return np.stack((angle / np.tan(angle / 4), snap), -1)


def ending(springs: Array | None) -> Array:
    """Variance (s,) of the acceleration at the end of a contact of length 1, per unit intensity of its process."""
    one = np.ones(1 if springs is None else len(springs))
    moved, added = _within(one, one, springs)
    added = added + moved @ _first(one, springs) @ moved.swapaxes(-1, -2)
    return np.asarray(added[..., STEADY - 1, STEADY - 1])


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


def swing(duration: Array, frequency: Array) -> Array:
    """As `integrator`, where the crackle is minus the jerk times the square of a circular ``frequency`` (...)."""
    last = swung(duration, frequency)
    found = integrator(np.broadcast_to(duration, last.shape[:-1]))
    found[..., STATES - 1] = last
    found[..., : STATES - 1, STATES - 2] = last[..., 1:]
    found[..., STATES - 1, STATES - 2] = -(frequency**2) * last[..., STATES - 2]
    return found


def swing_noise(duration: Array, frequency: Array) -> Array:
    """Covariance (..., 5, 5) that white crackle of unit intensity adds to what `swing` moves."""
    places, weights = nodes()
    last = swung(duration[..., None] * places, frequency[..., None])
    return np.asarray((last.swapaxes(-1, -2) * (duration[..., None, None] * weights)) @ last)


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
