"""The error that all steps of a flight have in common: its causes, and its size against the stated one."""

import dataclasses

import numpy as np
import pytest
import torch
from shots import clean, noisy, pair, rotation_matrix, speckle, turned

import torchsphere as ts
from torchsphere import track
from torchsphere.dynamics import shared_errors
from torchsphere.errors import steady_error
from torchsphere.synthetic import ray_caster


def steps(*step: float) -> np.ndarray:
    return np.tile(np.array(step, dtype=float), (20, 1))


def test_a_step_of_whole_pixels_has_no_aliasing_and_a_quarter_pixel_has_the_most() -> None:
    whole, quarter = (steady_error.sd_steady(steps(d, 3.0, 0.0, 0.0, 0.0), 50.0, on_map=False) for d in (2.0, 2.25))
    np.testing.assert_allclose(whole[:2], 0.00035, rtol=1e-6)
    assert quarter[0] == pytest.approx(np.hypot(0.0005, 0.00035), rel=1e-6)
    # x and the rotation about y err together; y and the rotation about x do not err with them.
    np.testing.assert_allclose(quarter[[1, 2, 4]], whole[[1, 2, 4]], rtol=1e-12)
    assert quarter[3] == pytest.approx(1.2 * quarter[0] / 50.0, rel=1e-12)


def test_the_error_by_a_turn_grows_with_the_square_of_the_fineness_up_to_a_degree() -> None:
    def of_turn(degrees: float, fine: float) -> float:
        sd = steady_error.sd_steady(steps(0, 0, 0, np.radians(degrees), 0), 50.0, fine, on_map=False)
        return float(np.sqrt(sd[0] ** 2 - 0.00035**2))

    assert of_turn(0.5, 0.4) == pytest.approx(0.5 * 0.0115 * 0.16, rel=1e-6)
    assert of_turn(0.5, 0.2) == pytest.approx(of_turn(0.5, 0.4) / 4, rel=1e-6)
    assert of_turn(1.0, 0.4) == pytest.approx(2 * of_turn(0.5, 0.4), rel=1e-6)
    # Beyond a degree the error stays, and the error by fast turns does not depend on the fineness.
    added = [of_turn(3.0, fine) ** 2 - of_turn(1.0, fine) ** 2 for fine in (0.2, 0.4)]
    np.testing.assert_allclose(added, 0.0020**2, rtol=1e-6)


def of_fast_turn(degrees: tuple[float, float, float], radius: float, *, on_map: bool = False) -> np.ndarray:
    """Stated error (5,) of a turn without the stated error of a turn by 1 deg about the same axis."""
    turn = np.radians(degrees)
    fast, slow = (
        steady_error.sd_steady(steps(0, 0, *vector), radius, on_map=on_map)
        for vector in (turn, turn / np.degrees(np.hypot(turn[0], turn[1])))
    )
    return np.sqrt(fast**2 - slow**2)


def test_a_fast_turn_out_of_the_plane_errs_along_the_front_and_less_across_and_about_z() -> None:
    x, y, wx, wy, wz = of_fast_turn((0.0, 5.0, 0.0), 50.0)
    assert x == pytest.approx(4 * 0.0010, rel=1e-6)
    assert y == pytest.approx(0.3 * x, rel=1e-6)
    np.testing.assert_allclose([wy, wx], [1.2 * x / 50.0, 1.2 * y / 50.0], rtol=1e-6)
    assert wz == pytest.approx(0.2 * x / 50.0, rel=1e-6)
    # A turn about x moves the front along y.
    np.testing.assert_allclose(of_fast_turn((5.0, 0.0, 0.0), 50.0), [y, x, wy, wx, wz], rtol=1e-6)
    # The error falls with the square of the radius and does not grow beyond 8 deg.
    assert of_fast_turn((0.0, 5.0, 0.0), 25.0)[0] == pytest.approx(4 * x, rel=1e-6)
    assert of_fast_turn((0.0, 15.0, 0.0), 50.0)[0] == pytest.approx(7 / 4 * x, rel=1e-6)


def test_a_turn_within_the_plane_and_a_map_have_no_error_by_fast_turns() -> None:
    np.testing.assert_array_equal(of_fast_turn((0.0, 5.0, 0.0), 50.0, on_map=True), 0.0)
    slow, fast = (steady_error.sd_steady(steps(0, 0, 0, 0, np.radians(d)), 50.0, on_map=False) for d in (1.0, 10.0))
    np.testing.assert_array_equal(fast[:4], slow[:4])


