"""Many small Kalman filters side by side: one array holds all of them, a row per entry (see `entries`).

The step of all filters to the next frame is one product of matrices, and what is measured there some ten operations on
whole rows. As tiny as the filters are, the number of operations is what they cost: written out entry by entry, some
forty operations of torch per frame took 3 to 4 times as long. NumPy's take a third of the time of torch's.

Where the entries of a small filter's state stand: each in its row, of an array with a column per filter.

A filter's state is a covariance, of which each entry that differs is kept once, and means: the negative ones, and for
the pose what the frame's measured value differs from it, so that an innovation is a row like the others. Several values
may be filtered beside each other by the same covariance; e of them have a row each. The rows go by the states: of each
the covariances with itself and with those after it, then its means.

How a state moves on to the next frame is linear in these rows. `operators` are the matrices of that.
"""

from __future__ import annotations

import functools
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Numbers = NDArray[np.int64]

#: Variance of what is not known beforehand, in units of the noise's: less would matter, more would cost digits.
UNKNOWN = 1e8


def count(states: int, values: int = 1) -> int:
    """Rows of filters with so many states each."""
    return states * (states + 1) // 2 + states * values


@functools.cache
def _places(states: int) -> tuple[Numbers, Numbers]:
    """Rows and columns of the different entries of a covariance, by its rows."""
    a, b = np.triu_indices(states)
    return a.astype(np.int64), b.astype(np.int64)


@functools.cache
def _rows(states: int, values: int) -> tuple[Numbers, Numbers]:
    """Which rows of a filter hold the entries of its covariance, and which (states, values) its means."""
    starts: Numbers = np.cumsum([0, *(states - a + values for a in range(states))])[:-1]
    a, b = _places(states)
    return starts[a] + b - a, (starts + states - np.arange(states))[:, None] + np.arange(values)


def operators(matrix: Array, added: list[Array], values: int = 1) -> Array:
    """What brings filters' rows on to the next frame (..., rows', rows + q).

    ``matrix`` (..., s', s) is the state's own, ``added`` q covariances (..., s', s') per unit of the constants.
    """
    after, before = matrix.shape[-2:]
    a, b = (v[:, None] for v in _places(after))
    c, d = _places(before)
    both = matrix[..., a, c] * matrix[..., b, d]
    both += np.where(c == d, 0.0, matrix[..., a, d] * matrix[..., b, c])
    (into, means_into), (out, means_out) = _rows(after, values), _rows(before, values)
    rows = count(before, values)
    found = np.zeros((*matrix.shape[:-2], count(after, values), rows + len(added)))
    found[..., into[:, None], out] = both
    for e in range(values):
        found[..., means_into[:, e, None], means_out[:, e]] = matrix
    for q, covariance in enumerate(added):
        found[..., into, rows + q] = covariance[..., a[:, 0], b[:, 0]]
    return found


def part(operator: Array, states: int, after: int, before: int) -> Array:
    """Of operators (..., rows, rows + q) of one value and so many states those for the first before and after alone."""
    if after == before == states:
        return operator
    constants = count(states) + np.arange(operator.shape[-1] - count(states))
    return operator[..., _first(states, after)[:, None], np.append(_first(states, before), constants)]


@functools.cache
def _first(states: int, some: int) -> Numbers:
    """Rows of one value's filters that hold ``some`` of their states."""
    rows, means = _rows(states, 1)
    a, b = _places(states)
    return np.sort(np.append(rows[(a < some) & (b < some)], means[:some, 0]))


def unknown(states: int, value: Array) -> Array:
    """Rows of filters of states that are not known beforehand, at measured values (...)."""
    found = np.zeros((count(states), *value.shape))
    rows, means = _rows(states, 1)
    a, b = _places(states)
    found[rows[a == b]] = UNKNOWN
    found[means[0, 0]] = value
    return found


def exact(states: int, mean: Array) -> Array:
    """Rows of filters of known states ``mean`` (states, ...), and beside each other of 1 in each of the states."""
    found = np.zeros((count(states, 1 + states), *mean.shape[1:]))
    means = _rows(states, 1 + states)[1]
    found[means[:, 0]] = mean
    found[means[np.arange(states), 1 + np.arange(states)]] = 1.0
    return found


def matrices(state: Array, states: int) -> tuple[Array, Array]:
    """Covariances (states, states, ...) and means (states, ...), the negative ones, of filters of one value each."""
    rows, means = _rows(states, 1)
    a, b = _places(states)
    both = np.empty((states, states), dtype=int)
    both[a, b] = both[b, a] = rows
    return state[both], state[means[:, 0]]


#: States after a step to the next frame, and its operator; None where there is no step.
Step = tuple[int, Array | None]

#: Columns of a product of matrices of a dozen rows for which NumPy starts no threads of its own: they take longer.
WITHOUT_THREADS = 2048

#: Frames whose innovations are kept before they are summed up.
AT_ONCE = 64


