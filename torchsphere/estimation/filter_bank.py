"""The rows of small Kalman filters (`kernels.filter_bank`): how a bank begins, runs, and gives its state."""

from __future__ import annotations

import functools

import numpy as np
from numpy.typing import NDArray

from torchsphere.kernels import filter_bank as loops
from torchsphere.kernels.filter_bank import IN_FLIGHT, NO_STEP, Bank, Observations, Steps

Array = NDArray[np.float64]
Numbers = NDArray[np.int64]

#: Variance of a state before the first measurement, in units of the noise's (docs/constants.toml).
PRIOR_VARIANCE = 1e8


def row_count(states: int, values: int = 1) -> int:
    """Rows of a filter with that many states and values."""
    return states * (states + 1) // 2 + states * values


@functools.cache
def _row_indices(states: int, values: int) -> tuple[Numbers, Numbers]:
    """Rows (states, states) that hold the covariances, and rows (states, values) that hold the means."""
    starts: Numbers = np.cumsum([0, *(states - a + values for a in range(states))])[:-1]
    a, b = np.triu_indices(states)
    rows = np.empty((states, states), dtype=np.int64)
    rows[a, b] = rows[b, a] = starts[a] + b - a
    return rows, (starts + states - np.arange(states))[:, None] + np.arange(values)


def unknown_states(states: int, value: Array) -> Array:
    """Rows (rows, ...) of filters with the prior variance in each state, at measured values (...)."""
    state = np.zeros((row_count(states), *value.shape))
    rows, means = _row_indices(states, 1)
    state[rows.diagonal()] = PRIOR_VARIANCE
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
    return state[rows], state[means[:, 0]]


def in_flight(matrix: Array, white: Array, *, begins: bool = False) -> Steps:
    """Steps of a flight with its matrices (f, 3, 3) and covariances (f, 5, 5); where it ``begins`` none comes first."""
    own = np.full(int(begins) + len(matrix), IN_FLIGHT)
    own[: int(begins)] = NO_STEP
    matrix, white = (np.concatenate((np.zeros((int(begins), *v.shape[1:])), v)) for v in (matrix, white))
    none = np.empty((1, 0, *white.shape[1:]))
    return Steps(np.full(len(matrix), matrix.shape[-1]), own, matrix, white, none, none)


def filtered(
    state: Array,
    states: int,
    steps: Steps,
    seen: Observations,
    intensities: tuple[Array, Array],
    recordings: Numbers,
    whitened: Array | None = None,
) -> tuple[Array, Array, Array]:
    """State after the last step, and sums (b, s) of the innovations' logarithms and squares.

    ``state`` (rows, b, s) are filters of so many ``states``, s / k of each of the k degrees of freedom side by side;
    the ``intensities`` (b, s) are those in flight and in contact (without steps in contact not read), and
    ``recordings`` (b,) those of the rows. Room for ``whitened`` innovations (f, values, b, s) is filled; without it
    there is one value.
    """
    values = 1 if whitened is None else whitened.shape[1]
    most = max(states, int(steps.states.max(initial=0)))
    room = np.zeros((row_count(most, values), *state.shape[1:]))
    room[: len(state)] = state
    # The loops are compiled for contiguous arrays alone.
    flight, contact = np.ascontiguousarray(intensities[0]), np.ascontiguousarray(intensities[1])
    logs, squares = np.zeros((2, *flight.shape))
    whitened = np.empty((0, 0, 0, 0)) if whitened is None else whitened
    steps, seen = Steps._make(map(np.ascontiguousarray, steps)), Observations._make(map(np.ascontiguousarray, seen))
    loops.run(Bank(room, flight, contact, recordings, values, logs, squares, whitened), states, steps, seen)
    left = int(steps.states[-1]) if len(steps.states) else states
    return room[: row_count(left, values)], logs, squares
