"""The truth table: against an independent computation of every column."""

import csv
import dataclasses
from pathlib import Path

import numpy as np
import pytest
from rendering import needs_mitsuba, picture, steady
from rendering import outline as touched
from scipy import ndimage
from scipy.optimize import least_squares
from scipy.spatial.transform import Rotation

from render import preset
from render.background import Background, StillObject
from render.camera import Camera
from render.outline import circle, outline, visible
from render.pattern import Pattern
from render.scene import Quality, Setup
from render.trajectory import Table
from render.truth import MOTION, SEEN, TRACKED, truth, write_truth

#: The columns of a tracker's result, in its order, and the columns that a truth lacks.
TRACK_CSV = (
    *("frame", "time_s", "status", "x_px", "y_px", "radius_px", "dx_px", "dy_px", "wx_rad", "wy_rad", "wz_rad"),
    *("sd_dx_px", "sd_dy_px", "sd_wx_rad", "sd_wy_rad", "sd_wz_rad", "zncc", "iterations", "qw", "qx", "qy", "qz"),
)
MEASURED = ("status", "sd_dx_px", "sd_dy_px", "sd_wx_rad", "sd_wy_rad", "sd_wz_rad", "zncc", "iterations")


def test_columns_are_those_of_a_track_in_its_order_then_the_motion_and_what_is_seen() -> None:
    columns = list(truth(preset.load("example")))
    assert columns == [*TRACKED, *MOTION, *SEEN]
    assert list(TRACKED) == [
        c for c in TRACK_CSV if not c.startswith("sd_") and c not in ("status", "zncc", "iterations")
    ]


def test_the_examples_truth_is_what_its_numbers_say() -> None:
    columns = truth(preset.load("example"))
    n = np.arange(40)
    assert (columns["frame"] == n).all()
    assert np.allclose(columns["time_s"], n / 36_000, rtol=1e-15)
    assert np.allclose(columns["x_px"], 80.4 + 1.3 * n, atol=1e-11)
    assert np.allclose(columns["y_px"], 120.7 + 0.2 * n, atol=1e-11)
    assert np.allclose(columns["radius_px"], 50.0, atol=1e-12)
    for name, step in zip(TRACKED[5:10], (1.3, 0.2, *np.radians([0.2, 0.5, 0.2])), strict=True):
        assert np.isnan(columns[name][0])
        assert np.allclose(columns[name][1:], step, atol=1e-11)
    angle = np.radians(np.linalg.norm([0.2, 0.5, 0.2])) * n
    assert np.allclose(columns["qw"], np.cos(angle / 2), atol=1e-14)
    assert np.allclose(columns["qy"], 0.5 / np.linalg.norm([0.2, 0.5, 0.2]) * np.sin(angle / 2), atol=1e-14)
    assert np.allclose(columns["vx_m_s"], 1.3 / 3333.3333333333335 * 36_000, rtol=1e-13)
    assert (columns["fx_N"] == 0).all()
    assert np.allclose(columns["wy_rad_s"], np.radians(0.5) * 36_000, rtol=1e-13)


@pytest.mark.parametrize("name", ["paper-bar", "oblique-impact", "drop-weight", "free-flight"])
def test_increments_and_orientations_belong_together(name: str) -> None:
    shot = preset.load(name)
    columns = truth(shot)
    q = Rotation.from_quat(np.stack([columns[k] for k in ("qx", "qy", "qz", "qw")], axis=1))
    steps = (q[1:] * q[:-1].inv()).as_rotvec()
    assert np.allclose(steps, np.stack([columns[k][1:] for k in ("wx_rad", "wy_rad", "wz_rad")], axis=1), atol=1e-13)
    assert np.allclose(np.diff(columns["x_px"]), columns["dx_px"][1:], atol=1e-13)
    assert np.allclose(columns["fy_N"], 1e-3 * shot.trajectory.mass_g * columns["ay_m_s2"], rtol=1e-14)


def test_a_pinhole_camera_sees_the_centre_by_its_formula() -> None:
    shot = preset.load("perspective", ["camera.principal_px=[250, 120]", "trajectory.velocity_m_s=[50, 5, 3]"])
    columns = truth(shot)
    x, y, z = columns["x_m"], columns["y_m"], columns["z_m"]
    assert np.allclose(columns["x_px"], 250 + 500 * x / z, atol=1e-10)
    assert np.allclose(columns["y_px"], 120 + 500 * y / z, atol=1e-10)
    assert np.allclose(columns["radius_px"], 500 * 0.015 / z, atol=1e-10)
    assert columns["radius_px"][-1] < columns["radius_px"][0]


def test_every_number_reads_back_to_its_last_bit(tmp_path: Path) -> None:
    columns = truth(preset.load("paper-bar"))
    write_truth(tmp_path / "truth.csv", columns)
    with (tmp_path / "truth.csv").open(newline="") as stream:
        rows = list(csv.DictReader(stream))
    assert len(rows) == 114
    assert [int(row["frame"]) for row in rows] == list(range(114))
    for name, column in columns.items():
        assert np.array_equal([float(row[name]) for row in rows], column, equal_nan=True), name


def test_a_truth_serves_as_a_table_of_motion(tmp_path: Path) -> None:
    shot = preset.load("example")
    columns = truth(shot)
    write_truth(tmp_path / "truth.csv", columns)
    table = Table(file=str(tmp_path / "truth.csv"))
    got, true = table(shot.times_s), shot.trajectory(shot.times_s)
    assert np.abs(got.position_m - true.position_m).max() < 1e-15
    assert np.abs(got.orientation - true.orientation).max() < 1e-14


