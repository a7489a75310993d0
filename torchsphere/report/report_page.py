"""``report.html``: one file that works from disk and loads nothing else."""

from __future__ import annotations

import base64
import json
import math
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from torchsphere.report import explanations, summary_tables
from torchsphere.report.figure_style import STATUS_COLOURS
from torchsphere.report.image_figures import residual_limit
from torchsphere.report.templating import page
from torchsphere.report.time_series import TimeSeries, abscissa, time_series
from torchsphere.results.reader import ResultFolder
from torchsphere.results.sampled_frames import NO_RESIDUAL, Sampled, encode_webp, rows_to_keep

#: Frames that are plotted at most. A longer recording has this many at even distances, and all frames with an image.
MAX_PLOTTED = 2000

#: Longest side of a residual map in the page, px, and its WebP quality.
MAP_PX, MAP_QUALITY = 72, 75

#: Grey level of a residual of 0, and grey levels from there to the limit. Level 0 means "no residual"; the compression
#: blurs its edges, so that no residual lies near it.
MAP_MIDDLE, MAP_REACH = 148, 100


def report_html(result: ResultFolder) -> str:
    """The report of a result as HTML."""
    summary = result.summary
    all_measured = bool((result.status == "ok").all())
    return page(
        "report.html",
        title=Path(summary["input"]["path"]).name,
        grade="good" if all_measured else "part" if result.has_steps else "bad",
        verdict=explanations.verdict(result),
        problems=explanations.problems(result),
        missing_inputs=explanations.missing_inputs(result),
        warnings=explanations.warnings(result),
        sections=summary_tables.sections(result),
        settings=_settings(summary),
        version=summary.get("versions", {}).get("torchsphere", ""),
        data=_script_data(result),
    )


def _settings(summary: dict[str, Any]) -> dict[str, str]:
    """Settings, facts of the input, versions and the method of differentiation: names and texts."""
    sections = {name: summary.get(name) or {} for name in ("settings", "input", "versions", "differentiation")}
    return {f"{section}.{name}": _text(v) for section, values in sections.items() for name, v in values.items()}


def _text(value: Any) -> str:
    if value is None:
        return "not given"
    return json.dumps(value, ensure_ascii=False) if isinstance(value, (dict, list)) else str(value)


def _script_data(result: ResultFolder) -> dict[str, Any]:
    """Everything that the page's scripts draw; unknown numbers are None."""
    sampled = result.sampled
    with_image = rows_to_keep(result.status, result.zncc) if sampled is None else sampled.row
    rows = _plotted_rows(len(result.frame), with_image)
    where, contact = abscissa(result), result.contact_s
    statuses = list(STATUS_COLOURS)
    return {
        "frame": result.frame[rows].tolist(),
        "where": _numbers(where.values[rows], 9),
        "abscissa": {"title": where.title, "unit": where.unit},
        "contact": None if contact is None or where.per_second is None else [where.per_second * t for t in contact],
        "status": [statuses.index(status) for status in result.status[rows]],
        "statuses": [_status(result, name) for name in statuses],
        "position": _numbers(result.position[rows], 7),
        "radius": _numbers(result.radius[rows], 7),
        "quaternion": _numbers(result.quaternion[rows], 7),
        "zncc": _numbers(result.zncc[rows], 6),
        "spin": _numbers(_camera_spin(result)[rows], 6),
        "lab": result.lab_frame,
        "panels": [_panel(result, series, rows) for series in time_series(result)],
        # Rows at which the page can stop: the rows with an image, or all rows if no images were kept.
        "shown": list(range(len(rows))) if sampled is None else np.searchsorted(rows, with_image).tolist(),
        "total": len(result.frame),
        "images": None if sampled is None else _images(sampled),
    }


def _plotted_rows(count: int, with_image: NDArray[np.int64]) -> NDArray[np.int64]:
    if count <= MAX_PLOTTED:
        return np.arange(count)
    return np.union1d(np.linspace(0, count - 1, MAX_PLOTTED).round().astype(np.int64), with_image)


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
        "values": _numbers(series.values[rows].T, 7),
        "sd": None if series.sd is None else _numbers(series.sd[rows].T, 3),
    }


def _camera_spin(result: ResultFolder) -> NDArray[np.float64]:
    """Spin (n, 3) in the camera frame, rad/s or rad per frame: the page shows its direction."""
    if result.motion is None:
        return result.increment[:, 2:]
    return result.motion.spin_rad_s * result.axis_signs


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


def _numbers(values: NDArray[Any], digits: int) -> list[Any]:
    """Nested lists of numbers with that many digits; None for NaN and infinity."""
    if values.ndim > 1:
        return [_numbers(row, digits) for row in values]
    return [float(f"{v:.{digits}g}") if math.isfinite(v) else None for v in values.tolist()]
