"""HTML pages from the Jinja templates in ``templates/``: the report of a result, and the index of a batch.

Each page is a single file; the report loads no other file. Styles and scripts are templates, too: ``{{``, ``{%`` and
``{#`` have Jinja's meaning in them.
"""

from __future__ import annotations

import base64
import csv
import functools
import json
import math
import os
import re
from collections import Counter
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any
from urllib.parse import quote

import numpy as np
from numpy.typing import NDArray

from torchsphere.motion.track import why_unusable
from torchsphere.report import explanations, summary_tables
from torchsphere.report.answer import answer
from torchsphere.report.figure_style import STATUS_COLOURS
from torchsphere.report.file_links import file_links
from torchsphere.report.force_figure import force_unit, law_curve
from torchsphere.report.image_figures import residual_limit
from torchsphere.report.time_series import TimeSeries, abscissa, time_series
from torchsphere.results.atomic_output import atomic_file
from torchsphere.results.reader import ResultFolder
from torchsphere.results.sampled_frames import NO_RESIDUAL, Sampled, encode_webp, rows_to_keep
from torchsphere.results.spreadsheet import plain_text
from torchsphere.runtime.warning_levels import CAUTION, NOTE, SEVERE

if TYPE_CHECKING:
    from jinja2 import Environment

#: Most frames at even distances in a plot of a longer recording, besides all frames with an image
#: (docs/constants.toml).
MAX_PLOTTED = 2000

#: Longest side of a residual map in the page, px, and its WebP quality.
MAP_PX, MAP_QUALITY = 72, 75

#: Grey level of a residual of 0, and grey levels from there to the limit. Level 0 means "no residual": no residual lies
#: near it, because the compression blurs its edges.
MAP_MIDDLE, MAP_REACH = 148, 100

#: First columns of the table; all others follow in the order of the rows.
FIRST_COLUMNS = ("recording", "state", "reason", "frames", "ok")

#: Columns with the path of the result folder, relative to the index; the page does not show them.
RESULT_COLUMNS = ("result", "out")


#: Folder with the templates that all pages share.
TEMPLATES = Path(__file__).parent / "templates"


def page(template: str, folder: Path = TEMPLATES, **values: Any) -> str:
    """The page of a ``template``, which escapes all ``values``, in its scripts as well.

    Templates come from the ``folder`` or from the `TEMPLATES` that all pages share. Raises ValueError if ``data`` for a
    script holds NaN or infinity, which JSON does not have.
    """
    return _environment(folder).get_template(template).render(values)


@functools.cache
def _environment(folder: Path) -> Environment:
    from jinja2 import Environment, FileSystemLoader, StrictUndefined

    environment = Environment(
        loader=FileSystemLoader([folder, TEMPLATES]),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
        keep_trailing_newline=True,
    )
    environment.policies["json.dumps_kwargs"] = {"allow_nan": False, "separators": (",", ":")}
    environment.filters["split_at_options"] = re.compile(r"(--[a-z][a-z-]*)").split
    return environment


def report_html(result: ResultFolder) -> str:
    """The report of a result as HTML."""
    summary = result.summary
    all_measured, unusable = bool((result.status == "ok").all()), bool(why_unusable(result.status))
    return page(
        "report.html",
        title=Path(summary["input"]["path"]).name,
        grade="bad" if unusable else "good" if all_measured else "part",
        verdict=explanations.verdict(result),
        problems=explanations.problems(result),
        missing_inputs=explanations.missing_inputs(result),
        answer=answer(result),
        severe=explanations.warnings(result, SEVERE),
        cautions=explanations.warnings(result, CAUTION),
        remarks=explanations.warnings(result, NOTE),
        sections=summary_tables.sections(result),
        budget=summary_tables.budget_table(result),
        ledger=summary_tables.ledger_table(result),
        energy=summary_tables.energy_table(result),
        has_force_path=result.force_path is not None,
        files=file_links(result),
        settings=_settings(summary),
        version=summary.get("versions", {}).get("torchsphere", ""),
        data=_script_data(result),
    )


def _settings(summary: dict[str, Any]) -> dict[str, str]:
    """Settings, facts of the input, versions and the method of differentiation: names and texts."""

    def text(value: Any) -> str:
        if value is None:
            return "not given"
        return json.dumps(value, ensure_ascii=False) if isinstance(value, (dict, list)) else str(value)

    sections = ("settings", "input", "versions", "differentiation")
    return {f"{name}.{key}": text(v) for name in sections for key, v in (summary.get(name) or {}).items()}


