"""SI units, signs of the lab frame, and uncertainty of local polynomials; the smoother has estimation/test_rts.py."""

import dataclasses

import numpy as np
import pytest
import torch
from tracks import made_track

import torchsphere as ts
from torchsphere.diagnostics.track_warnings import bandwidth_warnings, window_warnings
from torchsphere.estimation import savitzky_golay

N = 9


@pytest.fixture
def falling() -> ts.Track:
    """2 px per frame to the right; down, 0.1 px per frame faster each frame; turning clockwise as displayed."""
    k = np.arange(N - 1)
    zero = np.zeros(N - 1)
    increment = np.stack((zero + 2.0, 0.1 * k, zero, zero, zero + 0.01), 1)
    return made_track(increment, np.array([0.01, 0.01, 1e-4, 1e-4, 1e-4]), ts.Circle(50.0, 40.0, 20.0, 0.0, 0.0, 0.0))


@pytest.mark.parametrize("method", ["smoother", "savitzky-golay", "differences"])
def test_a_ball_that_falls_faster_and_faster_has_the_velocity_and_force_of_its_pixels(
    falling: ts.Track, method: str
) -> None:
    # 40 px are 20 mm, so a px is 0.5 mm; at 1000 frames/s, 2 px per frame are 1 m/s and 0.1 px per frame^2 50 m/s^2.
    motion = ts.kinematics(falling, frame_rate=1000.0, diameter_m=0.02, mass_kg=0.1, method=method)
    inner = slice(1, -1)
    # The smoother holds start and acceleration for unknown within 1e4 errors of a pose, not for anything: 1e-6 of them.
    exact = 1e-6 if method == "smoother" else 1e-9
    np.testing.assert_allclose(motion.velocity_m_s[inner, 0], 1.0, rtol=exact)
    np.testing.assert_allclose(motion.acceleration_m_s2[inner, 1], 50.0, rtol=exact)
    np.testing.assert_allclose(motion.force_N[inner, 1], 5.0, rtol=exact)
    np.testing.assert_allclose(motion.spin_rad_s[inner], [[0.0, 0.0, 10.0]] * (N - 2), atol=10 * exact)
    np.testing.assert_allclose(motion.time_s, np.arange(N) / 1000.0)


def test_in_the_lab_frame_a_falling_ball_moves_down_and_a_clockwise_turn_is_negative(falling: ts.Track) -> None:
    motion = ts.kinematics(falling, frame_rate=1000.0, m_per_px=5e-4, lab_frame=True)
    assert np.all(motion.velocity_m_s[2:-1, 1] < 0)
    assert np.all(motion.velocity_m_s[1:-1, 0] > 0)
    assert np.all(motion.spin_rad_s[1:-1, 2] < 0)
    assert motion.force_N is None


def test_the_first_and_last_frame_have_no_central_difference(falling: ts.Track) -> None:
    motion = ts.kinematics(falling, frame_rate=1000.0, m_per_px=5e-4, method="differences")
    for values in (motion.velocity_m_s, motion.acceleration_m_s2, motion.spin_rad_s, motion.sd_velocity_m_s):
        assert np.isnan(values[[0, -1]]).all()
        assert np.isfinite(values[1:-1]).all()


@pytest.mark.parametrize("method", ["savitzky-golay", "differences"])
def test_uncertainty_is_that_of_poses_with_independent_errors(method: str) -> None:
    # Independent errors of each frame's pose, as image noise makes them: increments are their differences. The sample's
    # standard deviation over 40,000 frames is right to 0.35 %, and to 0.5 % for second differences, which are
    # correlated among themselves by -2/3 and 1/6; four of that is the tolerance.
    rng = np.random.default_rng(3)
    pose_sd = np.array([0.01, 0.02, 1e-4, 2e-4, 3e-4])
    poses = rng.normal(size=(40_000, 5)) * pose_sd
    track = made_track(np.diff(poses, axis=0), pose_sd * np.sqrt(2), ts.Circle(0.0, 0.0, 20.0, 0.0, 0.0, 0.0))
    motion = ts.kinematics(track, frame_rate=100.0, m_per_px=1e-3, method=method)
    middle = len(poses) // 2
    np.testing.assert_allclose(np.nanstd(motion.velocity_m_s, axis=0), motion.sd_velocity_m_s[middle], rtol=0.02)
    np.testing.assert_allclose(np.nanstd(motion.spin_rad_s, axis=0), motion.sd_spin_rad_s[middle], rtol=0.02)
    acceleration, stated = motion.acceleration_m_s2, motion.sd_acceleration_m_s2[middle]
    np.testing.assert_allclose(np.nanstd(acceleration, axis=0), stated, rtol=0.02)


