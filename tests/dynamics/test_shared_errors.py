"""Errors that all frames share: their part in the standard deviations of velocity, spin and force."""

import dataclasses

import numpy as np
import pytest
from tracks import falling_track, made_track

import torchsphere as ts
from torchsphere.motion.findings import Findings


@pytest.fixture
def falling() -> ts.Track:
    return falling_track()


def test_a_steady_error_of_the_steps_widens_velocity_spin_and_force(falling: ts.Track) -> None:
    exact = ts.kinematics(falling, frame_rate=1000.0, m_per_px=5e-4, mass_kg=0.1)
    steady = dataclasses.replace(falling, sd_steady=np.array([0.02, 0.02, 1e-3, 1e-3, 1e-3]))
    motion = ts.kinematics(steady, frame_rate=1000.0, m_per_px=5e-4, mass_kg=0.1)
    # 0.02 px per frame are 0.01 m/s, and 0.001 rad are 1 rad/s. In a flight of 8 frame intervals the error may change
    # by 1.4 of its size: 0.014 m/s in 8 ms are 1.75 m/s^2, and 0.175 N with 0.1 kg.
    for name, added in (("velocity_m_s", 0.01), ("spin_rad_s", 1.0), ("force_N", 0.175)):
        wider, own = (getattr(m, f"sd_{name}")[4, 1] for m in (motion, exact))
        assert np.sqrt(wider**2 - own**2) == pytest.approx(added, rel=1e-6)


def by_pairs(track: ts.Track) -> ts.Track:
    return dataclasses.replace(track, findings=Findings())


# 0.2 of 20 px is 1 %; of a spin of 10 rad/s the rotation's share is 2.1 % by pairs, and 0.85 % on a map.
@pytest.mark.parametrize(("on_map", "of_spin"), [(True, 0.085), (False, 0.21)])
def test_the_radius_uncertainty_enters_scale_velocity_and_spin(falling: ts.Track, on_map: bool, of_spin: float) -> None:
    falling = falling if on_map else by_pairs(falling)
    exact = ts.kinematics(falling, frame_rate=1000.0, diameter_m=0.02)
    circle = dataclasses.replace(falling.circle, sd_radius=0.2)
    motion = ts.kinematics(dataclasses.replace(falling, circle=circle), frame_rate=1000.0, diameter_m=0.02)
    # Of a velocity of 1 m/s.
    added = np.sqrt(motion.sd_velocity_m_s[4, 0] ** 2 - exact.sd_velocity_m_s[4, 0] ** 2)
    assert added == pytest.approx(0.01, rel=1e-6)
    added = np.sqrt(motion.sd_spin_rad_s[4, 2] ** 2 - exact.sd_spin_rad_s[4, 2] ** 2)
    assert added == pytest.approx(of_spin, rel=1e-6)


@pytest.mark.parametrize(("on_map", "of_step"), [(True, 1.3), (False, 3.0)])
def test_the_radius_uncertainty_enters_the_velocity_of_a_ball_that_turns(on_map: bool, of_step: float) -> None:
    increment = np.tile([1.0, 0.0, 0.0, 0.02, 0.0], (10, 1))
    turning = made_track(
        increment, np.array([0.01, 0.01, 1e-4, 1e-4, 1e-4]), ts.Circle(50.0, 40.0, 20.0, 0.0, 0.0, 0.0)
    )
    exact = turning if on_map else by_pairs(turning)
    uncertain = dataclasses.replace(exact, circle=dataclasses.replace(exact.circle, sd_radius=0.2))
    wide, own = (ts.kinematics(t, frame_rate=1000.0, m_per_px=5e-4).sd_velocity_m_s[5, 0] for t in (uncertain, exact))
    # 20 rad/s about y move x, and 0.2 px are 0.1 mm.
    assert np.sqrt(wide**2 - own**2) == pytest.approx(of_step * 1e-4 * 20, rel=1e-6)


