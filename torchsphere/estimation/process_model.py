"""Process models of the ball's motion: steady in flight, with a rough or a smooth force in contact.

The state of a degree of freedom is (pose, rate, acceleration, jerk, snap). In flight the jerk is white noise of small
intensity. In contact the jerk is a state of unknown initial size, 0 again after the end. In the rough process its
derivative, the snap, is white noise. In the smooth process the snap is a state, too, and its derivative, the crackle,
is white noise plus a spring's part: minus the jerk times the square of a circular frequency (`SPRINGS`). Without noise
the force is then a parabola, a half-sine (a ball on a linear spring), a squared sine, or a shape between them.

The smoother overstates its errors for a force without noise: of the stated variance of the k-th derivative the share
(2 m - 2 k - 1) / 2 m comes from white noise in the m-th derivative, for the acceleration (m = 5, k = 2) a half.
"""

from __future__ import annotations

import functools
import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

#: States of flight (pose, rate, acceleration), of the rough process (jerk) and of the smooth one (snap).
FLIGHT_STATES, ROUGH_STATES, STATES = 3, 4, 5

#: Intensity of white crackle that stands for none, noise variance per frame^9 (docs/constants.md).
NEGLIGIBLE_INTENSITY = 1e-40

#: Springs of the smooth process, half turns of their oscillation within the contact (docs/constants.md).
SPRINGS = (0.0, 0.5, 0.8, 1.0, 1.2, 1.4, 1.6, 1.8, 2.0)

#: Variance of the height of a force without noise, per unit intensity and duration^5 (docs/constants.md).
FORCE_VARIANCE = 0.2

#: Terms of the power series of an oscillation, and Gauss nodes of integrals over its square (docs/constants.md).
TERMS, NODES = 14, 6


@dataclass(frozen=True)
class Transitions:
    """From each frame to the next, for n recordings and c contact intervals each; units of frames."""

    matrix: Array  # (n, c, t - 1, 5, 5) of the state; without jerk and snap in flight
    contact: Array  # covariance (n, c, t - 1, 5, 5) that the contact adds, per unit intensity
    flight: Array  # covariance (n, 1, t - 1, 5, 5) that white jerk adds in flight and contact, per unit intensity
    idle: NDArray[np.bool_]  # (n, c, t - 1), True where jerk and snap have no meaning after the transition


@dataclass(frozen=True)
class ContactSteps:
    """Transitions between t frames that overlap one of c contact intervals of each of n recordings."""

    is_inside: NDArray[np.bool_]  # (n, c, t - 1), True where the contact lasts throughout
    is_edge: NDArray[np.bool_]  # (n, c, t - 1), True where the contact begins or ends: e transitions
    edge_matrix: Array  # (e, 5, 5)
    edge_noise: Array  # covariance per unit intensity (e, 5, 5)
    inside_matrix: Array  # (n, c or 1, t - 1 or 1, 5, 5), the broadcast axes shared
    inside_noise: Array  # covariance per unit intensity, of the same shape

    @classmethod
    def of(cls, times: Array, windows: Array, springs: Array | None) -> ContactSteps:
        """Transitions for the arguments of `transitions`."""
        before, after = times[:, None, :-1], times[:, None, 1:]
        start, end = windows[..., :1], windows[..., 1:]
        touching = overlaps(times, windows)
        edges = touching & ((start >= before) | (end <= after))
        length, duration = end - start, after - before
        if (duration == duration[..., :1]).all():
            duration = duration[..., :1]
        whole = _contact_step(duration, length, None if springs is None else springs[..., None])
        spring = None if springs is None else np.broadcast_to(springs[..., None], edges.shape)[edges]
        before, after, start, end, length = (
            np.broadcast_to(v, edges.shape)[edges] for v in (before, after, start, end, length)
        )
        starts, ends = start >= before, end <= after
        inside, noise = _contact_step(np.minimum(end, after) - np.maximum(start, before), length, spring)
        begin = np.where(starts[:, None, None], flight_matrix(start - before), np.eye(STATES))
        finish = np.where(ends[:, None, None], flight_matrix(after - end), np.eye(STATES))
        initial = _initial_covariance(np.where(starts, length, 0.0), spring)
        noise = finish @ (noise + inside @ initial @ inside.swapaxes(-1, -2)) @ finish.swapaxes(-1, -2)
        return cls(touching & ~edges, edges, finish @ inside @ begin, noise, *whole)