def test_a_steady_error_of_the_steps_widens_velocity_spin_and_force(falling: ts.Track) -> None:
    exact = ts.kinematics(falling, frame_rate=1000.0, m_per_px=5e-4, mass_kg=0.1)
    steady = dataclasses.replace(falling, sd_steady=np.array([0.02, 0.02, 1e-3, 1e-3, 1e-3]))
    motion = ts.kinematics(steady, frame_rate=1000.0, m_per_px=5e-4, mass_kg=0.1)
    # 0.02 px per frame are 0.01 m/s, and 0.001 rad 1 rad/s. In a flight of 8 frame intervals it may change by 1.4 of
    # itself: 0.014 m/s in 8 ms is 1.75 m/s^2, of 0.1 kg 0.175 N.
    for name, added in (("velocity_m_s", 0.01), ("spin_rad_s", 1.0), ("force_N", 0.175)):
        wider, own = (getattr(m, f"sd_{name}")[4, 1] for m in (motion, exact))
        assert np.sqrt(wider**2 - own**2) == pytest.approx(added, rel=1e-6)


def test_the_radius_uncertainty_enters_scale_velocity_and_spin(falling: ts.Track) -> None:
    exact = ts.kinematics(falling, frame_rate=1000.0, diameter_m=0.02)
    circle = dataclasses.replace(falling.circle, sd_radius=0.2)
    motion = ts.kinematics(dataclasses.replace(falling, circle=circle), frame_rate=1000.0, diameter_m=0.02)
    # 0.2 of 20 px is 1 %: of a velocity of 1 m/s that is 0.01; of a spin of 10 rad/s the rotation's share is 2.1 %.
    added = np.sqrt(motion.sd_velocity_m_s[4, 0] ** 2 - exact.sd_velocity_m_s[4, 0] ** 2)
    assert added == pytest.approx(0.01, rel=1e-6)
    added = np.sqrt(motion.sd_spin_rad_s[4, 2] ** 2 - exact.sd_spin_rad_s[4, 2] ** 2)
    assert added == pytest.approx(0.21, rel=1e-6)


def test_an_uncertain_centre_widens_the_spin_about_z_of_a_ball_that_tilts() -> None:
    n = 11
    increment = np.tile([1.0, 0.0, 0.01, 0.02, 0.0], (n - 1, 1))
    exact = made_track(increment, np.array([0.01, 0.01, 1e-4, 1e-4, 1e-4]), ts.Circle(50.0, 40.0, 20.0, 0.0, 0.0, 0.0))
    uncertain = dataclasses.replace(exact, circle=dataclasses.replace(exact.circle, sd_x=0.4, sd_y=0.1))
    wide, own = (ts.kinematics(t, frame_rate=1000.0, m_per_px=5e-4).sd_spin_rad_s[5, 2] for t in (uncertain, exact))
    # 10 rad/s about x times 0.4 px, 20 rad/s about y times 0.1 px, 0.85 of it over 20 px.
    assert np.sqrt(wide**2 - own**2) == pytest.approx(0.85 * np.hypot(10 * 0.4, 20 * 0.1) / 20, rel=1e-6)


def test_what_the_radius_does_may_change_along_a_flight_by_its_own_size(falling: ts.Track) -> None:
    exact = ts.kinematics(falling, frame_rate=1000.0, m_per_px=5e-4)
    circle = dataclasses.replace(falling.circle, sd_radius=0.2)
    motion = ts.kinematics(dataclasses.replace(falling, circle=circle), frame_rate=1000.0, m_per_px=5e-4)
    added = np.sqrt(motion.sd_angular_acceleration_rad_s2[4, 2] ** 2 - exact.sd_angular_acceleration_rad_s2[4, 2] ** 2)
    # 2.1 % of a spin of 10 rad/s, in 8 ms.
    assert added == pytest.approx(0.21 / 8e-3, rel=1e-5)


