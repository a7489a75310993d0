"""Mean motion of a recording: its standard deviations are those of its errors."""

import dataclasses

import numpy as np
import pytest
from tracks import made_track

import torchsphere as ts
from torchsphere.dynamics.mean_motion import mean_motion
from torchsphere.synthetic import demo_shot

EXACT = ts.Circle(50.0, 40.0, 20.0, 0.0, 0.0, 0.0)
POSE_SD = np.array([0.01, 0.02, 1e-4, 2e-4, 3e-4])
STEP = np.array([2.0, -1.0, 0.0, 0.01, 0.002])


def drawn(seed: int, n: int = 12, lost: tuple[int, ...] = ()) -> ts.Track:
    """Steady motion with independent errors of the poses; the steps ``lost`` are not known."""
    error = np.random.default_rng(seed).normal(size=(n, 5)) * POSE_SD
    increment = STEP + np.diff(error, axis=0)
    increment[list(lost)] = np.nan
    track = made_track(np.nan_to_num(increment), POSE_SD * np.sqrt(2), EXACT)
    return dataclasses.replace(track, increment=increment)


@pytest.mark.parametrize("lost", [(), (4,), (0, 5, 6)])
def test_the_standard_deviation_of_a_mean_is_that_of_its_end_poses(lost: tuple[int, ...]) -> None:
    means = [mean_motion(drawn(seed, lost=lost), None) for seed in range(1500)]
    scatter = np.std([m["increment_px_rad"] - STEP for m in means], axis=0)
    # The standard deviation of 1500 values is right to 1.8 %; the tolerance is four times that.
    np.testing.assert_allclose(scatter, means[0]["sd_increment_px_rad"], rtol=0.075)


def test_mean_velocity_and_spin_are_the_mean_step_with_the_uncertainty_of_the_scale() -> None:
    track = drawn(0)
    motion = ts.kinematics(track, frame_rate=1000.0, m_per_px=5e-4, relative_sd_scale=0.03, lab_frame=True)
    found = mean_motion(track, motion)
    step, sd = found["increment_px_rad"], found["sd_increment_px_rad"]
    np.testing.assert_allclose(found["velocity_m_s"], 0.5 * step[:2] * [1, -1])
    np.testing.assert_allclose(found["sd_velocity_m_s"], 0.5 * np.hypot(sd[:2], 0.03 * step[:2]))
    np.testing.assert_allclose(found["spin_rad_s"], 1000 * step[2:] * [1, -1, -1])
    np.testing.assert_allclose(found["sd_spin_rad_s"], 1000 * sd[2:])


def test_a_motion_that_was_not_measured_has_no_mean() -> None:
    track = drawn(0)
    blind = track.increment.copy()
    blind[:, 2:] = np.nan
    found = mean_motion(dataclasses.replace(track, increment=blind), None)
    for values in found.values():
        assert np.isfinite(values[:2]).all()
        assert np.isnan(values[2:]).all()


def test_a_model_without_rotations_has_no_mean_rotation() -> None:
    shot = demo_shot.make_shot()
    track = ts.track(shot.images[:8], model="translation")
    found = mean_motion(
        track, ts.kinematics(track, frame_rate=demo_shot.FRAME_RATE, diameter_m=1e-3 * demo_shot.DIAMETER_MM)
    )
    for name in ("increment_px_rad", "sd_increment_px_rad"):
        assert np.isfinite(found[name][:2]).all()
        assert np.isnan(found[name][2:]).all()
    assert np.isnan([found["spin_rad_s"], found["sd_spin_rad_s"]]).all()


def test_the_true_means_of_the_demo_lie_within_the_stated_uncertainty() -> None:
    ratios = []
    for seed in (1, 2, 3):
        shot = demo_shot.make_shot(seed)
        track = ts.track(shot.images[:26])
        motion = ts.kinematics(track, frame_rate=demo_shot.FRAME_RATE, diameter_m=1e-3 * demo_shot.DIAMETER_MM)
        found = mean_motion(track, motion)
        true = shot.increment[:25].mean(0)
        to_m_s = 1e-3 * demo_shot.DIAMETER_MM / (2 * demo_shot.RADIUS_PX) * demo_shot.FRAME_RATE
        ratios.append((found["increment_px_rad"] - true) / found["sd_increment_px_rad"])
        ratios.append((found["velocity_m_s"] - to_m_s * true[:2]) / found["sd_velocity_m_s"])
        ratios.append((found["spin_rad_s"] - demo_shot.FRAME_RATE * true[2:]) / found["sd_spin_rad_s"])
    values = np.abs(np.concatenate(ratios))
    # Ten such flights and ten impacts had a root mean square of 0.4 to 1.0 in each component.
    assert np.sqrt((values**2).mean()) < 1.3
    assert np.sqrt((values**2).mean()) > 0.3
    assert values.max() < 3