def overlaps(times: Array, windows: Array) -> NDArray[np.bool_]:
    """Mask (n, c, t - 1) of the steps between ``times`` (n, t) that the intervals ``windows`` (n, c, 2) overlap."""
    before, after = times[:, None, :-1], times[:, None, 1:]
    return np.asarray(np.minimum(windows[..., 1:], after) > np.maximum(windows[..., :1], before))


def transitions(times: Array, windows: Array, springs: Array | None) -> Transitions:
    """Transitions between ``times`` (n, t), frames, under contact intervals ``windows`` (n, c, 2), start and end.

    An interval may start and end between frames; an interval of length 0 is no contact. ``springs`` (n, c) are those of
    the smooth process, None for the rough process.
    """
    duration = np.diff(times)[:, None]
    steps = ContactSteps.of(times, windows, springs)
    is_inside = steps.is_inside[..., None, None]
    matrix = np.where(is_inside, steps.inside_matrix, flight_matrix(duration))
    contact = np.where(is_inside, steps.inside_noise, 0.0)
    matrix[steps.is_edge], contact[steps.is_edge] = steps.edge_matrix, steps.edge_noise
    idle = (windows[..., 1:] <= times[:, None, 1:]) | ~(steps.is_inside | steps.is_edge)
    return Transitions(matrix, contact, white_noise(duration, FLIGHT_STATES), idle)


def _contact_step(duration: Array, length: Array, springs: Array | None) -> tuple[Array, Array]:
    """Matrix and noise covariance (..., 5, 5) over a ``duration`` (...) inside contacts of a length (...)."""
    if springs is None:
        return integrator(duration), white_noise(duration, ROUGH_STATES)
    frequency = np.pi * springs / np.where(length > 0, length, np.inf)
    return spring_matrix(duration, frequency), spring_noise(duration, frequency)


def _initial_covariance(length: Array, springs: Array | None) -> Array:
    """Covariance (..., 5, 5) of the states at the start of a contact of that length (...), per unit intensity.

    The contact's own duration ties the first jerk and snap to the intensity, so that they need no parameter. In the
    smooth process a force without noise is added, which begins and ends at 0, of the variance `FORCE_VARIANCE`.
    """
    covariance = np.zeros((*length.shape, STATES, STATES))
    order = ROUGH_STATES if springs is None else STATES
    for i in range(FLIGHT_STATES, order):
        covariance[..., i, i] = length ** (2 * (order - i) - 1)
    if springs is not None:
        force = initial_jerk_snap(springs) * np.stack((length**1.5, length**0.5), -1)
        covariance[..., FLIGHT_STATES:, FLIGHT_STATES:] += FORCE_VARIANCE * force[..., :, None] * force[..., None, :]
    return covariance


def initial_jerk_snap(springs: Array) -> Array:
    """Jerk and snap (..., 2) at the start of a contact of length 1 whose force has no noise and the height 1.

    With ``a`` the angle of the oscillation the force is ``(cos(a (s - 1/2)) - cos(a / 2)) / (1 - cos(a / 2))``.
    """
    # Below this angle the force is a parabola to 1e-6.
    angle = np.pi * np.maximum(springs, 1e-3)
    snap = -(angle**2) * np.cos(angle / 2) / (1 - np.cos(angle / 2))
    return np.stack((angle / np.tan(angle / 4), snap), -1)


def end_variance(springs: Array | None) -> Array:
    """Variance (s,) of the acceleration at the end of a contact of length 1, per unit intensity of the process."""
    one = np.ones(1 if springs is None else len(springs))
    matrix, noise = _contact_step(one, one, springs)
    covariance = noise + matrix @ _initial_covariance(one, springs) @ matrix.swapaxes(-1, -2)
    return np.asarray(covariance[..., FLIGHT_STATES - 1, FLIGHT_STATES - 1])


