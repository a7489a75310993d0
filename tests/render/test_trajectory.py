"""Trajectories: derivatives, impulse and energy against formulas, orientation against an independent integration."""

from pathlib import Path

import numpy as np
import pytest
from scipy.integrate import quad, solve_ivp

from render import rotation
from render.trajectory import (
    KINDS,
    DropWeight,
    FreeFlight,
    FrontalImpact,
    ObliqueImpact,
    SpinInPlace,
    Table,
    Trajectory,
)
from render.trajectory.pulse import Pulse
from render.trajectory.table import read_table

SLOPE = np.radians(15.0)
NORMAL = (-float(np.sin(SLOPE)), -float(np.cos(SLOPE)), 0.0)

FLIGHT = FreeFlight(
    start_m=(-0.05, 0.01, 0.2), velocity_m_s=(14.0, 2.0, -1.0), spin_rev_s=(20, 50, -20), gravity_m_s2=(0, 9.81, 0)
)
FRONTAL = FrontalImpact(
    touch_m=(0.02, 0.001, 0.0),
    touch_us=300.0,
    contact_us=222.0,
    velocity_m_s=(70.0, 1.0, 0.5),
    restitution=0.1,
    spin_before_rev_s=(0.0, 500.0, 0.0),
    spin_after_rev_s=(700.0, 30.0, -900.0),
)
PEAKS = FrontalImpact(
    touch_m=(0.0, 0.0, 0.0),
    touch_us=300.0,
    contact_us=400.0,
    peaks=(0.5, 0.0, 0.3, 0.2),
    velocity_m_s=(70.0, 0.0, 0.0),
    restitution=0.4,
    spin_after_rev_s=(5.0, 6.0, 20.0),
)
SLIDES = ObliqueImpact(
    touch_m=(0.0, 0.0, 0.0),
    touch_us=200.0,
    contact_us=700.0,
    velocity_m_s=(80.0, 0.0, 0.0),
    spin_rev_s=(100.0, 200.0, -300.0),
    normal=NORMAL,
    restitution=0.6,
    friction=0.1,
    diameter_mm=19.0,
)
ROLLS = ObliqueImpact(
    touch_m=(0.0, 0.0, 0.0),
    touch_us=200.0,
    contact_us=700.0,
    velocity_m_s=(10.0, 8.0, 3.0),
    spin_rev_s=(10.0, 70.0, -30.0),
    normal=(0.0, -2.0, 0.0),
    restitution=0.6,
    friction=0.8,
    diameter_mm=19.0,
)
SPINS = SpinInPlace(centre_m=(0.0, 0.0, 0.1), spin_rev_s=(30.0, 0.0, 40.0))
RETURNS = SpinInPlace(spin_rev_s=(30.0, 0.0, 40.0), there_and_back_s=1e-3)
DROP = DropWeight(
    touch_m=(0.0, 0.02, 0.0), touch_us=400.0, contact_us=500.0, speed_m_s=3.0, restitution=0.4, mass_g=2000.0
)
ALL = {
    "free flight": FLIGHT,
    "frontal impact": FRONTAL,
    "frontal impact with peaks": PEAKS,
    "oblique impact that slides": SLIDES,
    "oblique impact that rolls": ROLLS,
    "spin in place": SPINS,
    "spin there and back": RETURNS,
    "drop weight": DROP,
}

every = pytest.mark.parametrize("motion", ALL.values(), ids=ALL.keys())
TIMES = np.linspace(-1e-4, 1.2e-3, 400)
BEFORE, AFTER = np.array([0.0]), np.array([2e-3])


def spin_at(motion: Trajectory, time: float) -> np.ndarray:
    return motion.state(np.array([time])).spin_rad_s[0]


@every
def test_velocity_is_the_derivative_of_position(motion: Trajectory) -> None:
    h = 1e-8
    slope = (motion(TIMES + h).position_m - motion(TIMES - h).position_m) / (2 * h)
    # The error of the difference, h^2 / 6 times the third derivative of the shortest peak, is 4e-7 m/s.
    assert np.abs(slope - motion.state(TIMES).velocity_m_s).max() < 1e-6


@every
def test_acceleration_is_the_derivative_of_velocity_and_force_is_mass_times_it(motion: Trajectory) -> None:
    h = 1e-9
    state = motion.state(TIMES)
    slope = (motion.state(TIMES + h).velocity_m_s - motion.state(TIMES - h).velocity_m_s) / (2 * h)
    assert np.abs(slope - state.acceleration_m_s2).max() < 1e-5 * max(1.0, np.abs(slope).max())
    assert np.allclose(state.force_N, 1e-3 * motion.mass_g * state.acceleration_m_s2, rtol=1e-14)


