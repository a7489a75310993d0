"""The limbs of a ball in several frames: along a path that leaves them, and around one circle that all share."""

import numpy as np
import pytest
import torch
from shots import noisy, rotation_matrix, speckle

from torchsphere.detection.limbs import IN_SIGHT_PX, fit_along_path, fit_around
from torchsphere.synthetic import ray_caster

RADIUS, FRAMES = 24.0, np.arange(3, 9)


def images_of(centres: np.ndarray) -> torch.Tensor:
    """Images (m, h, w) of a ball that turns, at the ``centres`` (m, 2)."""
    turned = torch.stack([rotation_matrix(torch.tensor([0.02, 0.03, 0.01]) * i) for i in range(len(centres))]).float()
    clean = ray_caster.render(
        speckle(4, RADIUS), torch.from_numpy(centres).float(), RADIUS, turned, 90.0, shape=(84, 100)
    )
    return noisy(clean, 2.0, 3)


@pytest.fixture(scope="module")
def truth() -> np.ndarray:
    """Circles (m, 3) of a ball that moves by 1.5 px per frame."""
    along = np.arange(len(FRAMES), dtype=float)
    return np.column_stack((40.0 + 1.5 * along, 41.0 + 0.2 * along, np.full(len(FRAMES), RADIUS)))


def test_limbs_are_found_along_the_path_of_the_ball(truth: np.ndarray) -> None:
    found = fit_along_path(images_of(truth[:, :2]), FRAMES, truth, None, None)
    assert found.frames.tolist() == FRAMES.tolist()
    assert (np.abs(found.circles - truth) < 5 * found.sd).all()
    assert np.array_equal(found.guesses, truth)


def test_limbs_are_found_although_the_path_leaves_them_by_more_than_is_in_sight(truth: np.ndarray) -> None:
    path = truth + np.arange(len(FRAMES))[:, None] * [1.2, -0.8, 0.0]
    assert np.abs(path - truth).max() > 5 * IN_SIGHT_PX
    found = fit_along_path(images_of(truth[:, :2]), FRAMES, path, None, None)
    assert found.frames.tolist() == FRAMES.tolist()
    assert (np.abs(found.circles - truth) < 5 * found.sd).all()


def test_a_frame_whose_image_shows_no_limb_is_left_out(truth: np.ndarray) -> None:
    images = images_of(truth[:, :2])
    hidden = torch.zeros(images.shape[1:], dtype=torch.bool)
    hidden[:, 56:] = True
    path = truth.copy()
    # The circle of the last frame lies where no pixel is known.
    path[-1, 0] += 60.0
    found = fit_along_path(images, FRAMES, path, hidden, None)
    assert found.frames.tolist() == FRAMES[:-1].tolist()


def test_limbs_of_a_ball_in_its_place_are_found_around_a_circle_that_is_off() -> None:
    place = np.array([45.3, 40.6, RADIUS])
    found = fit_around(
        images_of(np.tile(place[:2], (len(FRAMES), 1))), FRAMES, place + np.array([2.0, -1.5, 1.0]), None, None
    )
    assert found.frames.tolist() == FRAMES.tolist()
    assert (np.abs(found.circles - place) < 5 * found.sd).all()
    # All were looked for around the circle that most frames show.
    assert np.abs(found.guesses - place).max() < 0.5
    assert np.ptp(found.guesses, axis=0).max() == 0
