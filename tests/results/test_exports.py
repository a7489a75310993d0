"""All tables of a result in one file of HDF5 or MAT: names, units, values, and the summary."""

import csv
import importlib.util
import json
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow.parquet as pq
import pytest
from scipy.io import loadmat

from torchsphere.cli.main import main
from torchsphere.measure import Measurement
from torchsphere.notebook.measured import request_for
from torchsphere.recording.refusal import LibraryMissingError
from torchsphere.results import exports, writer
from torchsphere.results.columns import unit_of
from torchsphere.results.reader import TRACK_COLUMNS


def h5py_or_skip() -> Any:
    return pytest.importorskip("h5py", reason="h5py is not installed (extra 'export')")


@pytest.fixture(scope="module")
def folder(measured: tuple[Path, Measurement], tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The demo's impact, written with all exports for which there is a library."""
    _, done = measured
    place = tmp_path_factory.mktemp("exports")
    kinds = ("hdf5", "mat") if importlib.util.find_spec("h5py") else ("mat",)
    request = request_for(done.track, done.motion, place)
    writer.write_measurement(place, request, done, 36_000.0, kinds)
    return place


def table(path: Path) -> dict[str, list[str]]:
    with path.open(newline="") as stream:
        rows = list(csv.DictReader(stream))
    return {name: [row[name] for row in rows] for name in rows[0]}


TABLES = ("track", "kinematics", "force_path")


@pytest.mark.parametrize("name", TABLES)
def test_hdf5_has_the_columns_of_each_csv_file_with_their_units(folder: Path, name: str) -> None:
    h5py = h5py_or_skip()
    columns = table(folder / f"{name}.csv")
    with h5py.File(folder / "result.h5") as file:
        group = file[name]
        assert [c for c in group.attrs["columns"] if c != "covariance"] == list(columns)
        for column, cells in columns.items():
            values = group[column][()]
            assert group[column].attrs["unit"] == unit_of(column)
            if values.dtype.kind == "O":
                assert [value.decode() for value in values] == cells
            else:
                np.testing.assert_allclose(values, np.array(cells, dtype=float), rtol=1e-9)


@pytest.mark.parametrize("name", TABLES)
def test_a_mat_file_has_a_struct_per_csv_file_with_its_units(folder: Path, name: str) -> None:
    columns = table(folder / f"{name}.csv")
    struct = loadmat(folder / "result.mat", simplify_cells=True)[name]
    assert set(columns) <= set(struct)
    for column, cells in columns.items():
        unit = struct["units"][column]
        assert (unit if isinstance(unit, str) else "") == unit_of(column)
        if struct[column].dtype.kind in "UO":
            assert list(struct[column]) == cells
        else:
            np.testing.assert_allclose(struct[column], np.array(cells, dtype=float), rtol=1e-9)


def test_both_files_have_covariances_impacts_and_summary(folder: Path, measured: tuple[Path, Measurement]) -> None:
    _, done = measured
    assert done.impact is not None
    speed = done.impact.speed_before
    content = loadmat(folder / "result.mat", simplify_cells=True)
    np.testing.assert_array_equal(content["track"]["covariance"][1:], done.track.covariance)
    # One impact alone is no list once the cells are simplified.
    assert content["impacts"]["speed_before"] == {"value": speed.value, "sd": speed.sd, "unit": "m/s"}
    assert json.loads(content["summary"])["impact"]["speed_before"]["unit"] == "m/s"
    assert content["impacts"]["energy_balance"]["total"]["lost"]["unit"] == "J"
    h5py = h5py_or_skip()
    with h5py.File(folder / "result.h5") as file:
        np.testing.assert_array_equal(file["track/covariance"][1:], done.track.covariance)
        found = file["impacts/1/speed_before"]
        assert found[()] == speed.value
        assert (found.attrs["sd"], found.attrs["unit"]) == (speed.sd, "m/s")
        assert file["impacts/1/velocity_before"].shape == (2,)
        assert file["impacts/1/ball"].attrs["kind"] == "solid"
        assert json.loads(file["summary"][()])["frame_rate"] == 36_000.0


def test_parquet_has_the_units_in_its_schema(folder: Path) -> None:
    schema = pq.read_schema(folder / "track.parquet")
    assert schema.field("wx_rad").metadata == {b"unit": b"rad"}
    assert schema.field("status").metadata is None
    assert schema.names[: len(TRACK_COLUMNS)] == list(TRACK_COLUMNS)


def test_the_command_line_writes_the_file_that_was_asked_for(tmp_path: Path, short: Path) -> None:
    options = ["--circle", "64.3,92.6,40", "--map", "off", "--no-report", "--quiet", "--frames", "0:4"]
    assert main(["track", str(short), "--out", str(tmp_path / "out"), *options, "--export", "mat"]) == 0
    assert {path.name for path in (tmp_path / "out").iterdir()} == {
        *("track.csv", "track.parquet", "summary.json", "result.mat")
    }
    content = loadmat(tmp_path / "out" / "result.mat", simplify_cells=True)
    assert set(content) - {"__header__", "__version__", "__globals__"} == {"track", "summary"}


def test_without_h5py_a_sentence_says_what_to_install(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setattr(exports.importlib.util, "find_spec", lambda name: None)
    with pytest.raises(LibraryMissingError, match=r"HDF5 needs h5py.*pip install 'torchsphere\[export\]'"):
        exports.check_exports(["mat", "hdf5"])
    exports.check_exports(["mat"])
    with pytest.raises(ValueError, match="export = 'xlsx': expected one of hdf5, mat"):
        exports.check_exports(["xlsx"])


@pytest.mark.parametrize(
    ("column", "unit"),
    [
        *(("time_s", "s"), ("x_px", "px"), ("sd_wx_rad", "rad"), ("x_m", "m"), ("vx_m_s", "m/s"), ("ay_m_s2", "m/s^2")),
        *(("fx_N", "N"), ("sd_wz_rad_s", "rad/s"), ("status", ""), ("frame", ""), ("zncc", "1"), ("qw", "1")),
        *(("frame_rate", "1/s"), ("peak_force_N", "N"), ("restitution", "1"), ("recording", ""), ("seconds", "s")),
    ],
)
def test_a_column_has_the_unit_of_its_name(column: str, unit: str) -> None:
    assert unit_of(column) == unit