@every
def test_spin_is_the_rate_of_the_orientation_in_camera_axes(motion: Trajectory) -> None:
    h = 1e-7
    turned = motion(TIMES + h).orientation @ motion(TIMES - h).orientation.swapaxes(1, 2)
    assert np.abs(rotation.log(turned) / (2 * h) - motion.state(TIMES).spin_rad_s).max() < 1e-3


@every
def test_orientation_agrees_with_an_independent_integration(motion: Trajectory) -> None:
    def rate(time: float, matrix: np.ndarray) -> np.ndarray:
        return np.cross(spin_at(motion, time), matrix.reshape(3, 3), axisb=0, axisc=0).ravel()

    times = np.linspace(0.0, 1.1e-3, 12)
    done = solve_ivp(rate, (0.0, 1.1e-3), np.eye(3).ravel(), "DOP853", times, rtol=1e-10, atol=1e-11, max_step=2e-5)
    # The limit of the class is 1e-6 rad; the error of the reference is about 1e-9.
    assert np.abs(done.y.T.reshape(-1, 3, 3) - motion(times).orientation).max() < 1e-8


@every
def test_a_batch_is_the_same_as_its_single_times(motion: Trajectory) -> None:
    batch = motion.state(TIMES[::40])
    for i, time in enumerate(TIMES[::40]):
        single = motion.state(np.array([time]))
        for name in ("position_m", "orientation", "velocity_m_s", "acceleration_m_s2", "force_N", "spin_rad_s"):
            assert (getattr(single, name)[0] == getattr(batch, name)[i]).all(), name


@every
def test_orientation_starts_from_no_rotation(motion: Trajectory) -> None:
    assert np.abs(motion(BEFORE).orientation - np.eye(3)).max() < 1e-14


@pytest.mark.parametrize("motion", [FRONTAL, PEAKS, SLIDES, ROLLS, DROP])
def test_the_integral_of_the_force_is_the_change_of_momentum(motion: Trajectory) -> None:
    begin, end = 1e-6 * motion.touch_us, 1e-6 * (motion.touch_us + motion.contact_us)
    change = motion.state(np.array([end])).velocity_m_s[0] - motion.state(np.array([begin])).velocity_m_s[0]
    kinks = np.linspace(begin, end, 9)[1:-1]
    for axis in range(3):
        force = lambda t, k=axis: motion.state(np.array([t])).force_N[0, k]  # noqa: E731
        impulse = quad(force, begin, end, points=kinks, epsabs=1e-7, epsrel=1e-7, limit=200)[0]
        assert impulse == pytest.approx(1e-3 * motion.mass_g * change[axis], abs=1e-6)


def test_free_flight_is_the_parabola_and_the_exponential() -> None:
    state = FLIGHT.state(np.array([0.01]))
    assert np.allclose(state.position_m[0], [-0.05 + 0.14, 0.01 + 0.02 + 0.5 * 9.81e-4, 0.2 - 0.01], atol=1e-15)
    assert np.allclose(state.velocity_m_s[0], [14.0, 2.0981, -1.0], atol=1e-14)
    assert np.allclose(state.orientation, rotation.exp(2 * np.pi * 0.01 * np.array([[20.0, 50.0, -20.0]])), atol=1e-14)


def test_a_frontal_impact_rebounds_with_its_restitution_and_ends_with_its_spin() -> None:
    state = FRONTAL.state(AFTER)
    assert np.allclose(state.velocity_m_s[0], [-7.0, 1.0, 0.5], atol=1e-12)
    assert np.allclose(state.spin_rad_s[0], 2 * np.pi * np.array([700, 30, -900]), rtol=1e-13)
    assert np.allclose(FRONTAL.state(BEFORE).spin_rad_s[0], 2 * np.pi * np.array([0, 500, 0]), atol=1e-12)


def test_a_half_sine_contact_has_its_peak_force_and_its_path() -> None:
    middle, end = np.array([411e-6]), np.array([522e-6])
    # pi / 2 times the mean force of 0.11 kg * 77 m/s / 222 us.
    assert FRONTAL.state(middle).force_N[0, 0] == pytest.approx(-np.pi / 2 * 0.11 * 77.0 / 222e-6, rel=1e-12)
    # A symmetric pulse: the mean of both velocities over the contact.
    assert FRONTAL(end).position_m[0, 0] == pytest.approx(0.02 + 222e-6 * (70.0 - 7.0) / 2, abs=1e-15)


