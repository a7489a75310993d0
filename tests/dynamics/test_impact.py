"""Impact quantities against a pulse whose momentum, energies and spin are known exactly."""

import dataclasses

import numpy as np
import pulses
import pytest
from pulses import LENGTH, M_PER_PX, MASS_KG, NOISES_M, PEAK_N, RATE, Pulse, pulse

import torchsphere as ts
from experiments.validation.simulated_impacts import Push, half_sine, rebound, simulated
from torchsphere.dynamics.ball import ball
from torchsphere.dynamics.impact import Estimate, Impact, impact, impacts
from torchsphere.dynamics.kinematics import Kinematics

#: Diameter of the pulse's ball: 75 px of radius.
DIAMETER_M = 2 * 75 * M_PER_PX


@pytest.fixture(scope="module")
def truth() -> Pulse:
    return pulse(11, NOISES_M[0])


@pytest.fixture(scope="module")
def motion(truth: Pulse) -> Kinematics:
    return ts.kinematics(truth.track, frame_rate=RATE, m_per_px=M_PER_PX, mass_kg=MASS_KG, relative_sd_scale=0.002)


@pytest.fixture(scope="module")
def found(motion: Kinematics) -> Impact:
    result, reason = impact(motion, ball(MASS_KG, DIAMETER_M), normal_deg=180.0)
    assert reason == ""
    assert result is not None
    return result


def is_within_3_sd(estimate: Estimate | None, true: float | np.ndarray) -> bool:
    """Whether a value is right to three standard deviations, none of which is 0."""
    assert estimate is not None
    assert np.all(estimate.sd > 0)
    return bool(np.all(np.abs(estimate.value - true) < 3 * estimate.sd))


def test_speeds_impulse_and_energies_are_those_of_the_pulse(truth: Pulse, found: Impact) -> None:
    before, after = truth.velocity_m_s[0, 0], truth.velocity_m_s[-1, 0]
    # The impulse of a half-sine: 2 / pi times peak and duration.
    impulse = 2 / np.pi * PEAK_N * LENGTH / RATE
    assert is_within_3_sd(found.velocity_before, truth.velocity_m_s[0])
    assert is_within_3_sd(found.velocity_after, truth.velocity_m_s[-1])
    assert is_within_3_sd(found.speed_after, abs(after))
    assert is_within_3_sd(found.impulse_size, impulse)
    assert found.impulse_size.value == pytest.approx(MASS_KG * (before - after), rel=0.01)
    assert is_within_3_sd(found.energy_before, 0.5 * MASS_KG * before**2)
    inertia = 0.4 * MASS_KG * (DIAMETER_M / 2) ** 2
    spin = 0.5 * inertia * (truth.spin_rad_s[-1] ** 2).sum()
    assert is_within_3_sd(found.spin_energy_after, spin)
    given = 0.5 * MASS_KG * (before**2 - after**2) - spin + 0.5 * inertia * (truth.spin_rad_s[0] ** 2).sum()
    assert is_within_3_sd(found.energy_given, given)


def test_contact_peak_and_restitution_are_those_of_the_pulse(truth: Pulse, found: Impact) -> None:
    before, after = truth.velocity_m_s[0, 0], truth.velocity_m_s[-1, 0]
    assert is_within_3_sd(found.contact_start, truth.edges_s[0])
    assert is_within_3_sd(found.duration, LENGTH / RATE)
    assert is_within_3_sd(found.peak_force, PEAK_N)
    assert found.peak_force.value == pytest.approx(PEAK_N, abs=500)
    assert is_within_3_sd(found.peak_time, truth.edges_s.mean())
    assert is_within_3_sd(found.restitution_normal, -after / before)
    assert is_within_3_sd(found.spin_after, truth.spin_rad_s[-1] / (2 * np.pi))
    assert is_within_3_sd(found.angle_of_impact, 90.0) or found.angle_of_impact.value == pytest.approx(90, abs=0.05)


def test_an_inclined_target_changes_the_angles_and_the_slip(motion: Kinematics, truth: Pulse) -> None:
    found, _ = impact(motion, ball(MASS_KG, DIAMETER_M), normal_deg=150.0)
    assert found is not None
    assert is_within_3_sd(found.angle_of_impact, 60.0)
    before, after = truth.velocity_m_s[0, 0], truth.velocity_m_s[-1, 0]
    # n = (cos 150, sin 150) and z x n = (-1/2, -sqrt(3)/2): both velocities are along x.
    slip = [
        -0.5 * v - DIAMETER_M / 2 * w for v, w in ((before, truth.spin_rad_s[0, 2]), (after, truth.spin_rad_s[-1, 2]))
    ]
    assert is_within_3_sd(found.restitution_tangential, -slip[1] / slip[0])
    assert is_within_3_sd(found.tangential_velocity_ratio, after / before)


