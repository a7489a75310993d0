"""Replacement of result folders, also by processes that are killed in the middle."""

import errno
import os
import shutil
import subprocess
import sys
import threading
from pathlib import Path

import pytest

from torchsphere.cli.exit_codes import sentence as main_sentence
from torchsphere.results import atomic_output, replacement
from torchsphere.results.atomic_output import FullDiskError, atomic_folder, atomic_path, full_disk_named, recover

#: Replaces a folder, and stops where it is told to, until it is killed.
WRITER = """
import os, sys
from pathlib import Path
from torchsphere.results import replacement
from torchsphere.results.atomic_output import atomic_folder

def stop(*_):
    print("here", flush=True)
    sys.stdin.readline()
    os._exit(1)

where = sys.argv[2]
if where == "between":
    # Without an exchange, the old folder has gone when the new one gets its name.
    replacement.exchange = lambda one, other: False
    rename = Path.replace
    Path.replace = lambda old, new: stop() if (old / "summary.json").read_text() == "new" else rename(old, new)
if where == "after":
    replacement.shutil.rmtree = stop
with atomic_folder(Path(sys.argv[1]), overwrite=True) as folder:
    (folder / "summary.json").write_text("new")
    if where == "filling":
        stop()
"""


def write(out: Path, text: str) -> None:
    with atomic_folder(out, overwrite=True) as folder:
        (folder / "summary.json").write_text(text)


def start(out: Path, where: str) -> "subprocess.Popen[str]":
    """A process that writes "new" to a folder and has come to a place in the code."""
    command = [sys.executable, "-c", WRITER, str(out), where]
    process = subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True)
    assert process.stdout is not None
    assert process.stdout.readline() == "here\n"
    return process


@pytest.mark.skipif(sys.platform == "win32", reason="there are no locks of folders here")
@pytest.mark.parametrize(("where", "text"), [("filling", "old"), ("between", "old"), ("after", "new")])
def test_what_a_killed_process_left_is_restored_or_removed_by_a_later_run(
    tmp_path: Path, where: str, text: str
) -> None:
    out = tmp_path / "out"
    write(out, "old")
    with start(out, where) as process:
        if where == "filling":
            # The process lives: nothing of it is touched.
            recover(out)
            assert len(list(tmp_path.iterdir())) == 2
        process.kill()
    assert len(list(tmp_path.iterdir())) == 2
    recover(out)
    assert [path.name for path in tmp_path.iterdir()] == ["out"]
    assert (out / "summary.json").read_text() == text
    assert [path.name for path in out.iterdir() if path.name != replacement.MARK] == ["summary.json"]


def test_a_folder_that_this_process_fills_is_left_alone(tmp_path: Path) -> None:
    with atomic_folder(tmp_path / "out", overwrite=True) as folder:
        recover(tmp_path / "out")
        (folder / "summary.json").write_text("new")
    assert (tmp_path / "out" / "summary.json").read_text() == "new"
    assert [path.name for path in (tmp_path / "out").iterdir()] == ["summary.json"]


def test_folders_of_others_are_left_alone(tmp_path: Path) -> None:
    for name in (".out.abcdefgh", ".other.abcdefgh", "out"):
        (tmp_path / name).mkdir()
        (tmp_path / name / "notes.txt").touch()
    recover(tmp_path / "out")
    assert len(list(tmp_path.iterdir())) == 3


@pytest.mark.skipif(sys.platform != "linux", reason="only Linux exchanges two names in one step")
def test_a_replaced_folder_is_there_at_every_moment(tmp_path: Path) -> None:
    out = tmp_path / "out"
    write(out, "0")
    missed, ended = [], threading.Event()

    def look() -> None:
        while not ended.is_set():
            if not (out / "summary.json").exists():
                missed.append(1)

    looker = threading.Thread(target=look)
    looker.start()
    for k in range(60):
        write(out, str(k))
    ended.set()
    looker.join()
    assert not missed


def test_folders_are_replaced_where_the_system_cannot_exchange_them(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(replacement, "exchange", lambda one, other: False)
    for text in ("first", "second"):
        write(tmp_path / "out", text)
    assert (tmp_path / "out" / "summary.json").read_text() == "second"
    assert list(tmp_path.iterdir()) == [tmp_path / "out"]


@pytest.mark.skipif(os.name != "posix", reason="there is no umask")
def test_output_has_the_permissions_that_the_umask_leaves(tmp_path: Path) -> None:
    before = os.umask(0o027)
    try:
        write(tmp_path / "out", "new")
        with atomic_path(tmp_path / "table.csv") as part:
            part.touch()
    finally:
        os.umask(before)
    assert (tmp_path / "out").stat().st_mode & 0o777 == 0o750
    assert (tmp_path / "table.csv").stat().st_mode & 0o777 == 0o640


def fill_the_disk(out: Path, code: int = errno.ENOSPC) -> None:
    with atomic_folder(out, overwrite=True) as folder:
        (folder / "track.csv").write_bytes(bytes(2_000_000))
        try:
            raise OSError(code, "No space left on device")
        finally:
            # As a library of figures does that ends a file after a full disk.
            raise AttributeError("'Stream' object has no attribute 'pos'")


@pytest.mark.parametrize(
    ("code", "sentence"),
    [
        (errno.ENOSPC, r"out/track.csv: no space left on device; the result needs more than 2.5 MB"),
        (errno.EDQUOT, r"out/track.csv: no space left on the quota; the result needs more than 2 MB"),
    ],
)
def test_a_full_disk_is_named_with_the_file_and_the_room_and_loses_nothing(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, code: int, sentence: str
) -> None:
    out = tmp_path / "out"
    write(out, "old")
    usage = shutil.disk_usage(tmp_path)
    monkeypatch.setattr(atomic_output.shutil, "disk_usage", lambda path: usage._replace(free=500_000))
    with pytest.raises(OSError, match=sentence) as full:
        fill_the_disk(out, code)
    assert full.value.errno == code
    assert (out / "summary.json").read_text() == "old"
    assert list(tmp_path.iterdir()) == [out]


def test_a_full_disk_within_a_folder_that_is_removed_is_named_by_its_own_file(tmp_path: Path) -> None:
    def draw(folder: Path) -> None:
        new = folder / ".drawing"
        new.mkdir()
        with full_disk_named(new, folder, "report"):
            (new / "report.html").write_text("half")
            raise OSError(errno.ENOSPC, "No space left on device")

    with (
        pytest.raises(FullDiskError, match=rf"{tmp_path}/out/report.html: no space left on device; the report needs"),
        atomic_folder(tmp_path / "out", overwrite=True) as folder,
    ):
        draw(folder)


def test_the_file_that_a_full_disk_does_not_take_is_named(tmp_path: Path) -> None:
    with pytest.raises(OSError, match="No space left") as full, atomic_path(tmp_path / "table.csv"):
        raise OSError(errno.ENOSPC, "No space left on device")
    assert main_sentence(full.value) == f"{tmp_path}/table.csv: no space left on device; make room"
