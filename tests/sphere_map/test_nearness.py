"""The camera's distance from images of a ball that moves sideways, cast with exact rays."""

import functools
import math

import numpy as np
import pytest
import torch
from numpy.typing import NDArray
from shots import noisy, rotation_matrix, speckle
from tracks import made_map

from torchsphere import Camera, Circle, track
from torchsphere.motion.track import Track
from torchsphere.sphere_map import nearness
from torchsphere.synthetic import ray_caster

RADIUS, SHAPE = 24.0, (76, 170)

#: Apparent turn about y per nearness, rad per frame: by the step of 3.7 px along x, and by the turn of 1.35 deg.
SEEN_FROM_ASIDE = 3.7 / RADIUS - 0.7 * math.radians(1.35)


@functools.lru_cache(maxsize=4)
def crossing(distance: float, turn_deg: float, n: int = 24) -> tuple[torch.Tensor, torch.Tensor, torch.Tensor]:
    """Images, centres (n, 2) and orientations (n, 3, 3) of a ball that crosses the image, ``distance`` radii away."""
    at = torch.arange(n, dtype=torch.float64)
    centres = torch.stack((40.3 + 3.7 * at, 38.2 - 0.11 * at), 1)
    turn = math.radians(turn_deg) * torch.tensor([0.3, 0.9, 0.3], dtype=torch.float64)
    orientations = torch.stack([rotation_matrix(turn * i) for i in range(n)])
    camera = None if math.isinf(distance) else Camera(focal_px=RADIUS * distance)
    pose = centres.float(), orientations.float()
    images = ray_caster.render(
        speckle(3, RADIUS), pose[0], RADIUS, pose[1], 90.0, shape=SHAPE, subsamples=4, camera=camera
    )
    return noisy(images, 2.0, 9), centres, orientations


def tracked(distance: float, turn_deg: float, **settings: object) -> tuple[Track, NDArray[np.float64]]:
    """The track, and its errors (n, 3) of the orientation since the first frame, deg."""
    images, centres, orientations = crossing(distance, turn_deg)
    found = track(images, Circle(*centres[0].tolist(), RADIUS), **settings)
    truth = (orientations @ orientations[0].T).numpy()
    turned = np.swapaxes(truth, 1, 2) @ found.orientation
    off = np.stack((turned[:, 2, 1], turned[:, 0, 2], turned[:, 1, 0]), 1)
    return found, np.degrees(off)


def test_the_distance_of_a_ball_that_turns_is_found() -> None:
    found, off = tracked(12.0, 1.5)
    made = made_map(found)
    assert made.radius_over_distance == pytest.approx(1 / 12, abs=3 * made.sd_radius_over_distance)
    # Taken as orthographic, the ball seems to turn by 85 px / (12 R), 17 deg.
    assert np.abs(off).max() < 3 * np.degrees(found.sd_steady[3]) * len(found.increment)
    assert np.abs(off).max() < 1.0


def test_a_camera_at_150_radii_is_not_taken_for_one_at_infinity() -> None:
    found, _ = tracked(150.0, 5.0)
    # Found at other distances to 0.0007. At infinity the radius took up what the map lacked, by 0.03 to 0.2 %.
    assert found.findings.radius_over_distance == pytest.approx(1 / 150, abs=0.002)
    assert found.circle.radius == pytest.approx(RADIUS, rel=4e-4)


def test_a_given_camera_is_held_by_the_map() -> None:
    found, off = tracked(12.0, 1.5, camera=Camera(focal_px=12.0 * RADIUS))
    assert found.settings["model"] == "pinhole"
    assert found.findings.is_on_map
    assert found.findings.radius_over_distance == pytest.approx(1 / 12, rel=1e-3)
    _, centres, _ = crossing(12.0, 1.5)
    assert np.abs(off).max() < 0.1
    assert np.abs(found.position - centres.numpy()).max() < 0.04
    assert found.warnings == () or not any("distance" in sentence for sentence in found.warnings)


def test_a_telecentric_view_is_taken_as_such_and_has_no_error_by_a_distance() -> None:
    found, off = tracked(math.inf, 1.5, telecentric=True)
    assert found.findings.radius_over_distance == 0
    assert np.abs(off).max() < 0.1
    assert np.degrees(found.sd_steady[3]) < 0.002
    unknown, _ = tracked(math.inf, 1.5)
    assert unknown.findings.radius_over_distance == 0
    # What a distance that is not seen may add: so much of the step over the radius, less the larger front, at least.
    assert unknown.sd_steady[3] > nearness.SYSTEMATIC_SD * SEEN_FROM_ASIDE
    np.testing.assert_allclose(unknown.position, found.position, atol=1e-6)


def test_without_a_map_the_unknown_distance_is_stated_and_said() -> None:
    found, _ = tracked(math.inf, 1.5, sphere_map=False)
    # The prior: a sd of 0.03 of that of a ball at its radius' distance.
    assert found.sd_steady[3] == pytest.approx(0.03 * SEEN_FROM_ASIDE, rel=0.01)
    assert found.sd_steady[2] < 0.1 * found.sd_steady[3]
    assert any("camera's distance is not known" in sentence for sentence in found.warnings)
    still, _ = tracked(math.inf, 1.5, sphere_map=False, telecentric=True)
    assert not any("distance" in sentence for sentence in still.warnings)


@pytest.mark.parametrize("distance", [10.0, 20.0])
def test_a_near_ball_that_turns_in_place_without_a_map_turns_as_fast_as_stated(distance: float) -> None:
    n, turn = 6, math.radians(1.5) * torch.tensor([0.1, 0.95, 0.3], dtype=torch.float64)
    centres = torch.tensor([[38.2, 38.0]]).expand(n, 2)
    orientations = torch.stack([rotation_matrix(turn * i) for i in range(n)]).float()
    camera = Camera(focal_px=RADIUS * distance)
    images = ray_caster.render(
        speckle(3, RADIUS), centres, RADIUS, orientations, 90.0, shape=(76, 76), subsamples=4, camera=camera
    )
    found = track(noisy(images, 2.0, 9), (38.2, 38.0, RADIUS / math.sqrt(1 - distance**-2)), sphere_map=False)
    error = found.increment[:, 2:].mean(0) - turn.numpy()
    scatter = np.sqrt(found.covariance.diagonal(axis1=1, axis2=2)[:, 2:].mean(0) / (n - 1))
    # A front that is larger seems to turn faster, by 7 % at 10 radii; a distance of 10 radii is 3.3 sd of the prior.
    assert error[1] > 0.5 * float(turn[1]) / distance
    assert (np.abs(error) < 5 * np.hypot(scatter, found.sd_steady[2:])).all()


def test_a_camera_is_not_telecentric() -> None:
    images, centres, _ = crossing(math.inf, 1.5)
    with pytest.raises(ValueError, match="telecentric"):
        track(images, (*centres[0].tolist(), RADIUS), telecentric=True, camera=Camera(focal_px=500))