def test_the_same_impact_in_the_lab_frame_has_the_same_sizes(truth: Pulse, found: Impact) -> None:
    motion = ts.kinematics(
        truth.track, frame_rate=RATE, m_per_px=M_PER_PX, mass_kg=MASS_KG, relative_sd_scale=0.002, lab_frame=True
    )
    other, _ = impact(motion, ball(MASS_KG, DIAMETER_M), normal_deg=180.0)
    assert other is not None
    for name in ("peak_force", "impulse_size", "energy_given", "restitution_normal", "restitution_tangential"):
        assert getattr(other, name).value == pytest.approx(getattr(found, name).value, rel=1e-9)
    np.testing.assert_allclose(other.spin_after.value * [1, -1, -1], found.spin_after.value)


def test_the_scale_uncertainty_reaches_force_and_energy(truth: Pulse, found: Impact) -> None:
    wide = ts.kinematics(truth.track, frame_rate=RATE, m_per_px=M_PER_PX, mass_kg=MASS_KG, relative_sd_scale=0.05)
    other, _ = impact(wide, ball(MASS_KG, DIAMETER_M), normal_deg=180.0)
    assert other is not None
    # 400 draws give the standard deviation to 3.5 %: three times that. An energy goes with the square of the scale.
    assert other.impulse_size.sd / other.impulse_size.value == pytest.approx(0.05, rel=0.11)
    assert other.energy_before.sd / other.energy_before.value == pytest.approx(0.10, rel=0.11)
    assert other.restitution_normal.sd == pytest.approx(found.restitution_normal.sd, rel=0.2)


def test_without_a_mass_no_quantity_is_in_newtons_and_a_sentence_says_why(motion: Kinematics) -> None:
    found, reason = impact(dataclasses.replace(motion, mass_kg=None))
    assert found is not None
    assert reason == ""
    assert found.peak_force is None
    summary = found.summary()
    assert not any(item.get("unit") in ("N", "N s", "J") for item in summary.values() if isinstance(item, dict))
    assert any("mass" in sentence for sentence in summary["missing"])
    # The direction of the change of velocity has no tangential change by definition, so none is stated.
    assert found.restitution_tangential is None
    assert summary["normal_direction"]["value"] == pytest.approx(180, abs=0.5) or summary["normal_direction"][
        "value"
    ] == pytest.approx(-180, abs=0.5)


def test_without_a_spin_the_energies_of_the_translation_remain(truth: Pulse, motion: Kinematics, found: Impact) -> None:
    # A spin of NaN must not enter them, not even times 0.
    assert motion.draws is not None
    unknown, draws = np.full_like(motion.spin_rad_s, np.nan), motion.draws
    still = dataclasses.replace(
        motion,
        spin_rad_s=unknown,
        draws=dataclasses.replace(draws, spin_rad_s=np.full_like(draws.spin_rad_s, np.nan)),
    )
    blind, reason = impact(still, ball(MASS_KG, DIAMETER_M), normal_deg=180.0)
    assert blind is not None, reason
    assert blind.energy_before == found.energy_before
    assert is_within_3_sd(blind.energy_after, 0.5 * MASS_KG * truth.velocity_m_s[-1, 0] ** 2)
    assert blind.spin_energy_after is not None
    assert blind.energy_given is not None
    assert np.isnan([blind.spin_energy_after.value, blind.energy_given.value, blind.spin_rate_after.value]).all()
    assert any("spin was not measured" in sentence for sentence in blind.missing)
    assert not any("spin was not measured" in sentence for sentence in found.missing)


def test_there_is_no_impact_without_scale_contact_flight_or_smoother(motion: Kinematics) -> None:
    assert motion.contact_s is not None
    cases = {
        "scale": None,
        "contact": dataclasses.replace(motion, contact_s=None, sd_contact_s=None),
        "smoother": dataclasses.replace(motion, about={"method": "differences"}),
        "reaches the start": dataclasses.replace(motion, contact_s=np.array([-1.0, motion.contact_s[1]])),
        "reaches the end": dataclasses.replace(motion, contact_s=np.array([motion.contact_s[0], 1.0])),
    }
    for word, case in cases.items():
        found, reason = impact(case, ball(MASS_KG, DIAMETER_M))
        assert found is None
        assert word in reason


def test_an_accelerated_motion_without_contact_is_not_called_steady(motion: Kinematics) -> None:
    within = dataclasses.replace(motion, contact_s=None, sd_contact_s=None)
    still = dataclasses.replace(within, acceleration_m_s2=2 * within.sd_acceleration_m_s2)
    assert "one steady acceleration" in impact(within)[1]
    assert "one steady motion" in impact(still)[1]


