"""The CSV that predictions come in: lines ``# key: value``, a line of column names, a row per frame."""

from __future__ import annotations

import csv
import math
from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from torchsphere.results.atomic_output import atomic_file

Array = NDArray[np.float64]

PLACE = ("x_px", "y_px")
QUATERNION = ("qw", "qx", "qy", "qz")
SHIFT = ("dx_px", "dy_px")
TURN = ("wx_rad", "wy_rad", "wz_rad")
STEP = (*SHIFT, *TURN)
SD = tuple(f"sd_{name}" for name in (*PLACE, *STEP))

#: Every column of numbers that is read.
NUMBERS = (*PLACE, *QUATERNION, *STEP, "radius_px", *SD, "ms")
TEXTS = ("suite", "status")
#: Columns of a `track.csv` of ``torchsphere track`` that say nothing here, so that the file is taken as it is.
IGNORED = ("time_s", "zncc", "iterations")
KNOWN = ("frame", *TEXTS, *NUMBERS, *IGNORED)

#: What a value that is not known may read as, in small letters.
BLANK = ("", "nan", "na", "none", "null")


@dataclass(frozen=True)
class Table:
    """A file of predictions as it stands, in the order of its rows.

    Attributes
    ----------
    keys : mapping
        What the lines ``# key: value`` say, the keys in small letters.
    frames : tuple of int
        Frame (m,) of each row, none twice.
    numbers : mapping
        Columns (m,) by name; NaN where a value is empty.
    texts : mapping
        Columns of words (m,) by name.
    """

    keys: Mapping[str, str]
    frames: tuple[int, ...]
    numbers: Mapping[str, Array]
    texts: Mapping[str, tuple[str, ...]]


def read(path: Path) -> Table:
    """Read a file of predictions.

    Raises
    ------
    ValueError
        In one sentence on the first thing that is wrong: no header, unknown columns or none that can be scored, a row
        that is too short or too long, a word where a number belongs, an infinite number, a frame that is there twice.
    OSError
        If it cannot be read.
    """
    try:
        lines = path.read_text(encoding="utf-8-sig").splitlines()
    except UnicodeDecodeError as error:
        raise ValueError(f"{path}: is no text in UTF-8; expected a CSV with a row per frame") from error
    numbered = [(k, line) for k, line in enumerate(lines, start=1) if line.strip()]
    keys = dict(_key(line) for _, line in numbered if line.startswith("#") and ":" in line)
    rows = [(k, next(csv.reader([line]))) for k, line in numbered if not line.startswith("#")]
    if not rows:
        raise ValueError(f"{path}: is empty; expected a line of column names and a row per frame")
    names = [name.strip() for name in rows[0][1]]
    _check_names(path, names)
    for k, row in rows[1:]:
        if len(row) != len(names):
            raise ValueError(f"{path}, line {k}: {len(row)} values for {len(names)} columns; give one for each, or ','")
    columns = {name: [(k, row[at].strip()) for k, row in rows[1:]] for at, name in enumerate(names)}
    frames = tuple(_frame(path, k, text) for k, text in columns["frame"])
    twice = sorted(frame for frame, count in Counter(frames).items() if count > 1)
    if twice:
        raise ValueError(f"{path}: frame {twice[0]} is there more than once; give one row per frame")
    numbers = {
        name: np.array([_number(path, k, name, text) for k, text in columns[name]], dtype=np.float64)
        for name in names
        if name in NUMBERS
    }
    texts = {name: tuple(text for _, text in columns[name]) for name in names if name in TEXTS}
    return Table(keys, frames, numbers, texts)


def write(path: Path, keys: Mapping[str, str], columns: Mapping[str, Sequence[float | int | str]]) -> None:
    """Write a file of predictions, whole or not at all; ``columns`` of one length by name, ``frame`` among them."""
    with atomic_file(path) as stream:
        for key, value in keys.items():
            stream.write(f"# {key}: {' '.join(str(value).split())}\n")
        writer = csv.writer(stream, lineterminator="\n")
        writer.writerow(columns)
        writer.writerows(zip(*(map(_text, column) for column in columns.values()), strict=True))


def columns_of(table: Table, names: Sequence[str]) -> Array:
    """Columns side by side (n, len(names)); NaN for one that is not there."""
    return np.stack([table.numbers.get(name, np.full(len(table.frames), np.nan)) for name in names], 1)


def _key(line: str) -> tuple[str, str]:
    key, _, value = line.lstrip("#").partition(":")
    return key.strip().lower(), value.strip()


def _check_names(path: Path, names: Sequence[str]) -> None:
    """ValueError unless a prediction can be read from columns of these names."""
    if "frame" not in names:
        raise ValueError(f"{path}: has no column 'frame', only {_list(names)}; number the frames from 0")
    unknown = [name for name in names if name not in KNOWN]
    if unknown:
        raise ValueError(f"{path}: unknown column {unknown[0]!r}; expected some of {', '.join(KNOWN)}")
    if len(set(names)) < len(names):
        raise ValueError(f"{path}: a column is there twice in {_list(names)}; leave one out")
    if not (set(PLACE) <= set(names) or set(SHIFT) <= set(names)):
        raise ValueError(f"{path}: has neither x_px and y_px nor dx_px and dy_px, only {_list(names)}; give one pair")
    if set(QUATERNION) & set(names) and not set(QUATERNION) <= set(names):
        raise ValueError(f"{path}: has some of qw, qx, qy, qz only; give all four, or none where none is measured")


def _list(names: Iterable[str]) -> str:
    return ", ".join(names)


def _frame(path: Path, line: int, text: str) -> int:
    try:
        value = float(text)
    except ValueError:
        value = math.nan
    if not (value >= 0 and value == math.floor(value) and math.isfinite(value)):
        raise ValueError(f"{path}, line {line}: frame {text!r} is no number of a frame; count from 0")
    return int(value)


def _number(path: Path, line: int, name: str, text: str) -> float:
    if text.lower() in BLANK:
        return math.nan
    try:
        value = float(text)
    except ValueError as error:
        raise ValueError(
            f"{path}, line {line}: {name} = {text!r} is no number; leave it empty where not known"
        ) from error
    if math.isinf(value):
        raise ValueError(f"{path}, line {line}: {name} is infinite; leave it empty where it is not known")
    return value


def _text(value: float | int | str) -> str:
    """A cell: numbers to their last bit, nothing where a number is not known."""
    if isinstance(value, str):
        return value
    if isinstance(value, int):
        return str(value)
    return "" if math.isnan(value) else repr(float(value))