@pytest.mark.parametrize("given", [{"diameter_m": 0.02}, {"m_per_px": 5e-4}])
def test_an_uncertain_length_widens_velocity_and_force_by_its_share(falling: ts.Track, given: dict) -> None:
    exact = ts.kinematics(falling, frame_rate=1000.0, mass_kg=0.1, **given)
    motion = ts.kinematics(falling, frame_rate=1000.0, mass_kg=0.1, relative_sd_scale=0.03, **given)
    for name in ("velocity_m_s", "force_N", "position_m"):
        value, sd, wider = (getattr(m, p + name)[4, 1] for m, p in ((exact, ""), (exact, "sd_"), (motion, "sd_")))
        assert wider == pytest.approx(np.hypot(sd, 0.03 * value), rel=1e-9)
    assert "known to 3 %" in motion.scale.origin


def test_a_missing_frame_leaves_nan_beside_it_and_nothing_else_with_differences(falling: ts.Track) -> None:
    increment = falling.increment.copy()
    increment[3] = np.nan
    track = dataclasses.replace(falling, increment=increment)
    motion = ts.kinematics(track, frame_rate=1000.0, m_per_px=5e-4, method="differences")
    missing = np.isnan(motion.velocity_m_s[:, 0])
    assert np.flatnonzero(missing).tolist() == [0, 3, 4, N - 1]


def test_differences_and_polynomials_say_which_frequencies_they_pass(falling: ts.Track) -> None:
    plain = ts.kinematics(falling, frame_rate=1000.0, m_per_px=5e-4, method="differences").about
    # A central difference has the gain sin(w) / w per frame: 0.7071 at w = 1.3916 rad, 221.5 Hz; a second difference
    # (sin(w/2) / (w/2))^2: 0.7071 at w = 2.0029 rad, 318.8 Hz.
    assert plain["bandwidth_Hz"]["rate"] == pytest.approx(221.5, abs=0.5)
    assert plain["bandwidth_Hz"]["acceleration"] == pytest.approx(318.8, abs=0.5)
    wide = ts.kinematics(falling, frame_rate=1000.0, m_per_px=5e-4, method="savitzky-golay", window=7, order=3).about
    assert wide["bandwidth_Hz"]["acceleration"] < plain["bandwidth_Hz"]["acceleration"]
    assert (wide["window_frames"], wide["order"]) == (7, 3)


@pytest.mark.parametrize("shifted", [False, True])
def test_frames_that_are_fitted_at_once_are_no_limit_that_shows(
    monkeypatch: pytest.MonkeyPatch, *, shifted: bool
) -> None:
    draw = np.random.default_rng(1)
    times, increment = draw.uniform(0.5, 1.5, 60).cumsum(), draw.normal(0, 0.1, (59, 5))
    joined = np.ones((59, 2), dtype=bool)
    joined[30, 1] = False

    def found(at_once: int) -> savitzky_golay.Rates:
        monkeypatch.setattr(savitzky_golay, "AT_ONCE", at_once)
        return savitzky_golay.rates(times, increment, joined, np.ones((60, 5)), window=7, order=3, shifted=shifted)

    whole, blocks = found(1000), found(11)
    for name in ("first", "second", "variance_first", "variance_second"):
        assert np.isfinite(getattr(whole, name)).sum() > 200
        np.testing.assert_allclose(getattr(blocks, name), getattr(whole, name), rtol=1e-12)


def test_uneven_times_leave_a_steady_acceleration_what_it_is(falling: ts.Track) -> None:
    times = np.cumsum([0.0, 1.0, 1.3, 0.7, 1.1, 2.0, 0.9, 1.0, 1.2]) * 1e-3
    position = np.stack((1e3 * 2.0 * times, 0.5 * 1e5 * times**2), 1)
    increment = falling.increment.copy()
    increment[:, :2], increment[:, 4] = np.diff(position, axis=0), 10 * np.diff(times)
    track = dataclasses.replace(falling, increment=increment, position=position)
    for method in ("smoother", "savitzky-golay", "differences"):
        motion = ts.kinematics(track, frame_rate=1000.0, m_per_px=5e-4, times_s=times, method=method)
        np.testing.assert_allclose(motion.acceleration_m_s2[1:-1, 1], 50.0, rtol=1e-5)
        np.testing.assert_allclose(motion.velocity_m_s[1:-1, 1], 50 * times[1:-1], rtol=1e-5)
        np.testing.assert_allclose(motion.spin_rad_s[1:-1, 2], 10.0, rtol=1e-5)
        np.testing.assert_allclose(motion.time_s, times)


