"""The bar impact's own model: beam, contact, both balances, and what it gives a renderer."""

import math
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.integrate import quad
from scipy.special import gamma

from experiments.paper.bar.beam import beam, free_roots, frequencies_hz, plastic_moment, symmetric_shape, timoshenko_hz
from experiments.paper.bar.contact import Contact
from experiments.paper.bar.history import History, peaks
from experiments.paper.bar.impact import simulate
from experiments.paper.bar.setup import Setup
from experiments.paper.bar.table import HEADER, motion, write_table

FRAME_S = 1 / 36_000

#: A bar that neither moves nor yields, struck centrally: a wall.
WALL = Setup(
    bar_density_kg_m3=1e13,
    bending_yield_pa=math.inf,
    modes=1,
    sideways_m_s=0.0,
    offset_m=0.0,
    spin_rad_s=(0.0, 0.0, 0.0),
    step_s=0.2e-6,
    length_s=0.4e-3,
)


@pytest.fixture(scope="module")
def impact() -> History:
    return simulate(Setup())


@pytest.fixture(scope="module")
def coarse() -> History:
    return simulate(Setup(step_s=0.2e-6))


def test_the_roots_are_those_of_the_tables() -> None:
    known = [4.7300407, 7.8532046, 10.9956078, 14.1371655]
    np.testing.assert_allclose(free_roots(4), known, atol=1e-7)  # as printed


def test_the_papers_alphas_are_the_roots_squared() -> None:
    np.testing.assert_allclose(free_roots(3) ** 2, [22.37, 61.67, 120.9], atol=0.05)  # as printed


def test_the_bars_own_numbers_give_903_and_4879_hz_and_the_papers_need_a_density_of_3340() -> None:
    roots = free_roots(3)[::2]
    np.testing.assert_allclose(frequencies_hz(roots, Setup()), [902.8, 4878.8], atol=0.1)  # as printed
    papers = frequencies_hz(roots, Setup(bar_density_kg_m3=3340.0))
    np.testing.assert_allclose(papers, [827, 4468], atol=1.0)  # its two numbers agree to 0.04 %


def test_shear_and_rotary_inertia_lower_the_frequencies_of_a_thick_bar_and_hardly_those_of_a_thin_one() -> None:
    # 4645 Hz by the characteristic equation, by hand.
    np.testing.assert_allclose(timoshenko_hz(3, Setup())[[0, 2]], [894.4, 4645.0], rtol=1e-3)
    thin = Setup(bar_diameter_m=1e-3)
    np.testing.assert_allclose(timoshenko_hz(3, thin), frequencies_hz(free_roots(3), thin), rtol=1e-3)


def test_each_mode_has_the_mass_of_the_bar_and_none_of_another() -> None:
    knots, weight = np.polynomial.legendre.leggauss(80)
    shapes = symmetric_shape(free_roots(16)[::2], knots / 2)
    np.testing.assert_allclose(shapes.T @ (weight[:, None] / 2 * shapes), np.eye(8), atol=1e-10)  # quadrature


def test_the_modes_neither_move_nor_turn_the_bar_as_a_whole() -> None:
    knots, weight = np.polynomial.legendre.leggauss(80)
    shapes = symmetric_shape(free_roots(16)[::2], knots / 2)
    np.testing.assert_allclose(weight @ shapes, 0, atol=1e-10)  # quadrature
    np.testing.assert_allclose(symmetric_shape(free_roots(16)[::2], -knots / 2), shapes, atol=1e-12)


def test_the_curvature_is_the_second_derivative_and_vanishes_at_the_free_ends() -> None:
    roots, step = free_roots(5)[::2], 1e-4
    place = np.linspace(-0.4, 0.4, 9)
    there, left, right = (symmetric_shape(roots, place + d) for d in (0.0, -step, step))
    curvature = symmetric_shape(roots, place, derivative=2)
    np.testing.assert_allclose(curvature, (left - 2 * there + right) / step**2, atol=0.05)  # of 250
    np.testing.assert_allclose(symmetric_shape(roots, np.array([0.5]), derivative=2), 0, atol=1e-10)


def test_the_modes_together_give_way_as_the_static_beam_does() -> None:
    # Force F at mid-span against the inertia of the bar's even acceleration: F L^3 / (320 E I), by integrating twice.
    setup = Setup(modes=40)
    bar = beam(setup)
    give = (bar.middle**2 / (bar.mass_kg * bar.omega_rad_s**2)).sum()
    exact = setup.bar_length_m**3 / (320 * setup.bending_stiffness_n_m2)
    assert give == pytest.approx(exact, rel=1e-5)  # the tail of a sum of 1 / n^4


