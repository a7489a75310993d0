"""Recordings that nothing should stop an archive for: names and kinds of file that a program does not expect."""

import csv
import errno
import os
import sys
from pathlib import Path

import pytest
from archive_shots import rows, serial, write_array

from torchsphere.archive import manifest
from torchsphere.archive.run import Counts, run
from torchsphere.recording import open_recording
from torchsphere.report import pages
from torchsphere.results.atomic_output import unfinished_folder

LONG = "n" * 222


def done(source: Path, out: Path) -> Counts:
    return run(manifest.read(source, {}, out), out, serial)


@pytest.mark.parametrize("name", [LONG, "n" * 251, f"{LONG}/{LONG}"], ids=["222", "251", "in a folder"])
def test_recordings_with_long_names_are_measured_and_found_again(tmp_path: Path, name: str) -> None:
    source, out = tmp_path / "in", tmp_path / "out"
    for shot in ("a", name, "z"):
        write_array(source / f"{shot}.npy", 1)
    assert done(source, out) == Counts(done=3, measured=3)
    assert (out / name / "summary.json").is_file()
    assert done(source, out) == Counts(done=3, measured=0)
    # A killed worker leaves a folder of the name that `atomic_folder` would have given.
    left = unfinished_folder(out / name)
    assert done(source, out) == Counts(done=3, measured=0)
    assert not left.exists()


@pytest.mark.skipif(sys.platform != "linux", reason="other systems allow names in UTF-8 alone")
def test_a_recording_whose_name_is_not_utf_8_is_measured_and_shown_with_escapes(tmp_path: Path) -> None:
    source, out = tmp_path / "in", tmp_path / "out"
    for name in ("a.npy", os.fsdecode(b"caf\xe9.npy")):
        write_array(source / name, 1)
    assert done(source, out) == Counts(done=2, measured=2)
    table = rows(out)
    assert set(table) == {"a.npy", "caf\\xe9.npy"}
    assert (out / table["caf\\xe9.npy"]["result"] / "summary.json").is_file()
    assert done(source, out) == Counts(done=2, measured=0)


def test_a_folder_that_cannot_be_looked_into_is_told(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    source = tmp_path / "in"
    for name in ("a.npy", "closed/b.npy"):
        write_array(source / name, 1)
    scandir = os.scandir

    def refuse(path: str) -> object:
        if Path(path).name == "closed":
            raise PermissionError(errno.EACCES, "Permission denied", path)
        return scandir(path)

    monkeypatch.setattr(os, "scandir", refuse)
    archive = manifest.read(source, {}, tmp_path / "out")
    assert [item.recording for item in archive.items] == ["a.npy"]
    assert archive.notes == (f"{source / 'closed'}: cannot be looked into (permission denied).",)


@pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="this system has no pipes")
def test_a_pipe_and_a_broken_link_fail_alone(tmp_path: Path) -> None:
    source, out = tmp_path / "in", tmp_path / "out"
    write_array(source / "a.npy", 1)
    for name in ("b.tif", "c.npy"):
        os.mkfifo(source / name)
    (source / "d.tif").symlink_to(source / "nowhere")
    archive = manifest.read(source, {}, out)
    assert [item.recording for item in archive.items] == ["b.tif", "c.npy", "d.tif", "a.npy"]
    for item in archive.items[:3]:
        with pytest.raises((ValueError, FileNotFoundError), match=r"neither a file nor a folder|does not exist"):
            open_recording(item.input)


def test_a_recording_with_the_name_of_a_table_fails_alone(tmp_path: Path) -> None:
    source, out = tmp_path / "in", tmp_path / "out"
    for name in ("a.npy", "index.html.npy", "summary.csv/b.npy"):
        write_array(source / name, 1)
    assert done(source, out) == Counts(done=1, failed=2, measured=3)
    assert "the run writes its own index.html; give another name" in rows(out)["index.html.npy"]["reason"]
    assert "the run writes its own summary.csv" in rows(out)["summary.csv/b.npy"]["reason"]


@pytest.mark.parametrize(
    ("row", "sentence"),
    [
        ("a.npy,index.html", "row 2: a result folder 'index.html' would lie where the run writes its own index.html"),
        ("a.npy,Summary.CSV/x", "row 2: a result folder 'Summary.CSV/x' would lie where .* its own summary.csv"),
        ("a\0.npy,x", "row 2: a name has a NUL, which no file has; correct the manifest"),
        ("a.npy,x\0y", "row 2: a name has a NUL"),
    ],
)
def test_a_row_with_an_impossible_name_is_refused(tmp_path: Path, row: str, sentence: str) -> None:
    sheet = tmp_path / "list.csv"
    sheet.write_text(f"recording,result\n{row}\n")
    with pytest.raises(ValueError, match=sentence):
        manifest.read(sheet, {}, tmp_path / "out")


def test_records_of_results_in_each_other_s_way_do_not_clash(tmp_path: Path) -> None:
    source, out = tmp_path / "in", tmp_path / "out"
    for name in ("x.npy", "x.json/y.npy", "x.started/z.npy"):
        write_array(source / name, 1)
    assert done(source, out) == Counts(done=3, measured=3)
    assert done(source, out) == Counts(done=3, measured=0)


def test_a_recording_that_is_named_in_a_manifest_and_too_long_for_the_system_fails_alone(tmp_path: Path) -> None:
    write_array(tmp_path / "a.npy", 1)
    sheet = tmp_path / "list.csv"
    sheet.write_text(f"recording\n{'n' * 300}.npy\na.npy\n")
    assert done(sheet, tmp_path / "out") == Counts(done=1, failed=1, measured=2)


def test_polygons_of_any_length_are_no_names_of_files(tmp_path: Path) -> None:
    write_array(tmp_path / "a.npy", 1)
    polygon = " ".join(f"{i},{i % 7}" for i in range(400))
    sheet = tmp_path / "list.csv"
    sheet.write_text(f'recording,ignore\na.npy,"{polygon}"\n')
    (item,) = manifest.read(sheet, {}, tmp_path / "out").items
    assert item.settings["ignore"] == [polygon]


def test_cells_that_a_spreadsheet_would_run_are_neutral_and_read_back_as_they_were(tmp_path: Path) -> None:
    source, out = tmp_path / "in", tmp_path / "out"
    names = ["=1+1.npy", "+a.npy", "-b.npy", "@c.npy", "'=d.npy"]
    for name in names:
        write_array(source / name, 1)
    assert done(source, out).done == 5
    with (out / "summary.csv").open(newline="") as stream:
        cells = [cell for row in csv.reader(stream) for cell in row]
    assert not [cell for cell in cells if cell.startswith(("=", "+", "-", "@"))]
    table = pages.read_rows(out)
    assert sorted(row["recording"] for row in table) == sorted(names)
    assert all(pages.result_folder(out, row) for row in table)
