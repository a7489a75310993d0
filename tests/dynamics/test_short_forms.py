"""Results in a line of words, as a Python session or a notebook shows them."""

import math

import pytest

import torchsphere as ts
from torchsphere.synthetic import demo_shot


@pytest.fixture(scope="module")
def track() -> ts.Track:
    return ts.track(demo_shot.make_shot().images, (64.3, 92.6, 40.0), sphere_map=False, log=False)


def test_a_track_has_its_frames_circle_and_mean_motion_in_a_line(track: ts.Track) -> None:
    text = repr(track)
    assert len(text) < 200
    assert "71 frames: 71 ok; circle 64.30,92.60,40.00 px; mean step" in text


def test_a_motion_and_an_impact_have_their_numbers_in_a_line(track: ts.Track) -> None:
    motion = ts.kinematics(track, frame_rate=36000.0, diameter_m=0.03, mass_kg=0.11)
    assert "of 71 frames, 0 to 1.94444 ms: up to 71." in repr(motion)
    assert "; contact from 0.73" in repr(motion)
    impact, _ = ts.impact(motion, ts.ball(0.11, 0.03))
    assert impact is not None
    text = repr(impact)
    assert len(text) < 300
    assert math.isclose(float(text.split("speed ")[1].split()[0]), float(impact.speed_before.value), rel_tol=1e-4)
    assert "largest force" in text
