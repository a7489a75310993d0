"""Whatever may take longer than three seconds is told before it begins, in every command.

Each test lets a command run until it calls the slow function, which then raises: no test waits for a clock.
"""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import tifffile
import torch
from archive_shots import serial
from benchmark_folder import SUITES, write_benchmark
from plan_setups import GIVEN, sides

from torchsphere.archive import folder
from torchsphere.cli.main import main
from torchsphere.runtime import steps

CIRCLE = ["--circle", "64.3,92.6,40"]
SI = ["--fps", "36000", "--diameter-mm", "30"]
PAIRS = [*CIRCLE, "--map", "off"]


class ReachedError(Exception):
    """The slow function was called."""


@pytest.fixture
def told(monkeypatch: pytest.MonkeyPatch) -> list[str]:
    """The steps that were told, in order."""
    said: list[str] = []
    monkeypatch.setattr(steps, "tell", lambda step, *values: said.append(step % values))
    return said


@pytest.fixture
def last_word(monkeypatch: pytest.MonkeyPatch, told: list[str]) -> Callable[..., str]:
    """The last step that a command tells before it calls a function."""

    def before(slow: str, *command: object) -> str:
        def reached(*_: object, **__: object) -> None:
            raise ReachedError

        monkeypatch.setattr(f"torchsphere.{slow}", reached)
        with pytest.raises(ReachedError):
            main([str(word) for word in command])
        return told[-1]

    return before


#: Options of `track`, the function that takes long, and what is told before.
OF_TRACK = {
    "finding the ball": ([], "tracking.initial_circle.ball_search.find", "looking for the ball in 8 frames"),
    "its radius": ([], "tracking.initial_circle.calibrate_circle", "to measure its radius"),
    "limbs": (CIRCLE, "tracking.slipped_path.fit_along_path", "comparing the path of the ball with its outlines"),
    "a map": (CIRCLE, "tracking.absolute_motion.estimate_blur", "making a map of the ball"),
    "checks": (PAIRS, "tracking.track.ledger.applied", "checking the result against the images"),
    "velocities": ([*PAIRS, *SI], "measure.kinematics", "computing velocities and forces"),
    "tables": (PAIRS, "measure.writer.write_measurement", "writing the result to "),
    "figures": (PAIRS, "measure.draw.draw", ", with figures and report"),
    "overlay": ([*PAIRS, "--overlay"], "measure.overlay.write_overlay", "drawing overlay.mp4"),
    "ParaView": ([*PAIRS, "--paraview"], "measure.paraview.write_paraview", "writing the series for ParaView"),
}


@pytest.mark.parametrize("case", OF_TRACK)
def test_track_tells_what_takes_long(case: str, short: Path, tmp_path: Path, last_word: Callable[..., str]) -> None:
    options, slow, word = OF_TRACK[case]
    if case == "overlay":
        pytest.importorskip("av", reason="the extra 'video' is not installed")
    # Figures alone take a second.
    report = [] if case in ("figures", "overlay") else ["--no-report"]
    assert word in last_word(slow, "track", short, "--out", tmp_path / "out", *options, *report)


def test_a_large_file_is_told_before_it_is_opened(
    short: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, last_word: Callable[..., str]
) -> None:
    monkeypatch.setattr(steps, "LARGE_BYTES", 100)
    track = ["track", short, "--out", tmp_path / "out", *PAIRS, "--no-report"]
    assert last_word("recording.tiff.describe", *track) == f"opening {short}"


def test_a_large_folder_is_told_before_its_images_are_opened(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, last_word: Callable[..., str]
) -> None:
    monkeypatch.setattr(steps, "LARGE_BYTES", 100)
    for k in range(2):
        tifffile.imwrite(tmp_path / f"{k}.tif", np.zeros((8, 9), np.uint8), photometric="minisblack")
    word = last_word("recording.folder.describe", "track", tmp_path, "--out", tmp_path / "out", "--no-report")
    assert word == f"opening the 2 images in {tmp_path}"


def test_the_checksum_of_a_large_recording_is_told(
    short: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, last_word: Callable[..., str]
) -> None:
    monkeypatch.setattr(steps, "LARGE_BYTES", 100)
    word = last_word("measure.hash_files", "track", short, "--out", tmp_path / "out", *PAIRS, "--no-report")
    assert word == "computing the checksum of the recording"


def test_demo_and_warm_up_tell_what_takes_long(tmp_path: Path, last_word: Callable[..., str]) -> None:
    make_shot = "synthetic.demo_shot.make_shot"
    assert last_word(make_shot, "demo", "--out", tmp_path / "demo") == "rendering the shot"
    assert last_word(make_shot, "warm-up") == "measuring 12 frames of a synthetic shot"