@pytest.mark.parametrize(("degrees", "seed"), [(5.0, 31), (10.0, 32)])
def test_the_common_error_of_fast_turns_is_no_larger_than_stated(degrees: float, seed: int) -> None:
    made = clean(seed=seed, n=9, step=(1.4, 0.2), turn_deg=degrees, radius=40.0)
    measured = track(made.images, made.circle, sphere_map=False)
    error = (measured.increment - made.increments.numpy()).mean(0)
    # Without the term of fast turns x and y would err by 3 to 7 stated standard deviations, wz by 4 to 17.
    assert (np.abs(error) < 3 * measured.sd_steady).all(), error / measured.sd_steady


def test_the_common_error_of_steps_on_a_map_is_no_larger_than_stated() -> None:
    made = clean(seed=51, n=100, step=(1.4, 0.2), turn_deg=2.0, radius=40.0)
    measured = track(noisy(made.images, 1.0, 1), made.circle, sphere_map=True, telecentric=True)
    assert measured.findings.is_on_map
    error = (measured.increment - made.increments.numpy()).mean(0)
    assert (np.abs(error) < measured.sd_steady).all(), error / measured.sd_steady


def test_the_common_error_in_images_from_wide_pixels_is_no_larger_than_stated() -> None:
    # Pixels of 5 x 4 of a fine image, which are shown as squares with sides of four of its pixels.
    n, radius, step, turn = 50, 40.0, (1.4, 0.2), torch.deg2rad(torch.tensor(turned(2.0), dtype=torch.float64))
    centres = torch.tensor((60.2, 55.4)) + torch.arange(n)[:, None] * torch.tensor(step)
    poses = 4 * (centres + 0.5) - 0.5, torch.stack([rotation_matrix(turn * i) for i in range(n)]).float()
    fine = ray_caster.render(speckle(61, radius), poses[0], 4 * radius, poses[1], 90.0, shape=(480, 800), subsamples=1)
    stored = fine.reshape(n, 120, 4, 160, 5).mean((2, 4))
    circle = (*centres[0].tolist(), radius)
    measured = track(noisy(stored, 1.0, 61), circle, sphere_map=True, telecentric=True, pixel_aspect=1.25)
    assert measured.findings.is_on_map
    error = (measured.increment - np.concatenate((step, turn))).mean(0)
    # With square pixels the stated error would be 0.0002 px.
    assert (np.abs(error) < measured.sd_steady).all(), error / measured.sd_steady
    assert np.abs(error[:2]).max() > 0.0002


def test_steps_that_were_not_measured_are_left_out() -> None:
    some = steps(0.25, 0.1, 0.001, 0.002, 0.0)
    gaps = np.concatenate((some, np.full((7, 5), np.nan)))
    expected = steady_error.sd_steady(some, 40.0, on_map=False)
    np.testing.assert_allclose(steady_error.sd_steady(gaps, 40.0, on_map=False), expected, rtol=1e-12)
    assert np.isfinite(steady_error.sd_steady(gaps[-7:], 40.0, on_map=False)).all()


def test_the_fineness_of_the_texture_does_not_depend_on_light_and_noise() -> None:
    f, _, (x, y, radius) = pair((0, 0, 0, 0, 0))
    circle = ts.Circle(x, y, radius)
    fine = steady_error.texture_fineness(f, circle)
    assert steady_error.texture_fineness(0.5 * f + 20, circle) == pytest.approx(fine, rel=1e-9)
    assert steady_error.texture_fineness(noisy(f, 4.0, 1), circle) == pytest.approx(fine, rel=0.03)
    # The same speckle at half the size is four times as fine, less the loss by the pre-blur.
    f, _, (x, y, radius) = pair((0, 0, 0, 0, 0), radius=25.0, pattern=speckle(0, 50.0), centre=(40.1, 39.7))
    assert steady_error.texture_fineness(f, ts.Circle(x, y, radius)) > 1.5 * fine


def test_a_plain_ball_has_a_fineness_within_bounds() -> None:
    assert (
        0
        <= steady_error.texture_fineness(torch.full((100, 100), 90.0), ts.Circle(50.0, 50.0, 30.0))
        <= steady_error.MAX_FINENESS
    )


def turn_of_the_places(step: tuple[float, float], degrees: float, radius: float) -> float:
    """Turn, rad, that least squares find in errors ``sin 2 pi s`` px; each point of a disc has its own shift s."""
    x, y = np.meshgrid(*2 * [np.linspace(-radius, radius, 401)])
    x, y = (v[np.hypot(x, y) < radius] for v in (x, y))
    turn = np.radians(degrees)
    of_x, of_y = np.sin(2 * np.pi * (step[0] - turn * y)), np.sin(2 * np.pi * (step[1] + turn * x))
    return float((x * of_y - y * of_x).sum() / (x**2 + y**2).sum())