def test_a_single_frame_has_no_increment() -> None:
    columns = truth(preset.load("example", ["frames=1"]))
    assert len(columns["frame"]) == 1
    assert np.isnan(columns["dx_px"]).all()
    assert columns["qw"].tolist() == [1.0]


def resampled(points: np.ndarray, count: int) -> np.ndarray:
    """Points at equal distances along a closed line."""
    closed = np.vstack([points, points[:1]])
    along = np.concatenate(([0.0], np.hypot(*np.diff(closed, axis=0).T).cumsum()))
    at = np.linspace(0.0, along[-1], count, endpoint=False)
    return np.column_stack([np.interp(at, along, column) for column in closed.T])


@pytest.mark.parametrize(
    ("camera", "centre_m"),
    [
        (Camera(), (0.011, -0.004, 0.3)),
        (Camera("pinhole", focal_px=500.0), (-0.0525, -0.003, 0.15)),
        (Camera("pinhole", focal_px=700.0, principal_px=(-80.0, 60.0)), (0.14, 0.02, 0.21)),
        (Camera("pinhole", focal_px=2000.0, distortion=(-1.5, 0.0, 0.0)), (-0.0525, -0.012, 0.6)),
    ],
    ids=["orthographic", "perspective", "off-axis", "distorted"],
)
def test_the_outlines_circle_is_the_least_squares_fit_to_a_dense_outline(
    camera: Camera, centre_m: tuple[float, float, float]
) -> None:
    centre = np.array(centre_m)
    points = resampled(touched(camera, centre, 0.015, count=20000), 5000)
    start = (*points.mean(axis=0), 50.0)
    fitted = least_squares(lambda c: np.hypot(*(points - c[:2]).T) - c[2], start, xtol=1e-14, ftol=1e-14, gtol=1e-14)
    # The corners of the dense line cut off 1e-6 px.
    assert np.allclose(circle(outline(camera, centre, 0.015)), fitted.x, rtol=0, atol=2e-4)


def test_a_whole_ball_is_seen_wholly_and_one_outside_not_at_all() -> None:
    camera = Camera(width=200, height=120, scale_px_per_mm=2.0)
    assert visible(camera, np.zeros(3), 0.015, ()) == 1.0
    assert visible(camera, np.array([0.07, 0.0, 0.0]), 0.015, ()) == 0.0
    assert visible(camera, np.array([0.05, 0.0, 0.0]), 0.015, ()) == pytest.approx(0.5, abs=1e-3)


ORTHOGRAPHIC = Camera(width=600, height=360, scale_px_per_mm=7.0)
PINHOLE = Camera("pinhole", width=600, height=360, focal_px=1000.0)
POST = (0.006, 0.006, 0.03)


@needs_mitsuba
@pytest.mark.parametrize(
    ("camera", "centre_m", "thing"),
    [
        (ORTHOGRAPHIC, (0.004, 0.002, 0.0), StillObject(centre_m=(0.0, 0.0, 0.05))),
        (
            ORTHOGRAPHIC,
            (0.036, 0.012, 0.0),
            StillObject(centre_m=(0.030, 0.0, -0.04), size_m=(0.01, 0.03, 0.01), turn_deg=(10.0, 25.0, 35.0)),
        ),
        (ORTHOGRAPHIC, (0.0, 0.0, 0.0), StillObject("bar", (0.004, 0.0, -0.05), (0.014, 0.014, 0.02))),
        (PINHOLE, (0.01, 0.0, 0.15), StillObject("bar", (0.008, 0.0, 0.08), POST, (80.0, 0.0, 20.0))),
        (
            dataclasses.replace(PINHOLE, distortion=(-0.2, 0.0, 0.0)),
            (0.037, 0.01, 0.15),
            StillObject(centre_m=(0.030, 0.0, 0.145), size_m=(0.004, 0.2, 0.05)),
        ),
    ],
    ids=["behind", "turned box, border", "bar along the view", "bar, pinhole", "pressed in, distorted, border"],
)
def test_the_visible_share_is_that_of_the_renderers_image(
    camera: Camera, centre_m: tuple[float, float, float], thing: StillObject
) -> None:
    # A white ball and a black object before darkness: all light comes from the visible part of the ball.
    ball = Pattern(kind="plain", brightest=1.0)
    black = Background(kind="dark", objects=(dataclasses.replace(thing, albedo=0.0),))
    image = picture(Setup(pattern=ball, camera=camera, background=black, quality=Quality(16)), steady(centre_m))
    # The object shades the ball smoothly: a pixel with half of its surroundings' light counts as the ball's.
    seen = image > 0.5 * np.maximum(ndimage.maximum_filter(image, 7), 1.0)
    edge = touched(camera, np.array(centre_m), 0.015)
    x, y = edge.T
    area = 0.5 * abs(np.dot(x, np.roll(y, -1)) - np.dot(y, np.roll(x, -1)))
    found = visible(camera, np.array(centre_m), 0.015, (thing,))
    assert (found == 1.0) == (thing.centre_m[2] == 0.05)
    # The edges are longer than 200 px, with an error of a few hundredths of a pixel; the areas have 30 000 px.
    assert found == pytest.approx(seen.sum() / area, abs=0.003)