@pytest.mark.usefixtures("few_recordings")
def test_a_plan_tells_what_takes_long(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, last_word: Callable[..., str]
) -> None:
    # An image is ready, while a pattern takes a second to render.
    image, side = tmp_path / "ball.tif", sides(18.0)[0]
    tifffile.imwrite(image, side.image.round().to(torch.uint8).numpy(), photometric="minisblack")
    looks = ["--image", image, "--circle", "{},{},{}".format(*side.circle)]
    plan = ["plan", *GIVEN, *looks, "--out", tmp_path / "plan"]
    words = {
        "planning.plan._cost_of_blur": "computing the cost of motion blur",
        "planning.plan.rehearse": "rehearsing the measurement of an impact",
        "planning.plan.increment_covariance": "computing the uncertainty of a step on examples of the ball",
    }
    # The last function first: each is replaced, and stays so.
    for slow, word in words.items():
        assert last_word(slow, *plan) == word
    monkeypatch.setattr("torchsphere.cli.plan._from_images", lambda *_: None)
    assert last_word("planning.presentation.as_table", *plan) == "drawing the plan"


def test_info_tells_that_it_looks_for_the_ball(short: Path, tmp_path: Path, last_word: Callable[..., str]) -> None:
    word = last_word("tracking.initial_circle.ball_search.find", "info", short, "--preview", tmp_path / "ball.png")
    assert word == "looking for the ball in 8 frames"


def test_report_tells_what_it_draws(measured: tuple[Path, object], tmp_path: Path, last_word) -> None:
    result, _ = measured
    assert last_word("report.draw.draw", "report", result) == f"drawing {result}"
    assert last_word("report.comparison.read", "report", result, tmp_path) == "comparing 2 results"


def test_pick_tells_that_it_reads_frames(short: Path, tmp_path: Path, last_word: Callable[..., str]) -> None:
    word = last_word("pick.footage.Footage.image", "pick", short, "--no-browser", "--out", tmp_path / "out")
    assert word == f"reading some frames of {short}"


def test_a_benchmark_tells_each_run(tmp_path: Path, last_word: Callable[..., str]) -> None:
    bench = write_benchmark(tmp_path / "bench")
    command = ["benchmark", "run", bench, "--tracker", "edge_fit", "--out", tmp_path / "out"]
    assert last_word("benchmark.run._warm_up", *command) == f"running edge_fit on suite {SUITES[0]}"


def test_instruments_tell_that_they_look_for_the_delay(
    measured: tuple[Path, object], tmp_path: Path, last_word
) -> None:
    result, _ = measured
    times = 1e-5 * np.arange(300)
    signal = np.exp(-(((times - 1e-3) / 1e-4) ** 2))
    np.savetxt(tmp_path / "s.csv", np.column_stack((times, signal)), delimiter=",", header="time_s,a", comments="")
    word = last_word("instruments.delay._correlation", "instruments", result, "--accelerometer", tmp_path / "s.csv")
    assert word.startswith("looking for the delay of two signals of ")


def test_a_batch_tells_its_beginning_and_its_end(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, told: list[str], last_word: Callable[..., str]
) -> None:
    for k in range(2):
        (tmp_path / "shots").mkdir(exist_ok=True)
        np.save(tmp_path / "shots" / f"{k}.npy", np.zeros((3, 8, 9), np.uint8))
    batch = ["batch", tmp_path / "shots", "--out", tmp_path / "out"]
    monkeypatch.setattr("torchsphere.archive.processes.run", lambda jobs, **_: serial(jobs))
    at_the_end = folder.sweep

    def sweep(*arguments: Any) -> int:
        assert told == ["reading the state of 2 recordings"] or told[-1] == "writing the table of 2 recordings"
        return at_the_end(*arguments)

    monkeypatch.setattr("torchsphere.archive.folder.sweep", sweep)
    assert main([str(word) for word in batch]) == 0
    assert told == ["reading the state of 2 recordings", "writing the table of 2 recordings"]
    assert last_word("archive.run.key_of", *batch) == "reading the state of 2 recordings"


def test_the_search_of_a_large_archive_is_told(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, last_word) -> None:
    monkeypatch.setattr("torchsphere.archive.scan.MANY_FILES", 2)
    for k in range(2):
        np.save(tmp_path / f"{k}.npy", np.zeros((3, 8, 9), np.uint8))
    word = last_word("archive.scan._in_folder", "batch", tmp_path, "--out", tmp_path / "out")
    assert word == f"looking for recordings in {tmp_path}, which holds many files"


def test_the_first_compilation_is_told_once_before_it_begins_and_a_kept_loop_is_silent(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, told: list[str]
) -> None:
    import numba

    from torchsphere.kernels import jit

    monkeypatch.setattr(numba.config, "CACHE_DIR", str(tmp_path))
    jit._tell_compilation.cache_clear()
    events = told
    first, second = jit.compiled(triple), jit.compiled(triple)
    compile_ = first._compiler.compile
    monkeypatch.setattr(first._compiler, "compile", lambda *a: (events.append("compiled"), compile_(*a))[1])
    assert first(2.0) == 6.0
    word = f"compiling the loops over pixels, once for this machine and version ({steps.COMPILATION_TIME})"
    assert events == [word, "compiled"]
    assert second(2.0) == 6.0
    jit._tell_compilation.cache_clear()
    # The third loop is read from the disk.
    assert jit.compiled(triple)(2.0) == 6.0
    assert events == [word, "compiled"]


def triple(value: float) -> float:
    return 3 * value
