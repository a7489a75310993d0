"""Many small Kalman filters in one array, a row per entry of the state and a column per filter.

The rows go by the states: for each state its covariances with itself and the later states, then its means. Means are
negative, and that of the pose is relative to the measured value of the frame, so that an innovation is a row like the
others. Several values with the same covariance have a row of means each. A step to the next frame is one product of
matrices (`step_operators`); NumPy takes a third of the time of torch for arrays of this size.
"""

from __future__ import annotations

import functools
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from torchsphere.kernels import filter_step

Array = NDArray[np.float64]
Numbers = NDArray[np.int64]

#: Variance of a state before the first measurement, in units of the noise's (docs/constants.toml).
PRIOR_VARIANCE = 1e8

#: Columns of a product of small matrices for which NumPy starts no threads (docs/constants.toml).
SINGLE_THREAD_COLUMNS = 2048

#: Frames whose innovations are kept before their sums are taken.
FRAMES_AT_ONCE = 64


@dataclass(frozen=True)
class OwnSteps:
    """A step to the next frame that differs from row to row of a bank."""

    matrix: Array  # (b, s', s)
    added: Array  # covariances (q, b, s', s') per unit of the constants


#: Number of states after a step to the next frame, and its operator for all rows or the steps of each row; None where
#: there is no step.
Step = tuple[int, Array | OwnSteps | None]


def row_count(states: int, values: int = 1) -> int:
    """Rows of a filter with that many states and values."""
    return states * (states + 1) // 2 + states * values


@functools.cache
def _covariance_indices(states: int) -> tuple[Numbers, Numbers]:
    """Row and column indices of the upper triangle of a covariance, row by row."""
    a, b = np.triu_indices(states)
    return a.astype(np.int64), b.astype(np.int64)


@functools.cache
def _row_indices(states: int, values: int) -> tuple[Numbers, Numbers]:
    """Rows that hold the upper triangle of the covariance, and rows (states, values) that hold the means."""
    starts: Numbers = np.cumsum([0, *(states - a + values for a in range(states))])[:-1]
    a, b = _covariance_indices(states)
    return starts[a] + b - a, (starts + states - np.arange(states))[:, None] + np.arange(values)


def step_operators(matrix: Array, added: list[Array], values: int = 1) -> Array:
    """Operators (..., rows', rows + q) that move the rows of filters to the next frame.

    ``matrix`` (..., s', s) moves the state; ``added`` are q covariances (..., s', s') per unit of the constants.
    """
    after, before = matrix.shape[-2:]
    a, b = (v[:, None] for v in _covariance_indices(after))
    c, d = _covariance_indices(before)
    products = matrix[..., a, c] * matrix[..., b, d]
    products += np.where(c == d, 0.0, matrix[..., a, d] * matrix[..., b, c])
    (into, means_into), (out, means_out) = _row_indices(after, values), _row_indices(before, values)
    rows = row_count(before, values)
    operators = np.zeros((*matrix.shape[:-2], row_count(after, values), rows + len(added)))
    operators[..., into[:, None], out] = products
    for e in range(values):
        operators[..., means_into[:, e, None], means_out[:, e]] = matrix
    for q, covariance in enumerate(added):
        operators[..., into, rows + q] = covariance[..., a[:, 0], b[:, 0]]
    return operators


def unknown_states(states: int, value: Array) -> Array:
    """Rows (rows, ...) of filters with the prior variance in each state, at measured values (...)."""
    state = np.zeros((row_count(states), *value.shape))
    rows, means = _row_indices(states, 1)
    a, b = _covariance_indices(states)
    state[rows[a == b]] = PRIOR_VARIANCE
    state[means[0, 0]] = value
    return state


def known_states(states: int, mean: Array) -> Array:
    """Rows of filters with exactly known means (states, ...), and as further values a mean of 1 in each state."""
    state = np.zeros((row_count(states, 1 + states), *mean.shape[1:]))
    means = _row_indices(states, 1 + states)[1]
    state[means[:, 0]] = mean
    state[means[np.arange(states), 1 + np.arange(states)]] = 1.0
    return state


def unpacked(state: Array, states: int) -> tuple[Array, Array]:
    """Covariances (states, states, ...) and negative means (states, ...) of filters of one value."""
    rows, means = _row_indices(states, 1)
    a, b = _covariance_indices(states)
    both = np.empty((states, states), dtype=int)
    both[a, b] = both[b, a] = rows
    return state[both], state[means[:, 0]]


@dataclass(frozen=True)
class Observations:
    """Measured values of t frames, for columns (...) that broadcast with the columns of the filters."""

    noise: Array  # variance of the error of each value (t, ...)
    # (t, 2, ...): what the pose's variance and the value gain from the frame before; unused in the first frame.
    step: Array
    weight: Array  # (t, ...), 1 where the value was seen, else 0

    def repeated(self, m: int, rows: Any = slice(None)) -> Observations:
        """Of columns (n, k) some ``rows`` (b, k m), each column ``m`` times."""
        return Observations(*(v[..., rows, :].repeat(m, -1) for v in (self.noise, self.step, self.weight)))

    def frames(self, start: int, stop: int) -> Observations:
        """Observations of the frames ``start`` to ``stop - 1``."""
        return Observations(*(v[start:stop] for v in (self.noise, self.step, self.weight)))


