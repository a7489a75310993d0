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

Array = NDArray[np.float64]

#: States of flight (pose, rate, acceleration), of the rough process (jerk) and of a form (height and its rate).
FLIGHT_STATES, ROUGH_STATES, STATES = 3, 4, 5

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
    def of(cls, times: Array, windows: Array, forms: Array | None) -> ContactSteps:
        """Transitions for the arguments of `transitions`."""
        before, after = times[:, None, :-1], times[:, None, 1:]
        start, end = windows[..., :1], windows[..., 1:]
        touching = overlaps(times, windows)
        edges = touching & ((start >= before) | (end <= after))
        whole = _inside_steps(before, after, windows, forms)
        form = None if forms is None else np.broadcast_to(forms[:, :, None], (*edges.shape, forms.shape[-1]))[edges]
        before, after, start, end = (np.broadcast_to(v, edges.shape)[edges] for v in (before, after, start, end))
        starts, ends = start >= before, end <= after
        moments = np.maximum(start, before) - start, np.minimum(end, after) - start
        inside, noise = _contact_step(*moments, end - start, form)
        begin = np.where(starts[:, None, None], flight_matrix(start - before), np.eye(STATES))
        finish = np.where(ends[:, None, None], flight_matrix(after - end), np.eye(STATES))
        initial = _initial_covariance(np.where(starts, end - start, 0.0), form)
        noise = finish @ (noise + inside @ initial @ inside.swapaxes(-1, -2)) @ finish.swapaxes(-1, -2)
        return cls(touching & ~edges, edges, finish @ inside @ begin, noise, *whole)


def _inside_steps(before: Array, after: Array, windows: Array, forms: Array | None) -> tuple[Array, Array]:
    """Matrices and covariances (n, c or 1, t - 1 or 1, 5, 5) of the steps inside the contacts."""
    duration = after - before
    if forms is None:
        # The rough process does not depend on the time since the start.
        even = (duration == duration[..., :1]).all()
        return (
            _contact_step(0.0 * duration[..., :1], duration[..., :1], None, None)
            if even
            else _contact_step(0.0 * duration, duration, None, None)
        )
    start, length = windows[..., :1], windows[..., 1:] - windows[..., :1]
    return _contact_step(before - start, after - start, length, forms[:, :, None])


def overlaps(times: Array, windows: Array) -> NDArray[np.bool_]:
    """Mask (n, c, t - 1) of the steps between ``times`` (n, t) that the intervals ``windows`` (n, c, 2) overlap."""
    before, after = times[:, None, :-1], times[:, None, 1:]
    return np.asarray(np.minimum(windows[..., 1:], after) > np.maximum(windows[..., :1], before))


def transitions(times: Array, windows: Array, forms: Array | None) -> Transitions:
    """Transitions between ``times`` (n, t), frames, under contact intervals ``windows`` (n, c, 2), start and end.

    An interval may start and end between frames; an interval of length 0 is no contact. ``forms`` (n, c, 6) are those
    of the force, None for the rough process.
    """
    duration = np.diff(times)[:, None]
    steps = ContactSteps.of(times, windows, forms)
    is_inside = steps.is_inside[..., None, None]
    matrix = np.where(is_inside, steps.inside_matrix, flight_matrix(duration))
    contact = np.where(is_inside, steps.inside_noise, 0.0)
    matrix[steps.is_edge], contact[steps.is_edge] = steps.edge_matrix, steps.edge_noise
    idle = (windows[..., 1:] <= times[:, None, 1:]) | ~(steps.is_inside | steps.is_edge)
    envelope = np.zeros((*windows.shape[:2], times.shape[1]))
    if forms is not None:
        length = windows[..., 1:] - windows[..., :1]
        passed = (times[:, None] - windows[..., :1]) / np.where(length > 0, length, 1.0)
        envelope = np.where(length > 0, force_forms.envelope(passed, forms), 0.0)
    return Transitions(matrix, contact, white_noise(duration, FLIGHT_STATES), idle, envelope)


