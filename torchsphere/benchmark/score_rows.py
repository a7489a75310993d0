"""Scores of trackers over the suites of a benchmark as rows of a table, and the table's CSV file."""

from __future__ import annotations

import csv
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from torchsphere.benchmark import predictions
from torchsphere.benchmark.folder import Benchmark, Suite, Truth, read_footage
from torchsphere.benchmark.predictions import Prediction
from torchsphere.benchmark.score import KINDS, Score, score
from torchsphere.motion.ledger import INCREMENTS
from torchsphere.results.atomic_output import atomic_file
from torchsphere.results.spreadsheet import neutral_cell, plain_text

#: Values of the column ``rotation``; `NOT_VISIBLE` for a ball without a pattern.
MEASURED, NOT_MEASURED, NOT_VISIBLE = "measured", "not measured", "not to be seen"

#: Columns of the four mean errors, in the order of `score.KINDS`.
MEANS = tuple(f"{name}_{unit}" for name, unit, _ in KINDS)
_COMPONENTS = tuple(name.replace("_rad", "_deg") for name in INCREMENTS)

#: Columns of numbers.
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
_TEXTS = ("tracker", "suite", "checksum", "rotation")
COLUMNS = (*_TEXTS, *VALUES, "notes")


@dataclass(frozen=True)
class ScoreRow:
    """Scores of one tracker on one suite."""

    tracker: str
    suite: str
    checksum: str
    rotation: str  # `MEASURED`, `NOT_MEASURED` or `NOT_VISIBLE`
    values: Mapping[str, float]  # by the names in `VALUES`; NaN for unknown values
    notes: str  # sentences on missing predictions


def score_folder(benchmark: Benchmark, folder: Path, tracker: str, truth: Mapping[str, Truth]) -> list[ScoreRow]:
    """Score a folder of ``SUITE.csv`` files on the suites in ``truth``; a suite without a file counts as lost.

    Raises ValueError if no suite has a file, or if a file is invalid (`predictions.read`).
    """
    chosen = [suite for suite in benchmark if suite.name in truth]
    if not any((folder / f"{suite.name}.csv").is_file() for suite in chosen):
        raise ValueError(f"{folder}: holds no predictions; expected files such as {chosen[0].name}.csv, one per suite")
    rows = []
    for suite in chosen:
        path = folder / f"{suite.name}.csv"
        if path.is_file():
            prediction = predictions.read(path, suite)
        else:
            prediction = predictions.lost(suite, f"There is no {path.name}: every frame counts as lost.")
        rows.append(_score_row(suite, tracker, truth[suite.name], prediction))
    return rows


def score_file(suite: Suite, path: Path, tracker: str) -> ScoreRow:
    """Score the predictions for one suite; raises as `predictions.read` and `folder.read_footage`."""
    prediction = predictions.read(path, suite)
    return _score_row(suite, tracker, read_footage(suite).truth, prediction)


def _score_row(suite: Suite, tracker: str, truth: Truth, prediction: Prediction) -> ScoreRow:
    found = score(truth, prediction)
    rotation = NOT_MEASURED if not found.measures_rotation else MEASURED if truth.shows_rotation else NOT_VISIBLE
    return ScoreRow(tracker, suite.name, suite.checksum, rotation, _values(found), " ".join(prediction.notes))


def _values(found: Score) -> dict[str, float]:
    """The score's numbers by the names in `VALUES`."""
    parts = [v for kind in found.kinds for v in (kind.mean, kind.bias, kind.std)]
    components = np.stack((found.component_bias, found.component_std), 1).ravel().tolist()
    numbers = (
        100 * found.points,
        *parts,
        *components,
        *(found.drift_px, found.drift_deg),
        *(100 * found.lost, 100 * found.lost_rotation, 100 * found.silent),
        *(float(found.gone), 100 * found.gone_noticed),
        *(found.calibration_px.ratio, 100 * found.calibration_px.within),
        *(found.calibration_deg.ratio, 100 * found.calibration_deg.within),
        *(found.ms_per_pair, float(found.frames)),
    )
    return dict(zip(VALUES, numbers, strict=True))


def write(path: Path, rows: Sequence[ScoreRow]) -> None:
    """Write scores as CSV, whole or not at all; NaN is an empty cell."""
    with atomic_file(path) as stream:
        writer = csv.writer(stream, lineterminator="\n")
        writer.writerow(COLUMNS)
        for row in rows:
            numbers = (row.values[name] for name in VALUES)
            cells = ("" if math.isnan(value) else format(value, ".6g") for value in numbers)
            texts = map(neutral_cell, (row.tracker, row.suite, row.checksum, row.rotation))
            writer.writerow((*texts, *cells, neutral_cell(row.notes)))


def read(path: Path) -> list[ScoreRow]:
    """Read a file that `write` wrote; ValueError for any other file."""
    try:
        with path.open(newline="", encoding="utf-8") as stream:
            rows = list(csv.DictReader(stream))
    except (csv.Error, UnicodeDecodeError) as error:
        raise ValueError(f"{path}: is no CSV file in UTF-8 ({error}); score again") from error
    missing = [name for name in COLUMNS if not rows or rows[0].get(name) is None]
    if missing:
        raise ValueError(f"{path}: has no column {missing[0]!r}; expected a file of 'torchsphere benchmark score'")
    try:
        values = [{name: float(row[name] or "nan") for name in VALUES} for row in rows]
    except ValueError as error:
        raise ValueError(f"{path}: holds a word where a number belongs ({error}); score again") from error
    texts = [{name: plain_text(row[name] or "") for name in (*_TEXTS, "notes")} for row in rows]
    return [
        ScoreRow(text["tracker"], text["suite"], text["checksum"], text["rotation"], numbers, text["notes"])
        for text, numbers in zip(texts, values, strict=True)
    ]


def read_earlier(path: Path, benchmark: Benchmark, rows: Sequence[ScoreRow]) -> list[ScoreRow]:
    """Scores in an earlier file on the same images, without the trackers and suites of the new ``rows``."""
    if not path.is_file():
        return []
    images, new = {suite.name: suite.checksum for suite in benchmark}, {(row.tracker, row.suite) for row in rows}
    try:
        known = read(path)
    except ValueError:
        # A file of another version or a damaged file; its predictions can be scored again.
        return []
    return [row for row in known if images.get(row.suite) == row.checksum and (row.tracker, row.suite) not in new]