@pytest.mark.parametrize(
    ("settings", "word"),
    [
        ({"frame_rate": 0.0, "m_per_px": 1e-3}, "frame_rate"),
        ({"frame_rate": float("nan"), "m_per_px": 1e-3}, "frame_rate"),
        ({"frame_rate": None, "m_per_px": 1e-3}, "frame_rate = None: the recording does not tell it; give"),
        ({"frame_rate": 1.0}, "either"),
        ({"frame_rate": 1.0, "m_per_px": 1e-3, "diameter_m": 0.02}, "either"),
        ({"frame_rate": 1.0, "diameter_m": -0.02}, "diameter_m"),
        ({"frame_rate": 1.0, "m_per_px": 1e-3, "mass_kg": float("inf")}, "mass_kg"),
        ({"frame_rate": 1.0, "m_per_px": 1e-3, "relative_sd_scale": -0.1}, "relative_sd_scale"),
        ({"frame_rate": 1.0, "m_per_px": 1e-3, "method": "guess"}, "method"),
        ({"frame_rate": 1.0, "m_per_px": 1e-3, "method": "savitzky-golay", "window": 6}, "window"),
        ({"frame_rate": 1.0, "m_per_px": 1e-3, "times_s": np.zeros(N)}, "times_s"),
        ({"frame_rate": "1000", "m_per_px": 1e-3}, "frame_rate = '1000': expected a finite, positive number"),
        ({"frame_rate": 1.0, "m_per_px": 1e-3, "mass_kg": "0.1"}, "mass_kg = '0.1': expected a finite"),
        ({"frame_rate": 1.0, "diameter_m": "0.03"}, "diameter_m = '0.03'"),
        ({"frame_rate": 1.0, "m_per_px": 1e-3, "relative_sd_scale": None}, "relative_sd_scale = None"),
        ({"frame_rate": 1.0, "m_per_px": 1e-3, "first_frame": "3"}, "first_frame = '3'"),
        ({"frame_rate": 1.0, "m_per_px": 1e-3, "times_s": "abc"}, "times_s: expected"),
        ({"frame_rate": 1.0, "m_per_px": 1e-3, "method": "savitzky-golay", "window": 7.0}, "window = 7.0"),
        ({"frame_rate": 1e300, "m_per_px": 1e-3}, "frame_rate = 1e.300: expected .* frames per second"),
    ],
)
def test_a_senseless_number_is_refused_by_its_name(falling: ts.Track, settings: dict, word: str) -> None:
    with pytest.raises(ValueError, match=word):
        ts.kinematics(falling, **settings)


def test_numbers_may_be_those_of_arrays_and_tensors(falling: ts.Track) -> None:
    expected = ts.kinematics(falling, frame_rate=1000.0, diameter_m=0.5, mass_kg=0.25)
    # As numpy.load gives the scalars of an archive, and torch a single value.
    for rate, mass in ((np.array(1000.0), np.float32(0.25)), (torch.tensor(1000.0), torch.tensor(0.25))):
        found = ts.kinematics(falling, frame_rate=rate, diameter_m=np.array(0.5), mass_kg=mass)  # type: ignore[arg-type]
        np.testing.assert_array_equal(found.velocity_m_s, expected.velocity_m_s)
        np.testing.assert_array_equal(found.force_N, expected.force_N)