def test_a_camera_at_an_unknown_distance_widens_a_scale_that_comes_from_the_outline(falling: ts.Track) -> None:
    unknown = dataclasses.replace(falling, findings=dataclasses.replace(falling.findings, sd_radius_over_distance=0.1))
    # A ball at k = radius over distance has an outline of R / sqrt(1 - k^2): larger by 0.5 % at 10 radii.
    k = np.abs(np.random.default_rng(0).normal(0, 0.1, 100_000))
    shown = np.sqrt(np.mean((k**2 / 2) ** 2))
    by_outline, given = (
        [ts.kinematics(track, frame_rate=1000.0, **size).sd_velocity_m_s[4, 0] for track in (unknown, falling)]
        for size in ({"diameter_m": 0.02}, {"m_per_px": 5e-4})
    )
    # 1 m/s. The size of a pixel that is given does not depend on the outline.
    assert np.sqrt(by_outline[0] ** 2 - by_outline[1] ** 2) == pytest.approx(shown, rel=0.02)
    assert given[0] == given[1]


def test_an_uncertain_centre_widens_the_spin_about_z_of_a_ball_that_tilts() -> None:
    n = 11
    increment = np.tile([1.0, 0.0, 0.01, 0.02, 0.0], (n - 1, 1))
    exact = made_track(increment, np.array([0.01, 0.01, 1e-4, 1e-4, 1e-4]), ts.Circle(50.0, 40.0, 20.0, 0.0, 0.0, 0.0))
    uncertain = dataclasses.replace(exact, circle=dataclasses.replace(exact.circle, sd_x=0.4, sd_y=0.1))
    wide, own = (ts.kinematics(t, frame_rate=1000.0, m_per_px=5e-4).sd_spin_rad_s[5, 2] for t in (uncertain, exact))
    # 10 rad/s about x times 0.4 px and 20 rad/s about y times 0.1 px; 0.85 of their sum over 20 px.
    assert np.sqrt(wide**2 - own**2) == pytest.approx(0.85 * np.hypot(10 * 0.4, 20 * 0.1) / 20, rel=1e-6)


def test_the_error_by_the_radius_may_change_along_a_flight_by_its_own_size(falling: ts.Track) -> None:
    exact = ts.kinematics(falling, frame_rate=1000.0, m_per_px=5e-4)
    circle = dataclasses.replace(falling.circle, sd_radius=0.2)
    motion = ts.kinematics(dataclasses.replace(falling, circle=circle), frame_rate=1000.0, m_per_px=5e-4)
    added = np.sqrt(motion.sd_angular_acceleration_rad_s2[4, 2] ** 2 - exact.sd_angular_acceleration_rad_s2[4, 2] ** 2)
    # 0.85 % of a spin of 10 rad/s, in 8 ms.
    assert added == pytest.approx(0.085 / 8e-3, rel=1e-5)


def test_errors_of_the_steps_add_up_in_positions_that_are_their_sum_and_not_on_a_map() -> None:
    n = 21
    increment = np.tile([1.0, 0.0, 0.0, 0.02, 0.0], (n - 1, 1))
    sd = np.array([0.01, 0.01, 1e-4, 1e-4, 1e-4])
    on_map = made_track(increment, sd, ts.Circle(50.0, 40.0, 20.0, 0.0, 0.0, 0.05))
    track = dataclasses.replace(on_map, findings=Findings())
    steady = dataclasses.replace(track, sd_steady=np.array([0.02, 0.01, 0.0, 0.0, 0.0]))
    none = dataclasses.replace(track, circle=dataclasses.replace(track.circle, sd_radius=0.0))
    kept = dataclasses.replace(on_map, sd_steady=steady.sd_steady)
    first, exact, mapped, known = (
        1e3 * ts.kinematics(t, frame_rate=1000.0, m_per_px=1e-3).sd_position_m for t in (steady, none, kept, on_map)
    )
    added = np.sqrt(first**2 - exact**2)
    # 0.02 px per frame, and 3 x 0.05 px for each rad about y, of which there are 0.02 per frame.
    np.testing.assert_allclose(added[:, 0], np.arange(n) * np.hypot(0.02, 0.15 * 0.02), rtol=1e-3, atol=1e-9)
    np.testing.assert_allclose(added[:, 1], np.arange(n) * 0.01, rtol=1e-3, atol=1e-9)
    np.testing.assert_allclose(mapped, known, rtol=1e-9)
