"""Warnings on an impact: contacts cut off or too short, other impacts, and restitutions that no target gives."""

import dataclasses
import re

import numpy as np
import pytest
from pulses import M_PER_PX, MASS_KG, NOISES_M, PEAK_N, RATE, pulse

import torchsphere as ts
from torchsphere.diagnostics.impact_warnings import filter_warnings, impact_warnings
from torchsphere.dynamics.filtered_motion import filtered_motion
from torchsphere.dynamics.impact import impact
from torchsphere.dynamics.impact_estimate import Estimate, Impact
from torchsphere.dynamics.kinematics import Kinematics
from torchsphere.geometry.orientation import chain


@pytest.fixture(scope="module")
def motion() -> Kinematics:
    return ts.kinematics(pulse(11, NOISES_M[0]).track, frame_rate=RATE, m_per_px=M_PER_PX, mass_kg=MASS_KG)


@pytest.fixture(scope="module")
def sound(motion: Kinematics) -> Impact:
    """The impact of a ball that is thrown back."""
    found, _ = impact(motion, normal_deg=180.0)
    assert found is not None
    return dataclasses.replace(found, restitution_normal=estimate(0.33))


def estimate(value: float) -> Estimate:
    return Estimate(np.array(value), np.array(0.01), "1")


def test_an_impact_between_two_long_flights_gives_no_warning(motion: Kinematics, sound: Impact) -> None:
    assert impact_warnings(motion, sound) == ()


def test_a_class_that_takes_part_of_the_force_gives_a_warning_with_the_share(motion: Kinematics, sound: Impact) -> None:
    truth = pulse(11, NOISES_M[0])
    filtered = filtered_motion(truth.track, motion, 1000)
    (sentence,) = filter_warnings(motion, sound, filtered)
    kept = np.abs(ts.channel_filter(truth.force_N[:, 0], RATE, 1000)).max() / PEAK_N
    assert 0.6 < kept < 0.7
    (shown,) = re.findall(r"class 1000 takes (\d+) %", sentence)
    # Noise and differences over three frames change the largest values by 1 %.
    assert int(shown) == pytest.approx(100 * (1 - kept), abs=1.5)
    whole = dataclasses.replace(filtered, acceleration_m_s2=motion.acceleration_m_s2)
    assert filter_warnings(motion, sound, whole) == ()
    assert filter_warnings(motion, sound, None) == ()
    assert filter_warnings(motion, None, filtered) == ()


@pytest.mark.parametrize(("side", "word"), [("before", "starts"), ("after", "ends")])
def test_few_frames_of_flight_give_a_warning(motion: Kinematics, sound: Impact, side: str, word: str) -> None:
    velocity, contact = motion.velocity_m_s.copy(), (sound.contact_start.value, sound.contact_end.value)
    if side == "before":
        velocity[: int(contact[0] * RATE) - 3] = np.nan
    else:
        velocity[int(contact[1] * RATE) + 5 :] = np.nan
    (sentence,) = impact_warnings(dataclasses.replace(motion, velocity_m_s=velocity), sound)
    assert sentence.startswith(f"Frames measured {side} the contact: 4,")
    assert word in sentence


@pytest.mark.parametrize(("value", "word"), [(-0.44, "flies the way it came"), (1.7, "faster than it came")])
def test_a_restitution_that_no_target_at_rest_gives_is_reported(
    motion: Kinematics, sound: Impact, value: float, word: str
) -> None:
    (sentence,) = impact_warnings(motion, dataclasses.replace(sound, restitution_normal=estimate(value)))
    assert f"{value:g}" in sentence
    assert word in sentence
    assert "`frames`" in sentence


@pytest.mark.parametrize("value", [-0.02, 1.02])
def test_a_restitution_out_of_range_by_noise_gives_no_warning(motion: Kinematics, sound: Impact, value: float) -> None:
    assert impact_warnings(motion, dataclasses.replace(sound, restitution_normal=estimate(value))) == ()