@pytest.mark.parametrize("modes", [1, 8, 24])
def test_the_points_at_which_it_yields_hold_all_of_the_bending_energy(modes: int) -> None:
    bar = beam(Setup(modes=modes))
    energy = bar.stiffness_n_m2 * bar.curvature_m2.T @ (bar.weight_m[:, None] * bar.curvature_m2)
    own = bar.mass_kg * bar.omega_rad_s**2
    np.testing.assert_allclose(energy / np.sqrt(np.outer(own, own)), np.eye(modes), atol=1e-8)  # quadrature


def test_a_section_without_hardening_yields_at_the_stress_times_a_sixth_of_the_diameter_cubed() -> None:
    setup = Setup(rate_coefficient=1e-12, bending_hardening_pa=1e-3)
    moment = plastic_moment(setup)(np.array([0.0, 5.0]))
    np.testing.assert_allclose(moment, setup.bending_yield_pa * setup.bar_diameter_m**3 / 6, rtol=1e-8)


def test_a_section_hardens_as_its_fibres_do() -> None:
    setup, curvature = Setup(), 4.0
    rate = 1 + 0.1 * math.log(100 / 0.18)
    radius = setup.bar_radius_m

    def stress(y: float) -> float:
        return rate * (175e6 + 223e6 * (curvature * y) ** 0.37)

    exact = quad(lambda y: 4 * y * stress(y) * math.sqrt(radius**2 - y**2), 0, radius)[0]
    assert plastic_moment(setup)(np.array([curvature]))[0] == pytest.approx(exact, rel=1e-6)


def test_the_contact_yields_without_a_jump_of_force_or_slope() -> None:
    contact = Contact.of(Setup())
    start, step = contact.yield_approach_m, 1e-3 * contact.yield_approach_m
    below, there, above = (contact.loading(start + d) for d in (-step, 0.0, step))
    assert there == pytest.approx((below + above) / 2, rel=1e-6)  # curvature of one side
    assert (above - there) / (there - below) == pytest.approx(1, rel=1e-3)


@pytest.mark.parametrize("deepest", [0.5, 1.0, 20.0, 400.0])
def test_the_work_of_a_load_cycle_is_the_plastic_work(deepest: float) -> None:
    contact = Contact.of(Setup())
    deepest *= contact.yield_approach_m
    turn = contact.dent(deepest)[1]
    up = quad(contact.loading, 0, deepest, points=[contact.yield_approach_m], limit=200)[0]
    down = quad(lambda a: contact.force(a, deepest), turn, deepest, limit=200)[0]
    assert contact.plastic_work(deepest) == pytest.approx(up - down, rel=1e-6, abs=1e-9 * up)
    assert contact.elastic_energy(deepest, deepest) == pytest.approx(down, rel=1e-6)
    assert contact.force(deepest * (1 - 1e-9), deepest) == pytest.approx(contact.loading(deepest), rel=1e-5)
    assert contact.force(turn, deepest) == 0


def test_an_elastic_ball_meets_a_wall_as_hertz_has_it() -> None:
    setup = replace(WALL, contact_pressure_pa=math.inf, speed_m_s=20.0)
    history, contact = simulate(setup), Contact.of(setup)
    stiffness = 4 / 3 * contact.modulus_pa * math.sqrt(contact.radius_m)
    deepest = (5 / 4 * setup.ball_mass_kg * setup.speed_m_s**2 / stiffness) ** 0.4
    duration = 4 * math.sqrt(math.pi) * gamma(0.4) / (5 * gamma(0.9)) * deepest / setup.speed_m_s
    ((start, stop),) = history.contacts_s
    assert history.normal_N.max() == pytest.approx(stiffness * deepest**1.5, rel=1e-4)  # top between two steps
    assert stop - start == pytest.approx(duration, abs=2 * setup.step_s)
    np.testing.assert_allclose(history.velocity_m_s[-1], [-setup.speed_m_s, 0, 0], atol=1e-4)


@pytest.mark.parametrize("speed", [1.0, 20.0, 70.0])
def test_an_elasto_plastic_ball_comes_back_from_a_wall_as_thornton_has_it(speed: float) -> None:
    setup = replace(WALL, speed_m_s=speed)
    contact = Contact.of(setup)
    first = contact.elastic_energy(contact.yield_approach_m, contact.yield_approach_m)
    q = math.sqrt(2 * first / setup.ball_mass_kg) / speed
    restitution = math.sqrt(6 * math.sqrt(3) / 5 * (1 - q**2 / 6))
    restitution *= (q / (q + 2 * math.sqrt(6 / 5 - q**2 / 5))) ** 0.25
    found = -simulate(setup).velocity_m_s[-1, 0] / speed
    assert found == pytest.approx(restitution, rel=1e-3)  # the deepest approach lies between two steps


