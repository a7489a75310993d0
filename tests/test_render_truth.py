"""The truth table: against an independent computation of every column."""

import csv
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from render import preset
from render.trajectory import Table
from render.truth import MOTION, TRACKED, truth, write_truth

#: The columns that a tracker's result has as well, in its order, and those that it cannot have: status, sd_*, zncc.
TRACK_CSV = (
    *("frame", "time_s", "status", "x_px", "y_px", "radius_px", "dx_px", "dy_px", "wx_rad", "wy_rad", "wz_rad"),
    *("sd_dx_px", "sd_dy_px", "sd_wx_rad", "sd_wy_rad", "sd_wz_rad", "zncc", "iterations", "qw", "qx", "qy", "qz"),
)
MEASURED = ("status", "sd_dx_px", "sd_dy_px", "sd_wx_rad", "sd_wy_rad", "sd_wz_rad", "zncc", "iterations")


def test_columns_are_those_of_a_track_in_its_order_and_then_the_motion() -> None:
    columns = list(truth(preset.load("example")))
    assert columns == [*TRACKED, *MOTION]
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