def test_peaks_share_the_impulse() -> None:
    at = 1e-6 * np.array([400.0, 500.0, 600.0, 700.0])
    assert np.allclose(PEAKS.state(at).velocity_m_s[:, 0], 70.0 - 98.0 * np.array([0.5, 0.5, 0.8, 1.0]), atol=1e-12)


def energy(motion: ObliqueImpact, time: np.ndarray) -> float:
    state, mass, radius = motion.state(time), 1e-3 * motion.mass_g, 0.5e-3 * motion.diameter_mm
    return float(0.5 * mass * (state.velocity_m_s**2).sum() + 0.2 * mass * radius**2 * (state.spin_rad_s**2).sum())


def slip(motion: ObliqueImpact, time: np.ndarray) -> np.ndarray:
    """Velocity of the contact point along the plane, from first principles."""
    normal = np.array(motion.normal) / np.linalg.norm(motion.normal)
    state = motion.state(time)
    point = state.velocity_m_s[0] + np.cross(state.spin_rad_s[0], -0.5e-3 * motion.diameter_mm * normal)
    return point - (point @ normal) * normal


@pytest.mark.parametrize("motion", [SLIDES, ROLLS])
def test_an_oblique_impact_loses_the_energy_that_restitution_and_friction_take(motion: ObliqueImpact) -> None:
    mass, normal = 1e-3 * motion.mass_g, np.array(motion.normal) / np.linalg.norm(motion.normal)
    approach = float(np.array(motion.velocity_m_s) @ normal)
    first, last = np.linalg.norm(slip(motion, BEFORE)), np.linalg.norm(slip(motion, AFTER))
    # The effective mass of a solid sphere's contact point along the plane is 2/7 of its mass.
    lost = 0.5 * mass * approach**2 * (1 - motion.restitution**2) + 0.5 * mass * 2 / 7 * (first**2 - last**2)
    assert energy(motion, BEFORE) - energy(motion, AFTER) == pytest.approx(lost, rel=1e-10)


def test_sliding_friction_takes_its_share_of_the_slip_and_rolling_has_none_left() -> None:
    normal_impulse = 1.6 * 80.0 * np.sin(SLOPE)
    left = np.linalg.norm(slip(SLIDES, BEFORE)) - 3.5 * 0.1 * normal_impulse
    assert left > 0
    assert np.linalg.norm(slip(SLIDES, AFTER)) == pytest.approx(left, rel=1e-12)
    assert np.linalg.norm(slip(ROLLS, AFTER)) < 1e-12


@pytest.mark.parametrize("motion", [SLIDES, ROLLS])
def test_the_torque_of_an_oblique_impact_is_arm_times_force(motion: ObliqueImpact) -> None:
    times, h = np.linspace(2.1e-4, 8.9e-4, 50), 1e-8
    state = motion.state(times)
    mass, radius = 1e-3 * motion.mass_g, 0.5e-3 * motion.diameter_mm
    arm = -radius * np.array(motion.normal) / np.linalg.norm(motion.normal)
    rate = (motion.state(times + h).spin_rad_s - motion.state(times - h).spin_rad_s) / (2 * h)
    torque = 0.4 * mass * radius**2 * rate
    assert np.abs(torque - np.cross(arm, state.force_N)).max() < 1e-5 * np.abs(torque).max()


def test_friction_on_a_plate_below_turns_a_ball_that_flies_right_clockwise() -> None:
    motion = ObliqueImpact(
        touch_m=(0.0, 0.0, 0.0),
        touch_us=0.0,
        contact_us=100.0,
        velocity_m_s=(30.0, 10.0, 0.0),
        normal=(0.0, -1.0, 0.0),
        restitution=0.5,
        friction=0.2,
        diameter_mm=20.0,
    )
    state = motion.state(AFTER)
    assert state.velocity_m_s[0, 0] == pytest.approx(30.0 - 0.2 * 15.0)
    assert np.allclose(state.spin_rad_s[0], [0.0, 0.0, 0.2 * 15.0 / (0.4 * 0.010)])


def test_the_path_of_an_oblique_impact_is_curved_over_many_frames() -> None:
    velocity = SLIDES.state(np.linspace(2e-4, 9e-4, 15)).velocity_m_s
    heading = np.arctan2(velocity[:, 1], velocity[:, 0])
    assert (np.diff(heading) < 0).all(), "y is down, so that the ball is deflected upwards"