def test_a_ball_that_grips_a_wall_leaves_rolling_with_five_sevenths_of_its_sliding() -> None:
    setup = replace(WALL, sideways_m_s=1.5)
    history = simulate(setup)
    # The front drags against +y, so that the ball turns about -z.
    spin = -5 / 7 * 1.5 / setup.ball_radius_m
    assert history.velocity_m_s[-1, 1] == pytest.approx(5 / 7 * 1.5, rel=1e-3)  # what is left of the sliding
    np.testing.assert_allclose(history.spin_rad_s[-1], [0, 0, spin], atol=1e-3 * abs(spin))


def test_a_ball_that_slides_throughout_gains_spin_by_the_impulse_times_friction() -> None:
    setup = replace(WALL, sideways_m_s=20.0, friction=0.01, creep_m_s=0.01)
    history = simulate(setup)
    impulse = setup.ball_mass_kg * (setup.speed_m_s - history.velocity_m_s[-1, 0])
    spin = -0.01 * impulse * setup.ball_radius_m / setup.ball_inertia_kg_m2
    np.testing.assert_allclose(history.spin_rad_s[-1], [0, 0, spin], atol=1e-5 * abs(spin))


def test_momentum_is_kept(impact: History) -> None:
    momentum = impact.momentum_kg_m_s
    np.testing.assert_allclose(momentum - momentum[0], 0, atol=1e-12 * momentum[0, 0])


def test_energy_is_kept_and_no_share_of_it_falls_below_nothing(impact: History) -> None:
    total = impact.total_energy_J
    np.testing.assert_allclose(total, total[0], rtol=1e-6)
    assert min(part.min() for part in impact.energy_J.values()) > -1e-9 * total[0]
    for name in ("bar, plastic bending", "contact, plastic", "friction", "damping"):
        assert (np.diff(impact.energy_J[name]) >= -1e-12 * total[0]).all(), name


def test_the_force_is_what_changes_the_balls_velocity(impact: History) -> None:
    impulse = np.trapezoid(impact.force_N, impact.time_s, axis=0)
    change = impact.setup.ball_mass_kg * (impact.velocity_m_s[-1] - impact.velocity_m_s[0])
    np.testing.assert_allclose(impulse, change, atol=5e-5)  # of 6.2 N s: the trapezoids


def test_half_the_step_changes_nothing_that_a_camera_could_see(impact: History, coarse: History) -> None:
    fine, rough = (peaks(h.time_s, h.normal_N) for h in (impact, coarse))
    np.testing.assert_allclose([p.time_s for p in rough], [p.time_s for p in fine], atol=0.5e-6)
    np.testing.assert_allclose([p.force_N for p in rough], [p.force_N for p in fine], atol=150)  # of 73 kN
    np.testing.assert_allclose(end(coarse), end(impact), atol=0.02)


def end(history: History) -> np.ndarray:
    """Velocity in m/s and spin in revolutions per second at the end."""
    return np.concatenate((history.velocity_m_s[-1], history.spin_rad_s[-1] / (2 * math.pi)))


def test_more_modes_change_the_force_little(coarse: History) -> None:
    more = simulate(replace(coarse.setup, modes=24))
    few, many = (peaks(h.time_s, h.normal_N) for h in (coarse, more))
    np.testing.assert_allclose([p.time_s for p in many], [p.time_s for p in few], atol=4e-6)
    assert many[0].force_N == pytest.approx(few[0].force_N, rel=0.015)
    np.testing.assert_allclose(end(more), end(coarse), atol=0.4)


def test_the_impact_is_like_the_papers(impact: History) -> None:
    tops = peaks(*impact.seen(FRAME_S))
    assert len(tops) == 4
    assert tops[0].force_N == pytest.approx(60e3, rel=0.03)  # table 3
    assert tops[2].time_s - tops[0].time_s == pytest.approx(0.594e-3, abs=FRAME_S)
    assert tops[1].time_s - tops[0].time_s == pytest.approx(0.124e-3, abs=FRAME_S)
    assert np.linalg.norm(impact.spin_rad_s[-1]) / (2 * math.pi) == pytest.approx(20, rel=0.01)


def test_a_ball_that_passes_beyond_the_bars_axis_is_pushed_away_from_the_camera_and_its_front_lags(
    impact: History,
) -> None:
    assert impact.setup.offset_m > 0
    assert impact.velocity_m_s[-1, 2] > 0
    front = np.array([0.0, 0.0, -impact.setup.ball_radius_m])
    assert np.cross(impact.spin_rad_s[-1], front)[0] < 0 < impact.velocity_m_s[-1, 0]