def _script_data(result: ResultFolder) -> dict[str, Any]:
    """Data for the page's scripts; unknown numbers are None."""
    sampled = result.sampled
    with_image = rows_to_keep(result.status, result.zncc) if sampled is None else sampled.row
    rows = np.arange(len(result.frame))
    if len(rows) > MAX_PLOTTED:
        rows = np.union1d(np.linspace(0, len(rows) - 1, MAX_PLOTTED).round().astype(np.int64), with_image)
    time, contact = abscissa(result), result.contact_s
    spin = result.increment[:, 2:] if result.motion is None else result.motion.spin_rad_s * result.axis_signs
    statuses = list(STATUS_COLOURS)
    return {
        "forcePath": _force_path(result),
        "frame": result.frame[rows].tolist(),
        "where": numbers(time.values[rows], 9),
        "abscissa": {"title": time.title, "unit": time.unit},
        "contact": None if contact is None or time.per_second is None else [time.per_second * t for t in contact],
        "status": [statuses.index(status) for status in result.status[rows]],
        "statuses": [_status(result, name) for name in statuses],
        "position": numbers(result.position[rows], 7),
        "radius": numbers(result.radius[rows], 7),
        "quaternion": numbers(result.quaternion[rows], 7),
        "zncc": numbers(result.zncc[rows], 6),
        # In the camera frame, rad/s or rad per frame: the page shows the direction alone.
        "spin": numbers(spin[rows], 6),
        "lab": result.lab_frame,
        "panels": [_panel(result, series, rows) for series in time_series(result)],
        # Rows at which the page can stop: the rows with an image, or all rows if no images were kept.
        "shown": list(range(len(rows))) if sampled is None else np.searchsorted(rows, with_image).tolist(),
        "total": len(result.frame),
        "images": None if sampled is None else _images(sampled),
    }


def _status(result: ResultFolder, name: str) -> dict[str, Any]:
    return {
        "name": name.replace("_", " "),
        "colour": STATUS_COLOURS[name],
        "count": int((result.status == name).sum()),
        "meaning": explanations.meaning_and_remedy(result, name)[0],
    }


def _panel(result: ResultFolder, series: TimeSeries, rows: NDArray[np.int64]) -> dict[str, Any]:
    return {
        "key": series.key,
        "title": series.title,
        "unit": series.unit,
        "names": series.components,
        "why": explanations.why_empty(result, series.key) if series.is_empty else "",
        "values": numbers(series.values[rows].T, 7),
        "raw": _raw(series, rows, abscissa(result).per_second),
        "sd": None if series.sd is None else numbers(series.sd[rows].T, 3),
    }


def _force_path(result: ResultFolder) -> dict[str, Any] | None:
    """Force against penetration of the strongest impact, mm and the figure's unit of force."""
    path = result.force_path
    if path is None:
        return None
    unit, factor = force_unit(path)
    law = law_curve(path, result.summary["impact"])
    return {
        "unit": unit,
        "loading": path.is_loading.tolist(),
        "depth": numbers(1e3 * path.penetration_m, 5),
        "force": numbers(factor * path.force_N, 5),
        "sdForce": numbers(factor * path.sd_force_N, 3),
        "law": None if law is None else [numbers(1e3 * law[0][::5], 5), numbers(factor * law[1][::5], 5)],
    }


def _raw(series: TimeSeries, rows: NDArray[np.int64], per_second: float | None) -> dict[str, Any] | None:
    """Raw differences at the plotted ``rows``, or at the interval after each."""
    raw = series.raw
    if raw is None or per_second is None:
        return None
    kept = np.unique(rows.clip(max=len(raw.time_s) - 1))
    return {"where": numbers(per_second * raw.time_s[kept], 9), "values": numbers(raw.values[kept].T, 5)}


def _images(sampled: Sampled) -> dict[str, Any]:
    limit = residual_limit(sampled)
    return {
        "box": sampled.box,
        "frames": [_uri(image) for image in sampled.webp],
        "maps": [_map(sampled, i, limit) if there else None for i, there in enumerate(sampled.has_residual)],
        "mapMiddle": MAP_MIDDLE,
        "mapReach": MAP_REACH,
        "mapWidth": sampled.residual.shape[-1] * sampled.residual_bin,
        "limit": limit,
    }


