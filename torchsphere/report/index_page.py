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

#: Columns of the table that stand first, in this order; all others follow in the order of the rows.
FIRST = ("recording", "state", "reason", "frames", "ok")

#: Columns that may hold the path of the result folder, relative to the index; they are not shown.
RESULT = ("result", "out")

#: Path of the thumbnail in a result folder.
THUMBNAIL = "figures/thumbnail.webp"


def write_index(out_dir: Path, rows: Sequence[Mapping[str, Any]]) -> Path:
    """Write ``index.html`` for the results of a batch, whole or not at all.

    Parameters
    ----------
    out_dir : Path
        Folder of the batch, which has the result folders.
    rows : sequence of mapping
        A row per recording: "recording", "state" ("done", "failed" or "pending"), "reason", "frames", "ok", "result"
        (path of the result folder, relative to ``out_dir`` or absolute), and further numbers with units in their
        names. A cell that is None, empty or NaN is shown as "not measured".

    Returns
    -------
    Path
        Path of the page.
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
    """The result folder of a row; None if it has none."""
    folders = (out_dir / str(row[name]) for name in (*RESULT, "recording") if row.get(name))
    return next((folder for folder in folders if (folder / "summary.json").is_file()), None)


def _columns(rows: Sequence[Mapping[str, Any]]) -> list[str]:
    seen = dict.fromkeys(name for row in rows for name in row)
    return [*(name for name in FIRST if name in seen), *(name for name in seen if name not in (*FIRST, *RESULT))]


def _cells(out_dir: Path, row: Mapping[str, Any], columns: Sequence[str]) -> dict[str, Any]:
    """A row for the script of the page: its values, and the relative addresses of report and thumbnail, or None."""
    folder = result_folder(out_dir, row)

    def address(name: str) -> str | None:
        path = None if folder is None else folder / name
        return quote(Path(os.path.relpath(path, out_dir)).as_posix()) if path is not None and path.is_file() else None

    cells = [_cell(row.get(name)) for name in columns]
    return {"cells": cells, "report": address("report.html"), "picture": address(THUMBNAIL)}


def _cell(value: Any) -> Any:
    """A number, also from its text, or a text; None if the cell is empty or not finite."""
    if isinstance(value, bool):
        return str(value).lower()
    try:
        number = float(value)
    except (TypeError, ValueError):
        return None if value is None else str(value) or None
    if not math.isfinite(number):
        return None
    return int(number) if number.is_integer() and abs(number) < 1e15 else number
