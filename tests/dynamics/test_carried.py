"""Nothing is typed twice: frame rate, diameter and mass go from recording and track to kinematics and impact."""

import dataclasses
import logging
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from pulses import M_PER_PX, MASS_KG, NOISES_M, RATE, pulse
from tracks import falling_track

import torchsphere as ts
from torchsphere.settings.calibration import Calibration
from torchsphere.tracking.arguments import with_camera

#: Diameter of the pulse's ball: 75 px of radius.
DIAMETER_M = 150 * M_PER_PX


@pytest.fixture(scope="module")
def images() -> np.ndarray:
    """Five images of a ball that moves by 2 px per frame."""
    from torchsphere.synthetic import demo_shot

    return demo_shot.make_shot().images[:5]


CIRCLE = (64.3, 92.6, 40.0)


def tracked(recording: Any, **settings: Any) -> ts.Track:
    return ts.track(recording, CIRCLE, **{"map": "off", "log": False} | settings)


@pytest.fixture
def file(images: np.ndarray, tmp_path: Path) -> Path:
    np.savez(tmp_path / "shot.npz", images=images, frame_rate=36_000.0)
    return tmp_path / "shot.npz"


def test_the_frame_rate_of_the_file_and_what_the_track_was_given_reach_the_kinematics(file: Path) -> None:
    with ts.open_recording(file) as recording:
        track = tracked(recording, diameter_m=0.03, mass_kg=0.11)
    assert track.calibration == Calibration(36_000.0, 0.03, None, 0.11)
    assert track.facts is not None
    assert track.facts.kind == "NumPy archive (NPZ)"
    motion = ts.kinematics(track, method="differences")
    plain = ts.kinematics(
        dataclasses.replace(track, calibration=Calibration()),
        frame_rate=36_000.0,
        diameter_m=0.03,
        mass_kg=0.11,
        method="differences",
    )
    np.testing.assert_array_equal(motion.velocity_m_s, plain.velocity_m_s)
    np.testing.assert_array_equal(motion.force_N, plain.force_N)
    assert motion.warnings == plain.warnings == ()


def test_a_frame_rate_that_contradicts_the_file_wins_and_is_a_warning(
    file: Path, caplog: pytest.LogCaptureFixture
) -> None:
    with ts.open_recording(file) as recording, caplog.at_level(logging.WARNING, "torchsphere"):
        track = tracked(recording, frame_rate=30_000.0, diameter_m=30.0, log=True)
    assert track.calibration.frame_rate == 30_000.0
    assert "The file states frame_rate = 36000; 30000 was given and used." in track.warnings
    assert any("30 m, which is implausible" in sentence for sentence in track.warnings)
    assert set(track.warnings) <= set(caplog.messages)
    caplog.clear()
    with caplog.at_level(logging.WARNING, "torchsphere"):
        motion = ts.kinematics(track, fps=36_000, method="differences")
    assert motion.frame_rate == 36_000.0
    assert motion.warnings[0] == "The track states frame_rate = 30000; 36000 was given and used."
    # The track has said what is wrong with the diameter.
    assert caplog.messages == [motion.warnings[0]]


def test_map_and_sphere_map_are_one_argument_and_names_of_the_command_line_do(images: np.ndarray) -> None:
    one = ts.track(images, CIRCLE, sphere_map=False, log=False, frame_rate=36_000.0, diameter_m=0.03)
    other = tracked(images, fps=36_000.0, diameter_mm=30.0)
    np.testing.assert_array_equal(one.increment, other.increment)
    assert one.calibration == other.calibration
    with pytest.raises(ValueError, match="sphere_map = True and map = 'off' contradict each other"):
        tracked(images, sphere_map=True)
    with pytest.raises(ValueError, match="map = 'maybe': expected one of auto, on, off"):
        tracked(images, map="maybe")
    with pytest.raises(TypeError, match="track has no argument 'diametre_mm'"):
        tracked(images, diametre_mm=30.0)
    with pytest.raises(ValueError, match="shutter_us was given, but no frame rate is known"):
        tracked(images, shutter_us=5.0)