def test_a_short_contact_has_edges_as_uncertain_as_it_states_them(motion: Kinematics, sound: Impact) -> None:
    start, short = sound.contact_start, 1.5 / RATE
    for sd in (0.3 / RATE, 0.8 / RATE):
        edge = dataclasses.replace(start, sd=np.array(sd))
        end = dataclasses.replace(edge, value=start.value + short)
        brief = dataclasses.replace(
            sound, contact_start=edge, contact_end=end, duration=dataclasses.replace(edge, value=np.array(short))
        )
        sentence = next(each for each in impact_warnings(motion, brief) if "too few to see its course" in each)
        assert f"its edges are known to {RATE * sd:.2g} frames" in sentence


def pushed(motion: Kinematics, frames: slice, newton: float) -> Kinematics:
    """The motion with another force, along y, in these frames."""
    acceleration = motion.acceleration_m_s2.copy()
    acceleration[frames] = 0.0, newton / MASS_KG
    return dataclasses.replace(motion, acceleration_m_s2=acceleration)


def test_a_pause_of_the_force_is_reported_as_two_impacts(motion: Kinematics, sound: Impact) -> None:
    # The contact lasts 14 frames, from frame 33 or 34 on.
    (sentence,) = impact_warnings(pushed(motion, slice(39, 42), 0.0), sound)
    assert sentence.startswith("Within the contact, from frame 39 to 41, there is next to no force")
    assert "up to 40 and from 40" in sentence


@pytest.mark.parametrize(("frames", "newton"), [(slice(39, 41), 0.0), (slice(39, 42), 4e3)])
def test_a_short_or_shallow_dip_of_the_force_gives_no_warning(
    motion: Kinematics, sound: Impact, frames: slice, newton: float
) -> None:
    assert impact_warnings(pushed(motion, frames, newton), sound) == ()


def test_two_impacts_are_found_apart_and_need_no_warning() -> None:
    # The ball of the pulse is pushed the same way once more from frame 112 on, and loses its spin.
    first = pulse(11, NOISES_M[0])
    once = first.track
    again = once.increment.copy()
    again[:, :2] += (first.velocity_m_s[-1] - first.velocity_m_s[0]) / RATE / M_PER_PX
    again[:, 2:] = again[::-1, 2:]
    increment = np.concatenate((once.increment, again))
    n = len(increment) + 1
    track = dataclasses.replace(
        once,
        position=np.concatenate((once.position[:1], once.position[0] + increment[:, :2].cumsum(0))),
        increment=increment,
        covariance=np.tile(once.covariance[:1], (n - 1, 1, 1)),
        orientation=chain(np.concatenate((np.zeros((1, 3)), increment[:, 2:])), np.ones(n, dtype=bool)),
        zncc=np.ones(n),
        iterations=np.ones(n, dtype=np.int64),
        status=np.full(n, "ok"),
        radius=np.full(n, 75.0),
        sd_growth=np.zeros(n - 1),
    )
    motion = ts.kinematics(track, frame_rate=RATE, m_per_px=M_PER_PX, mass_kg=MASS_KG)
    found, _ = impact(motion, normal_deg=180.0)
    assert found is not None
    assert found.count == 2
    assert not any("Measure each impact alone" in sentence for sentence in impact_warnings(motion, found))


def test_a_force_outside_the_contact_is_reported_as_another_impact(motion: Kinematics, sound: Impact) -> None:
    (sentence,) = impact_warnings(pushed(motion, slice(70, 71), 2.9e3), sound)
    assert sentence.startswith("In frame 70, outside the contact, the ball is pushed by 10 %")


def test_a_force_next_to_the_contact_belongs_to_it(motion: Kinematics, sound: Impact) -> None:
    # As in a recording that ends within the contact.
    assert impact_warnings(pushed(motion, slice(48, 60), 6e3), sound) == ()


def test_gravity_is_no_other_impact(motion: Kinematics, sound: Impact) -> None:
    gravity = np.array([0.0, 3e3 / MASS_KG])
    falling = dataclasses.replace(motion, acceleration_m_s2=motion.acceleration_m_s2 + gravity)
    assert impact_warnings(falling, sound) == ()


def test_a_contact_within_two_frames_is_reported(motion: Kinematics, sound: Impact) -> None:
    (sentence,) = impact_warnings(motion, dataclasses.replace(sound, duration=estimate(1.3 / RATE)))
    assert sentence.startswith("The contact lasts 1.3 frames")
