"""SI units, signs of the lab frame, and uncertainty of central differences."""

import dataclasses

import numpy as np
import pytest

import torchsphere as ts
from torchsphere.orientation import chain

N = 9


def made_track(increment: np.ndarray, sd: np.ndarray, circle: ts.Circle) -> ts.Track:
    n = len(increment) + 1
    position = np.array([circle.x, circle.y]) + np.concatenate((np.zeros((1, 2)), increment[:, :2].cumsum(0)))
    rotation = np.concatenate((np.zeros((1, 3)), increment[:, 2:]))
    return ts.Track(
        position=position,
        increment=increment,
        covariance=np.tile(np.diag(sd**2), (n - 1, 1, 1)),
        orientation=chain(rotation, np.ones(n, dtype=bool)),
        zncc=np.ones(n),
        iterations=np.ones(n, dtype=np.int64),
        status=np.full(n, "ok"),
        circle=circle,
        settings={},
    )


@pytest.fixture
def falling() -> ts.Track:
    """2 px per frame to the right; down, 0.1 px per frame faster each frame; turning clockwise as displayed."""
    k = np.arange(N - 1)
    zero = np.zeros(N - 1)
    increment = np.stack((zero + 2.0, 0.1 * k, zero, zero, zero + 0.01), 1)
    return made_track(increment, np.array([0.01, 0.01, 1e-4, 1e-4, 1e-4]), ts.Circle(50.0, 40.0, 20.0, 0.0, 0.0, 0.0))


def test_a_ball_that_falls_faster_and_faster_has_the_velocity_and_force_of_its_pixels(falling: ts.Track) -> None:
    # 40 px are 20 mm, so a px is 0.5 mm; at 1000 frames/s, 2 px per frame are 1 m/s and 0.1 px per frame^2 50 m/s^2.
    motion = ts.kinematics(falling, frame_rate=1000.0, diameter_m=0.02, mass_kg=0.1)
    inner = slice(1, -1)
    np.testing.assert_allclose(motion.velocity_m_s[inner, 0], 1.0, rtol=1e-12)
    np.testing.assert_allclose(motion.acceleration_m_s2[inner, 1], 50.0, rtol=1e-9)
    np.testing.assert_allclose(motion.force_N[inner, 1], 5.0, rtol=1e-9)
    np.testing.assert_allclose(motion.spin_rad_s[inner], [[0.0, 0.0, 10.0]] * (N - 2), atol=1e-12)
    np.testing.assert_allclose(motion.time_s, np.arange(N) / 1000.0)


def test_in_the_lab_frame_a_falling_ball_moves_down_and_a_clockwise_turn_is_negative(falling: ts.Track) -> None:
    motion = ts.kinematics(falling, frame_rate=1000.0, m_per_px=5e-4, lab_frame=True)
    assert np.all(motion.velocity_m_s[2:-1, 1] < 0)
    assert np.all(motion.velocity_m_s[1:-1, 0] > 0)
    assert np.all(motion.spin_rad_s[1:-1, 2] < 0)
    assert motion.force_N is None


def test_the_first_and_last_frame_have_no_central_difference(falling: ts.Track) -> None:
    motion = ts.kinematics(falling, frame_rate=1000.0, m_per_px=5e-4)
    for values in (motion.velocity_m_s, motion.acceleration_m_s2, motion.spin_rad_s, motion.sd_velocity_m_s):
        assert np.isnan(values[[0, -1]]).all()
        assert np.isfinite(values[1:-1]).all()


def test_uncertainty_is_that_of_poses_with_independent_errors() -> None:
    # Independent errors of each frame's pose, as image noise makes them: increments are their differences. The sample's
    # standard deviation over 40,000 frames is right to 0.35 %, and to 0.5 % for second differences, which are
    # correlated among themselves by -2/3 and 1/6; four of that is the tolerance.
    rng = np.random.default_rng(3)
    pose_sd = np.array([0.01, 0.02, 1e-4, 2e-4, 3e-4])
    poses = rng.normal(size=(40_000, 5)) * pose_sd
    track = made_track(np.diff(poses, axis=0), pose_sd * np.sqrt(2), ts.Circle(0.0, 0.0, 20.0, 0.0, 0.0, 0.0))
    motion = ts.kinematics(track, frame_rate=100.0, m_per_px=1e-3)
    pairs = (
        (motion.velocity_m_s, motion.sd_velocity_m_s),
        (motion.acceleration_m_s2, motion.sd_acceleration_m_s2),
        (motion.spin_rad_s, motion.sd_spin_rad_s),
    )
    for values, sd in pairs:
        np.testing.assert_allclose(np.nanstd(values, axis=0), sd[1], rtol=0.02)


def test_the_radius_uncertainty_enters_scale_velocity_and_spin(falling: ts.Track) -> None:
    circle = dataclasses.replace(falling.circle, sd_radius=0.2)
    motion = ts.kinematics(dataclasses.replace(falling, circle=circle), frame_rate=1000.0, diameter_m=0.02)
    # 0.2 of 20 px is 1 %: of a velocity of 1 m/s that is 0.01, against 2.5 mm/s from the increments.
    assert motion.sd_velocity_m_s[4, 0] == pytest.approx(np.hypot(0.01, 0.01 / 2 * 0.5), rel=1e-6)
    assert motion.sd_spin_rad_s[4, 2] > 0.02 * 10


def test_a_missing_frame_leaves_nan_beside_it_and_nothing_else(falling: ts.Track) -> None:
    increment = falling.increment.copy()
    increment[3] = np.nan
    motion = ts.kinematics(dataclasses.replace(falling, increment=increment), frame_rate=1000.0, m_per_px=5e-4)
    missing = np.isnan(motion.velocity_m_s[:, 0])
    assert np.flatnonzero(missing).tolist() == [0, 3, 4, N - 1]


@pytest.mark.parametrize(
    ("settings", "word"),
    [
        ({"frame_rate": 0.0, "m_per_px": 1e-3}, "frame_rate"),
        ({"frame_rate": float("nan"), "m_per_px": 1e-3}, "frame_rate"),
        ({"frame_rate": 1.0}, "either"),
        ({"frame_rate": 1.0, "m_per_px": 1e-3, "diameter_m": 0.02}, "either"),
        ({"frame_rate": 1.0, "diameter_m": -0.02}, "diameter_m"),
        ({"frame_rate": 1.0, "m_per_px": 1e-3, "mass_kg": float("inf")}, "mass_kg"),
    ],
)
def test_a_senseless_number_is_refused_by_its_name(falling: ts.Track, settings: dict, word: str) -> None:
    with pytest.raises(ValueError, match=word):
        ts.kinematics(falling, **settings)
