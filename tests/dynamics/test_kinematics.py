"""SI units, signs of the lab frame, uncertainty of local polynomials and of mean motion (smoother: test_rts.py)."""

import dataclasses

import numpy as np
import pytest
import torch
from tracks import falling_track, made_track

import torchsphere as ts
from torchsphere.dynamics.kinematics import mean_motion
from torchsphere.estimation import savitzky_golay
from torchsphere.synthetic import demo_shot

#: Frames of the falling ball.
N = 9

#: Steady motion for the means: circle, standard deviations of a pose, and the step.
EXACT = ts.Circle(50.0, 40.0, 20.0, 0.0, 0.0, 0.0)
POSE_SD = np.array([0.01, 0.02, 1e-4, 2e-4, 3e-4])
STEP = np.array([2.0, -1.0, 0.0, 0.01, 0.002])
NO_ERROR = np.zeros((12, 5))


@pytest.fixture
def falling() -> ts.Track:
    return falling_track()


@pytest.mark.parametrize("method", ["smoother", "savitzky-golay", "differences"])
def test_an_accelerated_ball_has_the_velocity_and_force_of_its_pixels(falling: ts.Track, method: str) -> None:
    # 40 px are 20 mm, so a px is 0.5 mm; at 1000 frames/s, 2 px per frame are 1 m/s and 0.1 px per frame^2 50 m/s^2.
    motion = ts.kinematics(falling, frame_rate=1000.0, diameter_m=0.02, mass_kg=0.1, method=method)
    inner = slice(1, -1)
    # The smoother takes start and acceleration as unknown within 1e4 errors of a pose only: an error of 1e-6.
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
    # Image noise gives each frame's pose an independent error: increments are differences of these. The standard
    # deviation of 40,000 frames is right to 0.35 %, and to 0.5 % for second differences, whose errors are correlated
    # by -2/3 and 1/6; the tolerance is four times that.
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


@pytest.mark.parametrize("given", [{"diameter_m": 0.02}, {"m_per_px": 5e-4}])
def test_an_uncertain_length_widens_velocity_and_force_by_its_share(falling: ts.Track, given: dict) -> None:
    exact = ts.kinematics(falling, frame_rate=1000.0, mass_kg=0.1, **given)
    motion = ts.kinematics(falling, frame_rate=1000.0, mass_kg=0.1, relative_sd_scale=0.03, **given)
    for name in ("velocity_m_s", "force_N", "position_m"):
        value, sd, wider = (getattr(m, p + name)[4, 1] for m, p in ((exact, ""), (exact, "sd_"), (motion, "sd_")))
        assert wider == pytest.approx(np.hypot(sd, 0.03 * value), rel=1e-9)
    assert "known to 3 %" in motion.scale.origin


@pytest.mark.parametrize("method", ["smoother", "savitzky-golay", "differences"])
def test_mass_and_frame_rate_widen_the_rates_by_their_powers(falling: ts.Track, method: str) -> None:
    settings = {"frame_rate": 1000.0, "m_per_px": 5e-4, "mass_kg": 0.1, "method": method, "window": 5, "order": 2}
    exact = ts.kinematics(falling, **settings)
    motion = ts.kinematics(falling, relative_sd_mass=0.02, relative_sd_frame_rate=0.01, **settings)
    shares = {"velocity_m_s": 0.01, "spin_rad_s": 0.01, "acceleration_m_s2": 0.02, "position_m": 0.0}
    # The force goes with mass and the square of the rate.
    shares |= {"angular_acceleration_rad_s2": 0.02, "force_N": np.hypot(0.02, 0.02)}
    for name, share in shares.items():
        value, sd, wider = (getattr(m, p + name)[4] for m, p in ((exact, ""), (exact, "sd_"), (motion, "sd_")))
        np.testing.assert_array_equal(getattr(motion, name)[4], value)
        np.testing.assert_allclose(wider, np.hypot(sd, share * value), rtol=1e-9)
    np.testing.assert_array_equal(motion.time_s, exact.time_s)


def test_an_uncertain_frame_rate_widens_mean_velocity_and_spin(falling: ts.Track) -> None:
    exact, wide = (
        mean_motion(falling, ts.kinematics(falling, frame_rate=1000.0, m_per_px=5e-4, relative_sd_frame_rate=sd))
        for sd in (0.0, 0.01)
    )
    for name in ("velocity_m_s", "spin_rad_s"):
        np.testing.assert_allclose(wide[f"sd_{name}"], np.hypot(exact[f"sd_{name}"], 0.01 * exact[name]), rtol=1e-9)


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
def test_the_number_of_frames_fitted_at_once_does_not_change_the_rates(
    monkeypatch: pytest.MonkeyPatch, *, shifted: bool
) -> None:
    draw = np.random.default_rng(1)
    times, increment = draw.uniform(0.5, 1.5, 60).cumsum(), draw.normal(0, 0.1, (59, 5))
    is_measured = np.ones((59, 2), dtype=bool)
    is_measured[30, 1] = False

    def found(at_once: int) -> savitzky_golay.Rates:
        monkeypatch.setattr(savitzky_golay, "FRAMES_AT_ONCE", at_once)
        return savitzky_golay.rates(times, increment, is_measured, np.ones((60, 5)), window=7, order=3, shifted=shifted)

    whole, blocks = found(1000), found(11)
    for name in ("first", "second", "variance_first", "variance_second"):
        assert np.isfinite(getattr(whole, name)).sum() > 200
        np.testing.assert_allclose(getattr(blocks, name), getattr(whole, name), rtol=1e-12)


