"""The compiled bank of small Kalman filters against covariances and means moved and updated one filter at a time."""

import numpy as np
import pytest

from torchsphere.estimation.filter_bank import filtered
from torchsphere.kernels.filter_bank import IN_FLIGHT, NO_STEP, WIDTH, Observations, Steps

#: Rows of two recordings, columns of two degrees of freedom (more than are filtered at a time), and most states.
ROWS, FREEDOMS, STATES = 3, 2, 5
COLUMNS = FREEDOMS * (WIDTH // 2 + 3)


def packed(covariance: np.ndarray, means: np.ndarray) -> np.ndarray:
    """Rows of one filter: for each state its covariances with itself and the later states, then its means."""
    return np.concatenate([np.concatenate((covariance[a, a:], means[a])) for a in range(len(means))])


def some_covariances(rng: np.random.Generator, *shape: int) -> np.ndarray:
    root = rng.normal(size=(*shape, STATES, STATES))
    return np.asarray(root @ root.swapaxes(-1, -2))


def steps_of(states: tuple[int, ...], own: tuple[int, ...], rng: np.random.Generator) -> Steps:
    matrix = rng.normal(size=(ROWS, max(own) + 1, STATES, STATES))
    # The loops leave out what is 0.
    matrix[rng.random(matrix.shape) < 0.3] = 0.0
    flight = rng.normal(size=(len(own), 3, 3))
    white, contact = some_covariances(rng, len(own)), some_covariances(rng, *matrix.shape[:2])
    return Steps(np.array(states), np.array(own), flight, white, matrix, contact)


# A start in flight, a step into a contact, one within it, one out of it, and a flight; the first frame has no step.
@pytest.mark.parametrize("contact_states", [4, 5])
@pytest.mark.parametrize("values", [1, 4])
def test_filters_move_and_are_updated_as_one_alone_would_be(contact_states: int, values: int) -> None:
    rng = np.random.default_rng(10 * contact_states + values)
    steps = steps_of((3, 3, contact_states, contact_states, 3, 3), (NO_STEP, IN_FLIGHT, 0, 1, 2, IN_FLIGHT), rng)
    frames = len(steps.own)
    seen = Observations(*rng.random((4, frames, 2, FREEDOMS)))
    seen.seen[:] = 1.0
    seen.seen[3, 1, 0] = 0.0
    intensities = rng.random((2, ROWS, COLUMNS))
    recordings = np.array([1, 0, 1])
    covariances, means = some_covariances(rng, ROWS, COLUMNS)[..., :3, :3], rng.normal(size=(ROWS, COLUMNS, 3, values))
    state = np.empty((6 + 3 * values, ROWS, COLUMNS))
    for place in np.ndindex(ROWS, COLUMNS):
        state[(slice(None), *place)] = packed(covariances[place], means[place])
    whitened = np.zeros((frames, values, ROWS, COLUMNS))
    found, logs, squares = filtered(
        state, 3, steps, seen, (intensities[0], intensities[1]), recordings, None if values == 1 else whitened
    )
    for row, column in np.ndindex(ROWS, COLUMNS):
        covariance, mean = covariances[row, column], means[row, column]
        recording, freedom = recordings[row], column // (COLUMNS // FREEDOMS)
        own_logs, own_squares = 0.0, 0.0
        for f in range(frames):
            own = steps.own[f]
            if own != NO_STEP:
                now, before = steps.states[f], len(covariance)
                matrix = steps.flight[f] if own == IN_FLIGHT else steps.matrix[row, own, :now, :before]
                covariance = matrix @ covariance @ matrix.T + intensities[0, row, column] * steps.white[f, :now, :now]
                if own != IN_FLIGHT:
                    covariance += intensities[1, row, column] * steps.contact[row, own, :now, :now]
                mean = matrix @ mean
                covariance[0, 0] += seen.drift[f, recording, freedom]
                mean[0, 0] += seen.change[f, recording, freedom]
            if seen.seen[f, recording, freedom] == 0.0:
                continue
            variance = covariance[0, 0] + seen.noise[f, recording, freedom]
            own_logs, own_squares = own_logs + np.log(variance), own_squares + mean[0, 0] ** 2 / variance
            if values > 1:
                np.testing.assert_allclose(whitened[f, :, row, column], mean[0] / np.sqrt(variance), rtol=1e-9)
            gain = covariance[:, :1] / variance
            mean, covariance = mean - gain * mean[:1], covariance - gain * covariance[:1]
        np.testing.assert_allclose(found[:, row, column], packed(covariance, mean), rtol=1e-7, atol=1e-7)
        np.testing.assert_allclose((logs[row, column], squares[row, column]), (own_logs, own_squares), rtol=1e-9)
