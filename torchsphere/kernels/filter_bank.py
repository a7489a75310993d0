"""Many small Kalman filters in compiled loops, some columns through all frames at a time, so that they stay in cache.

The rows of a filter go by its states: for each state its covariances with itself and the later states, then its means.
Means are negative, and that of the pose is relative to the measured value of the frame, so that an innovation is a row
like the others. Several values with the same covariance have a row of means each.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from torchsphere.kernels.jit import Doubles, Integers, compiled

#: Instead of the number of a step in `Steps.own`: that of a flight, which all rows share, and none.
IN_FLIGHT, NO_STEP = -1, -2

#: Columns that are filtered at a time: twenty rows of them, twice, fill half of a core's first cache.
WIDTH = 64

#: Frames whose variances are multiplied before a logarithm is taken: the product stays within the range of a double.
_FACTORS = 4

#: Rows of what is kept of the columns at work: sums, the product of variances, 1 over a variance, and a state's gains.
_LOGS, _SQUARES, _PRODUCT, _SHARE, _GAIN = range(5)


class Steps(NamedTuple):
    """Steps of b filters to f frames; g of them are a contact's, and differ from row to row."""

    states: Integers  # (f,), number of states in each frame
    own: Integers  # (f,), number of the contact's step that leads there, or `IN_FLIGHT`, or `NO_STEP`
    flight: Doubles  # (f, 3, 3), matrix in flight
    white: Doubles  # (f, 5, 5), covariance per unit of the intensity in flight
    matrix: Doubles  # (b, g, 5, 5), matrix in contact
    contact: Doubles  # (b, g, 5, 5), covariance per unit of the intensity in contact


class Observations(NamedTuple):
    """Measured values of f frames, for k degrees of freedom of n recordings."""

    noise: Doubles  # variance of the error of each value (f, n, k)
    drift: Doubles  # what the pose's variance gains from the frame before (f, n, k); unused in the first frame
    change: Doubles  # what the value gains (f, n, k); unused in the first frame
    seen: Doubles  # (f, n, k), 1 where the value was seen, else 0


class Bank(NamedTuple):
    """Filters of b rows with s columns, those of a degree of freedom side by side; the state changes in place."""

    state: Doubles  # (rows, b, s)
    flight: Doubles  # intensities (b, s)
    contact: Doubles  # intensities (b, s), not read where there is no contact
    recordings: Integers  # (b,), number of the recording of each row
    values: int  # values that are filtered by the same covariance
    logs: Doubles  # sums (b, s) of the logarithms of the innovations' variances
    squares: Doubles  # sums (b, s) of the squares of the first value's innovations in units of the variances
    whitened: Doubles  # innovations (f, values, b, s) in units of their standard deviation, or empty


