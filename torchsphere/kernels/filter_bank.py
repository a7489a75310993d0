"""Likelihoods of poses under many contacts and intensities: a small Kalman filter for each, in one compiled loop.

A state is pose, rate and acceleration, in contact also the two of the force (`estimation.process_model`). Before the
first contact the filters of one intensity in flight are the same and run once. After the last contact the frames depend
on the state there and on the intensity in flight alone: for each intensity they are reduced to three linear
measurements of that state and the rest of the squares. The reduction is an orthogonal transformation (rotations of
Givens) of the innovations and of their derivatives by the state, because differences of sums of squares would lose
digits.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from torchsphere.kernels.contact_steps import Tables, step
from torchsphere.kernels.jit import Doubles, Integers, compiled

_FLIGHT, _STATES = 3, 5

#: Frames whose variances are multiplied before a logarithm is taken: the product stays within the range of a double.
_FACTORS = 4

#: Rows of a filter's numbers: covariances of the five states (an upper triangle), means, and the sums of logarithms
#: and squares.
_MEAN, _SUMS, _ROWS = 5, 6, 7

#: Rows of what is known of the frames after the contacts: three measurements and the rest of the squares, with the
#: errors at the reference in the last column; then the reference and the sum of the logarithms.
_REFERENCE, _AFTER_ROWS = 4, 5


class Frames(NamedTuple):
    """Poses of k degrees of freedom in t frames of n recordings, in units of their noise."""

    times: Doubles  # (n, t), frames
    value: Doubles  # (n, k, t), read where seen
    variance: Doubles  # variance of the error of each value (n, k, t)
    drift: Doubles  # variance (n, k, t - 1) of errors that stay in all later values
    seen: Any  # (n, k, t), bool


class Hypotheses(NamedTuple):
    """Contacts, c for each of n recordings, with m pairs of intensities for each degree of freedom."""

    windows: Doubles  # (n, c, 2), frames
    forms: Doubles  # (n, c, 6), all 0 for the rough process
    flight: Doubles  # intensities (n, k, c, m)
    contact: Doubles  # intensities (n, k, c, m)


class Limits(NamedTuple):
    """Numbers that `estimation.likelihood` sets."""

    prior_variance: float  # of each state before the first frame
    settling: int  # frames seen after the last contact before all filters share the flight
    shared: int  # fewest frames of a flight that is shared


@compiled
def run(frames: Frames, given: Hypotheses, tables: Tables, limits: Limits, logs: Doubles, squares: Doubles) -> None:
    """Fill the sums (n, k, c, m) of the logarithms of the innovations' variances, and of their squares over these."""
    _, k, c, m = given.flight.shape
    t = frames.times.shape[1]
    room, matrix, added = np.zeros((5, 5, 5)), np.zeros((t, 5, 5)), np.zeros((t, 5, 5))
    powers, which, counts = np.empty((k, c * m)), np.empty((k, c * m), np.int64), np.empty(k, np.int64)
    now, work = np.zeros((_ROWS, _STATES)), np.empty((2, _STATES))
    for n in range(len(frames.times)):
        times = frames.times[n]
        first, last = _touched(times, given.windows[n])
        end = _settled(frames.seen[n], last, limits.settling)
        for freedom in range(k):
            counts[freedom] = _distinct(given.flight[n, freedom], powers[freedom], which[freedom])
        is_shared = t - 1 - end >= limits.shared and 4 * counts.max() <= c * m
        end = end if is_shared else t - 1
        before, after = np.zeros((k, counts.max(), _ROWS, _STATES)), np.zeros((k, counts.max(), _AFTER_ROWS, 4))
        for freedom in range(k):
            for u in range(counts[freedom]):
                _begin(before[freedom, u], limits.prior_variance)
                _fly(frames, n, freedom, -1, first, powers[freedom, u], before[freedom, u], work)
                if is_shared:
                    _reduce(frames, n, freedom, end, powers[freedom, u], after[freedom, u])
        for i in range(c):
            window, form = given.windows[n, i], given.forms[n, i]
            own_first, own_last = _touched(times, given.windows[n, i : i + 1])
            own_first, own_last = min(own_first, end), min(own_last, end)
            for f in range(own_first, own_last):
                step(times[f], times[f + 1], window, form, tables, room, matrix[f], added[f])
            for freedom in range(k):
                for j in range(m):
                    u = which[freedom, i * m + j]
                    flight, contact = powers[freedom, u], given.contact[n, freedom, i, j]
                    _copy(before[freedom, u], now)
                    _fly(frames, n, freedom, first, own_first, flight, now, work)
                    _touch(frames, n, freedom, own_first, own_last, (flight, contact), matrix, added, now, work)
                    _fly(frames, n, freedom, own_last, end, flight, now, work)
                    if is_shared:
                        _add_after(after[freedom, u], now, work)
                    logs[n, freedom, i, j], squares[n, freedom, i, j] = now[_SUMS, 0], now[_SUMS, 1]


