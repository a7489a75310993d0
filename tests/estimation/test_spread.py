"""Standard deviations by quantiles."""

import numpy as np
import pytest

from torchsphere.estimation.spread import sd_of_errors


def test_normal_errors_have_their_standard_deviation() -> None:
    errors = np.random.default_rng(0).normal(scale=(0.5, 3.0), size=(20_000, 2))
    np.testing.assert_allclose(sd_of_errors(errors), (0.5, 3.0), rtol=0.02)


def test_a_few_wild_values_count_for_nothing() -> None:
    errors = np.random.default_rng(0).normal(size=2_000)
    errors[:20] = 1e6
    assert float(sd_of_errors(errors)) == pytest.approx(1.0, rel=0.05)


def test_two_likely_places_are_both_within_two_standard_deviations() -> None:
    # Seven of ten contacts end here, three 0.2 frames later.
    errors = np.repeat((0.0, 0.2), (280, 120)) + 1e-3 * np.random.default_rng(0).normal(size=400)
    assert 2 * float(sd_of_errors(errors)) == pytest.approx(0.2, abs=0.01)


def test_unknown_values_are_left_out_and_where_all_are_unknown_so_is_the_spread() -> None:
    errors = np.array([[1.0, np.nan], [-1.0, np.nan], [np.nan, np.nan]])
    np.testing.assert_array_equal(sd_of_errors(errors), (1.0, np.nan))
