"""Coefficient of friction of impacts with exact impulses, and when it is a lower bound."""

import numpy as np
import pytest

from torchsphere.dynamics.friction import Friction, friction
from torchsphere.dynamics.rebound import Rebound

RADIUS_M = 0.015

#: Noise of velocities and spins in the drawn motions, m/s and rad/s.
NOISE_M_S, NOISE_RAD_S = 0.05, 1.0


def found(
    tangential_impulse: float,
    normal_impulse: float = 60.0,
    tangential_speed: float = 40.0,
    normal_deg: float = 180.0,
    drawn_radius_m: float | np.ndarray = RADIUS_M,
) -> Friction:
    """Friction of a solid ball that hits a wall, with impulses over the mass, m/s."""
    angle = np.radians(normal_deg)
    n = np.array([np.cos(angle), np.sin(angle)])
    t = np.array([-n[1], n[0]])
    before = -30.0 * n + tangential_speed * t
    after = before + normal_impulse * n + tangential_impulse * t
    # The force acts at -R n: it turns a solid ball by -R J_t / I about z.
    spin_after = np.array([0.0, 0.0, -2.5 * tangential_impulse / RADIUS_M])
    rng = np.random.default_rng(0)

    def drawn(value: np.ndarray, noise: float) -> np.ndarray:
        return value + noise * rng.normal(size=(400, len(value)))

    contact, zero = np.array([0.0, 1e-3]), np.zeros(3)
    smoothed = Rebound(before, after, zero, spin_after, contact, n)
    many = Rebound(
        *(drawn(before, NOISE_M_S), drawn(after, NOISE_M_S), drawn(zero, NOISE_RAD_S)),
        *(drawn(spin_after, NOISE_RAD_S), np.tile(contact, (400, 1)), np.tile(n, (400, 1))),
    )
    return friction(smoothed, many, RADIUS_M, drawn_radius_m)


@pytest.mark.parametrize("normal_deg", [180.0, 90.0, 37.0])
def test_a_ball_that_slides_to_the_end_gives_the_coefficient(normal_deg: float) -> None:
    # Slip of 40 m/s, of which 3.5 times the impulse of 6 m/s is lost: 19 m/s remain.
    result = found(-6.0, normal_deg=normal_deg)
    assert result.coefficient.value == pytest.approx(0.1, rel=1e-9)
    # sqrt(2) 0.05 m/s of the tangential impulse over 60 m/s.
    assert result.coefficient.sd == pytest.approx(np.sqrt(2) * NOISE_M_S / 60, rel=0.15)
    assert result.slip_before.value == pytest.approx(40.0)
    assert result.slip_after.value == pytest.approx(19.0)
    assert result.is_lower_bound is False
    assert "still slides" in result.sentence


def test_a_ball_that_rolls_at_the_end_gives_a_lower_bound() -> None:
    # A solid ball rolls when 2/7 of its slip is lost as impulse.
    result = found(-40.0 * 2 / 7)
    assert result.coefficient.value == pytest.approx(40.0 * 2 / 7 / 60)
    assert result.slip_after.value == pytest.approx(0.0, abs=1e-9)
    assert result.is_lower_bound is True
    assert "lower bound" in result.sentence


def test_a_slip_that_changed_its_sign_gives_a_lower_bound() -> None:
    result = found(-14.0)
    assert result.slip_after.value == pytest.approx(-9.0)
    assert result.is_lower_bound is True
    assert "changed its sign" in result.sentence


def test_an_impulse_along_the_slip_is_said_to_be_no_friction() -> None:
    result = found(3.0)
    assert result.slip_after.value > result.slip_before.value
    assert result.is_lower_bound is None
    assert "as no friction does" in result.sentence
    # A smooth surface: the impulse is 0 within its errors, and the ball slides on.
    assert found(1e-3).is_lower_bound is False


def test_a_ball_without_slip_before_does_not_show_whether_it_slid() -> None:
    result = found(-3.0, tangential_speed=0.0)
    assert result.is_lower_bound is None
    assert "slip before the impact is 0" in result.sentence


def test_without_a_spin_it_is_not_known_whether_the_ball_slid() -> None:
    n, contact = np.array([-1.0, 0.0]), np.array([0.0, 1e-3])
    unknown = np.full(3, np.nan)
    one = Rebound(np.array([30.0, 40.0]), np.array([-30.0, 34.0]), unknown, unknown, contact, n)
    many = Rebound(*(np.tile(value, (5, 1)) for value in vars(one).values()))
    result = friction(one, many, RADIUS_M, RADIUS_M)
    assert result.coefficient.value == pytest.approx(0.1)
    assert result.is_lower_bound is None
    assert np.isnan(result.slip_after.value)
    assert result.summary()["is_lower_bound"] is None


def test_an_error_of_the_diameter_reaches_the_slip_of_a_spinning_ball_alone() -> None:
    exact = found(-6.0)
    wide = found(-6.0, drawn_radius_m=RADIUS_M * (1 + 0.02 * np.random.default_rng(1).normal(size=400)))
    assert wide.coefficient.sd == exact.coefficient.sd
    assert wide.slip_before.sd == pytest.approx(exact.slip_before.sd, rel=0.02)
    # The surface of the ball that spins after the impact moves with 2.5 times 6 m/s.
    assert wide.slip_after.sd == pytest.approx(np.hypot(exact.slip_after.sd, 0.02 * 15.0), rel=0.1)