@compiled
def _touched(times: Doubles, windows: Doubles) -> Any:
    """First and last frame of the steps that any of the ``windows`` (c, 2) overlaps; the last frame twice if none."""
    first, last = len(times) - 1, -1
    for i in range(len(windows)):
        for f in range(len(times) - 1):
            if min(windows[i, 1], times[f + 1]) > max(windows[i, 0], times[f]):
                first, last = min(first, f), max(last, f + 1)
    return first, max(first, last)


@compiled
def _settled(seen: Any, last: int, frames: int) -> Any:
    """Frame by which the state left unknown at frame ``last`` is known from frames ``seen`` (k, t) since."""
    found = min(last + 1, seen.shape[1] - 1)
    for freedom in range(seen.shape[0]):
        count = 0
        for f in range(last + 1, seen.shape[1]):
            if seen[freedom, f] and count < frames:
                count += 1
                found = max(found, f)
    return found


@compiled
def _distinct(values: Doubles, found: Doubles, which: Integers) -> Any:
    """Number of the distinct values of (c, m), which are ``found`` first, and of which number each is."""
    count, place = 0, 0
    for i in range(values.shape[0]):
        for j in range(values.shape[1]):
            at = 0
            while at < count and found[at] != values[i, j]:
                at += 1
            if at == count:
                found[at] = values[i, j]
                count += 1
            which[place] = at
            place += 1
    return count


@compiled
def _copy(values: Doubles, found: Doubles) -> None:
    for i in range(_ROWS):
        for j in range(_STATES):
            found[i, j] = values[i, j]


@compiled
def _begin(now: Doubles, variance: Any) -> None:
    for a in range(_FLIGHT):
        now[a, a] = variance


@compiled
def _fly(
    frames: Frames, n: int, freedom: int, first: int, last: int, intensity: Any, now: Doubles, work: Doubles
) -> None:
    """Move a filter in flight from frame ``first``, -1 for before all frames, to ``last``, and update it there."""
    product = 1.0
    for f in range(first + 1, last + 1):
        if f > 0:
            _move_in_flight(now, frames.times[n, f] - frames.times[n, f - 1], intensity)
            now[0, 0] += frames.drift[n, freedom, f - 1]
        if frames.seen[n, freedom, f]:
            product *= _update(now, _FLIGHT, frames.value[n, freedom, f], frames.variance[n, freedom, f], work)
        if f % _FACTORS == 0 or f == last:
            now[_SUMS, 0] += np.log(product)
            product = 1.0


@compiled
def _touch(
    frames: Frames,
    n: int,
    freedom: int,
    first: int,
    last: int,
    intensities: Any,
    matrix: Doubles,
    added: Doubles,
    now: Doubles,
    work: Doubles,
) -> None:
    """Move a filter in contact from frame ``first`` to ``last``, by each step's ``matrix`` and covariance ``added``."""
    flight, contact = intensities
    product = 1.0
    for f in range(first, last):
        _move(now, frames.times[n, f + 1] - frames.times[n, f], flight, matrix[f], work)
        for a in range(_STATES):
            for b in range(a, _STATES):
                now[a, b] += contact * added[f, a, b]
        now[0, 0] += frames.drift[n, freedom, f]
        if frames.seen[n, freedom, f + 1]:
            product *= _update(now, _STATES, frames.value[n, freedom, f + 1], frames.variance[n, freedom, f + 1], work)
        if f % _FACTORS == 0 or f == last - 1:
            now[_SUMS, 0] += np.log(product)
            product = 1.0


