"""Run trackers on the suites of a benchmark; each writes a CSV of predictions with its time, or its failure."""

from __future__ import annotations

import contextlib
import math
import re
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from numpy.typing import NDArray

from torchsphere.benchmark import prediction_table, predictions
from torchsphere.benchmark.folder import Benchmark, Suite, read_footage
from torchsphere.benchmark.trackers import Entry, Task
from torchsphere.recording import open_recording
from torchsphere.runtime import steps

#: Frames of the untimed first run of a built-in tracker (docs/constants.toml).
WARM_UP = 3


@dataclass(frozen=True)
class Outcome:
    """The run of one tracker on one suite."""

    tracker: str
    suite: str
    failed: str  # the tracker's error in one line, which loses all frames; empty for success
    kept: bool  # valid predictions of the same images existed, so that the tracker was not run


def folder_of(tracker: str) -> str:
    """Name of the folder of a tracker's predictions, without characters that file systems refuse."""
    return re.sub(r"[^\w.-]", "-", tracker)


def run(
    benchmark: Benchmark,
    trackers: Sequence[Entry],
    out: Path,
    *,
    suites: Iterable[str] | None = None,
    keep: bool = False,
    started: Callable[[str, str], None] | None = None,
) -> list[Outcome]:
    """Run trackers on each suite and write ``out/TRACKER/SUITE.csv``; an error of a tracker fails that suite alone.

    ``keep`` skips a tracker with earlier predictions of the same images; ``started(tracker, suite)`` reports progress.
    Raises ValueError if a suite is unknown or its files were changed.
    """
    chosen = list(benchmark) if suites is None else [benchmark.suite(name) for name in suites]
    outcomes, warm = [], set[str]()
    for suite in chosen:
        footage = None
        for entry in trackers:
            path = out / folder_of(entry.name) / f"{suite.name}.csv"
            if keep and _is_valid(path, suite):
                outcomes.append(Outcome(entry.name, suite.name, "", kept=True))
                continue
            # Read and verified once, and only if a tracker runs.
            footage = footage or read_footage(suite)
            if started is not None:
                started(entry.name, suite.name)
            steps.tell("running %s on suite %s", entry.name, suite.name)
            if entry.name not in warm and not entry.wants_array:
                _warm_up(entry, suite, footage.images)
            warm.add(entry.name)
            outcomes.append(Outcome(entry.name, suite.name, _run_one(entry, suite, footage.images, path), kept=False))
    return outcomes


def _warm_up(entry: Entry, suite: Suite, images: NDArray[Any]) -> None:
    """Run a built-in tracker on a few frames, because libraries load and compile on their first use."""
    # A tracker that fails here fails in the timed run too, which reports the error.
    with contextlib.suppress(Exception):
        entry.run(Task(images[:WARM_UP], suite.circle, suite.camera))


def _run_one(entry: Entry, suite: Suite, images: NDArray[Any], path: Path) -> str:
    """Write the predictions of a tracker for a suite; the result is the error, or empty."""
    keys = {"tracker": entry.name, "suite": suite.name, "checksum": suite.checksum, "settings": entry.settings}
    path.parent.mkdir(parents=True, exist_ok=True)
    try:
        with contextlib.nullcontext(images) if entry.wants_array else open_recording(suite.images_path) as source:
            columns, seconds = entry.run(Task(source, suite.circle, suite.camera))
        columns = {**columns, "ms": [1e3 * seconds / (suite.frames - 1)] * suite.frames}
        prediction_table.write(path, keys, columns)
        predictions.read(path, suite)
    # The other trackers and suites go on after any error.
    except Exception as error:
        failed = " ".join(f"{type(error).__name__}: {error}".split())
        blank = {name: [math.nan] * suite.frames for name in prediction_table.POSITION}
        prediction_table.write(path, keys | {"failed": failed}, {"frame": range(suite.frames), **blank})
        return failed
    return ""


def _is_valid(path: Path, suite: Suite) -> bool:
    """Whether the file holds predictions of the suite's present images, without a failure."""
    if not path.is_file():
        return False
    try:
        keys = prediction_table.read(path).keys
    except ValueError:
        return False
    return keys.get("checksum") == suite.checksum and "failed" not in keys