@dataclass
class InnovationSums:
    """Sums over the innovations of frames, for columns (...)."""

    logs: Array  # logarithms of the variances (...)
    squares: Array  # squares in units of the variances (...), for filters of one value
    whitened: list[Array] | None = None  # innovations in units of their sd, (frames, e, ...) each, if asked for

    @classmethod
    def zeros(cls, columns: tuple[int, ...], whitened: list[Array] | None = None) -> InnovationSums:
        """Sums over no frames."""
        return cls(np.zeros(columns), np.zeros(columns), whitened)

    def add(self, innovation: Array, variance: Array, share: Array, weight: Array) -> None:
        """Add innovations (f, e, ...) of f frames with their variances and ``share = weight / variance`` (f, ...)."""
        seen = np.where(weight > 0, variance, 1.0) if not weight.all() else variance
        for four in np.array_split(seen, -(-len(seen) // 4)):
            # One logarithm of the product of four variances: the product stays within the range of a double.
            self.logs += np.log(four.prod(0))
        if self.whitened is None:
            self.squares += np.einsum("f...,f...,f...->...", innovation[:, 0], innovation[:, 0], share)
        else:
            self.whitened.append(innovation * np.sqrt(share)[:, None])


class FilterBank:
    """Filters in columns (b, s), whose number of states may change from step to step.

    ``constants`` (q, b, s) are factors of the covariances that a step adds; the b rows may have operators of their own.
    ``values`` is how many values are filtered by the same covariance, e.
    """

    def __init__(self, constants: Array, values: int = 1) -> None:
        self._columns, self._constants, self._values = constants.shape[1:], constants, values
        self._states = 0
        self._buffers: dict[tuple[int, int], Array] = {}
        self._products: dict[int, Array] = {}
        self.state = np.empty(0)

    def start(self, states: int, state: Array) -> None:
        """Begin with ``state`` (rows, b, s)."""
        self._states = states
        self.state = self._buffer(states, 0)
        self.state[: len(state)] = state

    def _buffer(self, states: int, which: int) -> Array:
        """One of two arrays for filters of that many states, the constants in the last rows."""
        if (states, which) not in self._buffers:
            rows = row_count(states, self._values)
            buffer = np.zeros((rows + len(self._constants), *self._columns))
            buffer[rows:] = self._constants
            self._buffers[states, which] = buffer
            self._products[states] = np.empty((rows, *self._columns))
        return self._buffers[states, which]

    def run(self, steps: list[Step], observations: Observations, sums: InnovationSums) -> None:
        """Step to each next frame and update by its observation; operators are (rows, rows + q)."""
        for first in range(0, len(steps), FRAMES_AT_ONCE):
            part = steps[first : first + FRAMES_AT_ONCE]
            own = observations.frames(first, first + len(part))
            innovation = np.empty((len(part), self._values, *self._columns))
            variance, share = np.empty((2, len(part), *self._columns))
            for i, (states, operator) in enumerate(part):
                if operator is not None:
                    self._predict(states, operator)
                    self.state[0 : states + 1 : states] += own.step[i]
                self._update(own.noise[i], own.weight[i], innovation[i], variance[i], share[i])
            sums.add(innovation, variance, share, own.weight)

    def _predict(self, states: int, operator: Array | OwnSteps) -> None:
        """Move the state to the next frame, into the other buffer."""
        old, target = self.state, self._buffer(states, 0)
        if target is old:
            target = self._buffer(states, 1)
        if isinstance(operator, OwnSteps):
            filter_step.move(old, operator.matrix, operator.added, target)
        else:
            old, rows = old[: operator.shape[-1]], operator.shape[-2]
            flat, new = old.reshape(len(old), -1), target[:rows].reshape(rows, -1)
            for at in range(0, flat.shape[1], SINGLE_THREAD_COLUMNS):
                piece = slice(at, at + SINGLE_THREAD_COLUMNS)
                np.matmul(operator, flat[:, piece], out=new[:, piece])
        self.state, self._states = target, states

    def _update(self, noise: Array, weight: Array, innovation: Array, variance: Array, share: Array) -> None:
        """Kalman update by one value; innovation, its variance and ``weight / variance`` go to the last three."""
        states, e = self._states, self._values
        first = self.state[: states + e]
        np.add(first[0], noise, out=variance)
        np.divide(weight, variance, out=share)
        innovation[...] = first[states:]
        gain = first[:states] * share
        products = self._products[states]
        row = 0
        for a in range(states):
            size = states - a + e
            np.multiply(gain[a], first[a:], out=products[row : row + size])
            row += size
        self.state[:row] -= products
