"""The series for ParaView, read by VTK: pose, texture, vectors and times."""

import dataclasses
import xml.etree.ElementTree as ElementTree
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from torchsphere.report.paraview import sphere_mesh, write_paraview
from torchsphere.results.reader import ResultFolder, SIMotion

vtk = pytest.importorskip("vtk", reason="the package 'vtk', which reads the series back, is not installed")

HALF = np.sqrt(0.5)


def moving(path: Path, lab_frame: bool = False) -> ResultFolder:
    """Three frames, 1 ms apart: at rest, turned a quarter about +y (front to the left), then without a rotation."""
    n, zero = 3, np.zeros((3, 2))
    motion = SIMotion(
        time_s=1e-3 * np.arange(n),
        position_m=np.array([[0.01, 0.02], [0.03, 0.02], [0.05, 0.02]]),
        velocity_m_s=np.tile([20.0, 0.0], (n, 1)),
        acceleration_m_s2=zero,
        force_N=np.tile([0.0, -5.0], (n, 1)),
        spin_rad_s=np.array([[0.0, 1.0, 0.0], [0.0, 1.0, 0.0], [np.nan] * 3]),
        **{f"sd_{name}": zero for name in ("position_m", "velocity_m_s", "acceleration_m_s2", "force_N")},
        sd_spin_rad_s=np.zeros((n, 3)),
    )
    return ResultFolder(
        path=path,
        summary={"settings": {"lab_frame": lab_frame}, "scale": {"m_per_px": 1e-3}},
        frame=np.arange(7, 10),
        time_s=motion.time_s,
        status=np.array(["ok", "ok", "weak_texture"]),
        position=1e3 * motion.position_m,
        radius=np.full(n, 15.0),
        increment=np.full((n, 5), np.nan),
        sd_increment=np.full((n, 5), np.nan),
        zncc=np.ones(n),
        quaternion=np.array([[1.0, 0, 0, 0], [HALF, 0, HALF, 0], [np.nan] * 4]),
        motion=motion,
        sampled=None,
    )


def read(path: Path) -> Any:
    reader = vtk.vtkXMLPolyDataReader()
    reader.SetFileName(str(path))
    reader.Update()
    return reader.GetOutput()


def array(values: Any) -> np.ndarray:
    from vtk.util.numpy_support import vtk_to_numpy

    return vtk_to_numpy(values)


def test_a_quarter_turn_about_y_brings_the_front_to_the_left(tmp_path: Path) -> None:
    write_paraview(moving(tmp_path))
    front = int(np.abs(sphere_mesh().points - [0, 0, -1]).sum(1).argmin())
    before, after = (array(read(tmp_path / f"paraview/ball_{k:06d}.vtp").GetPoints().GetData()) for k in (7, 8))
    # 15 px of 1 mm; single precision.
    np.testing.assert_allclose(before[front], [0.01, 0.02, -0.015], atol=1e-8)
    np.testing.assert_allclose(after[front], [0.03 - 0.015, 0.02, 0.0], atol=1e-8)
    moved = array(read(tmp_path / "paraview/ball_000008.vtp").GetPointData().GetVectors())
    np.testing.assert_allclose(moved, after - before, atol=1e-8)


def test_in_the_lab_frame_the_same_turn_has_the_opposite_sign_about_y(tmp_path: Path) -> None:
    # The camera's +y is down; front is +z in the lab frame, and still goes to the left.
    write_paraview(moving(tmp_path, lab_frame=True))
    front = int(np.abs(sphere_mesh().points - [0, 0, 1]).sum(1).argmin())
    after = array(read(tmp_path / "paraview/ball_000008.vtp").GetPoints().GetData())
    np.testing.assert_allclose(after[front], [0.03 - 0.015, 0.02, 0.0], atol=1e-8)


def test_the_mesh_is_closed_with_outward_normals_and_texture(tmp_path: Path) -> None:
    write_paraview(moving(tmp_path))
    ball = read(tmp_path / "paraview/ball_000007.vtp")
    points = array(ball.GetPoints().GetData()) - [0.01, 0.02, 0.0]
    corners = points[array(ball.GetPolys().GetConnectivityArray()).reshape(-1, 3)]
    normal = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    assert np.all((normal * corners.mean(1)).sum(1) >= -1e-15)
    # Pyramids over all 18 x 36 facets fill the sphere to 1.3 %.
    volume = (corners[:, 0] * np.cross(corners[:, 1], corners[:, 2])).sum() / 6
    assert volume == pytest.approx(4 / 3 * np.pi * 0.015**3, rel=0.02)
    texture = array(ball.GetPointData().GetTCoords())
    assert texture.min() == 0
    assert texture.max() == 1


def test_the_centre_has_the_vectors_that_are_known_and_no_others(tmp_path: Path) -> None:
    write_paraview(moving(tmp_path))
    data = read(tmp_path / "paraview/centre_000008.vtp").GetPointData()
    for name, expected in (("velocity_m_s", [20, 0, 0]), ("force_N", [0, -5, 0]), ("spin_rad_s", [0, 1, 0])):
        np.testing.assert_array_equal(array(data.GetArray(name)), [expected])
    assert read(tmp_path / "paraview/centre_000009.vtp").GetPointData().GetArray("spin_rad_s") is None


def test_the_index_names_every_file_at_its_time_and_no_ball_without_a_rotation(tmp_path: Path) -> None:
    index = write_paraview(moving(tmp_path))
    entries = ElementTree.parse(index).getroot().findall(".//DataSet")
    found = [(float(e.get("timestep", "nan")), e.get("part"), e.get("file")) for e in entries]
    names = ((0.0, 7), (0.001, 8))
    expected = [(t, part, f"{kind}_{k:06d}.vtp") for t, k in names for part, kind in (("0", "ball"), ("1", "centre"))]
    assert found == [*expected, (0.002, "1", "centre_000009.vtp")]
    assert all((index.parent / file).is_file() for _, _, file in found)


def test_without_a_scale_the_series_is_in_px(tmp_path: Path) -> None:
    write_paraview(dataclasses.replace(moving(tmp_path), motion=None))
    points = array(read(tmp_path / "paraview/ball_000007.vtp").GetPoints().GetData())
    np.testing.assert_allclose(points.mean(0)[:2], [10, 20], atol=0.5)
    np.testing.assert_allclose(np.linalg.norm(points - [10, 20, 0], axis=1), 15, rtol=1e-6)


def test_a_ball_that_was_never_seen_is_refused_and_leaves_nothing(tmp_path: Path) -> None:
    unseen = dataclasses.replace(moving(tmp_path), position=np.full((3, 2), np.nan))
    with pytest.raises(ValueError, match="seen in no frame"):
        write_paraview(unseen)
    assert not list(tmp_path.iterdir())
