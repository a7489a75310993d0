"""Archives of several folders, manifests and recordings."""

from pathlib import Path

import pytest
from archive_shots import rows, serial, write_array

from torchsphere.archive import manifest, processes
from torchsphere.cli.main import main
from torchsphere.cli.track import _own_folders

#: Neither a page nor a map of the ball, where the test is about neither.
FAST = ("--quiet", "--no-report", "--map", "off")


@pytest.fixture
def days(tmp_path: Path) -> Path:
    for name, level in (("day1/a.npy", 1), ("day2/a.npy", 2), ("day2/b.npy", 3), ("c.npy", 4)):
        write_array(tmp_path / name, level)
    return tmp_path


def test_folders_and_recordings_are_one_archive_and_folders_keep_their_names(
    days: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(processes, "run", lambda jobs, **_: serial(jobs))
    sources = [str(days / name) for name in ("day1", "day2", "c.npy")]
    assert main(["batch", *sources, "--out", str(days / "out"), *FAST]) == 0
    results = {name: row["result"] for name, row in rows(days / "out").items()}
    assert results == {"day1/a.npy": "day1/a", "day2/a.npy": "day2/a", "day2/b.npy": "day2/b", "c.npy": "c"}
    found = {path.parent.relative_to(days / "out").as_posix() for path in (days / "out").rglob("summary.json")}
    assert found == {"day1/a", "day2/a", "day2/b", "c"}


def test_arrays_of_one_file_have_folders_of_their_own() -> None:
    inputs = [Path("day/two.h5:/left"), Path("day/two.h5:/camera/right"), Path("day/one.h5")]
    assert [folder.as_posix() for folder in _own_folders(inputs, Path("out"))] == [
        "out/two-left",
        "out/two-camera-right",
        "out/one",
    ]


def test_one_recording_alone_is_an_archive_too(days: Path) -> None:
    archive = manifest.read_all([days / "c.npy"], {}, days / "out")
    assert [(item.recording, item.result) for item in archive.items] == [("c.npy", "c")]


def test_two_recordings_of_one_result_are_refused(days: Path) -> None:
    with pytest.raises(ValueError, match="both would be written to a; leave one out"):
        manifest.read_all([days / "day1" / "a.npy", days / "day2" / "a.npy"], {}, days / "out")
