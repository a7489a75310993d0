"""Results that contradict themselves."""

import dataclasses

import numpy as np
import pytest
from tracks import falling_track

import torchsphere as ts
from torchsphere.diagnostics.contradictions import contradictions
from torchsphere.runtime.warning_levels import SEVERE, level_of
from torchsphere.sphere_map.decision import MadeMap
from torchsphere.tracking.findings import Findings


@pytest.fixture
def falling() -> ts.Track:
    return falling_track()


def motion_of(track: ts.Track, method: str = "smoother") -> ts.Kinematics:
    return ts.kinematics(track, frame_rate=1e3, m_per_px=5e-4, method=method)


@pytest.mark.parametrize("method", ["smoother", "differences", "savitzky-golay"])
def test_a_velocity_that_leads_where_the_ball_is_contradicts_nothing(falling: ts.Track, method: str) -> None:
    assert contradictions(falling, motion_of(falling, method)) == ()
    assert contradictions(falling, None) == ()


def test_a_velocity_that_leads_elsewhere_is_flagged_with_its_frames(falling: ts.Track) -> None:
    motion = motion_of(falling)
    # 2 px per frame for 8 frames, with the wrong sign: 16 mm away.
    wrong = dataclasses.replace(motion, velocity_m_s=motion.velocity_m_s * [-1, 1])
    (sentence,) = contradictions(falling, wrong)
    assert level_of(sentence) == SEVERE
    assert sentence.startswith("Velocity and position contradict each other: from frame 0 to 8")
    assert "16 mm" in sentence


def test_a_jump_of_the_position_that_no_velocity_explains_is_flagged(falling: ts.Track) -> None:
    motion = motion_of(falling)
    position = motion.position_m.copy()
    position[5:, 0] += 0.01
    (sentence,) = contradictions(falling, dataclasses.replace(motion, position_m=position))
    assert "10 mm" in sentence


def test_an_impact_contradicts_nothing(measured) -> None:
    done = measured[1]
    assert contradictions(done.track, done.motion) == ()


@pytest.mark.parametrize(("widened", "over_noise", "count"), [(1.0, 1.0, 0), (2.9, 1.4, 0), (3.1, 1.0, 1), (1, 1.6, 1)])
def test_a_residual_that_is_no_noise_is_flagged(
    falling: ts.Track, widened: float, over_noise: float, count: int
) -> None:
    findings = Findings(map=MadeMap(widened=widened, residual_over_noise=over_noise))
    found = contradictions(dataclasses.replace(falling, findings=findings), None)
    assert len(found) == count
    assert all(sentence.startswith("The residual images are no noise") for sentence in found)


def test_a_residual_that_a_video_codec_explains_is_not_flagged_twice(falling: ts.Track) -> None:
    findings = Findings(map=MadeMap(widened=5.4, residual_over_noise=0.8), coded=True)
    assert contradictions(dataclasses.replace(falling, findings=findings), None) == ()


def test_steps_without_a_map_have_no_such_residual(falling: ts.Track) -> None:
    assert contradictions(dataclasses.replace(falling, findings=Findings()), None) == ()
    assert np.isfinite(falling.increment).all()
