"""Absolute poses on a map of the ball: drift, uncertainty, and refusal of the map."""

import math
from dataclasses import dataclass, replace

import numpy as np
import pytest
import torch
from shots import angles_between, noisy, rotation_matrix, speckle
from tracks import made_map, no_map

from experiments.validation.attack_cases import CASES
from torchsphere import Circle, track
from torchsphere.recording.frame_source import Source
from torchsphere.sphere_map import bundle_adjustment, pose_errors, poses, radius_error, registration
from torchsphere.sphere_map.ball import Poses, TexturedBall, uniform_light
from torchsphere.sphere_map.decision import NoMap, Why
from torchsphere.sphere_map.elimination import COMMON, PER_IMAGE
from torchsphere.sphere_map.keyframes import MAX_KEYFRAMES, MIN_KEYFRAMES
from torchsphere.sphere_map.level import Adjustment
from torchsphere.sphere_map.nearness import UNKNOWN_SD
from torchsphere.sphere_map.pixel_weights import uniform_profile
from torchsphere.sphere_map.poses import MapRequest
from torchsphere.sphere_map.registration import Registration
from torchsphere.sphere_map.state import State
from torchsphere.sphere_map.window import Windows
from torchsphere.synthetic import ray_caster
from torchsphere.tracking.track import Track

RADIUS, N = 20.0, 60


@dataclass(frozen=True)
class Turning:
    """A ball that turns in place by 90 deg and back, and its track."""

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


def test_a_ball_that_turns_far_gets_a_map_by_default(turning: Turning) -> None:
    found = made_map(turning.track)
    assert MIN_KEYFRAMES <= found.keyframes <= MAX_KEYFRAMES
    assert found.frames == N
    # The residual is noise alone, by the estimate from the pairs.
    assert found.residual_over_noise < 1.3


def test_progress_counts_all_frames_and_counts_them_again_for_the_map(turning: Turning) -> None:
    done = np.array([call[0] for call in turning.progress])
    assert {call[1] for call in turning.progress} == {N}
    restarts = np.flatnonzero(np.diff(done) < 0)
    assert len(restarts) == 1
    assert done[restarts[0]] == N
    assert done[restarts[0] + 1] == 0
    assert done[-1] == N


def test_torch_has_one_thread_during_a_track_and_its_former_number_afterwards(turning: Turning) -> None:
    """If other programs use the cores, torch's own threads wait for each other."""
    before, during = torch.get_num_threads(), set()
    torch.set_num_threads(2)
    try:
        track(
            turning.images[:8], turning.circle, sphere_map=True, progress=lambda *_: during.add(torch.get_num_threads())
        )
        assert torch.get_num_threads() == 2
    finally:
        torch.set_num_threads(before)
    assert during == {1}


def test_position_and_orientation_do_not_drift(turning: Turning) -> None:
    measured = turning.track
    assert (measured.status == "ok").all()
    errors = np.abs(measured.position - turning.centres)
    # 0.01 px are stated for each of 120 numbers. The sum of the increments is off by 0.1 px or more.
    assert errors.max() < 0.035
    truth = turning.orientations @ turning.orientations[0].T
    angles = angles_between(measured.orientation, truth)
    assert angles.mean() < 0.06
    assert angles.max() < 0.12


def test_a_wrong_radius_is_corrected(turning: Turning) -> None:
    assert abs(turning.track.circle.radius - RADIUS) < 3 * radius_error.RADIUS_ERROR_PX
    assert turning.track.circle.sd_radius >= radius_error.RADIUS_ERROR_PX


def test_increments_are_the_differences_of_the_poses_and_have_the_stated_errors(turning: Turning) -> None:
    measured = turning.track
    np.testing.assert_allclose(measured.increment[:, :2], np.diff(measured.position, axis=0), atol=1e-12)
    errors = measured.increment[:, :2] - np.diff(turning.centres, axis=0)
    sd = np.sqrt(np.einsum("nii->ni", measured.covariance)[:, :2])
    # 118 numbers give their scatter to 7 %; frames beside the keyframes are stated a quarter too wide on purpose.
    assert 0.6 < np.sqrt(np.mean((errors / sd) ** 2)) < 1.25


