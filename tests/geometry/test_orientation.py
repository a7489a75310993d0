"""Rotations chained on SO(3)."""

import numpy as np
import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st
from shots import angles_between, rotation_matrix

from torchsphere.geometry.orientation import chain, quaternions


def slow_chain(rotations: np.ndarray) -> np.ndarray:
    """A_i = exp([w_i]x) A_{i-1} in a loop; the first rotation is not used."""
    matrices = [np.eye(3)]
    for vector in rotations[1:]:
        matrices.append(rotation_matrix(torch.from_numpy(vector)).numpy() @ matrices[-1])
    return np.stack(matrices)


def random_rotations(n: int, seed: int = 0, scale: float = 0.3) -> np.ndarray:
    return scale * np.random.default_rng(seed).standard_normal((n, 3))


@pytest.mark.parametrize("n", [1, 2, 3, 8, 13, 64])
def test_the_chain_is_the_product_with_the_later_rotation_on_the_left(n: int) -> None:
    rotations = random_rotations(n)
    chained = chain(rotations, np.ones(n, bool))
    np.testing.assert_allclose(chained, slow_chain(rotations), atol=1e-12)  # float64, 64 products


def test_a_quarter_turn_about_y_takes_the_front_to_the_left() -> None:
    turned = chain(np.array([[0, 0, 0], [0, np.pi / 2, 0]]), np.ones(2, bool))[1]
    np.testing.assert_allclose(turned @ [0, 0, -1], [-1, 0, 0], atol=1e-12)  # rounding


def test_the_order_of_two_rotations_matters_and_is_kept() -> None:
    x, y = [np.pi / 2, 0, 0], [0, np.pi / 2, 0]
    there = chain(np.array([[0, 0, 0], x, y]), np.ones(3, bool))[2]
    expected = rotation_matrix(torch.tensor(y, dtype=torch.float64)) @ rotation_matrix(
        torch.tensor(x, dtype=torch.float64)
    )
    np.testing.assert_allclose(there, expected.numpy(), atol=1e-12)  # rounding


@settings(max_examples=20, deadline=None, derandomize=True)
@given(st.lists(st.floats(-3, 3), min_size=3, max_size=3))
def test_a_rotation_and_its_inverse_cancel(vector: list[float]) -> None:
    there_and_back = np.array([[0, 0, 0], vector, np.negative(vector)])
    np.testing.assert_allclose(chain(there_and_back, np.ones(3, bool))[2], np.eye(3), atol=1e-12)  # rounding


def test_frames_before_the_first_known_and_in_gaps_are_nan_and_the_chain_goes_on() -> None:
    rotations = random_rotations(6)
    known = np.array([False, True, True, False, True, True])
    rotations[~known] = np.nan
    chained = chain(rotations, known)
    assert np.isnan(chained[~known]).all()
    # The rotation of a frame starts at the last known frame before it.
    np.testing.assert_allclose(chained[known], slow_chain(rotations[known]), atol=1e-12)


def test_after_a_missing_rotation_all_is_nan() -> None:
    rotations = random_rotations(5)
    rotations[3] = np.nan
    chained = chain(rotations, np.ones(5, bool))
    assert np.isfinite(chained[:3]).all()
    assert np.isnan(chained[3:]).all()


def test_without_a_known_frame_all_is_nan() -> None:
    assert np.isnan(chain(np.full((3, 3), np.nan), np.zeros(3, bool))).all()


def test_long_chains_stay_rotations() -> None:
    chained = chain(random_rotations(20_000), np.ones(20_000, bool))
    products = chained @ chained.transpose(0, 2, 1)
    # Rounding of quaternions, log2(20 000) = 15 products of products deep.
    np.testing.assert_allclose(products, np.broadcast_to(np.eye(3), products.shape), atol=1e-9)


def test_quaternions_are_those_of_the_matrices_without_jumps_of_sign() -> None:
    turns = np.tile([0.0, 0.1, 0.0], (100, 1))
    found = quaternions(chain(turns, np.ones(100, bool)))
    angle = 0.1 * np.arange(100)
    # More than a whole turn, in which the scalar part changes its sign without a jump.
    expected = np.stack((np.cos(angle / 2), 0 * angle, np.sin(angle / 2), 0 * angle), 1)
    np.testing.assert_allclose(found, expected, atol=1e-7)  # near half a turn the matrix knows w to sqrt(1e-16)


def test_quaternions_of_unknown_orientations_are_nan() -> None:
    matrices = np.stack((np.full((3, 3), np.nan), np.eye(3), np.full((3, 3), np.nan)))
    found = quaternions(matrices)
    np.testing.assert_array_equal(found[1], [1, 0, 0, 0])
    assert np.isnan(found[[0, 2]]).all()


def test_the_angle_between_rotations_in_the_tests_is_right() -> None:
    a = slow_chain(np.array([[0, 0, 0], [0.1, 0, 0]]))
    np.testing.assert_allclose(angles_between(a, np.broadcast_to(np.eye(3), a.shape)), [0, np.rad2deg(0.1)], atol=1e-5)
