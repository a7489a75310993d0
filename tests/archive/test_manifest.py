"""The recordings of an archive, found in a folder or listed by a manifest."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest
import tifffile
from scipy.io import savemat

from torchsphere.archive import manifest, scan
from torchsphere.request import PER_RECORDING


def write_tiff(path: Path, pages: int) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    tifffile.imwrite(path, np.zeros((pages, 8, 9), np.uint8), photometric="minisblack")


def found(folder: Path, out: Path | None = None) -> list[str]:
    return [path.relative_to(folder).as_posix() for path in scan.scan(folder, out).recordings]


def test_recordings_alone_are_found_in_all_folders(tmp_path: Path) -> None:
    for name in ("b10.npy", "b9.npy", "x/y/z.CINE", "notes.txt", ".hidden.npy", ".git/a.npy"):
        path = tmp_path / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.touch()
    assert found(tmp_path) == ["b9.npy", "b10.npy", "x/y/z.CINE"]


def test_a_photron_recording_counts_once_and_so_does_a_folder_of_images(tmp_path: Path) -> None:
    for name in ("p.cihx", "p.mraw", "p.cih", "lonely.mraw", "only.cih"):
        (tmp_path / name).touch()
    for i in range(3):
        write_tiff(tmp_path / "images" / f"img{i}.tif", 1)
        (tmp_path / f"png{i}").mkdir()
        (tmp_path / "pngs").mkdir(exist_ok=True)
        (tmp_path / "pngs" / f"{i}.png").touch()
    assert found(tmp_path) == ["lonely.mraw", "only.cih", "p.cih", "images", "pngs"]


def test_tiffs_of_several_pages_are_a_recording_each_even_beside_a_damaged_one(tmp_path: Path) -> None:
    write_tiff(tmp_path / "b.tif", 4)
    write_tiff(tmp_path / "c.tif", 4)
    (tmp_path / "a.tif").write_bytes(b"cut")
    assert found(tmp_path) == ["a.tif", "b.tif", "c.tif"]


def test_single_images_beside_recordings_are_left_out_with_a_note(tmp_path: Path) -> None:
    for name in ("shot.cine", "p1.png", "p2.png"):
        (tmp_path / name).touch()
    made = scan.scan(tmp_path)
    assert [path.name for path in made.recordings] == ["shot.cine"]
    assert made.notes == (f"{tmp_path}: 2 single image(s) were left out: they lie beside recordings.",)


def write_hdf5(path: Path, **arrays: np.ndarray) -> None:
    h5py = pytest.importorskip("h5py", reason="the extra 'export' is not installed")
    path.parent.mkdir(parents=True, exist_ok=True)
    with h5py.File(path, "w") as file:
        for name, values in arrays.items():
            file[name] = values


def test_arrays_of_images_are_found_and_tables_left_out_with_a_note(tmp_path: Path) -> None:
    stack = np.zeros((3, 8, 9), np.uint8)
    write_hdf5(tmp_path / "one.h5", images=stack, time=np.arange(3))
    write_hdf5(tmp_path / "two.h5", left=stack, right=stack)
    write_hdf5(tmp_path / "result.h5", covariance=np.zeros((30, 5, 5)))
    (tmp_path / "damaged.h5").write_bytes(b"cut")
    savemat(tmp_path / "v5.mat", {"frames": stack})
    made = scan.scan(tmp_path)
    names = [path.relative_to(tmp_path).as_posix() for path in made.recordings]
    assert names == ["damaged.h5", "one.h5", "two.h5:/left", "two.h5:/right", "v5.mat"]
    assert made.notes == (f"{tmp_path}: 1 .h5 left out: no array of images inside.",)


def test_tables_beside_images_do_not_hide_them(tmp_path: Path) -> None:
    for k in range(3):
        (tmp_path / f"{k}.bmp").touch()
    savemat(tmp_path / "calibration.mat", {"K": np.eye(3)})
    made = scan.scan(tmp_path)
    assert made.recordings == (tmp_path,)
    assert made.notes == (f"{tmp_path}: 1 .mat left out: no array of images inside.",)


@pytest.mark.parametrize("suffix", ["bmp", "jpg", "pgm", "webp", "png"])
def test_a_folder_of_images_of_each_kind_is_a_recording(tmp_path: Path, suffix: str) -> None:
    for k in range(3):
        (tmp_path / f"{k}.{suffix}").touch()
    assert scan.scan(tmp_path).recordings == (tmp_path,)
    # Their sizes and times tell a change.
    before = scan.files_of(tmp_path)
    (tmp_path / f"1.{suffix}").write_bytes(b"x")
    assert scan.files_of(tmp_path) != before


def test_arrays_of_one_file_have_results_of_their_own(tmp_path: Path) -> None:
    stack = np.zeros((3, 8, 9), np.uint8)
    write_hdf5(tmp_path / "day" / "two.h5", left=stack, camera__right=stack)
    expected = {"two.h5:/camera__right": "two-camera__right", "two.h5:/left": "two-left"}
    archive = manifest.read(tmp_path / "day" / "two.h5", {}, tmp_path / "out")
    assert {item.recording: item.result for item in archive.items} == expected
    (tmp_path / "list.csv").write_text("recording,axes\nday/two.h5:/left,hwn\nday/two.h5:camera__right,\n")
    first, second = manifest.read(tmp_path / "list.csv", {}, tmp_path / "out").items
    assert (first.result, first.settings, first.input) == (
        "day/two-left",
        {"axes": "hwn"},
        tmp_path / "day" / "two.h5:" / "left",
    )
    assert second.result == "day/two-camera__right"
    assert scan.files_of(first.input) == scan.files_of(tmp_path / "day" / "two.h5") != [None]
    (named,) = manifest.read(tmp_path / "day" / "two.h5:" / "left", {}, tmp_path / "out").items
    assert (named.recording, named.result) == ("two.h5:/left", "two-left")


def test_the_refusal_of_a_folder_without_a_recording_says_what_lies_in_it(tmp_path: Path) -> None:
    for name in ("a.jpg", "sub/b.txt", "sub/c.txt", ".git/d.txt"):
        path = tmp_path / name
        path.parent.mkdir(exist_ok=True)
        path.touch()
    with pytest.raises(ValueError, match=r"holds no recording, but 2 \.txt, 1 \.jpg and a folder"):
        manifest.read(tmp_path, {}, tmp_path / "out")


def test_results_within_the_folder_are_not_recordings(tmp_path: Path) -> None:
    for name in ("a.npy", "out/.batch/x.npy", "out/a/figures/1.png", "out/a/figures/2.png", "track/1.png"):
        path = tmp_path / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.touch()
    for name in ("2.png", "track.csv", "summary.json"):
        (tmp_path / "track" / name).touch()
    (tmp_path / "new").mkdir()
    (tmp_path / "new" / "b.npy").touch()
    assert found(tmp_path, tmp_path / "new") == ["a.npy"]


def test_a_csv_gives_each_recording_its_settings_over_the_common_ones(tmp_path: Path) -> None:
    sheet = tmp_path / "list.csv"
    sheet.write_text(
        "\ufeffrecording,fps,diameter-mm,circle,frames,ignore,lab_frame,model\n"
        'a.npy,100,30,"10,20,5",3:9,"1,2 3,4 5,6",yes,\n'
        "sub/b.cine,,,10 20 5.5,:9,,no,finite\n"
    )
    first, second = manifest.read(sheet, {"fps": 50.0, "mm_per_px": 0.5}, tmp_path / "out").items
    assert (first.recording, first.input, first.result) == ("a.npy", tmp_path / "a.npy", "a")
    assert first.settings == {
        "fps": 100.0,
        "diameter_mm": 30.0,
        "circle": (10, 20, 5),
        "frames": (3, 9),
        "ignore": ["1,2 3,4 5,6"],
        "lab_frame": True,
    }
    assert second.result == "sub/b"
    assert second.settings == {
        "fps": 50.0,
        "mm_per_px": 0.5,
        "circle": (10, 20, 5.5),
        "frames": (None, 9),
        "lab_frame": False,
        "model": "finite",
    }


def test_semicolons_of_a_spreadsheet_separate_cells(tmp_path: Path) -> None:
    sheet = tmp_path / "list.csv"
    sheet.write_text("recording;fps\na.npy;100\n")
    assert manifest.read(sheet, {}, tmp_path / "out").items[0].settings == {"fps": 100.0}


def test_a_toml_gives_settings_for_all_and_for_each(tmp_path: Path) -> None:
    sheet = tmp_path / "list.toml"
    (tmp_path / "mask.png").touch()
    sheet.write_text(
        'fps = 100\n[[recordings]]\nrecording = "a.npy"\ncircle = [10, 20, 5]\nignore = ["mask.png"]\n'
        '[[recordings]]\nrecording = "a.npy"\nresult = "a-end"\nframes = "9:"\nfps = 7.5\nin-place = true\n'
    )
    first, second = manifest.read(sheet, {"fps": 1.0, "order": 2}, tmp_path / "out").items
    mask = str(tmp_path / "mask.png")
    assert first.settings == {"fps": 100.0, "order": 2, "circle": (10, 20, 5), "ignore": [mask]}
    assert second.settings == {"fps": 7.5, "order": 2, "frames": (9, None), "in_place": True}
    assert (first.result, second.result) == ("a", "a-end")


def test_results_of_recordings_outside_the_manifest_s_folder_stay_in_the_output_folder(tmp_path: Path) -> None:
    sheet = tmp_path / "list.csv"
    sheet.write_text("recording\n../far/a.npy\n/data/b.npy\n")
    assert [item.result for item in manifest.read(sheet, {}, tmp_path).items] == ["far/a", "data/b"]


BAD = {
    "no recording column": ("path,fps\na.npy,5\n", "expected one named 'recording'"),
    "unknown column": ("recording,speed\na.npy,5\n", "column 'speed' is no setting"),
    "column twice": ("recording,fps,fps\na.npy,5,6\n", "two columns 'fps'"),
    "column twice in other words": ("recording,mm-per-px,mm_per_px\na.npy,5,6\n", "'mm-per-px' and 'mm_per_px'"),
    "recordings twice": ("recording,input\na.npy,b.npy\n", "two columns of one meaning, 'recording' and 'input'"),
    "column without a name": ("recording;fps;;\na.npy;5;;\n", "column 3 has no name; name it, or remove it"),
    "tabs": ("recording\tfps\na.npy\t5\n", "commas or semicolons part the columns, not tabs"),
    "overwrite": ("recording,overwrite\na.npy,yes\n", "column 'overwrite'"),
    "no number": (
        "recording,fps\na.npy,5\nb.npy,fast\n",
        "row 3, column 'fps': fps = 'fast': expected a finite number",
    ),
    "not finite": ("recording,fps\na.npy,inf\n", "row 2, column 'fps'"),
    "negative": ("recording,fps\na.npy,-5\n", "row 2: fps = -5"),
    "two numbers": ("recording,circle\na.npy,1 2\n", "row 2, column 'circle': circle = '1 2': expected three numbers"),
    "frames": ("recording,frames\na.npy,all\n", "column 'frames'"),
    "unknown model": ("recording,model\na.npy,wobbly\n", "expected one of"),
    "no truth": ("recording,refine\na.npy,perhaps\n", "expected true or false"),
    "mass without a scale": ("recording,mass_g\na.npy,110\n", "row 2: mass_g was given without a scale"),
    "too many cells": ("recording,circle\na.npy,1,2,3\n", "row 2: has more cells"),
    "decimal comma": (
        'recording,fps\na.npy,5\nb.npy,"12,5"\n',
        "row 3, column 'fps': fps = '12,5': expected a finite number; the decimal sign is a point",
    ),
    "decimal comma among semicolons": ("recording;fps\na.npy;12,5\n", "row 2, column 'fps': fps = '12,5': expected a"),
    "decimal commas in a circle": (
        "recording;circle\na.npy;12,5 20,3 5,5\n",
        "row 2, column 'circle': circle = '12,5 20,3 5,5': expected three numbers X,Y,R; the decimal sign is a point",
    ),
    "decimal comma without quotes": ("recording,fps\na.npy,12,5\n", "columns; write decimals with a point, and"),
    "row twice": (
        "recording,fps\na.npy,5\nb.npy,5\na.npy,6\n",
        "list.csv, row 4: a.npy stands in row 2 already, and both would be written to a; leave one out",
    ),
    "no name": ("recording,fps\n,5\n", "row 2, column 'recording': is empty"),
    "no rows": ("recording,fps\n", "holds no recording"),
    "nothing": ("", "expected one named 'recording'"),
    "one result": ("recording\na.npy\na.cine\n", "a.npy and a.cine would both be written to a"),
    "one result but for case": ("recording\na.npy\nA.cine\n", "would both be written"),
    "result within a result": ("recording\na.npy\na/b.npy\n", "would lie within that of a.npy"),
    "result outside": ("recording,result\na.npy,../b\n", "leads out of the output folder"),
    "result in the state": ("recording,result\na.npy,.batch/a\n", "leads out of the output folder"),
    "latin": ("recording\ngr\udcfcn.npy\n", "UTF-8"),
}


@pytest.mark.parametrize("case", BAD)
def test_the_refusal_of_a_csv_names_row_and_column(case: str, tmp_path: Path) -> None:
    text, words = BAD[case]
    sheet = tmp_path / "list.csv"
    sheet.write_bytes(text.encode("utf-8", "surrogateescape"))
    with pytest.raises(ValueError, match=r"list\.csv") as refusal:
        manifest.read(sheet, {}, tmp_path / "out")
    assert words in str(refusal.value)
    assert "\n" not in str(refusal.value)


def test_a_comma_between_numbers_is_not_taken_for_a_decimal_sign() -> None:
    with pytest.raises(ValueError, match="expected three numbers") as refusal:
        PER_RECORDING["circle"].from_text("12,20")
    assert "decimal" not in str(refusal.value)


BAD_TOML = {
    "no toml": "fps = ",
    "no recordings": "fps = 5",
    "unknown key": '[[recordings]]\nrecording = "a.npy"\nspeed = 3',
    "unknown common key": 'speed = 3\n[[recordings]]\nrecording = "a.npy"',
    "no name": "[[recordings]]\nfps = 3",
    "text for a number": '[[recordings]]\nrecording = "a.npy"\nfps = "3"',
    "number for text": '[[recordings]]\nrecording = "a.npy"\nmodel = 3',
    "truth for a number": '[[recordings]]\nrecording = "a.npy"\nfps = true',
    "number for a name": "[[recordings]]\nrecording = 3",
    "twice": '[[recordings]]\nrecording = "a.npy"\n[[recordings]]\nrecording = "a.npy"',
    "key twice in other words": '[[recordings]]\nrecording = "a.npy"\nmm-per-px = 3\nmm_per_px = 4',
    "two recordings": '[[recordings]]\nrecording = "a.npy"\ninput = "b.npy"',
    "words in a list": '[[recordings]]\nrecording = "a.npy"\ncircle = ["a", 2, 3]',
}


@pytest.mark.parametrize("case", BAD_TOML)
def test_an_invalid_toml_is_refused(case: str, tmp_path: Path) -> None:
    sheet = tmp_path / "list.toml"
    sheet.write_text(BAD_TOML[case])
    with pytest.raises(ValueError, match=r"list\.toml"):
        manifest.read(sheet, {}, tmp_path / "out")


@pytest.mark.parametrize("name", ["nowhere", "notes.txt", "empty"])
def test_sources_other_than_archives_are_refused(name: str, tmp_path: Path) -> None:
    (tmp_path / "notes.txt").touch()
    (tmp_path / "empty").mkdir()
    with pytest.raises((ValueError, OSError), match="expected a folder of recordings, or a manifest"):
        manifest.read(tmp_path / name, {}, tmp_path / "out")


def test_ten_thousand_rows_are_read(tmp_path: Path) -> None:
    sheet = tmp_path / "list.csv"
    sheet.write_text("recording\n" + "".join(f"{i // 100}/{i}.npy\n" for i in range(10_000)))
    common: dict[str, Any] = {"fps": 5.0}
    items = manifest.read(sheet, common, tmp_path / "out").items
    assert len(items) == 10_000
    assert items[-1].result == "99/9999"


def test_results_among_the_recordings_are_refused(tmp_path: Path) -> None:
    (tmp_path / "a.npy").touch()
    with pytest.raises(ValueError, match="is the folder of the recordings itself"):
        manifest.read(tmp_path, {}, tmp_path / ".")


@pytest.mark.parametrize("make_link", ["symbolic", "hard"])
def test_a_link_to_a_recording_of_the_archive_is_left_out_with_a_note(make_link: str, tmp_path: Path) -> None:
    shots = tmp_path / "shots"
    write_tiff(shots / "shot.tif", 3)
    write_tiff(shots / "other.tif", 3)
    # By its name the link would come first, and in another folder it would have another name.
    for link in (shots / "another.tif", shots / "day" / "copy.tif"):
        link.parent.mkdir(exist_ok=True)
        if make_link == "symbolic":
            link.symlink_to(shots / "shot.tif")
        else:
            link.hardlink_to(shots / "shot.tif")
    archive = manifest.read_all([shots], {}, tmp_path / "out")
    kept = "shot.tif" if make_link == "symbolic" else "another.tif"
    assert [item.recording for item in archive.items] == sorted([kept, "other.tif"])
    assert len(archive.notes) == 2
    assert all(f"is the same recording as {kept}, and is measured once" in note for note in archive.notes)


def test_a_recording_that_several_sources_name_is_measured_once(tmp_path: Path) -> None:
    write_tiff(tmp_path / "shots" / "shot.tif", 3)
    archive = manifest.read_all([tmp_path / "shots", tmp_path / "shots" / "shot.tif"], {}, tmp_path / "out")
    assert [item.recording for item in archive.items] == ["shots/shot.tif"]
    assert archive.notes == ("shot.tif is the same recording as shots/shot.tif, and is measured once, by this name.",)


def test_a_link_with_settings_or_a_result_of_its_own_is_measured(tmp_path: Path) -> None:
    write_tiff(tmp_path / "shot.tif", 3)
    for name in ("slow.tif", "again.tif", "same.tif"):
        (tmp_path / name).symlink_to(tmp_path / "shot.tif")
    rows = "recording,fps,result\nshot.tif,50,\nslow.tif,5,\nagain.tif,50,mine\nsame.tif,50,\ngone.tif,50,\n"
    (tmp_path / "list.csv").write_text(rows)
    archive = manifest.read_all([tmp_path / "list.csv"], {}, tmp_path / "out")
    # A recording that is missing fails by its own name.
    assert [item.recording for item in archive.items] == ["shot.tif", "slow.tif", "again.tif", "gone.tif"]
    assert [note.partition(" is ")[0] for note in archive.notes] == ["same.tif"]


def test_a_link_to_a_folder_elsewhere_is_noted(tmp_path: Path) -> None:
    write_tiff(tmp_path / "elsewhere" / "shot.tif", 3)
    write_tiff(tmp_path / "shots" / "day" / "shot.tif", 3)
    (tmp_path / "shots" / "monday").symlink_to(tmp_path / "elsewhere")
    (tmp_path / "shots" / "today").symlink_to(tmp_path / "shots" / "day")
    made = scan.scan(tmp_path / "shots")
    assert [path.name for path in made.recordings] == ["shot.tif"]
    (note,) = made.notes
    assert note.startswith(f"{tmp_path / 'shots' / 'monday'}: is a link to a folder, which is not searched")
