"""Locks on recordings and on the summary, and the removal of unfinished folders without a lock."""

import errno
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest

from torchsphere.archive import claims, folder
from torchsphere.archive.claims import claims_of

#: Holds the lock of a recording, or without an argument the lock of the summary, until its input ends.
HOLDER = """
import sys
from pathlib import Path
from torchsphere.archive.claims import claims_of
held = claims_of(Path(sys.argv[1]))
with held.claim(sys.argv[2]) if len(sys.argv) > 2 else held.summary_lock() as is_mine:
    print(is_mine, flush=True)
    sys.stdin.readline()
"""


@contextmanager
def another_process(out: Path, *result: str) -> Iterator[subprocess.Popen[str]]:
    """A process that holds a lock during the block."""
    command = [sys.executable, "-c", HOLDER, str(out), *result]
    with subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True) as process:
        assert process.stdout is not None
        assert process.stdout.readline() == ("True\n" if result else "None\n")
        yield process


@pytest.fixture
def out(tmp_path: Path) -> Path:
    folder.prepare(tmp_path / "out")
    return tmp_path / "out"


@pytest.fixture
def without_locks(monkeypatch: pytest.MonkeyPatch) -> None:
    """A file system that refuses every lock, as some network file systems do."""

    def refuse(*_: int) -> None:
        raise OSError(errno.ENOLCK, "No locks available")

    monkeypatch.setattr(claims, "_set", refuse)


def test_a_recording_is_locked_against_another_process_until_that_is_killed(out: Path) -> None:
    with another_process(out, "a") as other:
        with claims_of(out).claim("a") as held, claims_of(out).claim("b") as free:
            assert (held, free) == (False, True)
        # Killed, not told to end: the system drops the lock.
        other.kill()
        other.wait()
        with claims_of(out).claim("a") as is_mine:
            assert is_mine


def test_a_recording_is_locked_against_the_same_process(out: Path) -> None:
    held = claims_of(out)
    with held.claim("a") as first, held.claim("a") as second, held.claim("b") as other:
        assert (first, second, other) == (True, False, True)
    with held.claim("a") as is_mine:
        assert is_mine


def test_a_run_waits_for_the_lock_of_the_summary(out: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    pauses: list[float] = []
    with another_process(out) as other:

        def end_the_other(seconds: float) -> None:
            pauses.append(seconds)
            other.kill()
            other.wait()

        monkeypatch.setattr("torchsphere.archive.claims.time.sleep", end_the_other)
        with claims_of(out).summary_lock():
            assert pauses == [claims.PAUSE_S]


def test_locks_are_supported_even_while_another_process_probes_them(out: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    assert claims_of(out).are_supported()

    def refuse(*_: int) -> None:
        raise OSError(errno.EAGAIN, "Resource temporarily unavailable")

    monkeypatch.setattr(claims, "_set", refuse)
    assert claims_of(out).are_supported()


def test_unfinished_folders_of_dead_processes_alone_are_removed(out: Path) -> None:
    for name in ("a", "b", "deep/c", ".a.abcd1234", ".b.abcd1234", "deep/.c.0_x9zzzz", ".stranger.abcd1234"):
        (out / name).mkdir(parents=True)
    results = ["a", "b", "deep/c", "d"]
    with another_process(out, "b") as other:
        assert folder.sweep(out, results) == 2
        assert (out / ".b.abcd1234").is_dir()
        other.kill()
        other.wait()
        assert folder.sweep(out, results) == 1
    assert sorted(p.name for p in out.iterdir() if p.is_dir()) == [".batch", ".stranger.abcd1234", "a", "b", "deep"]
    assert [p.name for p in (out / "deep").iterdir()] == ["c"]


@pytest.mark.usefixtures("without_locks")
def test_a_run_without_locks_goes_on_and_leaves_unfinished_folders_alone(out: Path) -> None:
    held = claims_of(out)
    assert not held.are_supported()
    with held.claim("a") as first, held.summary_lock():
        assert first
    # Another machine may be filling the folder.
    (out / ".a.abcd1234").mkdir()
    assert folder.sweep(out, ["a"]) == 0
    assert (out / ".a.abcd1234").is_dir()
