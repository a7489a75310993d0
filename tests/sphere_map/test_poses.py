"""Absolute poses on a map of the ball: drift, uncertainty, and when the map is refused."""

from dataclasses import dataclass

import numpy as np
import pytest
import torch
from shots import angles_between, noisy, rotation_matrix, speckle

from torchsphere import Circle, track
from torchsphere.recording.frame_source import Source
from torchsphere.sphere_map import bundle_adjustment, registration
from torchsphere.sphere_map import poses as mapped
from torchsphere.synthetic import ray_caster
from torchsphere.tracking.track import Track

RADIUS, N = 20.0, 60


@dataclass(frozen=True)
class Turning:
    """A ball that turns in place by 90 deg and back, and what was made of it."""

    images: torch.Tensor
    centres: np.ndarray
    orientations: np.ndarray
    track: Track
    progress: list[tuple[int, int]]

    @property
    def circle(self) -> tuple[float, float, float]:
        return (*self.centres[0], RADIUS)


@pytest.fixture(scope="module")
def turning() -> Turning:
    axis = torch.tensor([0.3, 0.85, 0.4], dtype=torch.float64)
    axis = axis / axis.norm()
    angle = np.radians(3.0) * np.concatenate((np.arange(N // 2), np.arange(N // 2, 0, -1)))
    orientations = torch.stack([rotation_matrix(a * axis) for a in angle])
    i = np.arange(N)
    centres = np.stack((40.3 + 0.3 * np.sin(i / 5), 38.6 + 0.2 * np.cos(i / 7)), 1)
    clean = ray_caster.render(
        speckle(1, RADIUS), torch.from_numpy(centres).float(), RADIUS, orientations.float(), 90.0, shape=(80, 80)
    )
    images = noisy(clean, 2.0, 9)
    calls: list[tuple[int, int]] = []
    found = track(images, (*centres[0], RADIUS + 0.2), progress=lambda done, total: calls.append((done, total)))
    return Turning(images, centres, orientations.numpy(), found, calls)


def test_a_ball_that_turns_far_gets_a_map_without_being_asked(turning: Turning) -> None:
    about = turning.track.settings["sphere_map"]
    assert about["used"] is True
    assert about["keyframes"] == mapped.KEYFRAMES
    assert about["frames"] == N
    # Noise is all that is left, by the pairs' own account.
    assert about["residual_over_noise"] < 1.3


def test_progress_goes_from_frame_to_frame_and_once_more_for_the_map(turning: Turning) -> None:
    done = np.array([call[0] for call in turning.progress])
    assert {call[1] for call in turning.progress} == {N}
    again = np.flatnonzero(np.diff(done) < 0)
    assert len(again) == 1
    assert done[again[0]] == N
    assert done[again[0] + 1] == 0
    assert done[-1] == N


def test_torch_has_a_single_thread_to_itself_in_all_of_a_track_and_its_own_number_afterwards(turning: Turning) -> None:
    """Where other programs use the cores, too, its threads wait for each other."""
    before, seen = torch.get_num_threads(), set()
    torch.set_num_threads(2)
    try:
        track(
            turning.images[:8], turning.circle, sphere_map=True, progress=lambda *_: seen.add(torch.get_num_threads())
        )
        assert torch.get_num_threads() == 2
    finally:
        torch.set_num_threads(before)
    assert seen == {1}


def test_neither_position_nor_orientation_drifts(turning: Turning) -> None:
    measured = turning.track
    assert (measured.status == "ok").all()
    off = np.abs(measured.position - turning.centres)
    # Outline and texture place each frame anew: 0.01 px stated, worst of 120; the pairs' sum is off by 0.1 px and more.
    assert off.max() < 0.035
    turned = turning.orientations @ turning.orientations[0].T
    assert angles_between(measured.orientation, turned).max() < 0.12


def test_the_radius_given_is_corrected(turning: Turning) -> None:
    assert abs(turning.track.circle.radius - RADIUS) < 3 * bundle_adjustment.SYSTEMATIC_RADIUS_PX
    assert turning.track.circle.sd_radius >= bundle_adjustment.SYSTEMATIC_RADIUS_PX


def test_increments_are_the_differences_of_the_poses_and_their_errors_are_those_stated(turning: Turning) -> None:
    measured = turning.track
    np.testing.assert_allclose(measured.increment[:, :2], np.diff(measured.position, axis=0), atol=1e-12)
    errors = measured.increment[:, :2] - np.diff(turning.centres, axis=0)
    sd = np.sqrt(np.einsum("nii->ni", measured.covariance)[:, :2])
    # 118 numbers know their scatter to 7 %; frames that are no keyframes are stated a quarter too wide on purpose.
    assert 0.6 < np.sqrt(np.mean((errors / sd) ** 2)) < 1.25


def test_a_map_that_is_not_wanted_is_not_made(turning: Turning) -> None:
    measured = track(turning.images[:8], turning.circle, sphere_map=False)
    assert measured.settings["sphere_map"]["used"] is False
    few = track(turning.images[:4], turning.circle, sphere_map=True)
    assert few.settings["sphere_map"]["used"] is False
    assert "4 frames" in few.settings["sphere_map"]["reason"]


def test_a_map_that_cannot_be_solved_for_leaves_the_measured_steps(
    turning: Turning, monkeypatch: pytest.MonkeyPatch
) -> None:
    def unsolvable(*_: object) -> None:
        raise np.linalg.LinAlgError("singular")

    plain = track(turning.images[:8], turning.circle, sphere_map=False)
    monkeypatch.setattr(bundle_adjustment, "adjust", unsolvable)
    measured = track(turning.images[:8], turning.circle, sphere_map=True)
    assert measured.settings["sphere_map"] == {"used": False, "reason": "the equations of the map have no solution"}
    np.testing.assert_array_equal(measured.increment, plain.increment)  # the same computation


def test_a_model_that_is_not_rigid_gets_no_map_and_says_so(turning: Turning) -> None:
    about = track(turning.images[:4], turning.circle, sphere_map=True, model="translation").settings["sphere_map"]
    assert about["used"] is False
    assert "translation" in about["reason"]
    assert "not needed" not in about["reason"]


def test_images_that_no_map_explains_are_refused(turning: Turning) -> None:
    """Every other image shows a ball with another pattern."""
    poses = torch.from_numpy(turning.centres[:10]).float(), torch.from_numpy(turning.orientations[:10]).float()
    other = ray_caster.render(speckle(2, RADIUS), poses[0], RADIUS, poses[1], 90.0, shape=(80, 80))
    images = turning.images[:10].clone()
    images[1::2] = noisy(other, 2.0, 11)[1::2]
    circle = Circle(*turning.circle)
    found = mapped.poses_on_map(
        Source.open(images), turning.centres[:10], turning.orientations[:10], 0.025, circle, None
    )
    assert isinstance(found, str)
    assert found


def test_a_frame_that_is_not_on_the_map_keeps_its_step(turning: Turning, monkeypatch: pytest.MonkeyPatch) -> None:
    """One registration is made to fail; the frame follows from its neighbour by the correlation's own increment."""
    true_register, calls = registration.register, []

    def failing(*args: object) -> registration.Registration:
        calls.append(1)
        found = true_register(*args)  # type: ignore[arg-type]
        return registration.Registration(found.pose, found.covariance, len(calls) != 2, found.misfit)

    monkeypatch.setattr(registration, "register", failing)
    monkeypatch.setattr(mapped, "KEYFRAMES", 10)
    plain = track(turning.images[:16], turning.circle, sphere_map=False)
    measured = track(turning.images[:16], turning.circle, sphere_map=True)
    about = measured.settings["sphere_map"]
    assert about["used"] is True
    assert about["frames"] == 15
    assert (measured.status == "ok").all()
    assert np.isfinite(measured.increment).all()
    kept = np.isclose(measured.covariance, plain.covariance, rtol=1e-12).all((1, 2))
    assert kept.sum() == 2  # the step to the frame, and the step from it