def test_a_drop_weight_falls_stops_and_rises_to_its_height() -> None:
    end = np.array([900e-6])
    state = DROP.state(end)
    assert state.velocity_m_s[0, 1] == pytest.approx(-1.2, abs=1e-13)
    assert state.velocity_m_s[0, 0] == 0
    apex = DROP.state(end + 1.2 / 9.81)
    assert apex.velocity_m_s[0, 1] == pytest.approx(0.0, abs=1e-12)
    assert state.position_m[0, 1] - apex.position_m[0, 1] == pytest.approx(1.2**2 / (2 * 9.81), rel=1e-12)
    assert DROP.state(BEFORE).force_N[0, 1] == pytest.approx(2.0 * 9.81)


def test_turning_there_and_back_ends_as_it_began() -> None:
    times = 1e-3 * np.array([0.0, 0.25, 0.5, 1.0])
    turned = np.linalg.norm(rotation.log(RETURNS(times).orientation), axis=1)
    rate = 2 * np.pi * 50.0
    assert np.allclose(turned, [0.0, rate * 1e-3 / (2 * np.pi), rate * 1e-3 / np.pi, 0.0], atol=1e-15)
    assert np.allclose(RETURNS.state(times).spin_rad_s[1], 2 * np.pi * np.array([30.0, 0.0, 40.0]))


def test_a_pulse_and_its_integrals_agree_also_where_it_is_cut() -> None:
    for pulse in (Pulse.whole(1.0, 2.0), Pulse(1.0, 2.0, 2.2)):
        for end in (0.5, 1.7, 2.1, 4.0):
            stop = min(max(end, 1.0), pulse.stop_s)
            share = quad(lambda t, p=pulse: p.density(np.array([t]))[0], 1.0, stop)[0]
            assert pulse.share(np.array([end]))[0] == pytest.approx(share, abs=1e-10)
            delay = quad(lambda t, p=pulse: p.share(np.array([t]))[0], 0.0, end, points=(1.0, stop))[0]
            assert pulse.delay(np.array([end]))[0] == pytest.approx(delay, abs=1e-10)


BAD = [
    (FRONTAL, "contact_us", 0.0),
    (FRONTAL, "restitution", 1.5),
    (FRONTAL, "normal", (0.0, 0.0, 0.0)),
    (FRONTAL, "normal", (1.0, 0.0, 0.0)),
    (FRONTAL, "peaks", (0.5, 0.4)),
    (FRONTAL, "velocity_m_s", (1.0, float("nan"), 0.0)),
    (SLIDES, "friction", -0.1),
    (SLIDES, "diameter_mm", 0.0),
    (SLIDES, "normal", (0.0, 1.0, 0.0)),
    (DROP, "speed_m_s", -1.0),
    (FLIGHT, "start_m", (1.0, 2.0)),
    (RETURNS, "there_and_back_s", 0.0),
    (SPINS, "mass_g", float("inf")),
]


@pytest.mark.parametrize(("motion", "field", "value"), BAD)
def test_a_bad_field_is_refused_by_its_name(motion: Trajectory, field: str, value: object) -> None:
    fields = {name: getattr(motion, name) for name in motion.__dataclass_fields__}
    with pytest.raises(ValueError, match=f"^{field} ="):
        type(motion)(**(fields | {field: value}))


def write(path: Path, motion: Trajectory, times: np.ndarray, *, quaternions: bool) -> Path:
    poses = motion(times)
    turned = rotation.quaternion(poses.orientation) if quaternions else rotation.log(poses.orientation)
    head = "qw,qx,qy,qz" if quaternions else "rx_rad,ry_rad,rz_rad"
    rows = np.concatenate((times[:, None], poses.position_m, turned), axis=1).tolist()
    path.write_text("\n".join([f"time_s,x_m,y_m,z_m,{head}", *(",".join(map(repr, row)) for row in rows)]) + "\n")
    return path


