"""Motion along the optical axis, from the size of the ball in each image."""

import dataclasses
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray
from tracks import made_track

import torchsphere as ts

Array = NDArray[np.float64]

#: Frames per second; frames; radius of the ball, m, its first distance, m, and the focal length, px.
RATE, FRAMES, RADIUS_M, DISTANCE_M, FOCAL_PX = 20_000.0, 60, 0.015, 1.0, 3000.0
#: Standard deviation of a pose, px, and of the logarithm of the outline's radius.
NOISE_PX, NOISE_SIZE = 0.002, 1e-5
CAMERA = ts.Camera(FOCAL_PX, (200.0, 100.0))
GIVEN = {"frame_rate": RATE, "diameter_m": 2 * RADIUS_M, "mass_kg": 0.1, "log": False}


def track_of(depth: Array, step_px: float = 2.0) -> ts.Track:
    """The track of a ball at that ``depth`` (n,), m, that moves along x by ``step_px`` at its first depth."""
    draw = np.random.default_rng(7)
    size = np.log(FOCAL_PX * RADIUS_M / depth) + NOISE_SIZE * draw.standard_normal(FRAMES)
    straight = np.column_stack((step_px * np.arange(FRAMES) - 60, np.zeros(FRAMES))) * (depth[0] / depth)[:, None]
    position = np.array(CAMERA.principal_px) + straight + NOISE_PX * draw.standard_normal((FRAMES, 2))
    increment = np.concatenate((np.diff(position, axis=0), np.zeros((FRAMES - 1, 3))), 1)
    radius = np.exp(size)
    sd = np.sqrt(2) * np.array([NOISE_PX, NOISE_PX, 1e-4, 1e-4, 1e-4])
    made = made_track(increment, sd, ts.Circle(*position[0].tolist(), float(radius[0]), 0.0, 0.0, 0.0))
    settings = {"model": "pinhole6", "camera": dataclasses.asdict(CAMERA)}
    return replace(
        made,
        position=position,
        radius=radius,
        sd_growth=np.full(FRAMES - 1, np.sqrt(2) * NOISE_SIZE),
        settings=settings,
    )


def depth_of(track: ts.Track, *, lab_frame: bool = False) -> ts.dynamics.depth.Depth:
    found = ts.kinematics(track, lab_frame=lab_frame, **GIVEN).depth
    assert found is not None
    return found


def away(per_frame: float) -> Array:
    """Depths (n,), m, that grow by a share of the first per frame."""
    return DISTANCE_M * (1 + per_frame * np.arange(FRAMES))


def test_a_ball_that_comes_nearer_moves_against_the_axis_which_points_away_from_the_camera() -> None:
    found = depth_of(track_of(away(-0.001)))
    np.testing.assert_allclose(found.z_m, away(-0.001), atol=5e-5)
    assert (np.abs(found.velocity_m_s + 0.001 * DISTANCE_M * RATE) < 5 * found.sd_velocity_m_s).all()
    # 2 px at 1 m are 0.67 mm beside 1 mm towards the camera.
    assert found.out_of_plane_deg == pytest.approx([-np.degrees(np.arctan(3 / 2))], abs=0.1)


def test_the_axis_of_the_lab_frame_points_to_the_camera() -> None:
    camera, lab = (depth_of(track_of(away(-0.001)), lab_frame=lab) for lab in (False, True))
    np.testing.assert_allclose(lab.z_m, -camera.z_m)
    np.testing.assert_allclose(lab.velocity_m_s, -camera.velocity_m_s)
    assert lab.out_of_plane_deg[0] > 0


def test_depths_are_right_within_their_standard_deviation() -> None:
    off = [
        (depth_of(track_of(away(rate))).velocity_m_s[30] - rate * DISTANCE_M * RATE)
        / depth_of(track_of(away(rate))).sd_velocity_m_s[30]
        for rate in (-0.002, -0.0005, 0.0005, 0.003)
    ]
    assert np.abs(off).max() < 3


def test_an_impact_that_turns_the_motion_along_the_axis_has_a_force_along_it() -> None:
    k = np.arange(FRAMES)
    depth = DISTANCE_M * (1 + 0.001 * np.where(k < 30, -k, k - 60))
    found = ts.kinematics(track_of(depth), **GIVEN)
    along = found.depth
    assert along is not None
    assert along.force_N is not None
    assert along.velocity_m_s[[5, -5]] == pytest.approx([-20, 20], abs=0.3)
    assert len(along.out_of_plane_deg) == 1 + len(found.contacts)
    # Away from the camera: the ball bounces back along the axis.
    assert along.force_N[28:33].max() > 5 * np.abs(along.force_N[:20]).max()


def test_the_mass_enters_the_force_and_its_uncertainty() -> None:
    plain, doubtful = (ts.kinematics(track_of(away(-0.001)), relative_sd_mass=sd, **GIVEN).depth for sd in (0.0, 0.2))
    assert plain is not None
    assert doubtful is not None
    assert plain.force_N is not None
    np.testing.assert_allclose(plain.force_N, 0.1 * plain.acceleration_m_s2)
    assert (doubtful.sd_force_N >= plain.sd_force_N).all()


def test_the_error_of_the_diameter_is_that_of_the_depth() -> None:
    found = ts.kinematics(track_of(away(-0.001)), relative_sd_scale=0.01, **GIVEN).depth
    assert found is not None
    np.testing.assert_allclose(found.sd_z_m, 0.01 * found.z_m, rtol=0.01)


@pytest.mark.parametrize("lacks", ["camera", "growth", "a camera that was given"])
def test_no_depth_is_stated_where_it_is_not_measured(lacks: str) -> None:
    track = track_of(away(-0.001))
    if lacks == "camera":
        track.settings["camera"] = None
    elif lacks == "growth":
        track.settings["model"] = "pinhole"
    else:
        track = replace(track, findings=replace(track.findings, grows=True, camera_assumed=True))
    assert ts.kinematics(track, **GIVEN).depth is None


def test_a_frame_that_was_not_measured_is_bridged() -> None:
    track = track_of(away(-0.001))
    track.position[20], track.radius[20] = np.nan, np.nan
    track.increment[19:21], track.covariance[19:21], track.sd_growth[19:21] = np.nan, np.nan, np.nan
    found = depth_of(track)
    assert np.isfinite(found.z_m).all()
    np.testing.assert_allclose(found.velocity_m_s[15:25], -20, atol=0.5)


def test_the_depth_is_written_and_read_as_the_last_columns(tmp_path: Path) -> None:
    motion = ts.kinematics(track_of(away(-0.001)), **GIVEN)
    assert motion.depth is not None
    place = motion.save(tmp_path / "result", report=False)
    head = (place / "kinematics.csv").read_text().splitlines()[0].split(",")
    assert head[-9:] == [
        *("frame", "z_m", "vz_m_s", "az_m_s2", "fz_N"),
        *("sd_z_m", "sd_vz_m_s", "sd_az_m_s2", "sd_fz_N"),
    ]
    loaded = ts.load(place).motion
    assert loaded is not None
    assert loaded.depth is not None
    np.testing.assert_allclose(loaded.depth.velocity_m_s, motion.depth.velocity_m_s, rtol=1e-8)
    assert loaded.depth.out_of_plane_deg == pytest.approx(motion.depth.out_of_plane_deg)
