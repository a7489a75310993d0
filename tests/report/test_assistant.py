"""What a process beside this one draws and hashes: the same as is made here, and made here where it cannot."""

import contextlib
import json
import signal
import subprocess
import sys
import time
from collections.abc import Iterator, Sequence
from pathlib import Path

import pytest
import torch

from torchsphere.measure import Request, measure
from torchsphere.report import assistant, draw
from torchsphere.report.assistant import Assistant
from torchsphere.runtime import threads as parallel
from torchsphere.runtime.file_hash import hash_files

CIRCLE = (170.3, 98.6, 40.0)


@contextlib.contextmanager
def threads(count: int) -> Iterator[None]:
    """So many threads for torch, which tell whether a core lies idle."""
    before = torch.get_num_threads()
    torch.set_num_threads(count)
    try:
        yield
    finally:
        torch.set_num_threads(before)


def tracked(short: Path, out: Path, count: int) -> Path:
    with threads(count):
        measure(Request(input=short, out=out, fps=36_000.0, diameter_mm=30.0, circle=CIRCLE, map="off"))
    return out


@pytest.fixture(scope="module")
def alone(short: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Give a result of a process that draws all by itself."""
    return tracked(short, tmp_path_factory.mktemp("alone") / "out", 1)


def contents(folder: Path) -> dict[str, object]:
    """All files by name, of the summary what does not depend on the clock."""
    found: dict[str, object] = {
        str(path.relative_to(folder)): path.read_bytes() for path in folder.rglob("*") if path.is_file()
    }
    return found | {"summary.json": json.loads((folder / "summary.json").read_text()) | {"seconds": None}}


def drawn_in(result: Path) -> set[str]:
    return {path.name for path in (result / "figures").iterdir()}


def test_with_idle_cores_a_result_is_the_same_file_by_file(short: Path, alone: Path, tmp_path: Path) -> None:
    assert contents(tracked(short, tmp_path / "out", 2)) == contents(alone)
    assert [path.name for path in tmp_path.iterdir()] == ["out"]


def test_figures_are_drawn_by_the_process_and_not_here(
    alone: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def here(*_: object) -> None:
        raise AssertionError("drawn here")

    monkeypatch.setattr(draw, "draw_figures", here)
    with Assistant([]) as beside:
        beside.begin(alone, draw.OF_NUMBERS, tmp_path)
        beside.begin(alone, draw.OF_IMAGES, tmp_path)
        assert beside.finish()
    for path in tmp_path.iterdir():
        assert path.read_bytes() == (alone / "figures" / path.name).read_bytes()
    assert {path.name for path in tmp_path.iterdir()} == drawn_in(alone) - {"thumbnail.webp"}


def test_a_process_that_dies_leaves_its_figures_to_this_one(
    short: Path, alone: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(assistant, "_CODE", "import os, signal; os.kill(os.getpid(), signal.SIGKILL)")
    assert contents(tracked(short, tmp_path / "out", 2)) == contents(alone)


@pytest.mark.parametrize("executable", ["", "/nowhere/python"])
def test_without_an_interpreter_figures_are_drawn_here(
    short: Path, alone: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, executable: str
) -> None:
    monkeypatch.setattr(sys, "executable", executable)
    assert drawn_in(tracked(short, tmp_path / "out", 2)) == drawn_in(alone)


def test_what_cannot_be_drawn_is_told_as_without_the_process(alone: Path, tmp_path: Path) -> None:
    with Assistant([]) as beside:
        beside.begin(tmp_path, draw.OF_NUMBERS, tmp_path)
        with pytest.raises(ValueError, match="no result folder"):
            draw.draw(tmp_path, beside)
    assert not list(tmp_path.iterdir())


#: What the process runs with figures of our own making, each of a name and a statement.
DRAWING = """
import os, sys, time
sys.path[:] = sys.argv[1:]
from torchsphere.report import assistant, draw
def drawn(result, names, folder):
    for name in names:
        (folder / (name + ".drawn")).write_text(str(os.getpid()))
        {statement}
draw.draw_figures = drawn
assistant.serve()
"""

FORKS = pytest.mark.skipif(not sys.platform.startswith("linux"), reason="elsewhere no process is forked")


@FORKS
def test_each_figure_is_drawn_by_a_process_of_its_own_and_all_of_them_at_once(
    alone: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    # None of them ends before all have begun.
    late = "time.sleep(0.01) if len(list(folder.iterdir())) < 5 else None"
    wait = f"[{late} for _ in range(3000)]"
    monkeypatch.setattr(assistant, "_CODE", DRAWING.format(statement=wait))
    with Assistant([]) as beside:
        beside.begin(alone, draw.OF_NUMBERS, tmp_path)
        beside.begin(alone, draw.OF_IMAGES, tmp_path)
        assert beside.finish()
    assert len({path.read_text() for path in tmp_path.iterdir()}) == 5


@FORKS
@pytest.mark.parametrize("statement", ["assert name != 'rotation'", "if name == 'rotation': os.kill(os.getpid(), 9)"])
def test_a_figure_that_fails_or_whose_process_dies_is_told(
    alone: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, statement: str
) -> None:
    monkeypatch.setattr(assistant, "_CODE", DRAWING.format(statement=statement))
    with Assistant([]) as beside:
        beside.begin(alone, draw.OF_NUMBERS, tmp_path)
        assert not beside.finish()
    assert len(list(tmp_path.iterdir())) == 3


@FORKS
@pytest.mark.parametrize("of_itself", [True, False])
def test_nothing_is_drawn_any_more_once_the_process_is_closed_or_has_died(
    alone: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, of_itself: bool
) -> None:
    dies = "os.kill(os.getppid(), 9); " if of_itself else ""
    monkeypatch.setattr(assistant, "_CODE", DRAWING.format(statement=dies + "time.sleep(600)"))
    with Assistant([]) as beside:
        beside.begin(alone, ["motion"], tmp_path)
        begun = tmp_path / "motion.drawn"
        for _ in range(3000):
            if begun.exists() and begun.read_text():
                break
            time.sleep(0.01)
        if of_itself:
            assert not beside.finish()
    drawing = Path("/proc") / begun.read_text() / "stat"
    for _ in range(500):
        # A process that has ended and that nobody has asked for yet is still listed.
        if not drawing.exists() or drawing.read_text().split()[2] == "Z":
            return
        time.sleep(0.01)
    raise AssertionError("it is still being drawn")


# The pipe that its jobs come through ends with whoever holds the other end, however that one ended.
def test_the_process_ends_when_no_job_can_come_any_more() -> None:
    done = subprocess.run(
        [sys.executable, "-c", assistant._CODE, *sys.path], stdin=subprocess.DEVNULL, timeout=60, check=False
    )
    assert done.returncode == 0


@pytest.mark.skipif(sys.platform == "win32", reason="signals of POSIX")
def test_closing_ends_the_process_and_an_interrupt_of_the_terminal_does_not() -> None:
    with Assistant([]) as beside:
        process = beside._process
        assert process is not None
        # Until it loads the figures' library an interrupt ends it, which costs nothing but its help.
        time.sleep(1.0)
        process.send_signal(signal.SIGINT)
        time.sleep(0.2)
        assert process.poll() is None
    assert process.poll() == -signal.SIGKILL


def test_a_refusal_leaves_no_process_and_no_folder(
    short: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def full(*_: object) -> None:
        raise OSError(28, "No space left on device", "frames.npz")

    started: list[Assistant] = []

    class Noted(Assistant):
        def __init__(self, files: Sequence[Path]) -> None:
            super().__init__(files)
            started.append(self)

    monkeypatch.setattr("torchsphere.measure.Assistant", Noted)
    monkeypatch.setattr("torchsphere.results.sampled_frames.save", full)
    with pytest.raises(OSError, match="No space left"):
        tracked(short, tmp_path / "out", 2)
    assert not list(tmp_path.iterdir())
    assert [one._process is None or one._process.poll() is not None for one in started] == [True]


# Its memory comes on top, which long recordings have none to spare for.
def test_a_long_recording_is_drawn_without_the_process(
    short: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("torchsphere.measure.AIDED_FRAMES", 7)
    monkeypatch.setattr("torchsphere.measure.Assistant", None)
    assert (tracked(short, tmp_path / "out", 2) / "report.html").is_file()


def test_one_thread_for_torch_leaves_no_core_idle() -> None:
    with threads(1):
        assert not parallel.has_idle_cores()
    with threads(2):
        assert parallel.has_idle_cores()
        with parallel.one_each():
            assert parallel.has_idle_cores()


def test_the_hash_is_that_of_the_files_and_left_to_this_process_where_they_cannot_be_read(tmp_path: Path) -> None:
    (tmp_path / "shot.raw").write_bytes(b"\0\1" * (1 << 20))
    with Assistant([tmp_path / "shot.raw"]) as beside:
        assert beside.sha256() == hash_files([tmp_path / "shot.raw"])
    with Assistant([tmp_path / "gone.raw"]) as beside:
        assert beside.sha256() is None
        assert not beside.finish()