def _contact_step(begin: Array, end: Array, length: Array | None, forms: Array | None) -> tuple[Array, Array]:
    """Matrix and noise covariance (..., 5, 5) from ``begin`` to ``end`` (...), since the start of the contact.

    The contacts have the lengths ``length`` (...) and the ``forms`` (..., 6), or the rough process.
    """
    if length is None or forms is None:
        return integrator(end - begin), white_noise(end - begin, ROUGH_STATES)
    begin, end, length = np.broadcast_arrays(begin, end, length)
    # An interval of length 0 is no contact; its steps are not used.
    length = np.where(length > 0, length, 1.0)
    duration = end - begin
    nodes, weights = _gauss_nodes()
    passed = duration[..., None] * nodes
    moments = begin[..., None] + np.concatenate((passed, duration[..., None]), -1)
    envelope = force_forms.envelope(moments / length[..., None], forms)
    own, last = envelope[..., :-1], envelope[..., -1:]
    weighted = own * (duration[..., None] * weights)
    left = duration[..., None] - passed
    matrix = flight_matrix(duration)
    height, rate = STATES - 2, STATES - 1
    matrix[..., 0, height], matrix[..., 1, height] = (weighted * left).sum(-1), weighted.sum(-1)
    matrix[..., 0, rate], matrix[..., 1, rate] = (weighted * left * passed).sum(-1), (weighted * passed).sum(-1)
    _add_kinks(matrix, begin, duration, length, forms)
    matrix[..., height, height] = matrix[..., rate, rate] = 1.0
    matrix[..., height, rate] = duration
    # What a unit of the height's rate from a node on becomes, the envelope taken as linear from there to the end.
    slope = (last - own) / np.where(left > 0, left, 1.0)
    response = np.stack(
        (
            own * left**3 / 6 + slope * left**4 / 12,
            own * left**2 / 2 + slope * left**3 / 3,
            np.zeros_like(left),
            left,
            np.ones_like(left),
        ),
        -2,
    )
    roughness = forms[..., force_forms.ROUGHNESS, None]
    noise = (response * (duration[..., None] * weights * roughness)[..., None, :]) @ response.swapaxes(-1, -2)
    return matrix, noise


def _add_kinks(matrix: Array, begin: Array, duration: Array, length: Array, forms: Array) -> None:
    """Add to the matrices (..., 5, 5) what Gauss nodes miss in a step in which the envelope has a kink.

    A kink is a ramp of the change of slope that begins within the step; polynomials are exact at the nodes.
    """
    forms = np.broadcast_to(forms, (*begin.shape, forms.shape[-1]))
    risen, falling = forms[..., force_forms.RISEN], forms[..., force_forms.FALLING]
    nodes, weights = _gauss_nodes()
    for kink, part in ((risen, risen), (falling, 1 - falling)):
        moment = kink * length - begin
        here = (risen > 0) & (moment > 0) & (moment < duration)
        slope = -1 / (part[here] * length[here])
        moment, whole = moment[here], duration[here]
        rest = whole - moment
        passed = whole[:, None] * nodes
        ramp = np.maximum(passed - moment[:, None], 0.0) * whole[:, None] * weights
        left = whole[:, None] - passed
        height, rate = STATES - 2, STATES - 1
        matrix[here, 0, height] += slope * (rest**3 / 6 - (ramp * left).sum(-1))
        matrix[here, 1, height] += slope * (rest**2 / 2 - ramp.sum(-1))
        matrix[here, 0, rate] += slope * (rest**4 / 12 + moment * rest**3 / 6 - (ramp * left * passed).sum(-1))
        matrix[here, 1, rate] += slope * (rest**3 / 3 + moment * rest**2 / 2 - (ramp * passed).sum(-1))


def _initial_covariance(length: Array, forms: Array | None) -> Array:
    """Covariance (..., 5, 5) of the states at the start of a contact of that length (...), per unit intensity.

    The contact's own duration ties the first jerk, or the height, to the intensity, so that they need no parameter.
    """
    covariance = np.zeros((*length.shape, STATES, STATES))
    height, rate = STATES - 2, STATES - 1
    if forms is None:
        covariance[..., height, height] = length
        return covariance
    # The height is of unit variance in the middle of the contact, and changes from there to both sides.
    change = SLOPE_VARIANCE * forms[..., force_forms.ROUGHNESS]
    covariance[..., height, height] = (1 + change / 4) * length**3
    covariance[..., height, rate] = covariance[..., rate, height] = -change / 2 * length**2
    covariance[..., rate, rate] = change * length
    return covariance


def end_variance() -> float:
    """Variance of the acceleration at the end of a contact of length 1, per unit intensity of the rough process."""
    one = np.ones(1)
    matrix, noise = integrator(one), white_noise(one, ROUGH_STATES)
    covariance = noise + matrix @ _initial_covariance(one, None) @ matrix.swapaxes(-1, -2)
    return float(covariance[0, FLIGHT_STATES - 1, FLIGHT_STATES - 1])


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