def test_a_camera_may_be_described_as_on_the_command_line() -> None:
    given = {"roi": 0.9, "distance_mm": 300.0, "principal_px": (20, 30), "distortion": (0.1, 0, 0)}
    camera = ts.Camera(distance_radii=20.0, principal_px=(20, 30), distortion=(0.1, 0, 0))
    assert with_camera(given, 0.03) == {"roi": 0.9, "camera": camera}
    assert with_camera({"focal_px": 500.0}, None) == {"camera": ts.Camera(500.0)}
    assert with_camera({"camera": camera}, None) == {"camera": camera}
    with pytest.raises(ValueError, match="distance_mm was given without diameter_m"):
        with_camera({"distance_mm": 300.0}, None)
    with pytest.raises(ValueError, match="camera and focal_px were both given"):
        with_camera({"camera": camera, "focal_px": 500.0}, None)


def test_a_part_of_the_frames_keeps_their_numbers_in_time(file: Path, images: np.ndarray) -> None:
    with ts.open_recording(file) as recording:
        part = tracked(recording, frames=(1, 5), diameter_m=0.03)
    assert len(part.status) == 4
    assert part.first_frame == 1
    motion = ts.kinematics(part, method="differences")
    np.testing.assert_allclose(motion.time_s, np.arange(1, 5) / 36_000.0)
    same = tracked(images, frames=slice(1, None))
    np.testing.assert_array_equal(part.increment, same.increment)
    with pytest.raises(ValueError, match="frames = 3:9 reaches beyond the end"):
        tracked(images, frames=(3, 9))


def test_several_motions_take_what_each_track_knows() -> None:
    tracks = [dataclasses.replace(falling_track(), calibration=Calibration(rate, 0.02)) for rate in (100.0, 200.0)]
    slow, fast = ts.kinematics_of_many(tracks)
    np.testing.assert_allclose(fast.velocity_m_s, 2 * slow.velocity_m_s)
    with pytest.raises(ValueError, match="frame_rate = None: the recording does not tell it"):
        ts.kinematics_of_many([falling_track()], diameter_mm=20.0)


@pytest.fixture(scope="module")
def motion() -> ts.Kinematics:
    """Motion of a pulse's ball, whose track knows mass and diameter."""
    track = dataclasses.replace(pulse(11, NOISES_M[0]).track, calibration=Calibration(RATE, DIAMETER_M, None, MASS_KG))
    return ts.kinematics(track, mass_sd_percent=1.0, log=False)


def test_the_impact_takes_mass_and_diameter_of_the_motion(motion: ts.Kinematics) -> None:
    found, _ = ts.impact(motion)
    typed, _ = ts.impact(motion, ts.ball(MASS_KG, DIAMETER_M, relative_sd_mass=0.01))
    assert found is not None
    assert typed is not None
    assert found.peak_force == typed.peak_force
    assert found.ball == typed.ball
    assert found.motion is motion
    shell, _ = ts.impact(motion, shell_mm=1.0)
    assert shell is not None
    assert shell.ball == ts.ball(MASS_KG, DIAMETER_M, shell_m=1e-3, relative_sd_mass=0.01)
    with pytest.raises(ValueError, match="a ball was given and a shell or an inertia, too"):
        ts.impact(motion, ts.ball(MASS_KG, DIAMETER_M), shell_m=1e-3)
    with pytest.raises(ValueError, match="but no mass"):
        ts.impact(dataclasses.replace(motion, mass_kg=None), inertia_kg_m2=1e-6)


def test_a_ball_that_is_another_than_that_of_the_motion_is_a_warning(
    motion: ts.Kinematics, caplog: pytest.LogCaptureFixture
) -> None:
    with caplog.at_level(logging.WARNING, "torchsphere"):
        found, _ = ts.impact(motion, ts.ball(2 * MASS_KG, 1.2 * DIAMETER_M, log=False))
    assert found is not None
    assert len(found.warnings) == 2
    assert "which is used for the impact" in found.warnings[0]
    assert caplog.messages == list(found.warnings)
    assert ts.impacts(motion, log=False)[0].warnings == ()


def test_units_are_checked_in_python_as_on_the_command_line(caplog: pytest.LogCaptureFixture) -> None:
    with caplog.at_level(logging.WARNING, "torchsphere"):
        motion = ts.kinematics(falling_track(), frame_rate=1000.0, diameter_m=30.0, method="differences")
        ts.ball(110.0, 0.03)
    assert "30 m, which is implausible" in motion.warnings[0]
    assert len(caplog.messages) == 2
    assert "110 kg" in caplog.messages[1]
    assert ts.ball(mass_g=110.0, diameter_mm=30.0).mass_kg == pytest.approx(0.11)
