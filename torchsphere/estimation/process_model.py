"""Process models of the ball's motion: steady in flight, with a force of a rough or of a given form in contact.

The state of a degree of freedom is (pose, rate, acceleration) in flight, and two more in contact. In flight the jerk is
white noise of small intensity. In the rough process the jerk is a state of unknown initial size, its derivative white
noise, and the fifth state is not used. In a process with a form (`force_forms`) the contact adds the envelope times a
height to the acceleration, which stays that of the flight; fourth and fifth state are the height and its rate, whose
derivative is white noise. The envelope is 0 at both ends, so that the force ends with the contact.

An intensity has the same meaning in all processes: times the cube of the contact's duration it is the variance of the
force's size. Of it the ``roughness`` of a form is the share by which the height changes within the contact.

The smoother overstates its errors for a force without noise: of the stated variance of the k-th derivative the share
(2 m - 2 k - 1) / 2 m comes from white noise in the m-th derivative, for the acceleration (m = 4, k = 2) three eighths.
"""

from __future__ import annotations

import functools
import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from torchsphere.estimation import force_forms
from torchsphere.kernels import contact_steps as loops
from torchsphere.runtime.arrays import Array

#: States of flight (pose, rate, acceleration), of the rough process (jerk) and of a form (height and its rate).
FLIGHT_STATES, ROUGH_STATES, STATES = 3, 4, 5

#: Variance of a state before the first measurement, in units of the noise's (docs/constants.toml).
PRIOR_VARIANCE = 1e8

#: Variance of the height's change over the contact that needs no noise, per roughness (docs/constants.toml).
SLOPE_VARIANCE = 4.0

#: Gauss nodes of the integrals over a step (docs/constants.toml).
NODES = 6


@dataclass(frozen=True)
class Transitions:
    """From each frame to the next, for n recordings and c contact intervals each; units of frames."""

    matrix: Array  # (n, c, t - 1, 5, 5) of the state; without the last two states in flight
    contact: Array  # covariance (n, c, t - 1, 5, 5) that the contact adds, per unit intensity
    flight: Array  # covariance (n, 1, t - 1, 5, 5) that white jerk adds in flight and contact, per unit intensity
    idle: NDArray[np.bool_]  # (n, c, t - 1), True where the last two states have no meaning after the transition
    envelope: Array  # (n, c, t) of the forms at the frames: times the height what the force adds to the acceleration


def overlaps(times: Array, windows: Array) -> NDArray[np.bool_]:
    """Mask (n, c, t - 1) of the steps between ``times`` (n, t) that the intervals ``windows`` (n, c, 2) overlap."""
    before, after = times[:, None, :-1], times[:, None, 1:]
    return np.asarray(np.minimum(windows[..., 1:], after) > np.maximum(windows[..., :1], before))


def transitions(times: Array, windows: Array, forms: Array | None) -> Transitions:
    """Transitions between ``times`` (n, t), frames, under contact intervals ``windows`` (n, c, 2), start and end.

    An interval may start and end between frames; an interval of length 0 is no contact. ``forms`` (n, c, 6) are those
    of the force, None for the rough process.
    """
    shape = (*windows.shape[:2], times.shape[1] - 1, STATES, STATES)
    matrix, contact = np.zeros(shape), np.zeros(shape)
    given = np.zeros((*shape[:2], len(force_forms.NAMES))) if forms is None else forms
    loops.steps(*map(np.ascontiguousarray, (times, windows, given)), step_tables(), matrix, contact)
    idle = (windows[..., 1:] <= times[:, None, 1:]) | ~overlaps(times, windows)
    envelope = np.zeros((*windows.shape[:2], times.shape[1]))
    if forms is not None:
        length = windows[..., 1:] - windows[..., :1]
        passed = (times[:, None] - windows[..., :1]) / np.where(length > 0, length, 1.0)
        envelope = np.where(length > 0, force_forms.envelope(passed, forms), 0.0)
    return Transitions(matrix, contact, white_noise(np.diff(times)[:, None], FLIGHT_STATES), idle, envelope)


@functools.cache
def step_tables() -> loops.Tables:
    """What the loops over steps look up."""
    nodes, weights = np.polynomial.legendre.leggauss(NODES)
    part = slice(ROUGH_STATES), slice(ROUGH_STATES)
    return loops.Tables(
        nodes=np.stack((0.5 * (nodes + 1), 0.5 * weights)),
        hertz=force_forms.hertz_over_sine(),
        taylor=_taylor_terms()[1],
        snap=np.ascontiguousarray(_noise_terms(ROUGH_STATES)[1][part]),
        slope_variance=SLOPE_VARIANCE,
    )


def end_variance() -> float:
    """Variance of the acceleration at the end of a contact of length 1, per unit intensity of the rough process."""
    # The first jerk has the variance 1, and acts as long as the contact lasts.
    noise = white_noise(np.ones(1), ROUGH_STATES)[0, FLIGHT_STATES - 1, FLIGHT_STATES - 1]
    return float(1.0 + noise)


def flight_matrix(duration: Array) -> Array:
    """The `integrator` of flight: without the last two states before and after."""
    return integrator(duration) * (np.arange(STATES) < FLIGHT_STATES)


def integrator(duration: Array) -> Array:
    """State after ``duration`` (...) per state before, (..., 5, 5), by Taylor's series."""
    powers, factors = _taylor_terms()
    return _powers(duration)[..., powers] * factors


def white_noise(duration: Array, order: int) -> Array:
    """Covariance (..., 5, 5) that white noise of unit intensity adds to ``order`` integrals over ``duration`` (...)."""
    powers, factors = _noise_terms(order)
    return _powers(duration)[..., powers] * factors


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
