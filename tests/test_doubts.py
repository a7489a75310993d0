"""What speaks against an impact: contacts cut off or too short, and restitutions that no target gives."""

import dataclasses

import numpy as np
import pytest
from test_smooth import M_PER_PX, MASS_KG, NOISES_M, RATE, pulse

import torchsphere as ts
from torchsphere.doubts import doubts
from torchsphere.estimates import Estimate, Impact
from torchsphere.impact import impact
from torchsphere.kinematics import Kinematics


@pytest.fixture(scope="module")
def motion() -> Kinematics:
    return ts.kinematics(pulse(11, NOISES_M[0]).track, frame_rate=RATE, m_per_px=M_PER_PX, mass_kg=MASS_KG)


@pytest.fixture(scope="module")
def sound(motion: Kinematics) -> Impact:
    """The impact, its ball thrown back."""
    found, _ = impact(motion, normal_deg=180.0)
    assert found is not None
    return dataclasses.replace(found, restitution_normal=of(0.33))


def of(value: float) -> Estimate:
    return Estimate(np.array(value), np.array(0.01), "1")


def test_an_impact_between_two_long_flights_is_not_doubted(motion: Kinematics, sound: Impact) -> None:
    assert doubts(motion, sound) == ()


@pytest.mark.parametrize(("side", "word"), [("before", "starts"), ("after", "ends")])
def test_few_frames_of_flight_may_be_frames_of_contact(motion: Kinematics, sound: Impact, side: str, word: str) -> None:
    velocity, contact = motion.velocity_m_s.copy(), (sound.contact_start.value, sound.contact_end.value)
    if side == "before":
        velocity[: int(contact[0] * RATE) - 3] = np.nan
    else:
        velocity[int(contact[1] * RATE) + 5 :] = np.nan
    (sentence,) = doubts(dataclasses.replace(motion, velocity_m_s=velocity), sound)
    assert sentence.startswith(f"Frames measured {side} the contact: 4,")
    assert word in sentence


@pytest.mark.parametrize(("value", "word"), [(-0.44, "flies the way it came"), (1.7, "faster than it came")])
def test_a_restitution_that_no_target_at_rest_gives_is_doubted(
    motion: Kinematics, sound: Impact, value: float, word: str
) -> None:
    (sentence,) = doubts(motion, dataclasses.replace(sound, restitution_normal=of(value)))
    assert f"{value:g}" in sentence
    assert word in sentence
    assert "--frames" in sentence


@pytest.mark.parametrize("value", [-0.02, 1.02])
def test_a_restitution_beyond_its_range_by_noise_is_none(motion: Kinematics, sound: Impact, value: float) -> None:
    assert doubts(motion, dataclasses.replace(sound, restitution_normal=of(value))) == ()


def test_a_contact_within_two_frames_does_not_tell_its_force(motion: Kinematics, sound: Impact) -> None:
    (sentence,) = doubts(motion, dataclasses.replace(sound, duration=of(1.3 / RATE)))
    assert sentence.startswith("The contact lasts 1.3 frames")