@pytest.mark.parametrize(
    ("step", "degrees", "radius"),
    [((0.0, 0.0), 0.3, 40.0), ((2.37, 0.3), 0.3, 40.0), ((0.5, 1.5), -0.6, 25.0), ((0.1, 0.2), 2.84, 50.0)],
)
def test_the_error_about_z_is_the_mean_of_the_errors_of_all_points_of_the_ball(
    step: tuple[float, float], degrees: float, radius: float
) -> None:
    stated = steady_error.sd_steady(steps(*step, 0, 0, np.radians(degrees)), radius, on_map=False)[4]
    left = np.radians(0.37) / radius**2
    expected = abs(0.00017 * turn_of_the_places(step, degrees, radius))
    # Sums over a disc with 401 and with 32 points across, where the turn moves the limb by up to 2.5 px.
    assert stated == pytest.approx(np.hypot(left, expected), rel=0.005)


def test_a_ball_without_a_turn_about_z_errs_about_z_by_its_single_spots_alone() -> None:
    for radius in (25.0, 50.0):
        stated = steady_error.sd_steady(steps(0.2, 0.3, 0.001, 0.004, 0.0), radius, on_map=False)[4]
        assert np.degrees(stated) == pytest.approx(0.37 / radius**2, rel=1e-9)


def errors_of_patterns(
    step: tuple[float, float], turn_deg: tuple[float, float, float], radius: float
) -> tuple[np.ndarray, np.ndarray]:
    """Errors (4, 5) of four patterns, means over four sub-pixel positions each, and the stated error of a pattern."""
    true = np.array([*step, *np.radians(turn_deg)])
    errors = np.empty((4, 4, 5))
    for seed in range(4):
        for k, place in enumerate((0.0, 0.25, 0.5, 0.75)):
            # The pattern of a larger ball has spots of 3.2 px on this ball.
            pattern = speckle(seed, 1.25 * radius)
            centre = (63.1 + place, 64.3 + place)
            f, g, circle = pair((*step, *turn_deg), radius=radius, pattern=pattern, centre=centre)
            errors[seed, k] = ts.correlate(f, g, circle, start=true).q[0].numpy() - true
    fine = steady_error.texture_fineness(f, ts.Circle(*circle))
    return errors.mean(1), steady_error.sd_steady(true[None], radius, fine, on_map=False)


@pytest.mark.parametrize("turn_deg", [(0.0, 0.4, 0.0), (0.4, 0.0, 0.0)])
def test_slow_turns_err_along_the_front_across_it_and_about_z_by_about_as_much_as_stated(
    turn_deg: tuple[float, float, float],
) -> None:
    errors, stated = errors_of_patterns((0.0, 0.0), turn_deg, 50.0)
    ratio = np.sqrt((errors**2).mean(0)) / stated
    assert ((ratio > 0.5) & (ratio < 2)).all(), ratio


@pytest.mark.parametrize("step", [(0.25, 0.4), (0.7, 0.15)])
def test_steps_with_the_same_sub_pixel_part_err_alike_and_no_more_than_stated(step: tuple[float, float]) -> None:
    errors, stated = errors_of_patterns(step, (0.0, 0.0, 0.0), 50.0)
    assert (np.abs(errors.mean(0)) < 3 * stated).all()


def test_a_ball_seen_from_the_side_at_an_unknown_distance_has_an_axis_that_seems_tilted() -> None:
    # 101 frames at 2 px along x, spun about the line of sight by 0.1 rad per frame. At the ends of the path, 100 px
    # from its middle, a camera at 100 radii sees the ball of 50 px from 0.02 rad, and its axis tilted by that.
    increment = np.tile([2.0, 0.0, 0.0, 0.0, 0.1], (100, 1))
    found = steady_error.sd_of_apparent_turn(increment, 50.0, 0.01)
    assert found[0] == pytest.approx(0.1 * 0.02 / 3**0.5, rel=0.01)  # rms along the path
    # The direction of the sight itself passes by 0.01 * 2 / 50 rad per frame.
    assert found[1] == pytest.approx(0.01 * 2 / 50)


