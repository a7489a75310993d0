"""Contacts of too few frames: no force is stated, and edges, impulse and speeds are right."""

import numpy as np
import pulses
import pytest
from pulses import M_PER_PX, MASS_KG, NOISES_M, PEAK_N, RATE, Pulse, pulse

import torchsphere as ts
from torchsphere.dynamics.ball import ball
from torchsphere.dynamics.impact import impact
from torchsphere.dynamics.impact_estimate import Estimate, Impact


def shot(seed: int, frames: float, monkeypatch: pytest.MonkeyPatch) -> tuple[Pulse, Impact]:
    """A half-sine of so many frames with the impulse of that of 14 frames, and the impact that is found."""
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
    truth, found = shot(seed, frames, monkeypatch)
    assert found.peak_force is not None
    assert found.mean_force is not None
    assert np.isnan([found.peak_force.value, found.peak_force.sd, found.mean_force.value, found.mean_force.sd]).all()
    assert error_in_sd(found.contact_start, truth.edges_s[0]) < 3
    assert error_in_sd(found.contact_end, truth.edges_s[1]) < 3
    assert error_in_sd(found.duration, frames / RATE) < 3
    assert error_in_sd(found.peak_time, float(truth.edges_s.mean())) < 3
    # The impulse of the pulse of 14 frames.
    assert error_in_sd(found.impulse_size, PEAK_N * 14 / RATE * 2 / np.pi) < 3


def test_a_contact_of_three_frames_shows_its_force(monkeypatch: pytest.MonkeyPatch) -> None:
    _, found = shot(1, 3.0, monkeypatch)
    assert error_in_sd(found.peak_force, PEAK_N * 14 / 3) < 3
