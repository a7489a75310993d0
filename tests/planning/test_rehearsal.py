"""The rehearsed impact against the true one, and the duration of an elastic impact."""

import math
from dataclasses import replace

import numpy as np
import pytest
from plan_setups import SMALL
from scipy.integrate import solve_ivp

from torchsphere.planning.expected import differences
from torchsphere.planning.rehearsal import Target, hertz_contact_s, rehearse


def test_the_duration_of_an_elastic_impact_is_that_of_the_integrated_contact() -> None:
    radius, modulus, speed, mass = 0.015, 60e9, 72.0, 0.110
    stiffness = 4 / 3 * modulus * math.sqrt(radius)

    def released(_: float, state: np.ndarray) -> float:
        return state[0] + 1e-12

    released.terminal, released.direction = True, -1  # type: ignore[attr-defined]
    path = solve_ivp(
        lambda _, s: (s[1], -stiffness / mass * max(s[0], 0.0) ** 1.5),
        (0, 1e-3), (0.0, speed), events=released, rtol=1e-8, atol=1e-12, max_step=1e-6,
    )  # fmt: skip
    setup = replace(SMALL, speed_m_s=speed)
    # 2.87 is the rounded 2.868 of the book.
    assert hertz_contact_s(setup, modulus) == pytest.approx(path.t_events[0][0], rel=2e-3)


def test_the_error_of_the_rehearsed_force_is_within_its_stated_uncertainty() -> None:
    covariance = np.diag([0.005**2, 0.005**2, 1e-4**2, 1e-4**2, 4e-5**2])
    setup = replace(SMALL, speed_m_s=72.0, px_per_mm=3.6, direction_deg=90.0)
    found = rehearse(covariance, setup, Target(4e-4, 0.3, "given"))
    assert found.found
    # Half a sine of force that turns 72 m/s into -0.3 times that.
    assert found.peak_N == pytest.approx(math.pi / 2 * 0.110 * 1.3 * 72 / 4e-4)
    assert np.trapezoid(found.true_force_N, found.time_s) == pytest.approx(-0.110 * 1.3 * 72, rel=0.02)
    assert found.force_error_N[1] < 2 * found.force_N[1, 0]
    assert found.force_N[1, 0] < 0.02 * found.peak_N
    # In flight the smoothed velocity is more precise than an increment.
    plain = differences(covariance, setup.frame_rate, setup.m_per_px, setup.mass_kg)
    assert (found.velocity_m_s[0] < plain.velocity_m_s).all()