def test_uneven_times_do_not_change_a_steady_acceleration(falling: ts.Track) -> None:
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
        ({"frame_rate": 1.0, "m_per_px": 1e-3, "relative_sd_mass": -0.1}, "relative_sd_mass = -0.1: expected a share"),
        ({"frame_rate": 1.0, "m_per_px": 1e-3, "relative_sd_mass": float("nan")}, "relative_sd_mass = nan"),
        ({"frame_rate": 1.0, "m_per_px": 1e-3, "relative_sd_frame_rate": 1.0}, "relative_sd_frame_rate = 1.0"),
        ({"frame_rate": 1.0, "m_per_px": 1e-3, "relative_sd_frame_rate": "1"}, "relative_sd_frame_rate = '1'"),
        ({"frame_rate": 1.0, "m_per_px": 1e-3, "first_frame": "3"}, "first_frame = '3'"),
        ({"frame_rate": 1.0, "m_per_px": 1e-3, "times_s": "abc"}, "times_s: expected"),
        ({"frame_rate": 1.0, "m_per_px": 1e-3, "method": "savitzky-golay", "window": 7.0}, "window = 7.0"),
        ({"frame_rate": 1e300, "m_per_px": 1e-3}, "frame_rate = 1e.300: expected .* frames per second"),
    ],
)
def test_an_invalid_number_is_refused_by_its_name(falling: ts.Track, settings: dict, word: str) -> None:
    with pytest.raises(ValueError, match=word):
        ts.kinematics(falling, **settings)


def test_numbers_may_be_those_of_arrays_and_tensors(falling: ts.Track) -> None:
    expected = ts.kinematics(falling, frame_rate=1000.0, diameter_m=0.5, mass_kg=0.25)
    # numpy.load gives scalars of an archive as arrays, and torch single values as tensors.
    for rate, mass in ((np.array(1000.0), np.float32(0.25)), (torch.tensor(1000.0), torch.tensor(0.25))):
        found = ts.kinematics(falling, frame_rate=rate, diameter_m=np.array(0.5), mass_kg=mass)  # type: ignore[arg-type]
        np.testing.assert_array_equal(found.velocity_m_s, expected.velocity_m_s)
        np.testing.assert_array_equal(found.force_N, expected.force_N)


def test_other_objects_than_tracks_are_refused_by_their_type(falling: ts.Track) -> None:
    known = {"frame_rate": 1000.0, "m_per_px": 1e-3}
    for wrong, words in ((None, "got NoneType"), ([falling], "got list"), (np.zeros((3, 4, 4)), "got ndarray")):
        with pytest.raises(ValueError, match=rf"track: expected what torchsphere.track returns, {words}"):
            ts.kinematics(wrong, **known)  # type: ignore[arg-type]
    # track_many returns an error for a recording that could not be tracked.
    with pytest.raises(ValueError, match="got OSError"):
        ts.kinematics_of_many([falling, OSError("cut")], **known)  # type: ignore[list-item]
    with pytest.raises(ValueError, match="expected a sequence of tracks, got one"):
        ts.kinematics_of_many(falling, **known)  # type: ignore[arg-type]
    with pytest.raises(ValueError, match=r"motion: expected what torchsphere.kinematics returns, got Track"):
        ts.impact(falling)  # type: ignore[arg-type]


def steady_track(error: np.ndarray, lost: tuple[int, ...] = ()) -> ts.Track:
    """Steady motion whose poses have the ``error`` (n, 5), in standard deviations; the steps ``lost`` are unknown."""
    increment = STEP + np.diff(error * POSE_SD, axis=0)
    increment[list(lost)] = np.nan
    track = made_track(np.nan_to_num(increment), POSE_SD * np.sqrt(2), EXACT)
    return dataclasses.replace(track, increment=increment)


@pytest.mark.parametrize("lost", [(), (4,), (0, 5, 6)])
def test_the_standard_deviation_of_a_mean_is_that_of_its_end_poses(lost: tuple[int, ...]) -> None:
    expected = mean_motion(steady_track(NO_ERROR, lost), None)
    variance = np.zeros(5)
    for one in np.eye(NO_ERROR.size).reshape(-1, *NO_ERROR.shape):
        # The mean is linear in the errors of the poses: one standard deviation of each gives its share of the scatter.
        found = mean_motion(steady_track(one, lost), None)
        variance += (found["increment_px_rad"] - expected["increment_px_rad"]) ** 2
    np.testing.assert_allclose(np.sqrt(variance), expected["sd_increment_px_rad"], rtol=1e-3)


def test_mean_velocity_and_spin_are_the_mean_step_with_the_uncertainty_of_the_scale() -> None:
    track = steady_track(NO_ERROR)
    motion = ts.kinematics(track, frame_rate=1000.0, m_per_px=5e-4, relative_sd_scale=0.03, lab_frame=True)
    found = mean_motion(track, motion)
    step, sd = found["increment_px_rad"], found["sd_increment_px_rad"]
    np.testing.assert_allclose(found["velocity_m_s"], 0.5 * step[:2] * [1, -1])
    np.testing.assert_allclose(found["sd_velocity_m_s"], 0.5 * np.hypot(sd[:2], 0.03 * step[:2]))
    np.testing.assert_allclose(found["spin_rad_s"], 1000 * step[2:] * [1, -1, -1])
    np.testing.assert_allclose(found["sd_spin_rad_s"], 1000 * sd[2:])


def test_a_motion_that_was_not_measured_has_no_mean() -> None:
    track = steady_track(NO_ERROR)
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
        track = ts.track(shot.images[:26], sphere_map=False)
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