def test_a_normal_along_the_flight_gives_no_impact_but_says_why(motion: Kinematics) -> None:
    result, reason = impact(motion, normal_deg=0.0)
    assert result is None
    assert "0 deg, which is the way that the ball flies" in reason


def test_a_normal_that_is_no_number_is_refused(motion: Kinematics) -> None:
    with pytest.raises(ValueError, match="normal_deg = nan"):
        impact(motion, normal_deg=float("nan"))


def test_a_ball_that_is_driven_on_has_no_impact(motion: Kinematics) -> None:
    # In the frame of a cart that overtakes the ball, the ball flies backwards and the target drives it on.
    overtaken = dataclasses.replace(motion, velocity_m_s=motion.velocity_m_s - 2 * np.abs(motion.velocity_m_s).max(0))
    result, reason = impact(overtaken)
    assert result is None
    assert "driven on the way it flies" in reason


def test_a_target_may_strike_the_ball_from_behind_after_an_impact() -> None:
    first = rebound(half_sine, 30.3, 14.0)
    second = Push(half_sine, 70.6, 14.0, 0.05 * first.peak_N)
    shot = simulated([first, second], 120, 1.5e-6, 0)
    motion = ts.kinematics(shot.track, frame_rate=RATE, m_per_px=M_PER_PX, mass_kg=MASS_KG)
    thrown_back, struck = impacts(motion, ball(MASS_KG, 0.015))
    assert thrown_back.restitution_normal.value == pytest.approx(0.5, abs=0.001)
    assert struck.peak_force is not None
    assert float(struck.peak_force.value) == pytest.approx(second.largest_N, rel=0.05)
    # The ball leaves the target faster than it came to it: there is no ratio of the two.
    assert np.isnan(struck.restitution_normal.value)
    assert any("struck from behind" in sentence for sentence in struck.missing)


def test_a_velocity_that_does_not_change_is_no_impact(motion: Kinematics) -> None:
    assert motion.draws is not None
    velocity = motion.draws.velocity_m_s
    steady = velocity - velocity.mean(0) + velocity.mean((0, 1))
    result, reason = impact(dataclasses.replace(motion, draws=dataclasses.replace(motion.draws, velocity_m_s=steady)))
    assert result is None
    assert "is that before it" in reason


def test_a_recording_too_short_for_a_velocity_says_so(motion: Kinematics) -> None:
    result, reason = impact(dataclasses.replace(motion, velocity_m_s=np.full_like(motion.velocity_m_s, np.nan)))
    assert result is None
    assert reason.startswith("No frame has a velocity")


def short_contact(seed: int, frames: float, monkeypatch: pytest.MonkeyPatch) -> tuple[Pulse, Impact]:
    """A half-sine of force over so many frames, with the impulse of 14 frames, and its impact."""
    monkeypatch.setattr(pulses, "LENGTH", frames)
    monkeypatch.setattr(pulses, "PEAK_N", PEAK_N * 14 / frames)
    made = pulse(seed, NOISES_M[0])
    motion = ts.kinematics(made.track, frame_rate=RATE, m_per_px=M_PER_PX, mass_kg=MASS_KG)
    found, reason = impact(motion, ball(MASS_KG, 0.03), normal_deg=180.0)
    assert reason == ""
    assert found is not None
    return made, found


def error_in_sd(estimate: Estimate | None, true: float) -> float:
    assert estimate is not None
    return float(abs(estimate.value - true) / estimate.sd)


@pytest.mark.parametrize("frames", [0.5, 1.0, 1.5, 2.0])
@pytest.mark.parametrize("seed", [1, 2])
def test_a_short_contact_has_right_edges_and_impulse_and_no_force(
    monkeypatch: pytest.MonkeyPatch, frames: float, seed: int
) -> None:
    truth, found = short_contact(seed, frames, monkeypatch)
    assert found.peak_force is not None
    assert found.mean_force is not None
    assert np.isnan([found.peak_force.value, found.peak_force.sd, found.mean_force.value, found.mean_force.sd]).all()
    assert error_in_sd(found.contact_start, truth.edges_s[0]) < 3
    assert error_in_sd(found.contact_end, truth.edges_s[1]) < 3
    assert error_in_sd(found.duration, frames / RATE) < 3
    assert error_in_sd(found.peak_time, float(truth.edges_s.mean())) < 3
    # The impulse of the pulse of 14 frames.
    assert error_in_sd(found.impulse_size, PEAK_N * 14 / RATE * 2 / np.pi) < 3


def test_a_contact_of_three_frames_has_a_force(monkeypatch: pytest.MonkeyPatch) -> None:
    _, found = short_contact(1, 3.0, monkeypatch)
    assert error_in_sd(found.peak_force, PEAK_N * 14 / 3) < 3
