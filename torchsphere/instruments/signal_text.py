"""The text of a file of signals as a table: encoding, separator, decimal sign, names, units, and what stands above."""

from __future__ import annotations

import codecs
import csv
import re
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from torchsphere.instruments.delay import MIN_SAMPLES
from torchsphere.instruments.sample_times import is_clock_time
from torchsphere.instruments.units import are_units, in_brackets

#: Separators and decimal signs; the first one wins where several read a file alike.
DIALECTS = ((",", "."), (";", ","), (";", "."), ("\t", "."), ("\t", ","), (" ", "."), (" ", ","), (",", ","))

#: Separators in words.
_WORDS = {",": "commas", ";": "semicolons", "\t": "tabs", " ": "blanks"}

#: Lines at the end of a file that show its dialect and its columns.
_SHOWN_LINES = 200

#: Names, in lines above the numbers, of the interval and of the start of samples, s, and of the units of columns.
_INTERVALS = ("delta_x", "sample interval", "increment", "x increment")
_STARTS = ("x0", "start")
_UNITS = ("y_unit_label", "unit", "units", "vunit", "vertical units")

#: Beginnings of workbooks, new and old, and of LabVIEW's TDMS files.
_NO_TEXT = (b"PK\x03\x04", b"\xd0\xcf\x11\xe0", b"TDSm")

Row = list[str]


@dataclass(frozen=True)
class Column:
    """A column of a file: name, text of its unit ("" without), and cells (n,) with decimal points."""

    name: str
    unit: str
    cells: Sequence[str]


@dataclass(frozen=True)
class Table:
    """The columns that hold values, the numbers (n,) of their lines, and interval and start of samples if stated, s."""

    columns: tuple[Column, ...]
    lines: Sequence[int]
    interval_s: float | None
    start_s: float | None


@dataclass(frozen=True)
class _Text:
    """The lines of a file, their cells, the places of those that are neither remarks nor empty, and the dialect."""

    path: Path
    lines: list[str]
    rows: list[Row]
    with_values: list[int]
    separator: str
    decimal: str

    def refusal(self, row: int, expected: str) -> ValueError:
        """A refusal of a line."""
        return ValueError(f"{self.path}, line {row + 1}: expected {expected}, got {self.lines[row][:80]!r}")

    @property
    def dialect(self) -> str:
        """The dialect in words."""
        return f"parted by {_WORDS[self.separator]}, with decimal {'commas' if self.decimal == ',' else 'points'}"


def read_table(path: Path) -> Table:
    """The table of a file.

    Raises
    ------
    ValueError
        If the file is no text, or has a line without the numbers that the others have.
    OSError
        If the file cannot be read.
    """
    text = _read(path)
    places = _places([text.rows[i] for i in text.with_values[-_SHOWN_LINES:]])
    kept = _kept(text, places)
    above = [row for row in text.rows[: kept[0]] if any(row)]
    names, units = _names(above, places, text.separator == " ")
    columns = zip(*([text.rows[i][place] for place in places] for i in kept), strict=True)
    return Table(
        tuple(map(Column, names, units, columns)),
        [i + 1 for i in kept],
        _stated(above, _INTERVALS),
        _stated(above, _STARTS),
    )


def _read(path: Path) -> _Text:
    """The lines of a file and their cells."""
    lines = [line.strip("\x1a") for line in re.split("\r\n|\r|\n", _decoded(path))]
    remarks = [line.lstrip()[:1] in ("#", "%") for line in lines]
    with_values = [i for i, line in enumerate(lines) if line.strip() and not remarks[i]]
    shown = [lines[i] for i in with_values[-_SHOWN_LINES:]]
    separator, decimal = max(DIALECTS, key=lambda dialect: _readable(shown, *dialect))
    plain = [line.lstrip("#% ") if remark else line for line, remark in zip(lines, remarks, strict=True)]
    try:
        rows = list(_rows(plain, separator, decimal))
    except csv.Error as error:
        raise ValueError(f"{path}: is no CSV file ({error})") from None
    if len(rows) != len(lines):
        raise ValueError(f"{path}: has a quotation mark that is not closed; remove it")
    return _Text(path, lines, rows, with_values, separator, decimal)


def _decoded(path: Path) -> str:
    """The text of a file in UTF-8, UTF-16 or Latin-1."""
    data = path.read_bytes()
    encoding = "utf-8-sig"
    if data.startswith((codecs.BOM_UTF16_LE, codecs.BOM_UTF16_BE)):
        encoding = "utf-16"
    elif data[1:2] == b"\0":
        # Every second byte of Western text in UTF-16 is 0.
        encoding = "utf-16-le"
    try:
        text = data.decode(encoding)
    except UnicodeDecodeError:
        text = data.decode("latin-1")
    if "\0" in text or data.startswith(_NO_TEXT):
        raise ValueError(f"{path}: is no text; export the signals as text (CSV)")
    return text.replace("∞", "inf")


