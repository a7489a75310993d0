"""The CSV file of predictions: lines ``# key: value``, a line of column names, a row per frame."""

from __future__ import annotations

import csv
import math
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from torchsphere.motion.ledger import INCREMENTS
from torchsphere.results.atomic_output import atomic_file
from torchsphere.runtime.arrays import Array

POSITION = ("x_px", "y_px")
QUATERNION = ("qw", "qx", "qy", "qz")
TRANSLATION, ROTATION = INCREMENTS[:2], INCREMENTS[2:]
SD = tuple(f"sd_{name}" for name in (*POSITION, *INCREMENTS))

#: Every column of numbers that is read.
NUMBERS = (*POSITION, *QUATERNION, *INCREMENTS, "radius_px", *SD, "ms")
TEXTS = ("suite", "status")
#: Columns of a ``track.csv`` that are accepted and not read.
IGNORED = ("time_s", "zncc", "iterations")
KNOWN = ("frame", *TEXTS, *NUMBERS, *IGNORED)

#: Texts of an unknown value, in small letters.
BLANK = ("", "nan", "na", "none", "null")


@dataclass(frozen=True)
class Table:
    """A file of predictions, m rows in the order of the file."""

    keys: Mapping[str, str]  # of the lines ``# key: value``, keys in small letters
    frames: tuple[int, ...]  # (m,), each once
    numbers: Mapping[str, Array]  # columns (m,) by name; NaN for an empty value
    texts: Mapping[str, tuple[str, ...]]  # columns (m,) by name


def read(path: Path) -> Table:
    """Read a file of predictions; ValueError, in one sentence, if a name, a value or a frame is invalid."""
    try:
        lines = path.read_text(encoding="utf-8-sig").splitlines()
        numbered = [(k, line) for k, line in enumerate(lines, start=1) if line.strip()]
        keys = dict(_key(line) for _, line in numbered if line.startswith("#") and ":" in line)
        rows = [(k, next(csv.reader([line]))) for k, line in numbered if not line.startswith("#")]
    except (UnicodeDecodeError, csv.Error) as error:
        raise ValueError(f"{path}: is no text in UTF-8 ({error}); expected a CSV with a row per frame") from error
    if not rows:
        raise ValueError(f"{path}: is empty; expected a line of column names and a row per frame")
    names = [name.strip() for name in rows[0][1]]
    _check_names(path, names)
    for k, row in rows[1:]:
        if len(row) != len(names):
            raise ValueError(f"{path}, line {k}: {len(row)} values for {len(names)} columns; give one for each, or ','")
    columns = {name: [(k, row[i].strip()) for k, row in rows[1:]] for i, name in enumerate(names)}
    frames = tuple(_frame(path, k, text) for k, text in columns["frame"])
    twice = sorted(frame for frame, count in Counter(frames).items() if count > 1)
    if twice:
        raise ValueError(f"{path}: has frame {twice[0]} more than once; give one row per frame")
    numbers = {
        name: np.array([_number(path, k, name, text) for k, text in columns[name]], dtype=np.float64)
        for name in names
        if name in NUMBERS
    }
    texts = {name: tuple(text for _, text in columns[name]) for name in names if name in TEXTS}
    return Table(keys, frames, numbers, texts)


def write(path: Path, keys: Mapping[str, str], columns: Mapping[str, Sequence[float | int | str]]) -> None:
    """Write a file of predictions whole or not at all; ``columns`` of equal length by name, with ``frame``."""
    with atomic_file(path) as stream:
        for key, value in keys.items():
            stream.write(f"# {key}: {' '.join(str(value).split())}\n")
        writer = csv.writer(stream, lineterminator="\n")
        writer.writerow(columns)
        writer.writerows(zip(*(map(_cell, column) for column in columns.values()), strict=True))


def columns_of(table: Table, names: Sequence[str]) -> Array:
    """Columns side by side (m, len(names)); NaN for a column that is missing."""
    return np.stack([table.numbers.get(name, np.full(len(table.frames), np.nan)) for name in names], 1)


def _key(line: str) -> tuple[str, str]:
    key, _, value = line.lstrip("#").partition(":")
    return key.strip().lower(), value.strip()


def _check_names(path: Path, names: Sequence[str]) -> None:
    """ValueError unless the columns of these names are a prediction."""
    listed, present = ", ".join(names), set(names)
    if "frame" not in present:
        raise ValueError(f"{path}: has no column 'frame', only {listed}; number the frames from 0")
    unknown = [name for name in names if name not in KNOWN]
    if unknown:
        raise ValueError(f"{path}: unknown column {unknown[0]!r}; expected some of {', '.join(KNOWN)}")
    if len(present) < len(names):
        raise ValueError(f"{path}: has a column twice in {listed}; leave one out")
    if not (present >= set(POSITION) or present >= set(TRANSLATION)):
        raise ValueError(f"{path}: has neither x_px and y_px nor dx_px and dy_px, only {listed}; give one pair")
    if present & set(QUATERNION) and not present >= set(QUATERNION):
        raise ValueError(f"{path}: has some of qw, qx, qy, qz only; give all four, or none if none is measured")


def _frame(path: Path, line: int, text: str) -> int:
    try:
        value = float(text)
    except ValueError:
        value = math.nan
    if not (value >= 0 and value == math.floor(value) and math.isfinite(value)):
        raise ValueError(f"{path}, line {line}: frame {text!r} is no frame number; count from 0")
    return int(value)


def _number(path: Path, line: int, name: str, text: str) -> float:
    if text.lower() in BLANK:
        return math.nan
    try:
        value = float(text)
    except ValueError as error:
        raise ValueError(f"{path}, line {line}: {name} = {text!r} is no number; leave unknown values empty") from error
    if math.isinf(value):
        raise ValueError(f"{path}, line {line}: {name} is infinite; leave unknown values empty")
    return value


def _cell(value: float | int | str) -> str:
    """A number with all its digits, empty for NaN."""
    if isinstance(value, (str, int)):
        return str(value)
    return "" if math.isnan(value) else repr(float(value))
