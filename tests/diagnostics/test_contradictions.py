"""Results that contradict themselves."""

import dataclasses

import pytest
from tracks import falling_track

import torchsphere as ts
from torchsphere.diagnostics.contradictions import contradictions
from torchsphere.runtime.warning_levels import SEVERE, level_of


@pytest.fixture
def falling() -> ts.Track:
    return falling_track()


def motion_of(track: ts.Track, method: str = "smoother") -> ts.Kinematics:
    return ts.kinematics(track, frame_rate=1e3, m_per_px=5e-4, method=method)


@pytest.mark.parametrize("method", ["smoother", "differences", "savitzky-golay"])
def test_a_velocity_that_leads_where_the_ball_is_contradicts_nothing(falling: ts.Track, method: str) -> None:
    assert contradictions(motion_of(falling, method)) == ()
    assert contradictions(None) == ()


def test_a_velocity_that_leads_elsewhere_is_flagged_with_its_frames(falling: ts.Track) -> None:
    motion = motion_of(falling)
    # 2 px per frame for 8 frames, with the wrong sign: 16 mm away.
    wrong = dataclasses.replace(motion, velocity_m_s=motion.velocity_m_s * [-1, 1])
    (sentence,) = contradictions(wrong)
    assert level_of(sentence) == SEVERE
    assert sentence.startswith("Velocity and position contradict each other: from frame 0 to 8")
    assert "16 mm" in sentence


def test_a_jump_of_the_position_that_no_velocity_explains_is_flagged(falling: ts.Track) -> None:
    motion = motion_of(falling)
    position = motion.position_m.copy()
    position[5:, 0] += 0.01
    (sentence,) = contradictions(dataclasses.replace(motion, position_m=position))
    assert "10 mm" in sentence


def test_an_impact_contradicts_nothing(measured) -> None:
    done = measured[1]
    assert contradictions(done.motion) == ()
