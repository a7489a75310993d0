"""``index.html`` of a batch: a table to sort and to search, with a thumbnail of every recording."""

from __future__ import annotations

import csv
import math
import os
from collections import Counter
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any
from urllib.parse import quote

from torchsphere.report.templating import page
from torchsphere.results.atomic_output import atomic_file

#: First columns of the table; all others follow in the order of the rows.
FIRST_COLUMNS = ("recording", "state", "reason", "frames", "ok")

#: Columns with the path of the result folder, relative to the index; the page does not show them.
RESULT_COLUMNS = ("result", "out")


def write_index(out_dir: Path, rows: Sequence[Mapping[str, Any]]) -> Path:
    """Write ``index.html`` for the results of a batch, whole or not at all, and return its path.

    A row per recording has "recording", "state" ("done", "failed" or "pending"), "reason", "frames", "ok", "result"
    (the result folder, relative to ``out_dir`` or absolute), and further numbers with units in their names. The page
    shows "not measured" in a cell that is None, empty or NaN.
    """
    columns = _columns(rows)
    states = Counter(str(row.get("state", "")) for row in rows)
    counts = ", ".join(f"{states[name]} {name}" for name in ("done", "failed", "pending") if states[name])
    html = page(
        "index.html",
        title="Recordings",
        grade="bad" if states["failed"] else "part" if states["pending"] else "good",
        verdict=f"{len(rows)} recordings: {counts}." if rows else "There are no recordings yet.",
        data={"columns": columns, "rows": [_cells(out_dir, row, columns) for row in rows]},
    )
    with atomic_file(out_dir / "index.html") as stream:
        stream.write(html)
    return out_dir / "index.html"


def read_rows(out_dir: Path) -> list[dict[str, str]]:
    """Rows of the ``summary.csv`` of a batch."""
    with (out_dir / "summary.csv").open(newline="", encoding="utf-8") as stream:
        return list(csv.DictReader(stream))


def result_folder(out_dir: Path, row: Mapping[str, Any]) -> Path | None:
    """The result folder of a row; None if there is none."""
    folders = (out_dir / str(row[name]) for name in (*RESULT_COLUMNS, "recording") if row.get(name))
    return next((folder for folder in folders if (folder / "summary.json").is_file()), None)


def _columns(rows: Sequence[Mapping[str, Any]]) -> list[str]:
    seen = dict.fromkeys(name for row in rows for name in row)
    return [
        *(name for name in FIRST_COLUMNS if name in seen),
        *(name for name in seen if name not in (*FIRST_COLUMNS, *RESULT_COLUMNS)),
    ]


def _cells(out_dir: Path, row: Mapping[str, Any], columns: Sequence[str]) -> dict[str, Any]:
    """A row for the page's script: values, and relative addresses of report and thumbnail, None if they are missing."""
    folder = result_folder(out_dir, row)

    def address(name: str) -> str | None:
        path = None if folder is None else folder / name
        return quote(Path(os.path.relpath(path, out_dir)).as_posix()) if path is not None and path.is_file() else None

    cells = [_cell(row.get(name)) for name in columns]
    return {"cells": cells, "report": address("report.html"), "picture": address("figures/thumbnail.webp")}


def _cell(value: Any) -> Any:
    """A number, which may be given as text, or a text; None if the cell is empty or not finite."""
    if isinstance(value, bool):
        return str(value).lower()
    try:
        number = float(value)
    except (TypeError, ValueError):
        return None if value is None else str(value) or None
    if not math.isfinite(number):
        return None
    return int(number) if number.is_integer() and abs(number) < 1e15 else number