def test_uneven_light_counts_by_its_share_of_the_steps_on_a_map_too() -> None:
    still = steps(0.0, 0.0, 0.0, 0.0, 0.0)
    none, half, full = (
        steady_error.sd_steady(still, 40.0, on_map=False, uneven_light=share) for share in (0.0, 0.5, 1.0)
    )
    np.testing.assert_allclose(full[:2] ** 2 - none[:2] ** 2, 0.0021**2, rtol=1e-9)
    np.testing.assert_allclose(full**2 - none**2, 2 * (half**2 - none**2), rtol=1e-9)
    assert np.sqrt(full[4] ** 2 - none[4] ** 2) == pytest.approx(0.0003 / 40.0, rel=1e-9)
    none, full = (steady_error.sd_steady(still, 40.0, on_map=True, uneven_light=share) for share in (0.0, 1.0))
    np.testing.assert_allclose(full[:2] ** 2 - none[:2] ** 2, 0.0021**2, rtol=1e-9)


@pytest.mark.parametrize("wz_deg", [0.1, 0.3, 0.6])
def test_a_turn_about_the_line_of_sight_errs_by_no_more_than_stated(wz_deg: float) -> None:
    errors, stated = errors_of_patterns((0.0, 0.0), (0.0, 0.0, wz_deg), 40.0)
    # With the B-spline as kernel the error is 0.0010 deg at 0.3 deg.
    assert np.degrees(stated[4]) < 0.0005
    assert abs(errors.mean(0)[4]) < 2 * stated[4]


def test_an_error_of_the_centre_enters_velocity_and_acceleration_by_the_spin_about_z() -> None:
    n = 20
    circle = ts.Circle(50.0, 40.0, 20.0, 0.3, 0.4, 0.0)
    increment = np.tile([2.0, 0.0, 0.0, 0.0, 0.05], (n - 1, 1))
    turn = 0.05 * np.arange(n)
    orientation = np.zeros((n, 3, 3))
    orientation[:, 2, 2] = 1.0
    orientation[:, :2, :2] = np.moveaxis(np.array([[np.cos(turn), -np.sin(turn)], [np.sin(turn), np.cos(turn)]]), 2, 0)
    track = ts.Track(
        position=np.stack((50.0 + 2.0 * np.arange(n), np.full(n, 40.0)), 1),
        increment=increment,
        covariance=np.tile(np.diag([1e-4, 1e-4, 1e-8, 1e-8, 1e-8]), (n - 1, 1, 1)),
        orientation=orientation,
        zncc=np.ones(n),
        iterations=np.ones(n, dtype=np.int64),
        status=np.full(n, "ok"),
        radius=np.full(n, 20.0),
        sd_growth=np.zeros(n - 1),
        sd_steady=np.zeros(5),
        circle=circle,
        settings={},
    )
    exact = dataclasses.replace(track, circle=ts.Circle(50.0, 40.0, 20.0, 0.0, 0.0, 0.0))
    wide, own = (ts.kinematics(t, frame_rate=1.0, m_per_px=1.0) for t in (track, exact))
    added = np.sqrt(wide.sd_velocity_m_s[9] ** 2 - own.sd_velocity_m_s[9] ** 2)
    # 0.05 rad per frame times the error of the centre in the other direction.
    np.testing.assert_allclose(added, [0.05 * 0.4, 0.05 * 0.3], rtol=1e-6)
    # The acceleration towards the centre has the square of the rotation.
    added = np.sqrt(wide.sd_acceleration_m_s2[9] ** 2 - own.sd_acceleration_m_s2[9] ** 2)
    np.testing.assert_allclose(added, [0.0025 * 0.3, 0.0025 * 0.4], rtol=1e-4)


@pytest.mark.parametrize("off", [(0.4, 0.0), (0.0, 0.4), (-0.3, 0.3)])
def test_a_wrong_centre_of_the_circle_adds_a_rotation_about_z_to_a_tilt(off: tuple[float, float]) -> None:
    tilt, step = (0.6, -0.4), (1.2, 0.4)
    added = []
    for seed in range(4):
        f, g, (x, y, radius) = pair((*step, *tilt, 0.0), seed=seed)
        right, wrong = (
            ts.correlate(f, g, (x + share * off[0], y + share * off[1], radius), start=[*step, 0, 0, 0]).q[0, 4]
            for share in (0, 1)
        )
        added.append(float(wrong - right))
    expected = shared_errors.ROTATION_Z_PER_CENTRE * float(np.radians(tilt) @ off) / radius
    # Four patterns scatter by a tenth of the value.
    assert np.mean(added) == pytest.approx(expected, rel=0.1)
