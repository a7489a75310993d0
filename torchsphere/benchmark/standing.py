"""Scores of trackers over the suites of a benchmark as rows, and the CSV that they are kept in."""

from __future__ import annotations

import csv
import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from torchsphere.benchmark import predictions
from torchsphere.benchmark.errors import Truth
from torchsphere.benchmark.folder import Benchmark, Suite, read_footage
from torchsphere.benchmark.prediction_checks import Given
from torchsphere.benchmark.predictions import Prediction
from torchsphere.benchmark.score import KINDS, Score, score
from torchsphere.geometry.orientation import matrices
from torchsphere.results.atomic_output import atomic_file
from torchsphere.results.reader import INCREMENTS

#: Kinds of suites whose ball has no pattern: nobody can see it turn.
WITHOUT_PATTERN = ("no-speckle",)

MEASURED, NOT_MEASURED, NOT_SEEN = "measured", "not measured", "not to be seen"

#: Columns of the four mean errors, in the order of `score.KINDS`.
MEANS = tuple(f"{name}_{unit}" for name, unit, _ in KINDS)
_COMPONENTS = tuple(name.replace("_rad", "_deg") for name in INCREMENTS)

#: Columns of numbers; percent where the name says so.
VALUES = (
    "points_percent",
    *(f"{kind}{part}" for kind in MEANS for part in ("", "_bias", "_std")),
    *(f"{part}_{name}" for name in _COMPONENTS for part in ("bias", "std")),
    *("drift_px_per_frame", "drift_deg_per_frame"),
    *("lost_percent", "lost_rotation_percent", "silent_percent"),
    *("gone_frames", "gone_noticed_percent"),
    *("sd_ratio_px", "within_95_px_percent", "sd_ratio_deg", "within_95_deg_percent"),
    *("ms_per_pair", "frames"),
)
WORDS = ("tracker", "suite", "checksum", "rotation")
COLUMNS = (*WORDS, *VALUES, "notes")


@dataclass(frozen=True)
class Standing:
    """One tracker on one suite.

    Attributes
    ----------
    tracker, suite, checksum : str
        Who was scored on what.
    rotation : str
        `MEASURED`, `NOT_MEASURED`, or `NOT_SEEN` where the ball shows none.
    values : mapping
        Numbers by the names in `VALUES`; NaN where there is none.
    notes : str
        Sentences on what was missing.
    """

    tracker: str
    suite: str
    checksum: str
    rotation: str
    values: Mapping[str, float]
    notes: str


def truths(suites: Iterable[Suite]) -> dict[str, Truth]:
    """Truth by name of the suite; ValueError where a suite is not what was made (`folder.read_footage`)."""
    found = {}
    for suite in suites:
        truth = read_footage(suite).truth
        shows = suite.kind not in WITHOUT_PATTERN
        found[suite.name] = Truth(truth.position, matrices(truth.quaternion), truth.visible, shows)
    return found


def given(suite: Suite) -> Given:
    """What a tracker of that suite was given."""
    return Given(suite.name, suite.frames, suite.circle, suite.checksum)


def standings(benchmark: Benchmark, folder: Path, tracker: str, truth: Mapping[str, Truth]) -> list[Standing]:
    """Score a folder with a ``SUITE.csv`` of predictions for each suite.

    Parameters
    ----------
    benchmark : Benchmark
        What they are predictions of.
    folder : Path
        Where the files are.
    tracker : str
        Its name.
    truth : mapping
        Of the suites to be scored, by name; a suite without a file counts as lost.

    Raises
    ------
    ValueError
        If no suite has a file, or a file is refused (`predictions.read`).
    """
    chosen = [suite for suite in benchmark if suite.name in truth]
    if not any((folder / f"{suite.name}.csv").is_file() for suite in chosen):
        raise ValueError(f"{folder}: holds no predictions; expected files such as {chosen[0].name}.csv, one per suite")
    found = []
    for suite in chosen:
        path = folder / f"{suite.name}.csv"
        if path.is_file():
            prediction = predictions.read(path, given(suite))
        else:
            prediction = predictions.nothing(given(suite), f"There is no {path.name}: every frame counts as lost.")
        found.append(standing(suite, tracker, truth[suite.name], prediction))
    return found


