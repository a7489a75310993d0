"""The largest force where it lies between two frames."""

import dataclasses

import numpy as np
import pytest

import torchsphere as ts
from experiments.validation.simulated_impacts import M_PER_PX, MASS_KG, RATE, Simulated, half_sine, rebound, simulated
from torchsphere.dynamics.draws import Draws
from torchsphere.dynamics.kinematics import Kinematics
from torchsphere.dynamics.peak_force import peak_force, peak_frame

BALL = ts.ball(MASS_KG, 0.015)

#: The middle of the contact lies midway between two frames.
START, LENGTH = 33.5, 6.0


@pytest.fixture(scope="module")
def shot() -> Simulated:
    return simulated([rebound(half_sine, START, LENGTH)], 74, 1.5e-6, seed=5)


@pytest.fixture(scope="module")
def motion(shot: Simulated) -> Kinematics:
    return ts.kinematics(shot.track, frame_rate=RATE, m_per_px=M_PER_PX, mass_kg=MASS_KG)


def drawn(motion: Kinematics) -> Draws:
    assert motion.draws is not None
    return motion.draws


def test_the_peak_between_two_frames_and_its_time_are_right(shot: Simulated, motion: Kinematics) -> None:
    at_peak = peak_frame(motion, drawn(motion))
    force, time = peak_force(motion, drawn(motion), BALL, at_peak)
    true, true_time = shot.pushes[0].largest_N, (START + LENGTH / 2) / RATE
    # The frames beside it have 3.4 % less.
    assert np.abs(shot.force_N).max() < 0.967 * true
    assert float(force.value) == pytest.approx(true, rel=0.005)
    assert abs(float(force.value) - true) < 3 * float(force.sd)
    assert abs(float(time.value) - true_time) < 3 * float(time.sd)
    assert abs(float(time.value) - true_time) < 0.1 / RATE
    assert (force.unit, time.unit) == ("N", "s")


def test_the_frame_of_the_peak_is_the_one_with_the_largest_force_in_contact(
    shot: Simulated, motion: Kinematics
) -> None:
    frame, direction = peak_frame(motion, drawn(motion))
    assert drawn(motion).span.start + frame in (36, 37)
    np.testing.assert_allclose(direction, [-1, 0], atol=0.01)


def straight(motion: Kinematics) -> Kinematics:
    """The motion with forces on straight lines between the frames."""
    draws = drawn(motion)
    return dataclasses.replace(motion, draws=dataclasses.replace(draws, between_m_s2=0 * draws.between_m_s2))


def test_on_straight_lines_between_the_frames_the_peak_is_in_a_frame(motion: Kinematics) -> None:
    plain = straight(motion)
    at_peak = frame, direction = peak_frame(plain, drawn(plain))
    force, time = peak_force(plain, drawn(plain), BALL, at_peak)
    assert motion.force_N is not None
    own = drawn(plain).span.start + frame
    assert float(force.value) == pytest.approx(float(motion.force_N[own] @ direction), rel=1e-9)
    assert float(time.value) == motion.time_s[own]


def test_a_larger_acceleration_outside_the_contact_is_not_its_peak(motion: Kinematics) -> None:
    at_peak = peak_frame(motion, drawn(motion))
    acceleration = motion.acceleration_m_s2.copy()
    acceleration[50] = -1e7, 0.0
    shaken = dataclasses.replace(motion, acceleration_m_s2=acceleration)
    assert peak_frame(shaken, drawn(shaken))[0] == at_peak[0]
    force, _ = peak_force(shaken, drawn(shaken), BALL, at_peak)
    assert float(force.value) == float(peak_force(motion, drawn(motion), BALL, at_peak)[0].value)


def test_the_error_of_the_mass_enters_the_peak(motion: Kinematics) -> None:
    uncertain = ts.ball(MASS_KG, 0.015, relative_sd_mass=0.05)
    force, time = peak_force(motion, drawn(motion), uncertain, peak_frame(motion, drawn(motion)))
    # 400 draws give a standard deviation to 3.5 %: three times that.
    assert float(force.sd) / float(force.value) == pytest.approx(0.05, rel=0.11)
    assert float(time.sd) < 0.1 / RATE


def test_the_time_of_the_peak_is_known_to_the_spacing_of_its_values_at_best(motion: Kinematics) -> None:
    """Where all drawn motions have their largest force at one time."""
    draws = drawn(motion)
    alike = dataclasses.replace(
        draws,
        acceleration_m_s2=np.broadcast_to(motion.acceleration_m_s2[draws.span], draws.acceleration_m_s2.shape),
        between_m_s2=np.broadcast_to(draws.between_m_s2[:1], draws.between_m_s2.shape),
    )
    _, time = peak_force(motion, alike, BALL, peak_frame(motion, alike))
    assert 0.005 / RATE < float(time.sd) < 0.5 / RATE