@compiled
def run(bank: Bank, states: int, steps: Steps, seen: Observations) -> None:
    """Move the filters, of so many ``states``, from frame to frame, and update them by what was observed there."""
    rows, b, s = bank.state.shape
    begin, each = states, s // seen.noise.shape[2]
    for i in range(b):
        n = bank.recordings[i]
        for at in range(0, s, WIDTH):
            width = min(WIDTH, s - at)
            flight, contact = bank.flight[i, at : at + width], bank.contact[i, at : at + width]
            old, new, work = np.empty((rows, width)), np.empty((rows, width)), np.empty((5, width))
            _copy(bank.state, i, at, old)
            work[_LOGS], work[_SQUARES], work[_PRODUCT], states = 0.0, 0.0, 1.0, begin
            for f in range(len(steps.states)):
                own = steps.own[f]
                if own != NO_STEP:
                    matrix = steps.flight[f] if own == IN_FLIGHT else steps.matrix[i, own]
                    _move(old, matrix, states, steps.states[f], bank.values, new)
                    states = steps.states[f]
                    _add_noise(steps.white[f], flight, states, bank.values, new)
                    if own != IN_FLIGHT:
                        _add_noise(steps.contact[i, own], contact, states, bank.values, new)
                    for j in range(width):
                        new[0, j] += seen.drift[f, n, (at + j) // each]
                        new[states, j] += seen.change[f, n, (at + j) // each]
                    old, new = new, old
                _compare(old, states, seen.noise[f, n], seen.seen[f, n], at, each, work)
                if f % _FACTORS == _FACTORS - 1:
                    _take_logarithm(work)
                if bank.whitened.size > 0:
                    for value in range(bank.values):
                        for j in range(width):
                            bank.whitened[f, value, i, at + j] = old[states + value, j] * np.sqrt(work[_SHARE, j])
                _update(old, states, bank.values, work)
            _take_logarithm(work)
            for j in range(width):
                bank.logs[i, at + j], bank.squares[i, at + j] = work[_LOGS, j], work[_SQUARES, j]
                for row in range(rows):
                    bank.state[row, i, at + j] = old[row, j]


@compiled
def _copy(state: Doubles, i: int, at: int, found: Doubles) -> None:
    for row in range(found.shape[0]):
        for j in range(found.shape[1]):
            found[row, j] = state[row, i, at + j]


@compiled
def _compare(old: Doubles, states: int, noise: Doubles, seen: Doubles, at: int, each: int, work: Doubles) -> None:
    """Add the innovations to the sums of ``work``, and leave there 1 over their variances, or 0 where none was seen."""
    for j in range(work.shape[1]):
        freedom = (at + j) // each
        is_seen = seen[freedom] > 0.0
        variance = old[0, j] + noise[freedom] if is_seen else 1.0
        share = 1.0 / variance if is_seen else 0.0
        work[_PRODUCT, j] *= variance
        work[_SQUARES, j] += old[states, j] * old[states, j] * share
        work[_SHARE, j] = share


@compiled
def _take_logarithm(work: Doubles) -> None:
    for j in range(work.shape[1]):
        work[_LOGS, j] += np.log(work[_PRODUCT, j])
        work[_PRODUCT, j] = 1.0


@compiled
def _move(old: Doubles, matrix: Doubles, before: int, after: int, values: int, new: Doubles) -> None:
    """Covariances and means of ``after`` states from those of the states ``before``."""
    row = 0
    for a in range(after):
        for b in range(a, after):
            new[row] = 0.0
            at = 0
            for c in range(before):
                _add(matrix[a, c] * matrix[b, c], old[at], new[row])
                for d in range(c + 1, before):
                    _add(matrix[a, c] * matrix[b, d] + matrix[a, d] * matrix[b, c], old[at + d - c], new[row])
                at += before - c + values
            row += 1
        for value in range(values):
            new[row] = 0.0
            at = 0
            for c in range(before):
                at += before - c + values
                _add(matrix[a, c], old[at - values + value], new[row])
            row += 1


@compiled
def _add_noise(covariance: Doubles, intensities: Doubles, states: int, values: int, found: Doubles) -> None:
    row = 0
    for a in range(states):
        for b in range(a, states):
            _add(covariance[a, b], intensities, found[row])
            row += 1
        row += values


@compiled
def _add(factor: float, values: Doubles, found: Doubles) -> None:
    if factor != 0.0:
        for j in range(len(found)):
            found[j] += factor * values[j]


@compiled
def _update(state: Doubles, states: int, values: int, work: Doubles) -> None:
    """Kalman update by the first state, whose rows come last: all gains are made of them."""
    row = states * (states + 1) // 2 + states * values
    for back in range(states):
        a = states - 1 - back
        row -= states - a + values
        for j in range(work.shape[1]):
            work[_GAIN, j] = state[a, j] * work[_SHARE, j]
        for b in range(a, states + values):
            for j in range(work.shape[1]):
                state[row + b - a, j] -= work[_GAIN, j] * state[b, j]