def of_file(suite: Suite, path: Path, tracker: str) -> Standing:
    """Score one file of predictions for one suite; raises as `predictions.read` and `truths` do."""
    prediction = predictions.read(path, given(suite))
    return standing(suite, tracker, truths([suite])[suite.name], prediction)


def standing(suite: Suite, tracker: str, truth: Truth, prediction: Prediction) -> Standing:
    """Score one prediction."""
    found = score(truth, prediction)
    rotation = NOT_MEASURED if not found.measures_rotation else MEASURED if truth.shows_rotation else NOT_SEEN
    return Standing(tracker, suite.name, suite.checksum, rotation, _values(found), " ".join(prediction.notes))


def _values(found: Score) -> dict[str, float]:
    """The score's numbers in the order of `VALUES`."""
    parts = [v for kind in found.kinds for v in (kind.mean, kind.bias, kind.std)]
    components = np.stack((found.component_bias, found.component_std), 1).ravel().tolist()
    numbers = (
        100 * found.points,
        *parts,
        *components,
        *(found.drift_px, found.drift_deg),
        *(100 * found.lost, 100 * found.lost_rotation, 100 * found.silent),
        *(float(found.gone), 100 * found.gone_noticed),
        *(found.honesty_px.ratio, 100 * found.honesty_px.within),
        *(found.honesty_deg.ratio, 100 * found.honesty_deg.within),
        *(found.ms_per_pair, float(found.frames)),
    )
    return dict(zip(VALUES, numbers, strict=True))


def write(path: Path, rows: Sequence[Standing]) -> None:
    """Write scores as CSV, whole or not at all; what there is none of stays empty."""
    with atomic_file(path) as stream:
        writer = csv.writer(stream, lineterminator="\n")
        writer.writerow(COLUMNS)
        for row in rows:
            numbers = (row.values[name] for name in VALUES)
            cells = ("" if math.isnan(value) else format(value, ".6g") for value in numbers)
            writer.writerow((row.tracker, row.suite, row.checksum, row.rotation, *cells, row.notes))


def earlier(path: Path, benchmark: Benchmark, rows: Sequence[Standing]) -> list[Standing]:
    """Scores in the file at ``path`` that stand beside new ``rows``: of other trackers or suites, of these images."""
    if not path.is_file():
        return []
    images, new = {suite.name: suite.checksum for suite in benchmark}, {(row.tracker, row.suite) for row in rows}
    try:
        known = read(path)
    except ValueError:
        # Of another version, or cut: the predictions are there to be scored again.
        return []
    return [row for row in known if images.get(row.suite) == row.checksum and (row.tracker, row.suite) not in new]


def read(path: Path) -> list[Standing]:
    """Read what `write` wrote.

    Raises
    ------
    ValueError
        If it is no such file.
    OSError
        If it cannot be read.
    """
    with path.open(newline="", encoding="utf-8") as stream:
        rows = list(csv.DictReader(stream))
    missing = [name for name in COLUMNS if not rows or rows[0].get(name) is None]
    if missing:
        raise ValueError(f"{path}: has no column {missing[0]!r}; expected what 'torchsphere benchmark score' wrote")
    try:
        return [_row(row) for row in rows]
    except ValueError as error:
        raise ValueError(f"{path}: holds a word where a number belongs ({error}); score again") from error


def _row(row: Mapping[str, str]) -> Standing:
    values = {name: float(row[name] or "nan") for name in VALUES}
    return Standing(row["tracker"], row["suite"], row["checksum"], row["rotation"], values, row["notes"])