@compiled
def _move(now: Doubles, duration: Any, intensity: Any, matrix: Doubles, work: Doubles) -> None:
    """Covariances and means of five states after a step, whose ``matrix`` adds a force to the step of a flight."""
    _move_in_flight(now, duration, intensity)
    one, other, last = matrix[3, 3], matrix[3, 4], matrix[4, 4]
    height, both, rate = now[3, 3], now[3, 4], now[4, 4]
    for a in range(_FLIGHT):
        now[_MEAN, a] += matrix[a, 3] * now[_MEAN, 3] + matrix[a, 4] * now[_MEAN, 4]
        by_height = matrix[a, 3] * height + matrix[a, 4] * both
        by_rate = matrix[a, 3] * both + matrix[a, 4] * rate
        work[0, a], work[1, a] = now[a, 3] + 0.5 * by_height, now[a, 4] + 0.5 * by_rate
        by_height, by_rate = now[a, 3] + by_height, now[a, 4] + by_rate
        now[a, 3], now[a, 4] = one * by_height + other * by_rate, last * by_rate
    for a in range(_FLIGHT):
        for b in range(a, _FLIGHT):
            now[a, b] += work[0, a] * matrix[b, 3] + work[1, a] * matrix[b, 4]
            now[a, b] += work[0, b] * matrix[a, 3] + work[1, b] * matrix[a, 4]
    now[3, 3] = one * one * height + 2.0 * one * other * both + other * other * rate
    now[3, 4], now[4, 4] = last * (one * both + other * rate), last * last * rate
    now[_MEAN, 3] = one * now[_MEAN, 3] + other * now[_MEAN, 4]
    now[_MEAN, 4] *= last


@compiled
def _move_in_flight(now: Doubles, duration: Any, intensity: Any) -> None:
    """Covariances, also those with the states of a force, and means of pose, rate and acceleration after a step."""
    half = 0.5 * duration * duration
    now[_MEAN, 0] += duration * now[_MEAN, 1] + half * now[_MEAN, 2]
    now[_MEAN, 1] += duration * now[_MEAN, 2]
    now[0, 0] += duration * (now[0, 1] + now[0, 1] + duration * now[1, 1]) + half * (now[0, 2] + now[0, 2])
    now[0, 0] += half * (2.0 * duration * now[1, 2] + half * now[2, 2])
    now[0, 1] += duration * (now[0, 2] + now[1, 1] + duration * now[1, 2]) + half * (now[1, 2] + duration * now[2, 2])
    now[0, 2] += duration * now[1, 2] + half * now[2, 2]
    now[1, 1] += duration * (2.0 * now[1, 2] + duration * now[2, 2])
    now[1, 2] += duration * now[2, 2]
    for b in range(_FLIGHT, _STATES):
        now[0, b] += duration * now[1, b] + half * now[2, b]
        now[1, b] += duration * now[2, b]
    _add_white(now, duration, intensity)


@compiled
def _add_white(now: Doubles, duration: Any, intensity: Any) -> None:
    """Add what white jerk adds to the covariances of pose, rate and acceleration."""
    one = intensity * duration
    two = one * duration
    three = two * duration
    four = three * duration
    now[0, 0] += four * duration / 20.0
    now[0, 1] += four / 8.0
    now[0, 2] += three / 6.0
    now[1, 1] += three / 3.0
    now[1, 2] += two / 2.0
    now[2, 2] += one


@compiled
def _update(now: Doubles, states: int, value: Any, noise: Any, work: Doubles) -> Any:
    """Kalman update by a measured pose, and the variance of its innovation, whose square the filter adds up."""
    variance = now[0, 0] + noise
    share = 1.0 / variance
    innovation = value - now[_MEAN, 0]
    now[_SUMS, 1] += innovation * innovation * share
    for a in range(states):
        work[0, a] = now[0, a]
    for a in range(states):
        gain = work[0, a] * share
        now[_MEAN, a] += gain * innovation
        for b in range(a, states):
            now[a, b] -= gain * work[0, b]
    return variance