def flight_matrix(duration: Array) -> Array:
    """The `integrator` of flight: without jerk and snap before and after."""
    return integrator(duration) * (np.arange(STATES) < FLIGHT_STATES)


def integrator(duration: Array) -> Array:
    """State after ``duration`` (...) per state before, (..., 5, 5), by Taylor's series."""
    powers, factors = _taylor_terms()
    return _powers(duration)[..., powers] * factors


def white_noise(duration: Array, order: int) -> Array:
    """Covariance (..., 5, 5) that white noise of unit intensity adds to ``order`` integrals over ``duration`` (...)."""
    powers, factors = _noise_terms(order)
    return _powers(duration)[..., powers] * factors


def spring_matrix(duration: Array, frequency: Array) -> Array:
    """The `integrator` where the crackle is minus the jerk times the square of a circular ``frequency`` (...)."""
    last = _snap_response(duration, frequency)
    matrix = integrator(np.broadcast_to(duration, last.shape[:-1]))
    matrix[..., STATES - 1] = last
    matrix[..., : STATES - 1, STATES - 2] = last[..., 1:]
    matrix[..., STATES - 1, STATES - 2] = -(frequency**2) * last[..., STATES - 2]
    return matrix


def spring_noise(duration: Array, frequency: Array) -> Array:
    """Covariance (..., 5, 5) that white crackle of unit intensity adds to a state with the `spring_matrix`."""
    nodes, weights = _gauss_nodes()
    last = _snap_response(duration[..., None] * nodes, frequency[..., None])
    return np.asarray((last.swapaxes(-1, -2) * (duration[..., None, None] * weights)) @ last)


def _snap_response(duration: Array, frequency: Array) -> Array:
    """State (..., 5) that a unit of snap becomes after ``duration`` (...) with a spring of circular ``frequency``.

    With ``x`` the angle turned, the states are powers of the duration times ``sum (-x^2)^m / (p + 2 m)!``, p from 4
    to 0: power series lose no digits at small angles.
    """
    integrals = STATES - 1
    square = -((duration * frequency) ** 2)
    response = np.empty((*square.shape, STATES))
    for power in (integrals, integrals - 1):
        total = np.zeros_like(square)
        for m in reversed(range(TERMS)):
            total = total * square + 1 / math.factorial(power + 2 * m)
        response[..., integrals - power] = total
    for power in reversed(range(integrals - 1)):
        response[..., integrals - power] = 1 / math.factorial(power) + square * response[..., integrals - 2 - power]
    response *= np.broadcast_to(duration, square.shape)[..., None] ** np.arange(integrals, -1, -1)
    return response


@functools.cache
def _gauss_nodes() -> tuple[Array, Array]:
    """Nodes between 0 and 1 and weights (q,) of Gauss-Legendre quadrature."""
    nodes, weights = np.polynomial.legendre.leggauss(NODES)
    return 0.5 * (nodes + 1), 0.5 * weights


@functools.cache
def _taylor_terms() -> tuple[NDArray[np.int64], Array]:
    """Powers of the duration in `integrator`, and their factors (5, 5)."""
    powers, factors = np.zeros((STATES, STATES), dtype=np.int64), np.zeros((STATES, STATES))
    for i in range(STATES):
        for j in range(i, STATES):
            powers[i, j], factors[i, j] = j - i, 1 / math.factorial(j - i)
    return powers, factors


@functools.cache
def _noise_terms(order: int) -> tuple[NDArray[np.int64], Array]:
    """Powers of the duration in `white_noise`, and their factors (5, 5)."""
    powers, factors = np.zeros((STATES, STATES), dtype=np.int64), np.zeros((STATES, STATES))
    for i in range(order):
        for j in range(order):
            powers[i, j] = power = 2 * order - 1 - i - j
            factors[i, j] = 1 / (math.factorial(order - 1 - i) * math.factorial(order - 1 - j) * power)
    return powers, factors


def _powers(duration: Array) -> Array:
    """Powers 0 to 9 of the duration (..., 10)."""
    factors = np.ones((*duration.shape, 2 * STATES))
    factors[..., 1:] = duration[..., None]
    return np.multiply.accumulate(factors, -1)
