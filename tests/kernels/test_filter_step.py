"""The compiled step of small Kalman filters against covariances and means moved one filter at a time."""

import numpy as np
import pytest

from torchsphere.estimation.filter_bank import step_operators
from torchsphere.kernels import filter_step

BANKS, FILTERS, ADDED = 3, 4, 2


def packed(covariance: np.ndarray, mean: np.ndarray) -> np.ndarray:
    """Rows of one filter: for each state its covariances with itself and the later states, then its mean."""
    states = len(mean)
    return np.concatenate([np.append(covariance[a, a:], mean[a]) for a in range(states)])


def some(states: int, rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
    """Covariance and mean of one filter."""
    root = rng.normal(size=(states, states))
    return root @ root.T, rng.normal(size=states)


# A flight, a contact, and the steps into and out of it.
@pytest.mark.parametrize(("before", "after"), [(3, 3), (4, 4), (5, 5), (3, 5), (5, 3), (3, 4), (4, 3)])
def test_a_step_moves_covariances_and_means_and_adds_the_noise(before: int, after: int) -> None:
    rng = np.random.default_rng(10 * before + after)
    matrix = rng.normal(size=(BANKS, after, before))
    # The loops leave out what is 0.
    matrix[rng.random(matrix.shape) < 0.3] = 0.0
    added = np.stack([[some(after, rng)[0] for _ in range(BANKS)] for _ in range(ADDED)])
    factors = rng.random((ADDED, BANKS, FILTERS))
    rows, later_rows = before * (before + 1) // 2 + before, after * (after + 1) // 2 + after
    old, expected = np.empty((rows + ADDED, BANKS, FILTERS)), np.empty((later_rows, BANKS, FILTERS))
    old[rows:] = factors
    for bank, number in np.ndindex(BANKS, FILTERS):
        covariance, mean = some(before, rng)
        old[:rows, bank, number] = packed(covariance, mean)
        moved = matrix[bank] @ covariance @ matrix[bank].T
        moved += sum(factors[q, bank, number] * added[q, bank] for q in range(ADDED))
        expected[:, bank, number] = packed(moved, matrix[bank] @ mean)
    # What the buffer held before, and its constants in the last rows, are of no concern.
    new = np.full((later_rows + ADDED, BANKS, FILTERS), np.nan)
    new[later_rows:] = factors
    filter_step.move(old, matrix, added, new)
    np.testing.assert_allclose(new[:later_rows], expected, rtol=1e-12, atol=1e-12)
    np.testing.assert_array_equal(new[later_rows:], factors)
    by_operators = np.einsum("bij,jbs->ibs", step_operators(matrix, list(added)), old)
    np.testing.assert_allclose(new[:later_rows], by_operators, rtol=1e-12, atol=1e-12)
