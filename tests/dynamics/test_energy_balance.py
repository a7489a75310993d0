"""The energy balance of an impact: rows add up, and errors that both energies share cancel in the loss."""

import numpy as np
import pytest
from pulses import M_PER_PX, MASS_KG, NOISES_M, RATE, pulse

import torchsphere as ts
from torchsphere.dynamics.energy_balance import EnergyBalance, EnergyRow, energy_balance
from torchsphere.dynamics.rebound import Rebound

BALL = ts.ball(MASS_KG, 0.015)


@pytest.fixture(scope="module")
def found() -> ts.Impact:
    truth = pulse(11, NOISES_M[0])
    motion = ts.kinematics(truth.track, frame_rate=RATE, m_per_px=M_PER_PX, mass_kg=MASS_KG, relative_sd_scale=0.01)
    impact, reason = ts.impact(motion, BALL, normal_deg=180.0)
    assert impact is not None, reason
    return impact


@pytest.fixture(scope="module")
def balance(found: ts.Impact) -> EnergyBalance:
    assert found.energy_balance is not None
    return found.energy_balance


def test_energies_are_those_of_the_pulse(balance: EnergyBalance) -> None:
    truth = pulse(11, NOISES_M[0])
    for when, frame in (("before", 0), ("after", -1)):
        translation = 0.5 * MASS_KG * (truth.velocity_m_s[frame] ** 2).sum()
        spin = 0.5 * BALL.inertia_kg_m2 * (truth.spin_rad_s[frame] ** 2).sum()
        for row, true in (
            (balance.translation, translation),
            (balance.spin, spin),
            (balance.total, translation + spin),
        ):
            energy = getattr(row, when)
            assert abs(energy.value - true) < 3 * energy.sd


def test_rows_and_columns_add_up(balance: EnergyBalance, found: ts.Impact) -> None:
    rows: tuple[EnergyRow, ...] = (balance.translation, balance.spin, balance.total)
    for row in rows:
        assert row.lost.value == pytest.approx(row.before.value - row.after.value)
        assert row.share.value == pytest.approx(row.lost.value / balance.total.before.value)
    for column in ("before", "after", "lost", "share"):
        parts = [getattr(row, column).value for row in rows]
        assert parts[2] == pytest.approx(parts[0] + parts[1])
    assert found.energy_given is not None
    assert balance.total.lost.value == pytest.approx(found.energy_given.value)
    assert balance.total.lost.sd == pytest.approx(found.energy_given.sd)
    assert found.energy_before is not None
    assert balance.translation.before.sd == pytest.approx(found.energy_before.sd)


def test_an_error_of_the_scale_moves_the_energies_and_leaves_the_share(balance: EnergyBalance) -> None:
    before = balance.translation.before
    # An energy goes with the square of the scale, whose standard deviation is 1 %; 400 draws give it to 3.5 %.
    assert before.sd / before.value == pytest.approx(0.02, rel=0.11)
    assert balance.translation.share.sd < 0.1 * before.sd / before.value


def test_without_a_spin_the_translation_remains() -> None:
    n, contact, unknown = np.array([-1.0, 0.0]), np.array([0.0, 1e-3]), np.full(3, np.nan)
    one = Rebound(np.array([30.0, 0.0]), np.array([-20.0, 0.0]), unknown, unknown, contact, n)
    many = Rebound(*(np.tile(value, (5, 1)) for value in vars(one).values()))
    balance = energy_balance(one, many, BALL, BALL)
    assert balance.translation.lost.value == pytest.approx(0.5 * MASS_KG * 500)
    for row in (balance.spin, balance.total):
        assert np.isnan(row.lost.value)
        assert np.isnan(row.lost.sd)
    assert balance.summary()["translation"]["before"]["unit"] == "J"