def test_no_map_is_made_if_it_is_switched_off_or_too_few_frames_are_known(turning: Turning) -> None:
    measured = track(turning.images[:8], turning.circle, sphere_map=False)
    assert not measured.findings.is_on_map
    few = track(turning.images[:4], turning.circle, sphere_map=True)
    assert not few.findings.is_on_map
    assert (no_map(measured).why, no_map(few).why) == (Why.NOT_ASKED, Why.FEW_FRAMES)
    assert "there are 4" in no_map(few).reason


def test_singular_equations_of_the_map_leave_the_measured_increments(
    turning: Turning, monkeypatch: pytest.MonkeyPatch
) -> None:
    def unsolvable(*_: object, **__: object) -> None:
        raise np.linalg.LinAlgError("singular")

    plain = track(turning.images[:8], turning.circle, sphere_map=False)
    monkeypatch.setattr(bundle_adjustment, "adjust", unsolvable)
    measured = track(turning.images[:8], turning.circle, sphere_map=True)
    assert no_map(measured).why is Why.NO_SOLUTION
    assert no_map(measured).reason == "the equations of the map have no solution"
    # The outlines agree, so that the circle stays without a map.
    assert measured.findings.outline_scatter < 0.01
    np.testing.assert_array_equal(measured.increment, plain.increment)  # the same computation


def test_a_model_that_is_not_rigid_gets_no_map_and_the_reason_names_the_model(turning: Turning) -> None:
    measured = track(turning.images[:4], turning.circle, sphere_map=True, model="translation")
    assert no_map(measured).why is Why.MODEL
    assert "translation" in no_map(measured).reason
    assert "not needed" not in no_map(measured).reason


def test_images_that_do_not_fit_any_map_are_refused(turning: Turning) -> None:
    """Every other image shows a ball with another pattern."""
    truth = torch.from_numpy(turning.centres[:10]).float(), torch.from_numpy(turning.orientations[:10]).float()
    other = ray_caster.render(speckle(2, RADIUS), truth[0], RADIUS, truth[1], 90.0, shape=(80, 80))
    images = turning.images[:10].clone()
    images[1::2] = noisy(other, 2.0, 11)[1::2]
    circle = Circle(*turning.circle)
    request = MapRequest(
        Source.open(images),
        turning.centres[:10],
        turning.orientations[:10],
        np.full(10, circle.radius),
        0.025,
        circle,
        None,
        0.1,
    )
    found = poses.poses_on_map(request)
    assert isinstance(found, NoMap)
    assert found


def test_a_frame_that_is_not_on_the_map_keeps_its_increment(turning: Turning, monkeypatch: pytest.MonkeyPatch) -> None:
    """One registration is made to fail; its frame follows from its neighbour by the correlation's increment."""
    true_register = registration.register

    def failing(windows: Windows, *rest: object) -> Registration:
        found = true_register(windows, *rest)  # type: ignore[arg-type]
        converged = found.converged.clone()
        if len(windows) == 16:
            converged[6] = False
        return replace(found, converged=converged)

    monkeypatch.setattr(registration, "register", failing)
    plain = track(turning.images[:16], turning.circle, sphere_map=False)
    measured = track(turning.images[:16], turning.circle, sphere_map=True)
    assert made_map(measured).frames == 15
    assert (measured.status == "ok").all()
    assert np.isfinite(measured.increment).all()
    kept = np.isclose(measured.covariance, plain.covariance, rtol=1e-12).all((1, 2))
    assert kept.sum() == 2  # the step to the frame, and the step from the frame


KEYS = [0, 4, 5, 8]


