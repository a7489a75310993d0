"""Run trackers on the suites of a benchmark: a CSV of predictions each, with the time; what failed is written, too."""

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
from torchsphere.benchmark.standing import given
from torchsphere.benchmark.trackers import Entry, Task
from torchsphere.recording import open_recording

#: Frames on which a built-in tracker is run once before its time counts.
WARM_UP = 3


@dataclass(frozen=True)
class Outcome:
    """What became of one tracker on one suite.

    Attributes
    ----------
    tracker, suite : str
        Who on what.
    path : Path
        The predictions.
    failed : str
        The tracker's error in one line; empty where it ended well. All frames are then lost.
    kept : bool
        The predictions were there, of the same images and without a failure, and the tracker was not run again.
    """

    tracker: str
    suite: str
    path: Path
    failed: str
    kept: bool


def folder_of(tracker: str) -> str:
    """Name of the folder of a tracker's predictions: ``module:function`` is no name for a file everywhere."""
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
    """Run trackers, one after the other on each suite.

    Parameters
    ----------
    benchmark : Benchmark
        The images.
    trackers : sequence of Entry
        Who is run.
    out : Path
        Folder; predictions go to ``out/TRACKER/SUITE.csv``.
    suites : iterable of str, optional
        Names of the suites; by default all.
    keep : bool
        Do not run again where predictions of the same images are there: for trackers that have not changed.
    started : callable, optional
        Called as ``started(tracker, suite)``.

    Returns
    -------
    list of Outcome
        One per tracker and suite; a tracker that raises an error fails on that suite alone.

    Raises
    ------
    ValueError
        If a suite is not known, or its files are not those that were made.
    OSError
        If a suite cannot be read or predictions cannot be written.
    """
    chosen = list(benchmark) if suites is None else [benchmark.suite(name) for name in suites]
    outcomes, warm = [], set[str]()
    for suite in chosen:
        footage = None
        for entry in trackers:
            path = out / folder_of(entry.name) / f"{suite.name}.csv"
            if keep and _is_of(path, suite):
                outcomes.append(Outcome(entry.name, suite.name, path, "", kept=True))
                continue
            # Verified once, and only where a tracker is run on it.
            footage = footage or read_footage(suite)
            if started is not None:
                started(entry.name, suite.name)
            if entry.name not in warm and not entry.wants_array:
                _warm_up(entry, suite, footage.images)
            warm.add(entry.name)
            outcomes.append(_run_one(entry, suite, footage.images, path))
    return outcomes


def _warm_up(entry: Entry, suite: Suite, images: NDArray[Any]) -> None:
    """Run a built-in tracker on a few frames: libraries load and compile on first use, which is no time per pair."""
    # A tracker that cannot do this will fail in the run itself and be told of there.
    with contextlib.suppress(Exception):
        entry.run(Task(images[:WARM_UP], suite.circle, suite.camera))


def _run_one(entry: Entry, suite: Suite, images: NDArray[Any], path: Path) -> Outcome:
    keys = {"tracker": entry.name, "suite": suite.name, "checksum": suite.checksum, "settings": entry.settings}
    path.parent.mkdir(parents=True, exist_ok=True)
    failed = ""
    try:
        if entry.wants_array:
            columns, seconds = entry.run(Task(images, suite.circle, suite.camera))
        else:
            with open_recording(suite.images_path) as recording:
                columns, seconds = entry.run(Task(recording, suite.circle, suite.camera))
        columns = {**columns, "ms": [1e3 * seconds / (suite.frames - 1)] * suite.frames}
        prediction_table.write(path, keys, columns)
        predictions.read(path, given(suite))
    # Whatever it is, the other trackers and suites go on.
    except Exception as error:
        failed = " ".join(f"{type(error).__name__}: {error}".split())
        blank = {name: [math.nan] * suite.frames for name in prediction_table.PLACE}
        prediction_table.write(path, keys | {"failed": failed}, {"frame": range(suite.frames), **blank})
    return Outcome(entry.name, suite.name, path, failed, kept=False)


def _is_of(path: Path, suite: Suite) -> bool:
    """Whether predictions of these very images are there, and no failure."""
    if not path.is_file():
        return False
    try:
        keys = prediction_table.read(path).keys
    except ValueError:
        return False
    return keys.get("checksum") == suite.checksum and "failed" not in keys