def _rows(lines: Sequence[str], separator: str, decimal: str) -> list[Row]:
    """The cells of lines, without blanks around them, with decimal points."""
    if separator == " ":
        # A unit belongs to the name before it: "Time (s)".
        lines = [re.sub(r"\s+(?=[\[(<])", "", line).replace("\t", " ") for line in lines]
    rows = csv.reader(lines, delimiter=separator, skipinitialspace=True)
    return [[cell.strip().replace(decimal, ".") for cell in row] for row in rows]


def _readable(lines: Sequence[str], separator: str, decimal: str) -> int:
    """How many more values than other texts lines have in a dialect."""
    try:
        rows = _rows(lines, separator, decimal)
    except csv.Error:
        return -len(lines)
    cells = [cell for row in rows for cell in row if cell]
    # 0,05 is one number with a decimal comma: 05 is none.
    if separator == "," and any(re.fullmatch(r"0\d+", cell) for row in rows for cell in row[1:]):
        return -len(cells)
    return 2 * sum(map(_is_value, cells)) - len(cells)


def is_number(text: str) -> bool:
    """Whether Python reads a number from a text."""
    try:
        float(text)
    except ValueError:
        return False
    return True


def _is_value(cell: str) -> bool:
    return is_number(cell) or is_clock_time(cell)


def _places(rows: Sequence[Row]) -> list[int]:
    """Places of the columns that hold values in most rows."""
    most = max(map(len, rows), default=0)
    return [
        place
        for place in range(most)
        if 2 * sum(place < len(row) and _is_value(row[place]) for row in rows) > len(rows)
    ]


def _holds(row: Row, places: Sequence[int]) -> bool:
    """Whether a row has a value in all places."""
    return len(row) > places[-1] and all(_is_value(row[place]) for place in places) if places else False


def _kept(text: _Text, places: Sequence[int]) -> list[int]:
    """Rows from the first few on that hold values one after the other; raises where one has more or fewer cells."""
    rows = [text.rows[i] for i in text.with_values]
    holds = (k for k in range(len(rows)) if all(_holds(row, places) for row in rows[k : k + MIN_SAMPLES]))
    first = next(holds, None)
    if first is None:
        raise text.refusal(
            text.with_values[-1] if rows else 0, "columns of numbers, parted by commas, semicolons, tabs or blanks"
        )
    # Other numbers above have words beside them; else a line between the first ones is damaged.
    filled = [{place for place, cell in enumerate(row) if cell} for row in rows[: first + 1]]
    alike = any(_holds(row, places) and cells == filled[-1] for row, cells in zip(rows, filled[:-1], strict=False))
    begins = first > 0 and any(map(is_number, rows[first - 1][places[0] : places[0] + 1]))
    usual = Counter(map(len, rows[-_SHOWN_LINES:])).most_common(1)[0][0]
    uneven = (k for k in range(first, len(rows)) if len(rows[k]) <= places[-1] or any(map(_is_value, rows[k][usual:])))
    wrong = first - 1 if begins or alike else next(uneven, None)
    if wrong is not None:
        raise text.refusal(text.with_values[wrong], f"{len(places)} numbers as in the other lines, {text.dialect}")
    return text.with_values[first:]


def _names(above: Sequence[Row], places: Sequence[int], exact: bool) -> tuple[list[str], list[str]]:
    """Names and units of the columns by the lines above the numbers; ``exact`` where any text has several cells."""

    def cells(row: Row) -> list[str]:
        return [row[place] if place < len(row) else "" for place in places]

    def has_names(row: Row) -> bool:
        fits = len(row) == places[-1] + 1 if exact else len(row) > places[-1]
        return fits and all(cell and (cell.isdigit() or not _is_value(cell)) for cell in cells(row))

    unknown = [f"column {place + 1}" for place in places]
    below = [cell for cell in cells(above[-1]) if cell] if above else []
    if len(above) > 1 and are_units(below) and has_names(above[-2]):
        return cells(above[-2]), [in_brackets(cell) or cell for cell in cells(above[-1])]
    keyed = next((row for row in above if row[0].lower() in _UNITS), [])
    units = ["" if place == 0 else cell for place, cell in zip(places, cells(keyed), strict=True)]
    names = cells(above[-1]) if above and has_names(above[-1]) else unknown
    return names, [in_brackets(name) or unit for name, unit in zip(names, units, strict=True)]


def _stated(above: Sequence[Row], names: Sequence[str]) -> float | None:
    """The number to the right of a name above the columns, or else below it."""
    for i, row in enumerate(above):
        for k, cell in enumerate(row):
            if cell.lower() in names:
                beside = [*row[k + 1 : k + 2], *(below[k] for below in above[i + 1 : i + 2] if k < len(below))]
                for text in beside:
                    if is_number(text):
                        return float(text)
    return None
