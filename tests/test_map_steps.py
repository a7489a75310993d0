"""Uncertainty of steps between frames on a map: noise of both images, and what of the map's errors does not cancel."""

import numpy as np
import pytest
import torch
from shots import rotation_matrix

from torchsphere.bundle import Bundle
from torchsphere.map_steps import step_covariances
from torchsphere.register import Registration
from torchsphere.sight import Ball, Pose
from torchsphere.trust import level_profile

RADIUS, KEYS = 20.0, [0, 4, 8]


def on_map(turns: np.ndarray) -> dict[int, Registration]:
    """Frames that are turned about y by so many rad, each of unit covariance: px, rotations times the radius."""
    unit = torch.eye(5, dtype=torch.float64)
    poses = [Pose(torch.zeros(2).double(), rotation_matrix(torch.tensor([0.0, a, 0.0]).double())) for a in turns]
    return {i: Registration(pose, unit, True, 1.0) for i, pose in enumerate(poses)}


def steps(turns: np.ndarray, of_keyframes: float) -> np.ndarray:
    """Variance (8, 5) of the steps, those between keyframes being ``of_keyframes`` times the noise of both."""
    found = on_map(turns)
    shading = torch.tensor([1.0, 0.0, 0.0, 0.0])
    adjusted = Bundle(
        ball=Ball(RADIUS, 0.3, 8, torch.zeros(0), shading),
        poses=[found[i].pose for i in KEYS],
        covariance=of_keyframes * np.eye(5 * len(KEYS) + 2),
        profile=level_profile(RADIUS),
        windows=[],
        settled=True,
    )
    variance = np.einsum("nii->ni", step_covariances(9, found, KEYS, adjusted))
    return variance * np.array([1, 1, *3 * [RADIUS**2]])


def test_a_quarter_of_the_turn_leaves_a_sixteenth_of_the_variance_that_the_map_adds() -> None:
    # Two images of unit variance each; between keyframes the map adds three times as much.
    np.testing.assert_allclose(steps(0.01 * np.arange(9), 4.0), 2 * (1 + 3 / 16), rtol=1e-9)


def test_a_ball_that_stops_turning_has_steps_as_certain_as_its_images() -> None:
    found = steps(0.01 * np.array([0, 1, 2, 3, 4, 4, 4, 6, 8]), 4.0)
    np.testing.assert_allclose(found[4:6], 2.0, rtol=1e-9)
    assert (found[:4] > 2.1).all()


@pytest.mark.parametrize(
    "turns", [np.zeros(9), 0.02 * np.array([0, 1, 0, 1, 0, 1, 0, 1, 0])], ids=["still", "to and fro"]
)
def test_no_step_is_less_certain_than_between_keyframes(turns: np.ndarray) -> None:
    found = steps(turns, 4.0)
    assert (found <= 2 * 4 * (1 + 1e-9)).all()
    assert (found >= 2 * (1 - 1e-9)).all()


def test_keyframes_that_are_surer_of_a_step_than_their_images_do_not_narrow_the_others() -> None:
    np.testing.assert_allclose(steps(0.01 * np.arange(9), 0.5), 2.0, rtol=1e-9)