def test_an_impact_is_the_same_with_the_bar_along_the_camera_but_for_a_quarter_turn() -> None:
    setup = replace(WALL, offset_m=0.7e-3, bar_density_kg_m3=2800.0, friction=0.1, spin_rad_s=(0.0, 3.0, 4.0))
    # The quarter turn about x that takes y to z and z to -y.
    turn = np.array([[1, 0, 0], [0, 0, -1], [0, 1, 0]])
    turned = replace(setup, bar_axis=(0.0, 0.0, 1.0), spin_rad_s=tuple(turn @ setup.spin_rad_s))
    one, other = simulate(replace(setup, length_s=1e-3)), simulate(replace(turned, length_s=1e-3))
    np.testing.assert_allclose(other.velocity_m_s, one.velocity_m_s @ turn.T, atol=1e-6)
    np.testing.assert_allclose(other.spin_rad_s, one.spin_rad_s @ turn.T, atol=1e-4)


def test_what_the_camera_sees_is_the_second_difference_of_the_positions() -> None:
    history = simulate(WALL)
    time, force = history.seen(FRAME_S)
    span = round(FRAME_S / WALL.step_s) * WALL.step_s
    x = [motion(history, time + d)[0][:, 0] for d in (-span, 0.0, span)]
    second = -(x[0] - 2 * x[1] + x[2]) / span**2 * WALL.ball_mass_kg
    np.testing.assert_allclose(force, second, atol=2e-3 * force.max())  # a sum over steps for an integral


def test_the_table_holds_the_motion_and_the_flight_to_both_sides(impact: History, tmp_path: Path) -> None:
    origin = (0.01, 0.002, 0.6)
    path = write_table(impact, tmp_path / "motion.csv", before_s=0.2e-3, after_s=1.3e-3, origin_m=origin)
    assert path.read_text().splitlines()[0] == HEADER
    rows = np.loadtxt(path, delimiter=",", skiprows=1)
    time, place = rows[:, 0], rows[:, 1:4] - origin
    np.testing.assert_allclose(time, 1e-6 * np.arange(-200, 1301), atol=1e-15)
    np.testing.assert_allclose(rows[200, 4:], 0, atol=1e-12)  # I at first touch
    velocity = np.diff(place, axis=0) / 1e-6
    np.testing.assert_allclose(velocity[:200], np.tile(impact.velocity_m_s[0], (200, 1)), atol=1e-6)
    np.testing.assert_allclose(velocity[-200:], np.tile(impact.velocity_m_s[-1], (200, 1)), atol=1e-6)
    np.testing.assert_allclose(place[200:1301:50], impact.position_m[::500], atol=1e-12)


def test_a_renderer_finds_force_and_spin_in_the_table(impact: History, tmp_path: Path) -> None:
    from render.trajectory.table import Table

    path = write_table(impact, tmp_path / "motion.csv", before_s=0.1e-3, after_s=1.3e-3)
    state = Table(file=str(path), start_s=0.0, mass_g=110.0).state(impact.time_s[::50])
    np.testing.assert_allclose(state.force_N, impact.force_N[::50], atol=300)  # of 73 kN, which sets in with a kink
    np.testing.assert_allclose(state.spin_rad_s, impact.spin_rad_s[::50], atol=0.5)  # of 125


@pytest.mark.parametrize(
    ("changed", "words"),
    [
        ({"ball_mass_kg": 0.0}, "ball_mass_kg = 0.0"),
        ({"modes": -1}, "modes = -1"),
        ({"step_s": math.nan}, "step_s = nan"),
        ({"bar_axis": (1.0, 0.0, 0.0)}, "bar_axis"),
        ({"bar_axis": (0.0, 2.0, 0.0)}, "bar_axis"),
        ({"spin_rad_s": (0.0, math.nan, 0.0)}, "spin_rad_s"),
        ({"offset_m": 0.03}, "misses the bar"),
    ],
)
def test_what_is_no_impact_is_refused(changed: dict[str, Any], words: str) -> None:
    with pytest.raises(ValueError, match=words):
        Setup(**changed)


def test_an_end_within_the_contact_is_refused() -> None:
    with pytest.raises(ValueError, match="still touches the bar"):
        simulate(Setup(length_s=0.3e-3, step_s=1e-6))


def test_a_table_that_runs_backwards_is_refused(impact: History, tmp_path: Path) -> None:
    with pytest.raises(ValueError, match="before_s = -1"):
        write_table(impact, tmp_path / "motion.csv", before_s=-1.0, after_s=1e-3)
