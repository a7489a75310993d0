"""Files of an impact's force and of filtered motion, and their place in the summary."""

import csv
import dataclasses
import json
from pathlib import Path

import numpy as np
import pytest
import tifffile

from torchsphere.measure import Measurement, Request, measure
from torchsphere.results.columns import force_path_columns
from torchsphere.results.reader import FORCE_PATH_COLUMNS, read
from torchsphere.results.writer import summary
from torchsphere.synthetic import demo_shot


def table(path: Path) -> list[dict[str, str]]:
    with path.open(newline="") as stream:
        return list(csv.DictReader(stream))


def test_the_force_path_has_a_row_per_frame_of_the_contact(measured: tuple[Path, Measurement]) -> None:
    folder, done = measured
    rows = table(folder / "force_path.csv")
    assert tuple(rows[0]) == FORCE_PATH_COLUMNS
    assert done.impact is not None
    frames = [int(row["frame"]) for row in rows]
    start, end = done.impact.contact_start.value, done.impact.contact_end.value
    kinematics = table(folder / "kinematics.csv")
    inside = [int(row["frame"]) for row in kinematics if start <= float(row["time_s"]) <= end]
    assert frames == inside
    # The normal is that of the change of velocity, and the largest force is along it.
    largest = max(float(row["force_N"]) for row in rows)
    assert largest == pytest.approx(float(done.impact.peak_force.value), rel=0.02)


def test_the_rows_of_the_strongest_impact_are_read_back(measured: tuple[Path, Measurement]) -> None:
    folder, done = measured
    (force,) = done.contact_forces
    assert force.path is not None
    found = read(folder).force_path
    assert found is not None
    np.testing.assert_allclose(found.penetration_m, force.path.penetration.value, rtol=1e-9)
    np.testing.assert_allclose(found.sd_force_N, force.path.force.sd, rtol=1e-9)
    np.testing.assert_array_equal(found.is_loading, force.path.is_loading)
    weaker = dataclasses.replace(force, path=None)
    assert set(force_path_columns([weaker, force], 0)["impact"]) == {2}


def test_without_a_force_there_is_no_table(measured: tuple[Path, Measurement]) -> None:
    _, done = measured
    assert not force_path_columns([dataclasses.replace(done.contact_forces[0], path=None)], 0)
    assert not force_path_columns([], 0)


def test_the_summary_has_balance_law_and_path_of_each_impact(measured: tuple[Path, Measurement]) -> None:
    folder, done = measured
    found = json.loads((folder / "summary.json").read_text())
    assert found["impact"] == found["impacts"][0]
    assert found["impact"]["energy_balance"]["translation"]["before"]["unit"] == "J"
    assert found["impact"]["contact_law"]["stiffness"]["unit"] == "N/m^1.5"
    assert "friction" not in found["impact"]
    assert any("no coefficient of friction" in sentence for sentence in found["impact"]["missing"])
    request = Request(input=folder / "shot.tif", out=folder)
    assert summary(request, done, 36e3)["impact"]["contact_law"]["frames"] >= 3


def test_filtered_motion_has_the_columns_of_the_kinematics_and_its_own_file(tmp_path: Path) -> None:
    tifffile.imwrite(tmp_path / "shot.tif", demo_shot.make_shot().images[20:40], photometric="minisblack")
    common = {"input": tmp_path / "shot.tif", "fps": 36_000.0, "diameter_mm": 30.0, "mass_g": 110.0, "report": False}
    circle = (170.3, 98.6, 40.0)
    done = measure(Request(out=tmp_path / "out", circle=circle, map="off", cfc=1000, **common))
    rows = table(tmp_path / "out" / "kinematics_cfc.csv")
    names = ("ax_m_s2", "ay_m_s2", "fx_N", "fy_N")
    assert list(rows[0]) == ["time_s", *names, *(f"sd_{name}" for name in names), "frame"]
    assert done.filtered is not None
    np.testing.assert_allclose([float(row["fx_N"]) for row in rows], done.filtered.force_N[:, 0], rtol=1e-9)
    assert all(float(row["sd_fx_N"]) > 0 for row in rows[1:-1])
    assert rows[0]["fx_N"] == "nan"
    settings = json.loads((tmp_path / "out" / "summary.json").read_text())["settings"]
    assert settings["cfc"] == 1000
    with pytest.raises(ValueError, match="cfc = 1000: the frame rate is 9000 frames per second"):
        measure(Request(out=tmp_path / "low", circle=circle, map="off", cfc=1000, **common | {"fps": 9000.0}))
    assert not (tmp_path / "low").exists()
