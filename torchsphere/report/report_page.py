"""``report.html``: one file that asks for nothing from outside, of HTML, CSS and JavaScript kept beside this module."""

from __future__ import annotations

import base64
import html
import io
import json
import math
import re
from collections.abc import Iterable
from pathlib import Path
from string import Template
from typing import Any

import numpy as np
from numpy.typing import NDArray

from torchsphere.report import explanations, summary_tables
from torchsphere.report.explanations import why_empty
from torchsphere.report.image_figures import residual_limit
from torchsphere.report.motion_figures import STATUS_COLOURS
from torchsphere.report.time_series import abscissa, panels
from torchsphere.results.reader import ResultFolder
from torchsphere.results.sampled_frames import LIMIT, NOTHING, Sampled, chosen

HERE = Path(__file__).parent / "templates"

#: Scripts in the order in which they build on each other.
SCRIPTS = (
    "state.js",
    "rotation.js",
    "viewer.js",
    "plots.js",
    "deviations.js",
    "strip.js",
    "orbit3d.js",
    "numbers.js",
    "main.js",
)

#: Frames up to which every one is plotted; beyond, as many evenly, and all that have an image.
PLOTTED = 2000

#: A residual map's longest side in the report, px; and how its values are written as grey levels of a WebP image, with
#: room between them and 0, which stands for "none" and which the compression smears.
MAP_PX, MAP_MIDDLE, MAP_REACH, MAP_QUALITY = 72, 148, 100, 75


def report_html(result: ResultFolder) -> str:
    """The report as HTML."""
    title = Path(result.summary["input"]["path"]).name
    return fill(
        "report.html",
        title=html.escape(title),
        style=(HERE / "base.css").read_text(encoding="utf-8"),
        script="\n".join((HERE / name).read_text(encoding="utf-8") for name in SCRIPTS),
        data=embedded(_data(result)),
        verdict=html.escape(explanations.verdict(result)),
        grade=_grade(result),
        problems=_problems(result),
        numbers=_sections(summary_tables.sections(result)),
        settings=_settings(result),
        version=html.escape(str(result.summary.get("versions", {}).get("torchsphere", ""))),
    )


def _grade(result: ResultFolder) -> str:
    """How the verdict is marked: all measured, part, or no motion at all."""
    if (result.status == "ok").all():
        return "good"
    return "part" if result.has_steps else "bad"


def fill(name: str, **parts: str) -> str:
    """The template ``name`` of this folder with its ``$parts``."""
    return Template((HERE / name).read_text(encoding="utf-8")).substitute(parts)


def embedded(data: Any) -> str:
    """JSON that may stand in a script of a page, whatever texts it holds."""
    text = json.dumps(data, ensure_ascii=True, allow_nan=False, separators=(",", ":"))
    return text.replace("<", "\\u003c").replace(">", "\\u003e").replace("&", "\\u0026")


def _data(result: ResultFolder) -> dict[str, Any]:
    """What the page's script shows; unknown numbers are null."""
    rows = _rows(result)
    sampled = result.sampled
    where = abscissa(result)
    contact = result.contact_s
    names = list(STATUS_COLOURS)
    return {
        "frame": result.frame[rows].tolist(),
        "where": _numbers(where.values[rows], 9),
        "abscissa": {"title": where.title, "unit": where.unit},
        "contact": None if contact is None or where.per_second is None else [where.per_second * t for t in contact],
        "status": [names.index(s) for s in result.status[rows]],
        "statuses": [_status(result, name) for name in names],
        "position": _numbers(result.position[rows], 7),
        "radius": _numbers(result.radius[rows], 7),
        "quaternion": _numbers(result.quaternion[rows], 7),
        "zncc": _numbers(result.zncc[rows], 6),
        "spin": _numbers(_spin(result)[rows], 6),
        "lab": result.lab_frame and result.motion is not None,
        "panels": [
            {
                "key": panel.key,
                "title": panel.title,
                "unit": panel.unit,
                "names": panel.names,
                "why": "" if np.isfinite(panel.values).any() else why_empty(result, panel.key),
                "values": [_numbers(column, 7) for column in panel.values[rows].T],
                "sd": None if panel.sd is None else [_numbers(column, 3) for column in panel.sd[rows].T],
            }
            for panel in panels(result)
        ],
        "shown": _stops(result, rows),
        "total": len(result.frame),
        "images": None if sampled is None else _images(sampled),
    }


def _rows(result: ResultFolder) -> NDArray[np.int64]:
    """Rows of the track that the page knows: all, or where there are too many, some."""
    n = len(result.frame)
    if n <= PLOTTED:
        return np.arange(n)
    even = np.linspace(0, n - 1, PLOTTED).round().astype(np.int64)
    return np.union1d(even, _sampled_rows(result))


def _sampled_rows(result: ResultFolder) -> NDArray[np.int64]:
    if result.sampled is not None:
        return result.sampled.row
    return chosen(result.status, result.zncc, LIMIT)


