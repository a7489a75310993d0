"""``index.html`` of a batch: a table that can be sorted and searched, with a small picture of every recording."""

from __future__ import annotations

import csv
import os
import tempfile
from collections import Counter
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any
from urllib.parse import quote

from torchsphere.report.report_page import HERE, embedded, fill

#: Columns that stand first, in this order, where rows have them; then all others in their own order.
FIRST = ("recording", "state", "reason", "frames", "ok")

#: Columns that lead to a row's result folder, relative to the index; the first that a row has counts.
RESULT = ("result", "out")

#: Where a small picture is, in a result folder.
THUMBNAIL = "figures/thumbnail.webp"


def write_index(out_dir: Path, rows: Sequence[Mapping[str, Any]]) -> Path:
    """Write ``index.html`` for the results of a batch; whole or not at all.

    Parameters
    ----------
    out_dir : Path
        Folder of the batch; the results lie in it.
    rows : sequence of mapping
        One per recording: "recording", "state" ("done", "failed" or "pending"), "reason", "frames", "ok", "result"
        (path of the result folder, relative to ``out_dir`` or absolute), and any further numbers, with units in their
        names. Cells may be None, empty or NaN: they are shown as "not measured".

    Returns
    -------
    Path
        The page.
    """
    columns = _columns(rows)
    states = Counter(str(row.get("state", "")) for row in rows)
    texts = [f"{states[name]} {name}" for name in ("done", "failed", "pending") if states[name]]
    data = {"columns": columns, "rows": [_cells(out_dir, row, columns) for row in rows]}
    page = fill(
        "index.html",
        grade="bad" if states["failed"] else "part" if states["pending"] else "good",
        style=(HERE / "base.css").read_text(encoding="utf-8") + (HERE / "index.css").read_text(encoding="utf-8"),
        script=(HERE / "index.js").read_text(encoding="utf-8"),
        data=embedded(data),
        verdict=f"{len(rows)} recordings: {', '.join(texts)}." if rows else "There are no recordings yet.",
    )
    handle, name = tempfile.mkstemp(prefix=".index.", dir=out_dir)
    with os.fdopen(handle, "w", encoding="utf-8") as stream:
        stream.write(page)
    new, path = Path(name), out_dir / "index.html"
    new.chmod(0o644)
    new.replace(path)
    return path


def read_rows(out_dir: Path) -> list[dict[str, str]]:
    """The rows of a batch's ``summary.csv``."""
    with (out_dir / "summary.csv").open(newline="", encoding="utf-8") as stream:
        return list(csv.DictReader(stream))


def result_folder(out_dir: Path, row: Mapping[str, Any]) -> Path | None:
    """The result folder of a row; None where there is none."""
    for name in (*RESULT, "recording"):
        where = row.get(name)
        if where and (out_dir / str(where) / "summary.json").is_file():
            return out_dir / str(where)
    return None


def _columns(rows: Sequence[Mapping[str, Any]]) -> list[str]:
    seen = dict.fromkeys(name for row in rows for name in row)
    return [*(name for name in FIRST if name in seen), *(name for name in seen if name not in (*FIRST, *RESULT))]


def _cells(out_dir: Path, row: Mapping[str, Any], columns: Sequence[str]) -> dict[str, Any]:
    """One row for the page: its values, and relative addresses of report and picture where they exist."""
    folder = result_folder(out_dir, row)
    address = None if folder is None else quote(Path(os.path.relpath(folder, out_dir)).as_posix())
    report = folder is not None and (folder / "report.html").is_file()
    picture = folder is not None and (folder / THUMBNAIL).is_file()
    return {
        "cells": [_cell(row.get(name)) for name in columns],
        "report": f"{address}/report.html" if report else None,
        "picture": f"{address}/{THUMBNAIL}" if picture else None,
    }


def _cell(value: Any) -> Any:
    """A number as such, also where it stands as text; None where there is nothing."""
    if value is None or isinstance(value, bool):
        return None if value is None else str(value).lower()
    try:
        number = float(value)
    except (TypeError, ValueError):
        return str(value) or None
    if number != number or number in (float("inf"), float("-inf")):
        return None
    return int(number) if number.is_integer() and abs(number) < 1e15 else number
