"""Steps of a process with a force in contact, for `estimation.process_model`, and envelopes of its forms, in loops.

A form is (onset, decay, risen, falling, roughness, is_hertz): see `estimation.force_forms`.
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np

from torchsphere.kernels.jit import Doubles, compiled

_FLIGHT, _HEIGHT, _RATE, _STATES = 3, 3, 4, 5

#: Places of the numbers in a form.
_ONSET, _DECAY, _RISEN, _FALLING, _ROUGHNESS, _HERTZ = range(6)


class Tables(NamedTuple):
    """What all steps look up."""

    nodes: Doubles  # Gauss nodes between 0 and 1, and their weights (2, q)
    hertz: Doubles  # (p,), the force of Hertz over a sine to its power, at even shares of 0 to 0.5 of the contact
    taylor: Doubles  # (5, 5), factors of the durations' powers in a matrix without force
    snap: Doubles  # (4, 4), those in the covariance of white snap
    slope_variance: float  # of the height over the contact, per roughness


@compiled
def envelopes(shares: Doubles, forms: Doubles, hertz: Doubles, found: Doubles) -> None:
    """Force (b, m) over its height at shares (b, m) of the contact, of forms (b, 6); 0 before and after."""
    for i in range(shares.shape[0]):
        peak = _peak(forms[i])
        for j in range(shares.shape[1]):
            found[i, j] = _envelope(shares[i, j], forms[i], peak, hertz)


@compiled
def _envelope(share: Any, form: Doubles, peak: Any, hertz: Doubles) -> Any:
    if not 0.0 <= share <= 1.0:
        return 0.0 * share  # what is no number stays none, and makes no index
    onset, decay, risen, falling = form[_ONSET], form[_DECAY], form[_RISEN], form[_FALLING]
    if onset == decay:
        level = _power(0.5 * math.sin(math.pi * share), onset) / peak
    else:
        level = _power(math.sin(0.5 * math.pi * share), onset) * _power(math.cos(0.5 * math.pi * share), decay) / peak
    if form[_HERTZ] > 0.0:
        place = (0.5 - abs(share - 0.5)) * 2.0 * (len(hertz) - 1)
        node = min(int(place), len(hertz) - 2)
        level *= hertz[node] + (place - node) * (hertz[node + 1] - hertz[node])
    straight = 1.0
    if risen > 0.0:
        straight = min(straight, share / risen)
    if falling < 1.0:
        straight = min(straight, (1.0 - share) / (1.0 - falling))
    return level * straight


@compiled
def _peak(form: Doubles) -> Any:
    """Highest value of the product of powers of sine and cosine in an envelope."""
    onset, decay = form[_ONSET], form[_DECAY]
    total = max(onset + decay, 1e-9)
    return _power(math.sqrt(onset / total), onset) * _power(math.sqrt(decay / total), decay)


@compiled
def _power(value: Any, power: Any) -> Any:
    """A value of 0 to 1 to a power: of the rounding below 0, 0; to the power 0, 1."""
    return 1.0 if power <= 0.0 else max(value, 0.0) ** power


@compiled
def steps(
    times: Doubles, windows: Doubles, forms: Doubles, tables: Tables, matrix: Doubles, covariance: Doubles
) -> None:
    """Fill the matrices and covariances (n, c, t - 1, 5, 5) of the steps between ``times`` (n, t).

    The contacts last over ``windows`` (n, c, 2) and have the ``forms`` (n, c, 6), all 0 for the rough process.
    """
    room = np.zeros((5, _STATES, _STATES))
    for n in range(matrix.shape[0]):
        for c in range(matrix.shape[1]):
            for i in range(matrix.shape[2]):
                into, added = matrix[n, c, i], covariance[n, c, i]
                step(times[n, i], times[n, i + 1], windows[n, c], forms[n, c], tables, room, into, added)


@compiled
def step(
    before: Any,
    after: Any,
    window: Doubles,
    form: Doubles,
    tables: Tables,
    room: Doubles,
    into: Doubles,
    added: Doubles,
) -> None:
    """Fill the matrix ``into`` (5, 5), and the covariance ``added``, of one step; there is ``room`` (5, 5, 5)."""
    initial, begin, finish, inside, work = room[0], room[1], room[2], room[3], room[4]
    start, end, is_formed = window[0], window[1], form[_ROUGHNESS] > 0.0
    into[:], added[:] = 0.0, 0.0
    if min(end, after) <= max(start, before):
        _flight(after - before, into)
        return
    first, last = max(start, before) - start, min(end, after) - start
    if is_formed:
        _formed(first, last, end - start, form, tables, into, added)
    else:
        _rough(last - first, tables, into, added)
    if start >= before:
        initial[:] = 0.0
        _start(end - start, form, is_formed, tables.slope_variance, initial)
        _product(into, initial, work)
        _add_product_transposed(work, into, added)
        _copy(into, inside)
        _flight(start - before, begin)
        _product(inside, begin, into)
    if end <= after:
        _flight(after - end, finish)
        _copy(into, inside)
        _product(finish, inside, into)
        _product(finish, added, work)
        added[:] = 0.0
        _add_product_transposed(work, finish, added)


@compiled
def _flight(duration: Any, found: Doubles) -> None:
    """State after a duration per state before, without force: the last two states have no meaning."""
    for a in range(_FLIGHT):
        found[a, a] = 1.0
    found[0, 1] = found[1, 2] = duration
    found[0, 2] = 0.5 * duration * duration


@compiled
def _rough(duration: Any, tables: Tables, matrix: Doubles, covariance: Doubles) -> None:
    """Step of the process whose jerk is a state and has white noise as derivative."""
    for a in range(_STATES):
        for b in range(a, _STATES):
            matrix[a, b] = tables.taylor[a, b] * duration ** (b - a)
    size = len(tables.snap)
    for a in range(size):
        for b in range(size):
            covariance[a, b] = tables.snap[a, b] * duration ** (2 * size - 1 - a - b)


@compiled
def _formed(
    first: Any, last: Any, length: Any, form: Doubles, tables: Tables, matrix: Doubles, covariance: Doubles
) -> None:
    """Step from ``first`` to ``last``, since the start of a contact whose force has a form."""
    duration, roughness, peak = last - first, form[_ROUGHNESS], _peak(form)
    at_end = _envelope(last / length, form, peak, tables.hertz)
    _flight(duration, matrix)
    matrix[_HEIGHT, _HEIGHT] = matrix[_RATE, _RATE] = 1.0
    matrix[_HEIGHT, _RATE] = duration
    for k in range(tables.nodes.shape[1]):
        passed = duration * tables.nodes[0, k]
        left, weight = duration - passed, duration * tables.nodes[1, k]
        own = _envelope((first + passed) / length, form, peak, tables.hertz)
        _add_force(own * weight, passed, left, matrix)
        # What a unit of the height's rate from here on becomes, the envelope taken as linear from here to the end.
        slope = (at_end - own) / left
        position = own * left**3 / 6 + slope * left**4 / 12
        velocity = own * left**2 / 2 + slope * left**3 / 3
        response = (position, velocity, 0.0, left, 1.0)
        for a in range(_STATES):
            for b in range(_STATES):
                covariance[a, b] += weight * roughness * response[a] * response[b]
    risen, falling = form[_RISEN], form[_FALLING]
    if risen > 0.0:
        _add_kink(first, duration, length, risen, risen, tables, matrix)
        _add_kink(first, duration, length, falling, 1.0 - falling, tables, matrix)


@compiled
def _add_force(area: Any, passed: Any, left: Any, matrix: Doubles) -> None:
    """Add an envelope of that ``area`` at one moment, with the time ``passed`` before and ``left`` after it."""
    matrix[0, _HEIGHT] += area * left
    matrix[1, _HEIGHT] += area
    matrix[0, _RATE] += area * left * passed
    matrix[1, _RATE] += area * passed


@compiled
def _add_kink(first: Any, duration: Any, length: Any, kink: Any, part: Any, tables: Tables, matrix: Doubles) -> None:
    """Add what Gauss nodes miss of a kink at the share ``kink``, with the change of slope 1 over the ``part``.

    A kink is a ramp that begins within the step; polynomials are exact at the nodes.
    """
    moment = kink * length - first
    if moment <= 0.0 or moment >= duration:
        return
    slope, rest = -1.0 / (part * length), duration - moment
    matrix[0, _HEIGHT] += slope * rest**3 / 6
    matrix[1, _HEIGHT] += slope * rest**2 / 2
    matrix[0, _RATE] += slope * (rest**4 / 12 + moment * rest**3 / 6)
    matrix[1, _RATE] += slope * (rest**3 / 3 + moment * rest**2 / 2)
    for k in range(tables.nodes.shape[1]):
        passed = duration * tables.nodes[0, k]
        ramp = max(passed - moment, 0.0) * duration * tables.nodes[1, k]
        _add_force(-slope * ramp, passed, duration - passed, matrix)


@compiled
def _start(length: Any, form: Doubles, is_formed: bool, slope_variance: Any, found: Doubles) -> None:
    """Covariance of the last two states at the start of a contact, per unit intensity.

    The contact's own length ties the first jerk, or the height, to the intensity, so that they need no parameter.
    """
    if not is_formed:
        found[_HEIGHT, _HEIGHT] = length
        return
    # The height is of unit variance in the middle of the contact, and changes from there to both sides.
    change = slope_variance * form[_ROUGHNESS]
    found[_HEIGHT, _HEIGHT] = (1 + change / 4) * length**3
    found[_HEIGHT, _RATE] = found[_RATE, _HEIGHT] = -change / 2 * length**2
    found[_RATE, _RATE] = change * length


@compiled
def _copy(values: Doubles, found: Doubles) -> None:
    for i in range(_STATES):
        for j in range(_STATES):
            found[i, j] = values[i, j]


@compiled
def _product(a: Doubles, b: Doubles, found: Doubles) -> None:
    found[:] = 0.0
    for i in range(_STATES):
        for k in range(_STATES):
            for j in range(_STATES):
                found[i, j] += a[i, k] * b[k, j]


@compiled
def _add_product_transposed(a: Doubles, b: Doubles, found: Doubles) -> None:
    for i in range(_STATES):
        for k in range(_STATES):
            for j in range(_STATES):
                found[i, j] += a[i, k] * b[j, k]
