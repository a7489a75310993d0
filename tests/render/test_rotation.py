"""Rotations: exact against independent formulas, with the signs that are visible in an image."""

import numpy as np
import pytest
from scipy.linalg import expm
from scipy.spatial.transform import Rotation

from render import rotation

RNG = np.random.default_rng(1)
DIRECTIONS = RNG.normal(size=(200, 3))
DIRECTIONS /= np.linalg.norm(DIRECTIONS, axis=1, keepdims=True)
#: Angles from zero to just below half a turn, rad.
VECTORS = DIRECTIONS * np.concatenate(([0.0], np.geomspace(1e-12, 3.1415, 199)))[:, None]


def test_positive_rotations_move_the_front_as_the_frames_of_the_project_say() -> None:
    front = np.array([0.0, 0.0, -1.0])
    x, y, z = rotation.exp(np.diag([0.1, 0.1, 0.1]))
    assert (x @ front)[1] > 0, "+wx moves the front down"
    assert (y @ front)[0] < 0, "+wy moves the front to the left"
    assert np.allclose(z @ [1, 0, 0], [np.cos(0.1), np.sin(0.1), 0], atol=1e-15), "+wz turns right towards down"


def test_exp_is_the_exponential_of_the_cross_product_matrix() -> None:
    expected = np.stack([expm(k) for k in rotation.cross_matrix(VECTORS)])
    assert np.abs(rotation.exp(VECTORS) - expected).max() < 1e-14


def test_cross_matrix_is_the_cross_product() -> None:
    other = RNG.normal(size=(200, 3))
    assert np.allclose(
        (rotation.cross_matrix(VECTORS) @ other[..., None])[..., 0], np.cross(VECTORS, other), atol=1e-15
    )


def test_log_undoes_exp_from_nothing_to_half_a_turn() -> None:
    error = np.linalg.norm(rotation.log(rotation.exp(VECTORS)) - VECTORS, axis=1)
    assert error.max() < 1e-14
    assert (rotation.log(np.eye(3)[None]) == 0).all()


def test_log_of_a_half_turn_is_its_axis() -> None:
    turned = rotation.log(2 * DIRECTIONS[:, :, None] * DIRECTIONS[:, None, :] - np.eye(3))
    assert np.allclose(np.linalg.norm(turned, axis=1), np.pi, atol=1e-14)
    assert np.allclose(np.abs((turned * DIRECTIONS).sum(1)), np.pi, atol=1e-14)


def test_quaternions_have_a_positive_real_part_and_give_the_matrix_back() -> None:
    matrices = Rotation.random(300, random_state=2).as_matrix()
    q = rotation.quaternion(matrices)
    assert (q[:, 0] >= 0).all()
    assert np.abs(np.linalg.norm(q, axis=1) - 1).max() < 1e-15
    assert np.abs(rotation.from_quaternion(q) - matrices).max() < 1e-14
    expected = np.roll(Rotation.from_matrix(matrices).as_quat(canonical=True), 1, axis=1)
    assert np.abs(q - expected).max() < 1e-14


def test_continuous_quaternions_of_a_turning_ball_never_jump() -> None:
    turns = np.linspace(0, 6 * np.pi, 200)
    q = rotation.continuous(rotation.quaternion(rotation.exp(turns[:, None] * np.array([[0.6, 0.0, 0.8]]))))
    assert np.allclose(q[:, 0], np.cos(turns / 2), atol=1e-14)
    assert np.allclose(q[:, 3], 0.8 * np.sin(turns / 2), atol=1e-14)


def test_no_quaternions_stay_no_quaternions() -> None:
    assert rotation.continuous(np.zeros((0, 4))).shape == (0, 4)


def test_compose_turns_by_the_earlier_rotation_first() -> None:
    earlier, later = 0.3 * DIRECTIONS[:50], 0.4 * DIRECTIONS[50:100]
    expected = (Rotation.from_rotvec(later) * Rotation.from_rotvec(earlier)).as_rotvec()
    assert np.allclose(rotation.compose(later, earlier), expected, atol=1e-14)


def test_increments_chain_to_the_orientations() -> None:
    orientation = Rotation.random(20, random_state=3).as_matrix()
    last = orientation[0]
    for step in rotation.exp(rotation.increments(orientation)):
        last = step @ last
    assert np.allclose(last, orientation[-1], atol=1e-13)


@pytest.mark.parametrize("shape", [(3,), (4, 3), (2, 5, 3)])
def test_any_number_of_axes_before_the_last_is_kept(shape: tuple[int, ...]) -> None:
    vectors = 0.1 * np.ones(shape)
    assert rotation.exp(vectors).shape == (*shape, 3)
    assert np.allclose(rotation.log(rotation.exp(vectors)), vectors, atol=1e-15)
