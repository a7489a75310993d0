"""Uncertainty of steps between frames on a map: noise of both images, as large as images show it that made no map."""

import numpy as np
import torch

from torchsphere.sphere_map.bundle_adjustment import Bundle
from torchsphere.sphere_map.pixel_weights import level_profile
from torchsphere.sphere_map.poses import step_covariances
from torchsphere.sphere_map.projection import Ball, Pose
from torchsphere.sphere_map.registration import Registration

RADIUS, KEYS = 20.0, [0, 4, 5, 8]


def steps(misfits: dict[int, float], of_keyframes: float = 4.0) -> np.ndarray:
    """Variance (8, 5) of the steps, px, rotations times the radius; each image alone has unit variance.

    Keyframes have no misfit of their own, and steps between them ``of_keyframes`` times the noise of both.
    """
    pose, unit = Pose(torch.zeros(2).double(), torch.eye(3).double()), torch.eye(5, dtype=torch.float64)
    found = {i: Registration(pose, unit, True, misfit) for i, misfit in misfits.items()}
    found |= {i: Registration(pose, unit, True, 1.0) for i in KEYS}
    adjusted = Bundle(
        ball=Ball(RADIUS, 0.3, 8, torch.zeros(0), torch.tensor([1.0, 0.0, 0.0, 0.0])),
        poses=[pose] * len(KEYS),
        covariance=of_keyframes * np.eye(5 * len(KEYS) + 2),
        profile=level_profile(RADIUS),
        windows=[],
        settled=True,
    )
    variance = np.einsum("nii->ni", step_covariances(9, found, KEYS, adjusted))
    return variance * np.array([1, 1, *3 * [RADIUS**2]])


def test_a_step_beside_the_keyframes_has_the_noise_that_its_own_images_leave() -> None:
    found = steps({1: 1.1, 2: 1.3, 3: 1.1, 6: 1.2, 7: 1.2})
    np.testing.assert_allclose(found[1], 1.1 + 1.3, rtol=1e-9)
    np.testing.assert_allclose(found[6], 1.2 + 1.2, rtol=1e-9)


def test_a_keyframe_counts_with_what_a_typical_other_image_leaves() -> None:
    """It leaves less than its noise, since the map was fitted to it."""
    found = steps({1: 1.1, 2: 1.3, 3: 1.1, 6: 1.2, 7: 1.2})
    np.testing.assert_allclose(found[0], 1.2 + 1.1, rtol=1e-9)
    np.testing.assert_allclose(found[5], 1.2 + 1.2, rtol=1e-9)


def test_between_keyframes_the_adjustment_is_believed() -> None:
    np.testing.assert_allclose(steps({1: 1.5, 2: 1.5})[4], 2 * 4.0, rtol=1e-9)


def test_a_frame_that_is_not_on_the_map_has_no_step() -> None:
    found = steps({1: 1.1, 3: 1.1})
    assert np.isnan(found[[1, 2, 5, 6, 7]]).all()
    assert np.isfinite(found[[0, 3, 4]]).all()