@pytest.mark.parametrize("quaternions", [True, False])
def test_a_table_of_a_free_flight_gives_it_back_exactly_between_its_rows(tmp_path: Path, quaternions: bool) -> None:
    # A cubic spline represents a parabola exactly, and a rotation spline a constant spin.
    table = Table(file=str(write(tmp_path / "t.csv", FLIGHT, np.linspace(0, 0.02, 21), quaternions=quaternions)))
    times = np.linspace(0, 0.02, 77)
    got, true = table.state(times), FLIGHT.state(times)
    assert np.abs(got.position_m - true.position_m).max() < 1e-14
    assert np.abs(got.orientation - true.orientation).max() < 1e-9
    assert np.abs(got.velocity_m_s - true.velocity_m_s).max() < 1e-11
    assert np.abs(got.acceleration_m_s2 - true.acceleration_m_s2).max() < 1e-8
    assert np.abs(got.spin_rad_s - true.spin_rad_s).max() < 1e-5


def test_the_spin_of_a_table_is_the_rate_of_its_orientation_in_camera_axes(tmp_path: Path) -> None:
    table = Table(file=str(write(tmp_path / "t.csv", FRONTAL, np.linspace(0, 1e-3, 60), quaternions=True)))
    times, h = np.linspace(1e-5, 9.9e-4, 50), 1e-9
    turned = table(times + h).orientation @ table(times - h).orientation.swapaxes(1, 2)
    assert np.abs(rotation.log(turned) / (2 * h) - table.state(times).spin_rad_s).max() < 1e-2


def test_a_table_starts_at_the_time_asked_for_and_refuses_times_it_does_not_hold(tmp_path: Path) -> None:
    path = write(tmp_path / "t.csv", FLIGHT, np.linspace(0, 0.02, 21), quaternions=True)
    later = Table(file=str(path), start_s=0.005)
    assert np.allclose(later(BEFORE).position_m, FLIGHT(np.array([0.005])).position_m, atol=1e-15)
    with pytest.raises(ValueError, match=r"t\.csv': holds the times 0 to 0\.02 s, but .* to 0\.021 s"):
        later(np.array([0.016]))


HEAD = "time_s,x_m,y_m,z_m,qw,qx,qy,qz"
GOOD = ["0,0,0,0,1,0,0,0", "1,0,0,0,1,0,0,0"]


@pytest.mark.parametrize(
    ("lines", "words"),
    [
        ([], "is empty"),
        (["time_s,x_m,y_m,qw,qx,qy,qz", *GOOD], "lacks the column z_m"),
        (["time_s,x_m,y_m,z_m", "0,0,0,0", "1,0,0,0"], "lacks an orientation"),
        ([HEAD, GOOD[0]], "has 1 rows of numbers"),
        ([HEAD, *GOOD, "2,0,zero,0,1,0,0,0"], "row 4, column y_m: given 'zero'"),
        ([HEAD, "# said by hand", *GOOD, "2,0,nan,0,1,0,0,0"], "row 5, column y_m: given 'nan'"),
        ([HEAD, *GOOD, "2,0,0,0,1,0,0"], "row 4: has 7 cells, expected 8"),
        ([HEAD, *GOOD, "1,0,0,0,1,0,0,0"], "row 4, column time_s: given 1 after 1"),
        ([HEAD, *GOOD, "2,0,0,0,2,0,0,0"], "row 4, columns qw to qz: the quaternion's length is 2"),
        ([HEAD, *GOOD, "2,0,0,0,0,1,0,0"], "row 4, columns qw to qz: turned by 180 deg"),
    ],
)
def test_a_bad_table_is_refused_with_file_row_and_column(tmp_path: Path, lines: list[str], words: str) -> None:
    path = tmp_path / "bad.csv"
    path.write_text("\n".join(lines) + "\n")
    with pytest.raises(ValueError, match=r"^file = '.*bad\.csv': ") as error:
        Table(file=str(path))
    assert words in str(error.value)


def test_a_table_that_is_not_there_is_refused_by_its_name(tmp_path: Path) -> None:
    with pytest.raises(ValueError, match=r"none\.csv': No such file"):
        Table(file=str(tmp_path / "none.csv"))


def test_columns_of_a_table_may_stand_in_any_order(tmp_path: Path) -> None:
    path = tmp_path / "t.csv"
    path.write_text("note,z_m,y_m,x_m,time_s,rz_rad,ry_rad,rx_rad\na,3,2,1,0,0,0,0\nb,6,5,4,1,0.3,0.2,0.1\n")
    _, place, turned = read_table(path)
    assert place.tolist() == [[1, 2, 3], [4, 5, 6]]
    assert np.allclose(turned.as_rotvec()[1], [0.1, 0.2, 0.3])


def test_every_kind_has_a_mass_and_gives_poses() -> None:
    assert {type(motion) for motion in ALL.values()} | {Table} == set(KINDS.values())
