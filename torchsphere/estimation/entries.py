"""Where the entries of a small filter's state stand: each in its row, of an array with a column per filter.

A filter's state is a covariance, of which each entry that differs is kept once, and means: the negative ones, and for
the pose what the frame's measured value differs from it, so that an innovation is a row like the others. Several values
may be filtered beside each other by the same covariance; e of them have a row each. The rows go by the states: of each
the covariances with itself and with those after it, then its means.

How a state moves on to the next frame is linear in these rows. `operators` are the matrices of that.
"""

from __future__ import annotations

import functools

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
