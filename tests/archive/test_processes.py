"""Whole archives by worker processes, some of which are killed or die, without harm to other recordings."""

import os
import signal
import subprocess
import sys
from contextlib import AbstractContextManager
from pathlib import Path

import pytest
from archive_shots import (
    COMMON,
    NAMES,
    PATIENCE_S,
    arguments,
    calls,
    check_the_whole,
    kill_holder,
    measured,
    pid_of,
    rows,
    wait_until,
    write_archive,
)
from processes import started

from torchsphere.cli import batch

SCRIPT = Path(__file__).parents[1] / "archive_shots.py"


def start(source: Path, out: Path, workers: int) -> AbstractContextManager["subprocess.Popen[bytes]"]:
    environment = os.environ | {"OMP_NUM_THREADS": "1"}
    return started([sys.executable, str(SCRIPT), str(source), str(out), str(workers)], env=environment)


def is_alive(pid: int) -> bool:
    try:
        state = Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[0]
    except FileNotFoundError:
        return False
    return state != "Z"


def test_a_killed_worker_and_bad_recordings_do_not_harm_other_recordings(tmp_path: Path) -> None:
    source, out = tmp_path / "in", tmp_path / "out"
    write_archive(source, NAMES)
    killer = kill_holder(source / "a" / "held2.pid")
    assert batch.run(arguments(source, out), measured) == batch.SOME_FAILED
    killer.join()
    check_the_whole(out, source)
    assert rows(out)["b/poison6.tif"]["reason"].startswith("the worker process died (signal 9, SIGKILL), and so did")
    before = {path: path.stat().st_mtime_ns for path in out.rglob("summary.json")}
    assert batch.run(arguments(source, out), measured) == batch.SOME_FAILED
    assert {path: path.stat().st_mtime_ns for path in out.rglob("summary.json")} == before
    check_the_whole(out, source)


@pytest.mark.skipif(not Path("/proc/self/stat").exists(), reason="there is no /proc to see whether a process lives")
def test_workers_end_after_their_parent_is_killed_and_the_next_run_continues(tmp_path: Path) -> None:
    source, out = tmp_path / "in", tmp_path / "out"
    names = ["r0", "r1", "held2", "r3"]
    write_archive(source, names)
    with start(source, out, 1) as parent:
        worker = pid_of(source / "held2.pid")
        parent.kill()
    wait_until(lambda: not is_alive(worker), "the worker ends after its parent")
    finished = calls(source)
    (out / ".r3.abcd_123").mkdir()
    assert batch.run(arguments(source, out, workers=1), measured) == 0
    assert calls(source) == sorted(names)
    assert set(finished) < set(names)
    assert sorted(path.name for path in out.iterdir() if path.is_dir()) == [".batch", *sorted(names)]
    assert [row["state"] for row in rows(out).values()] == ["done"] * 4


def test_ctrl_c_ends_the_workers_and_the_next_run_continues(tmp_path: Path) -> None:
    source, out = tmp_path / "in", tmp_path / "out"
    write_archive(source, ["held0", "r1"])
    with start(source, out, 1) as parent:
        worker = pid_of(source / "held0.pid")
        parent.send_signal(signal.SIGINT)
        assert parent.wait(PATIENCE_S) == 130
    with pytest.raises(ProcessLookupError):
        os.kill(worker, 0)
    assert [row["state"] for row in rows(out).values()] == ["pending", "pending"]
    assert sorted(path.name for path in out.iterdir()) == [".batch", "index.html", "summary.csv", "summary.parquet"]
    assert batch.run(arguments(source, out, workers=1), measured) == 0


def test_two_simultaneous_runs_share_the_work_and_both_end_with_all_results(tmp_path: Path) -> None:
    source, out = tmp_path / "in", tmp_path / "out"
    names = [f"r{i}" for i in range(5)]
    write_archive(source, names)
    with start(source, out, 1) as first, start(source, out, 1) as second:
        assert (first.wait(PATIENCE_S), second.wait(PATIENCE_S)) == (0, 0)
    assert calls(source) == sorted(names)
    assert [row["state"] for row in rows(out).values()] == ["done"] * 5


def test_a_run_without_new_recordings_starts_no_process(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    source, out = tmp_path / "in", tmp_path / "out"
    write_archive(source, ["r0"])
    assert batch.run(arguments(source, out, **COMMON), measured) == 0
    monkeypatch.setattr("torchsphere.archive.processes._start", None)
    assert batch.run(arguments(source, out), measured) == 0