def _stops(result: ResultFolder, rows: NDArray[np.int64]) -> list[int]:
    """Places among ``rows`` at which the page can stop: the frames with an image, or all of them without images."""
    if result.sampled is None:
        return list(range(len(rows)))
    return list(np.searchsorted(rows, result.sampled.row).tolist())


def _status(result: ResultFolder, name: str) -> dict[str, Any]:
    return {
        "name": name.replace("_", " "),
        "colour": STATUS_COLOURS[name],
        "count": int((result.status == name).sum()),
        "meaning": explanations.told(result, name)[0],
    }


def _spin(result: ResultFolder) -> NDArray[np.float64]:
    """Spin (n, 3) in the axes of the camera, rad/s or rad per frame, for directions."""
    if result.motion is None:
        return result.increment[:, 2:]
    return result.motion.spin_rad_s * (np.array([1.0, -1.0, -1.0]) if result.lab_frame else np.ones(3))


def _images(sampled: Sampled) -> dict[str, Any]:
    limit = residual_limit(sampled)
    side = sampled.residual.shape[-1]
    return {
        "box": sampled.box,
        "frames": [_uri(image) for image in sampled.webp],
        "maps": [_map(sampled, i, limit) if there else None for i, there in enumerate(sampled.has_residual)],
        "mapMiddle": MAP_MIDDLE,
        "mapReach": MAP_REACH,
        "mapWidth": side * sampled.residual_bin,
        "limit": limit,
    }


def _map(sampled: Sampled, i: int, limit: float) -> str:
    """Residual map ``i`` as grey levels around `MAP_MIDDLE`."""
    from PIL import Image

    units = sampled.residual[i].astype(np.float32) * (sampled.residual_step / limit)
    grey = MAP_MIDDLE + MAP_REACH * units.clip(-1, 1)
    grey[sampled.residual[i] == NOTHING] = 0
    image = Image.fromarray(grey.round().astype(np.uint8))
    if max(image.size) > MAP_PX:
        image = image.resize((MAP_PX, MAP_PX), Image.Resampling.NEAREST)
    stream = io.BytesIO()
    image.save(stream, "WEBP", quality=MAP_QUALITY, method=1)
    return _uri(stream.getvalue())


def _uri(webp: bytes) -> str:
    return "data:image/webp;base64," + base64.b64encode(webp).decode("ascii")


def _numbers(values: NDArray[Any], digits: int) -> list[Any]:
    """Nested lists of numbers with that many digits; null for what is not known."""
    if values.ndim > 1:
        return [_numbers(row, digits) for row in values]
    return [float(f"{v:.{digits}g}") if math.isfinite(v) else None for v in values.tolist()]


def _problems(result: ResultFolder) -> str:
    """What was not measured, what is lacking, and the warnings, as lists."""
    failed = [
        f"<li><strong>{html.escape(p['frames'])}</strong>: {_marked(p['meaning'])}. "
        f"<span class='do'>What to do: {_marked(p['remedy'])}</span></li>"
        for p in explanations.problems(result)
    ]
    lacking = [f"<li>{_marked(sentence)}</li>" for sentence in explanations.absent(result)]
    parts = [_list("", [*failed, *lacking])]
    notes = [f"<li>{_marked(sentence)}</li>" for sentence in explanations.warnings(result)]
    parts.append(_list("<h2>Warnings</h2>", notes))
    return "".join(parts)


def _marked(sentence: str) -> str:
    """The sentence with options of the command line kept in one piece."""
    return re.sub(r"(--[a-z][a-z-]*)", r"<code>\1</code>", html.escape(sentence))


def _list(heading: str, items: list[str]) -> str:
    return f"{heading}<ul>{''.join(items)}</ul>" if items else ""


def _sections(found: Iterable[summary_tables.Section]) -> str:
    return "".join(
        f"<section class='numbers'><h3>{html.escape(heading)}</h3><table>"
        + "".join(f"<tr><th scope='row'>{html.escape(k)}</th><td>{html.escape(v)}</td></tr>" for k, v in rows)
        + "</table></section>"
        for heading, rows in found
    )


def _settings(result: ResultFolder) -> str:
    """All settings, versions and the hash of the input, as a table."""
    summary = result.summary
    found = {f"settings.{k}": v for k, v in summary["settings"].items()}
    found |= {f"input.{k}": v for k, v in summary["input"].items()}
    found |= {f"versions.{k}": v for k, v in summary.get("versions", {}).items()}
    found |= {f"differentiation.{k}": v for k, v in (summary.get("differentiation") or {}).items()}
    return "".join(
        f"<tr><th scope='row'>{html.escape(name)}</th><td>{html.escape(_setting(value))}</td></tr>"
        for name, value in found.items()
    )


def _setting(value: Any) -> str:
    if value is None:
        return "not given"
    if isinstance(value, (dict, list)):
        return json.dumps(value, ensure_ascii=False)
    return str(value)