@compiled
def _reduce(frames: Frames, n: int, freedom: int, last: int, intensity: Any, found: Doubles) -> None:
    """Measurements that the frames after ``last`` are of the state there, relative to a reference near the true one."""
    _refer(frames, n, freedom, last, found[_REFERENCE])
    now, work, product = np.zeros((_ROWS, _STATES)), np.empty((2, _STATES)), 1.0
    # Means from the reference, and the derivatives of means by the state at the start.
    means, row = np.zeros((4, _FLIGHT)), np.empty(4)
    for a in range(_FLIGHT):
        means[a, a], means[_FLIGHT, a] = 1.0, found[_REFERENCE, a]
    for f in range(last + 1, frames.times.shape[1]):
        duration = frames.times[n, f] - frames.times[n, f - 1]
        _move_in_flight(now, duration, intensity)
        now[0, 0] += frames.drift[n, freedom, f - 1]
        for i in range(4):
            means[i, 0] += duration * (means[i, 1] + 0.5 * duration * means[i, 2])
            means[i, 1] += duration * means[i, 2]
        if frames.seen[n, freedom, f]:
            # The filter's own mean and measured values are 0; it leaves the covariances with the pose in ``work``.
            variance = _update(now, _FLIGHT, 0.0, frames.variance[n, freedom, f], work)
            for i in range(4):
                innovation = (frames.value[n, freedom, f] if i == _FLIGHT else 0.0) - means[i, 0]
                row[i] = innovation / np.sqrt(variance)
                for a in range(_FLIGHT):
                    means[i, a] += work[0, a] / variance * innovation
            _rotate(found, row)
            product *= variance
        if f % _FACTORS == 0 or f == frames.times.shape[1] - 1:
            found[_REFERENCE, _FLIGHT] += np.log(product)
            product = 1.0


@compiled
def _refer(frames: Frames, n: int, freedom: int, last: int, found: Doubles) -> None:
    """Pose and rate at frame ``last`` of a straight line through the first pose seen since and near the others."""
    base, ahead, total = -1, 0.0, 0.0
    for f in range(last + 1, frames.times.shape[1]):
        if frames.seen[n, freedom, f]:
            base = f if base < 0 else base
            elapsed = frames.times[n, f] - frames.times[n, base]
            ahead += elapsed * (frames.value[n, freedom, f] - frames.value[n, freedom, base])
            total += elapsed * elapsed
    if base >= 0:
        found[1] = ahead / total if total > 0.0 else 0.0
        found[0] = frames.value[n, freedom, base] - found[1] * (frames.times[n, base] - frames.times[n, last])


@compiled
def _rotate(found: Doubles, row: Doubles) -> None:
    """Rotations of Givens that take a row into the upper triangle (4, 4)."""
    for a in range(4):
        length = np.sqrt(found[a, a] * found[a, a] + row[a] * row[a])
        if length > 0.0:
            cosine, sine = found[a, a] / length, row[a] / length
            for b in range(a, 4):
                kept, other = found[a, b], row[b]
                found[a, b], row[b] = cosine * kept + sine * other, cosine * other - sine * kept


@compiled
def _add_after(after: Doubles, now: Doubles, work: Doubles) -> None:
    """Add to the sums the innovations of the frames after the last contact (`_reduce`); the state is used up."""
    now[_SUMS, 0] += after[_REFERENCE, _FLIGHT]
    now[_SUMS, 1] += after[_FLIGHT, _FLIGHT] * after[_FLIGHT, _FLIGHT]
    for a in range(_FLIGHT):
        now[_MEAN, a] -= after[_REFERENCE, a]
        for b in range(a):
            now[a, b] = now[b, a]
    product = 1.0
    for back in range(_FLIGHT):
        i = _FLIGHT - 1 - back
        innovation, variance = after[i, _FLIGHT], 1.0
        for a in range(_FLIGHT):
            innovation += after[i, a] * now[_MEAN, a]
            work[0, a] = 0.0
            for b in range(_FLIGHT):
                work[0, a] += now[a, b] * after[i, b]
        for a in range(_FLIGHT):
            variance += after[i, a] * work[0, a]
        product *= variance
        now[_SUMS, 1] += innovation * innovation / variance
        for a in range(_FLIGHT):
            gain, ahead = work[0, a] / variance, 0.0
            now[_MEAN, a] -= gain * innovation
            # Joseph's form, because a difference of covariances would be all rounding.
            for b in range(_FLIGHT):
                now[a, b] -= gain * work[0, b]
            for b in range(_FLIGHT):
                ahead += now[a, b] * after[i, b]
            for b in range(_FLIGHT):
                now[a, b] += (gain - ahead) * work[0, b] / variance
    now[_SUMS, 0] += np.log(product)