def step_variances(misfits: dict[int, float], keyframe_variance: float = 4.0) -> np.ndarray:
    """Variance (8, 5) of the steps, px, rotations times the radius; the noise of each image has unit variance.

    ``misfits`` are those of the frames, 1 for keyframes without; the adjustment gives each keyframe
    ``keyframe_variance``.
    """
    numbers = np.array(sorted({*misfits, *KEYS}))
    unit = torch.eye(6, dtype=torch.float64).expand(len(numbers), 6, 6)
    misfit = torch.tensor([misfits.get(int(i), 1.0) for i in numbers], dtype=torch.float64)
    at = Poses.at(torch.zeros(len(numbers), 2).double(), torch.eye(3).double().expand(len(numbers), 3, 3))
    found = Registration(at, unit, misfit > 0, misfit)
    size, none = torch.tensor(RADIUS, dtype=torch.float64), torch.zeros(len(KEYS), 1, 1)
    ball = TexturedBall(size, size * 0 + 0.3, 8, torch.zeros(0), uniform_light(size))
    windows = Windows(none, none, none, torch.zeros(len(KEYS), 2).double())
    state = State(windows, at.take(slice(0, len(KEYS))), ball, uniform_profile(size, 4.0))
    covariance = keyframe_variance * torch.eye(PER_IMAGE * len(KEYS) + COMMON, dtype=torch.float64)
    adjustment = Adjustment(state, covariance, settled=True)
    variance = np.einsum("nii->ni", pose_errors.step_covariances(9, numbers, found, KEYS, adjustment))
    return variance * np.array([1, 1, *4 * [RADIUS**2]])


def test_a_step_has_the_noise_of_its_two_images_scaled_by_their_misfits() -> None:
    found = step_variances({1: 1.1, 2: 1.3, 3: 1.1, 6: 1.2, 7: 1.2})
    np.testing.assert_allclose(found[1], 1.1 + 1.3, rtol=1e-9)
    np.testing.assert_allclose(found[6], 1.2 + 1.2, rtol=1e-9)


def test_a_frame_that_made_the_map_gets_back_the_noise_that_the_map_has_taken_up() -> None:
    """The mean of n images as their map: a residual has the variance 1 - 1 / n, for another image 1 + 1 / n.

    An image that made the map is moved by its own noise and by that of the n - 1 others in the map, 1 / n of each.
    """
    n, made = 4, np.arange(4)
    misfit = torch.tensor([1 - 1 / n] * n + [1 + 1 / n], dtype=torch.float64)
    found = pose_errors.without_leverage(misfit, np.arange(n + 1), made, torch.full((n,), 1 / n))
    of_others = (n - 1) / n**2
    np.testing.assert_allclose(found, [1 + of_others] * n + [1 + 1 / n], rtol=1e-9)


def test_a_step_between_keyframes_has_the_covariance_of_the_adjustment() -> None:
    np.testing.assert_allclose(step_variances({1: 1.5, 2: 1.5})[4], 2 * 4.0, rtol=1e-9)


def test_a_step_of_a_frame_that_is_not_on_the_map_has_no_covariance() -> None:
    found = step_variances({1: 1.1, 3: 1.1})
    assert np.isnan(found[[1, 2, 5, 6, 7]]).all()
    assert np.isfinite(found[[0, 3, 4]]).all()


@pytest.mark.parametrize(
    ("factor", "expected"), [(1.5, math.hypot(0.002, 0.5 * poses.SD_NEARNESS_MORE)), (2.5, UNKNOWN_SD)]
)
def test_images_that_the_map_does_not_explain_tell_nothing_of_the_cameras_distance(
    factor: float, expected: float
) -> None:
    still = np.zeros((2, 2)), np.tile(np.eye(3), (2, 1, 1)), np.full(2, 5.0), np.eye(5)[None], np.zeros(1)
    found = poses.MapPoses(*still, Circle(9.0, 9.0, 5.0), 2, 0.3, 1.0, np.ones(2), sd_nearness=0.002)
    widened = poses._widened(found, np.full(6, factor), is_distance_known=False)
    assert widened.sd_nearness == pytest.approx(expected)
    # With a camera that is given, or telecentric, there is nothing to find.
    assert poses._widened(found, np.full(6, factor), is_distance_known=True).sd_nearness == found.sd_nearness


@pytest.mark.parametrize("seed", [305, 306])
def test_a_steady_flight_has_a_map(seed: int) -> None:
    # The first steps of 305 move the poses by half a px twice: an adjustment that ended there was no map.
    flight = CASES["nothing"](seed)
    assert made_map(track(flight.images, log=False)).frames == len(flight.images)