@dataclass(frozen=True)
class Values:
    """What is measured in each of t frames, for columns (...) that the filters' ones are broadcast with.

    Attributes
    ----------
    noise : ndarray
        Variance of each value's error (t, ...).
    step : ndarray
        (t, 2, ...): what has been added to the pose's variance since the frame before, and to the value. Of the first
        frame it is not used.
    weight : ndarray
        (t, ...), 1 where the value was seen, else 0.
    """

    noise: Array
    step: Array
    weight: Array

    def spread(self, m: int, rows: Any = slice(None)) -> Values:
        """Of columns (n, k) those of some ``rows`` (b, k m), each ``m`` times."""
        return Values(*(v[..., rows, :].repeat(m, -1) for v in (self.noise, self.step, self.weight)))

    def frames(self, start: int, stop: int) -> Values:
        """Those of the frames ``start`` to ``stop - 1``."""
        return Values(*(v[start:stop] for v in (self.noise, self.step, self.weight)))


@dataclass
class Sums:
    """What the innovations of frames add up to, for columns (...).

    Attributes
    ----------
    logs : ndarray
        Logarithms (...) of the variances of the innovations.
    squares : ndarray
        Squares (...) of the innovations in units of their standard deviations; of filters of one value each.
    whitened : list of ndarray
        The innovations themselves, in the same units, (frames, e, ...) each; only where they are asked for.
    """

    logs: Array
    squares: Array
    whitened: list[Array] | None = None

    @classmethod
    def none(cls, columns: tuple[int, ...], whitened: list[Array] | None = None) -> Sums:
        """Of no frames."""
        return cls(np.zeros(columns), np.zeros(columns), whitened)

    def add(self, off: Array, total: Array, share: Array, weight: Array) -> None:
        """Innovations (f, e, ...) of f frames, their variances ``total``, and ``weight / total`` (f, ...)."""
        seen = np.where(weight > 0, total, 1.0) if not weight.all() else total
        for part in np.array_split(seen, -(-len(seen) // 4)):
            # A logarithm of four together: none of them is so large, or so small, that the product has no digits.
            self.logs += np.log(part.prod(0))
        if self.whitened is None:
            self.squares += np.einsum("f...,f...,f...->...", off[:, 0], off[:, 0], share)
        else:
            self.whitened.append(off * np.sqrt(share)[:, None])


class Bank:
    """Filters in columns (...) of one number of states after another.

    Parameters
    ----------
    constants : ndarray
        (q, b, s), for s filters of each of b rows, which may move on in their own ways: factors of the covariances that
        a step adds.
    values : int
        How many are filtered by the same covariance, e.
    """

    def __init__(self, constants: Array, values: int = 1) -> None:
        self._columns, self._constants, self._values = constants.shape[1:], constants, values
        self._states = 0
        self._buffers: dict[tuple[int, int], Array] = {}
        self._less: dict[int, Array] = {}
        self.state = np.empty(0)

    def start(self, states: int, state: Array) -> None:
        """Begin with ``state`` (rows, b, s)."""
        self._states = states
        self.state = self._buffer(states, 0)
        self.state[: len(state)] = state

    def _buffer(self, states: int, which: int) -> Array:
        if (states, which) not in self._buffers:
            rows = count(states, self._values)
            found = np.zeros((rows + len(self._constants), *self._columns))
            found[rows:] = self._constants
            self._buffers[states, which] = found
            self._less[states] = np.empty((rows, *self._columns))
        return self._buffers[states, which]

    def run(self, steps: list[Step], values: Values, sums: Sums) -> None:
        """Step by step to the next frame, and what is measured there.

        ``steps`` are states after the step and its operator, (rows, rows + q) for all or (b, rows, rows + q);
        ``values`` are those of the frames that they lead to.
        """
        for first in range(0, len(steps), AT_ONCE):
            part = steps[first : first + AT_ONCE]
            own = values.frames(first, first + len(part))
            off = np.empty((len(part), self._values, *self._columns))
            total, share = np.empty((2, len(part), *self._columns))
            for i, (states, operator) in enumerate(part):
                if operator is not None:
                    self._move(states, operator)
                    self.state[0 : states + 1 : states] += own.step[i]
                self.measure(own.noise[i], own.weight[i], off[i], total[i], share[i])
            sums.add(off, total, share, own.weight)

    def _move(self, states: int, operator: Array) -> None:
        old, rows = self.state, operator.shape[-2]
        target = self._buffer(states, 0)
        if target is old:
            target = self._buffer(states, 1)
        old = old[: operator.shape[-1]]
        if operator.ndim == 2:
            flat, new = old.reshape(len(old), -1), target[:rows].reshape(rows, -1)
            for piece in (slice(at, at + WITHOUT_THREADS) for at in range(0, flat.shape[1], WITHOUT_THREADS)):
                np.matmul(operator, flat[:, piece], out=new[:, piece])
        else:
            np.matmul(operator, old.transpose(1, 0, 2), out=target[:rows].transpose(1, 0, 2))
        self.state, self._states = target, states

    def measure(self, noise: Array, weight: Array, off: Array, total: Array, share: Array) -> None:
        """Take in one value each; its innovation, the variance of that and ``weight`` over it go to the last three."""
        states, e = self._states, self._values
        first = self.state[: states + e]
        np.add(first[0], noise, out=total)
        np.divide(weight, total, out=share)
        off[...] = first[states:]
        gain = first[:states] * share
        less = self._less[states]
        row = 0
        for a in range(states):
            size = states - a + e
            np.multiply(gain[a], first[a:], out=less[row : row + size])
            row += size
        self.state[:row] -= less