def _map(sampled: Sampled, i: int, limit: float) -> str:
    """Residual map ``i`` as grey levels around `MAP_MIDDLE`."""
    from PIL import Image

    units = sampled.residual[i].astype(np.float32) * (sampled.residual_step / limit)
    grey = MAP_MIDDLE + MAP_REACH * units.clip(-1, 1)
    grey[sampled.residual[i] == NO_RESIDUAL] = 0
    image = Image.fromarray(grey.round().astype(np.uint8))
    if max(image.size) > MAP_PX:
        image = image.resize((MAP_PX, MAP_PX), Image.Resampling.NEAREST)
    return _uri(encode_webp(image, quality=MAP_QUALITY, method=1))


def _uri(webp: bytes) -> str:
    return "data:image/webp;base64," + base64.b64encode(webp).decode("ascii")


def numbers(values: NDArray[Any], digits: int) -> list[Any]:
    """Nested lists of numbers with so many digits; None for NaN and infinity."""
    if values.ndim > 1:
        return [numbers(row, digits) for row in values]
    return [float(f"{v:.{digits}g}") if math.isfinite(v) else None for v in values.tolist()]


def write_index(out_dir: Path, rows: Sequence[Mapping[str, Any]], *, is_growing: bool = False) -> Path:
    """Write ``index.html`` for the results of a batch, whole or not at all, and return its path.

    A row per recording has "recording", "state" ("done", "unusable", "failed" or "pending"), "reason", "frames", "ok",
    "severe_warnings", "result" (the result folder, relative to ``out_dir`` or absolute), and further numbers with units
    in their names. The page shows "not measured" in a cell that is None, empty or NaN. ``is_growing`` says that the run
    goes on.
    """
    names = dict.fromkeys(name for row in rows for name in row)
    columns = [name for name in FIRST_COLUMNS if name in names]
    columns += [name for name in names if name not in (*FIRST_COLUMNS, *RESULT_COLUMNS)]
    states = Counter(str(row.get("state", "")) for row in rows)
    severe = sum(row.get("state") == "done" and bool(_cell(row.get("severe_warnings"))) for row in rows)
    texts = {name: f"{states[name]} {name}" for name in ("done", "unusable", "failed", "pending") if states[name]}
    if severe:
        texts["done"] += f" ({severe} of them with severe warnings)"
    verdict = f"{len(rows)} recordings: {', '.join(texts.values())}." if rows else "There are no recordings yet."
    growing = " The run goes on: load the page again to see what is new." if is_growing else ""
    is_bad = states["failed"] or states["unusable"] or severe
    html = page(
        "index.html",
        title="Recordings",
        grade="bad" if is_bad else "part" if states["pending"] else "good",
        verdict=verdict + growing,
        data={"columns": columns, "rows": [_cells(out_dir, row, columns) for row in rows]},
    )
    with atomic_file(out_dir / "index.html") as stream:
        stream.write(html)
    return out_dir / "index.html"


def read_rows(out_dir: Path) -> list[dict[str, str]]:
    """Rows of the ``summary.csv`` of a batch."""
    path = out_dir / "summary.csv"
    try:
        with path.open(newline="", encoding="utf-8") as stream:
            rows = list(csv.DictReader(stream))
    except (csv.Error, UnicodeDecodeError) as error:
        raise ValueError(f"{path}: is no CSV file in UTF-8 ({error}); run the batch again") from error
    # Cells beyond the columns have no name; a row that ends early has cells of None.
    return [{name: plain_text(cell or "") for name, cell in row.items() if name is not None} for row in rows]


def result_folder(out_dir: Path, row: Mapping[str, Any]) -> Path | None:
    """The result folder of a row; None if there is none."""
    folders = (out_dir / str(row[name]) for name in (*RESULT_COLUMNS, "recording") if row.get(name))
    return next((folder for folder in folders if _has_summary(folder)), None)


def _has_summary(folder: Path) -> bool:
    try:
        return (folder / "summary.json").is_file()
    except (OSError, ValueError):
        # A recording that failed may have a name that no file can have.
        return False


def _cells(out_dir: Path, row: Mapping[str, Any], columns: Sequence[str]) -> dict[str, Any]:
    """A row for the page's script: values, and relative addresses of report and thumbnail, None if they are missing."""
    # What is to be measured again has an earlier result, which is not that of this row.
    folder = None if row.get("state") == "pending" else result_folder(out_dir, row)

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
