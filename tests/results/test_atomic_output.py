"""Output that appears whole or not at all."""

from contextlib import suppress
from pathlib import Path

import pytest

from torchsphere.results.atomic_output import atomic_file, atomic_folder, check_folder


def test_a_file_that_fails_half_way_leaves_the_earlier_one(tmp_path: Path) -> None:
    path = tmp_path / "new" / "table.csv"
    with atomic_file(path) as stream:
        stream.write("first")
    with suppress(OSError), atomic_file(path) as stream:
        stream.write("half")
        raise OSError
    assert path.read_text() == "first"
    assert list(path.parent.iterdir()) == [path]


def test_a_folder_that_fails_half_way_leaves_the_earlier_one(tmp_path: Path) -> None:
    for text in ("first", "second"):
        with atomic_folder(tmp_path / "out", overwrite=True) as folder:
            (folder / "summary.json").write_text(text)
    with suppress(OSError), atomic_folder(tmp_path / "out", overwrite=True) as folder:
        (folder / "summary.json").write_text("half")
        raise OSError
    assert (tmp_path / "out" / "summary.json").read_text() == "second"
    assert list(tmp_path.iterdir()) == [tmp_path / "out"]


def test_only_output_of_the_same_kind_is_replaced(tmp_path: Path) -> None:
    (tmp_path / "suites.json").touch()
    check_folder(tmp_path, True, "benchmark", ("suites.json",))
    with pytest.raises(FileExistsError, match="holds files that are no result of torchsphere"):
        check_folder(tmp_path, overwrite=True)
    with pytest.raises(FileExistsError, match="not empty; give another folder, or `overwrite`"):
        check_folder(tmp_path, False, "benchmark", ("suites.json",))