def test_what_is_no_track_is_refused_as_that(falling: ts.Track) -> None:
    known = {"frame_rate": 1000.0, "m_per_px": 1e-3}
    for wrong, said in ((None, "got NoneType"), ([falling], "got list"), (np.zeros((3, 4, 4)), "got ndarray")):
        with pytest.raises(ValueError, match=rf"track: expected what torchsphere.track returns, {said}"):
            ts.kinematics(wrong, **known)  # type: ignore[arg-type]
    # What track_many returns for a recording that could not be tracked.
    with pytest.raises(ValueError, match="got OSError"):
        ts.kinematics_of_many([falling, OSError("cut")], **known)  # type: ignore[list-item]
    with pytest.raises(ValueError, match="expected a sequence of tracks, got one"):
        ts.kinematics_of_many(falling, **known)  # type: ignore[arg-type]
    with pytest.raises(ValueError, match=r"motion: expected what torchsphere.kinematics returns, got Track"):
        ts.impact(falling)  # type: ignore[arg-type]


def said_of(track: ts.Track, method: str, window: int) -> tuple[str, ...]:
    return window_warnings(track, ts.kinematics(track, frame_rate=1e3, m_per_px=5e-4, method=method, window=window))


def test_polynomials_longer_than_what_was_measured_say_what_is_empty_and_what_to_give(falling: ts.Track) -> None:
    (said,) = said_of(falling, "savitzky-golay", 11)
    assert "takes 11 frames measured in a row, and there are 9 at most" in said
    assert said.endswith(
        "velocities, accelerations and spins are empty; give --window 9 or less, or --method smoother."
    )
    assert said_of(falling, "savitzky-golay", 9) == said_of(falling, "smoother", 11) == ()
    # Frames 4 to 8 are left in a row.
    gap = falling.increment.copy()
    gap[3] = np.nan
    (said,) = said_of(dataclasses.replace(falling, increment=gap), "savitzky-golay", 7)
    assert "there are 5 at most" in said
    assert "--window 5 or less" in said
    # Frames 0 to 3: no window beyond the order of 3 is left.
    gap[4:] = np.nan
    (said,) = said_of(dataclasses.replace(falling, increment=gap), "savitzky-golay", 7)
    assert said.endswith(
        "there are 4 at most, so that velocities, accelerations and spins are empty; give --method smoother."
    )
    pairs = falling.increment.copy()
    pairs[::2] = np.nan
    (said,) = said_of(dataclasses.replace(falling, increment=pairs), "differences", 7)
    assert said.startswith("The method differences takes 3 frames measured in a row, and there are 2 at most")
    nothing = dataclasses.replace(falling, increment=np.full_like(gap, np.nan))
    assert said_of(nothing, "differences", 7) == ()


def test_a_rotation_that_polynomials_are_too_long_for_is_told_alone(falling: ts.Track) -> None:
    rotation = falling.increment.copy()
    rotation[5:, 2:] = np.nan
    (said,) = said_of(dataclasses.replace(falling, increment=rotation), "savitzky-golay", 7)
    assert said.endswith("there are 6 at most, so that spins are empty; give --window 5 or less, or --method smoother.")
    # Measured by no model, or nowhere: that has a sentence of its own.
    rotation[:, 2:] = np.nan
    assert said_of(dataclasses.replace(falling, increment=rotation), "savitzky-golay", 7) == ()


@pytest.mark.parametrize("method", ["savitzky-golay", "differences", "smoother"])
def test_polynomials_through_an_impact_say_that_they_flatten_it(method: str) -> None:
    velocity = np.interp(np.arange(40), [18, 22], [3.0, -1.0])
    steps = np.stack((velocity, *np.zeros((4, 40))), 1)
    sd, circle = np.array([0.01, 0.01, 1e-4, 1e-4, 1e-4]), ts.Circle(50.0, 40.0, 20.0, 0.0, 0.0, 0.0)
    known = {"frame_rate": 1000.0, "m_per_px": 5e-4, "method": method}
    said = bandwidth_warnings(ts.kinematics(made_track(steps, sd, circle), **known))
    assert len(said) == (method != "smoother")
    assert all(f"the method {method} do not hold what its polynomials" in sentence for sentence in said)
    steady = np.tile(steps[:1], (40, 1)) + sd * np.random.default_rng(1).normal(size=(40, 5))
    assert bandwidth_warnings(ts.kinematics(made_track(steady, sd, circle), **known)) == ()
    nothing = np.full_like(steps, np.nan)
    assert bandwidth_warnings(ts.kinematics(made_track(nothing, sd, circle), **known)) == ()
