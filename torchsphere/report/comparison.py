"""The page that compares several results: motions over each other from the first touch on, and impacts side by side."""

from __future__ import annotations

import os
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any
from urllib.parse import quote

import numpy as np
from numpy.typing import NDArray

from torchsphere.recording.frame_range import spread
from torchsphere.report import pages
from torchsphere.report.summary_tables import IMPACT, NOT_MEASURED, with_sd
from torchsphere.results.atomic_output import atomic_file
from torchsphere.results.reader import ResultFolder, read
from torchsphere.runtime import steps
from torchsphere.runtime.arrays import Array
from torchsphere.runtime.warning_levels import SEVERE, levels_of

#: Name of the page where none is given.
PAGE = "comparison.html"

#: What a table shows for a number that a shot does not have.
NONE = "\u2013"

#: Most frames of all shots together in the plots at even distances (docs/constants.toml).
MOST_FRAMES_IN_ALL = 16_000

#: Durations of the contact, before and after, in which all frames are plotted, and that the page shows first.
AROUND = 2.0

#: Panels: key, name of the vector, component, title, unit, factor to the unit. The last three are chosen by `_panels`.
_COMPONENTS = (
    ("velocity", "velocity_m_s", "xy", "m/s", 1.0),
    ("force", "force_N", "xy", "kN", 1e-3),
    ("spin", "spin_rad_s", "xyz", "rev/s", 0.5 / np.pi),
)


@dataclass(frozen=True)
class Shot:
    """A result with its name on the page, and its first contact, s since its first image."""

    name: str
    result: ResultFolder
    contact_s: tuple[float, float] | None  # of the first contact; None without one, or without times
    signs: Array  # (3,), that turn its vectors into the axes of the page

    @property
    def zero_s(self) -> float:
        """Moment that is 0 on the page: the first touch, or the first frame."""
        if self.contact_s is not None:
            return self.contact_s[0]
        return float(self.result.time_s[0]) if np.isfinite(self.result.time_s[0]) else 0.0


def write_comparison(folders: Sequence[Path], page: Path) -> Path:
    """Write the page, whole or not at all, and return its path.

    Raises ValueError for fewer than two folders, a folder that is no result, or one that is named twice, and OSError if
    the page cannot be written.
    """
    if page.is_dir():
        raise IsADirectoryError(f"{page}: is a folder; give the name of a page, as in {page / PAGE}")
    shots = _shots(folders)
    html = comparison_html(shots, page)
    with atomic_file(page) as stream:
        stream.write(html)
    return page


def _shots(folders: Sequence[Path]) -> list[Shot]:
    """The results by the shortest ends of their paths that differ."""
    if len(folders) < 2:
        raise ValueError("a comparison needs two results or more")
    whole = [Path(os.path.abspath(folder)) for folder in folders]  # noqa: PTH100  (a link keeps its name)
    for i, folder in enumerate(whole):
        if folder in whole[:i]:
            raise ValueError(f"{folders[i]}: is named twice; name each result once")
    steps.tell("comparing %d results", len(folders))
    results = [read(folder) for folder in folders]
    # The axes of the page are those of the laboratory only if all results have them.
    is_lab = all(result.lab_frame for result in results if result.motion is not None)
    signs = [np.ones(3) if is_lab else result.axis_signs for result in results]
    names = _names(whole)
    return [
        Shot(name, result, _first_contact(result), s) for name, result, s in zip(names, results, signs, strict=True)
    ]


def _names(folders: Sequence[Path]) -> list[str]:
    """As many last parts of each path as tell all apart."""
    for count in range(1, max(len(folder.parts) for folder in folders) + 1):
        names = ["/".join(folder.parts[-count:]) for folder in folders]
        if len(set(names)) == len(names):
            break
    return names


def _first_contact(result: ResultFolder) -> tuple[float, float] | None:
    """Start and end of the first contact; None without one, or without times."""
    impacts = result.summary.get("impacts") or [one for one in [result.summary.get("impact")] if one]
    edges = [[(one.get(f"contact_{edge}") or {}).get("value") for edge in ("start", "end")] for one in impacts]
    found = [(float(start), float(end)) for start, end in edges if start is not None and end is not None]
    if not found and result.contact_s is not None:
        found = [result.contact_s]
    return min(found) if found and np.isfinite(result.time_s).all() else None


def comparison_html(shots: Sequence[Shot], page: Path) -> str:
    """The page as HTML; links to reports are relative to its place."""
    aligned = sum(shot.contact_s is not None for shot in shots)
    return pages.page(
        "comparison.html",
        title=f"Comparison of {len(shots)} shots",
        grade="good" if aligned == len(shots) else "part",
        verdict=_verdict(shots, aligned),
        notes=_notes(shots),
        shots=[{"name": shot.name, "report": _address(shot, page)} for shot in shots],
        impacts=_impact_rows(shots),
        setup=_setup_rows(shots),
        data=_data(shots),
    )


def _verdict(shots: Sequence[Shot], aligned: int) -> str:
    if aligned == len(shots):
        return f"{len(shots)} shots, aligned at the first touch."
    if aligned == 0:
        return f"{len(shots)} shots, none with a contact: times since the first image of each."
    verb = ("has", "is") if aligned == 1 else ("have", "are")
    return f"{aligned} of {len(shots)} shots {verb[0]} a contact and {verb[1]} aligned at the first touch."


def _notes(shots: Sequence[Shot]) -> list[str]:
    """Sentences on shots that the plots show otherwise, or not at all."""
    notes = []
    for shot in shots:
        motion = shot.result.motion
        if motion is None:
            notes.append(
                f"{shot.name}: velocities are not known, as frame rate or scale are missing. Track it again with "
                "--fps and --diameter-mm."
            )
            continue
        if shot.contact_s is None:
            notes.append(f"{shot.name}: no contact was found, so its times count from its first image.")
        if motion.force_N is None:
            notes.append(f"{shot.name}: force is not known. Track it again with --mass-g.")
    frames = {shot.result.lab_frame for shot in shots if shot.result.motion is not None}
    if len(frames) > 1:
        notes.append("Some results are in the lab frame. All are shown in the camera frame: y down, z away from it.")
    return notes


def _address(shot: Shot, page: Path) -> str | None:
    """Relative address of the report of a shot; None if there is none."""
    report = shot.result.path / "report.html"
    if not report.is_file():
        return None
    return quote(Path(os.path.relpath(report, page.absolute().parent)).as_posix())


def _impact_rows(shots: Sequence[Shot]) -> list[tuple[str, list[str]]]:
    """Rows of the table: a quantity, and its value with its standard deviation in each shot."""
    impacts = [shot.result.summary.get("impact") or {} for shot in shots]
    rows = []
    for key, name, unit, factor in IMPACT:
        numbers = [impact.get(key) or {} for impact in impacts]
        if not any(numbers):
            continue
        cells = [
            with_sd(_in_axes(shot, key, one.get("value")), one.get("sd"), unit, factor)
            for shot, one in zip(shots, numbers, strict=True)
        ]
        rows.append((name, [NONE if cell == NOT_MEASURED else cell for cell in cells]))
    return rows


def _in_axes(shot: Shot, key: str, value: Any) -> Any:
    """A vector in the axes of the page."""
    if not isinstance(value, list) or None in value:
        return value
    size = 2 if key.startswith("velocity") else 3
    return [float(v * sign) for v, sign in zip(value, shot.signs[:size], strict=True)]


def _setup_rows(shots: Sequence[Shot]) -> list[tuple[str, list[str]]]:
    """Rows with recording, frames, camera and ball of each shot."""

    def cells(of: Any) -> list[str]:
        return [str(of(shot.result.summary)) for shot in shots]

    def given(name: str, unit: str) -> Any:
        return lambda s: NONE if s["settings"].get(name) is None else f"{s['settings'][name]:g} {unit}"

    return [
        ("Recording", cells(lambda s: Path(s["input"]["path"]).name)),
        (
            "Frames",
            cells(lambda s: f"{sum(s['frames_per_status'].values())}, {s['frames_per_status'].get('ok', 0)} ok"),
        ),
        ("Frame rate", cells(lambda s: NONE if s.get("frame_rate") is None else f"{s['frame_rate']:,.10g} frames/s")),
        ("Size of a pixel", cells(lambda s: _pixel(s.get("scale")))),
        ("Mass", cells(given("mass_g", "g"))),
        ("Impacts", cells(lambda s: len(s.get("impacts") or ()))),
        ("Warnings", cells(_warnings)),
    ]


def _pixel(scale: dict[str, Any] | None) -> str:
    return NONE if not scale else with_sd(scale["m_per_px"], scale.get("sd_m_per_px"), "mm", 1e3)


def _data(shots: Sequence[Shot]) -> dict[str, Any]:
    """Data for the page's script: times in ms since the zero of each shot; unknown numbers are None."""
    most = min(pages.MAX_PLOTTED, MOST_FRAMES_IN_ALL // len(shots))
    rows = [_rows(shot, most) for shot in shots]
    spans = [_contact_ms(shot) for shot in shots]
    longest = max((span[1] - span[0] for span in spans if span is not None), default=0.0)
    return {
        "names": [shot.name for shot in shots],
        "times": [_times(shot, at) for shot, at in zip(shots, rows, strict=True)],
        "contacts": spans,
        "around": None if not longest else [-AROUND * longest, (1 + AROUND) * longest],
        "panels": _panels(shots, rows),
    }


def _times(shot: Shot, rows: NDArray[np.int64]) -> list[Any]:
    if shot.result.motion is None:
        return []
    return pages.numbers(1e3 * (shot.result.time_s[rows] - shot.zero_s), 9)


def _contact_ms(shot: Shot) -> tuple[float, float] | None:
    """Start and end of the contact of the shot's first impact, ms on the page."""
    if shot.contact_s is None:
        return None
    start, end = shot.contact_s
    return 1e3 * (start - shot.zero_s), 1e3 * (end - shot.zero_s)


def _rows(shot: Shot, most: int) -> NDArray[np.int64]:
    """Rows of a shot in the plots: at even distances, and all around its contact, as far as there is room."""
    n = len(shot.result.frame)
    even = spread(np.arange(n), most)
    contact = _contact_ms(shot)
    if n <= most or contact is None:
        return even
    time, spare = 1e3 * (shot.result.time_s - shot.zero_s), AROUND * (contact[1] - contact[0])
    near = np.flatnonzero((time > contact[0] - spare) & (time < contact[1] + spare))
    return np.union1d(even, near) if len(near) <= most else even


def _panels(shots: Sequence[Shot], rows: Sequence[NDArray[np.int64]]) -> list[dict[str, Any]]:
    """A panel for each component that some shot has; of shots without it nothing."""
    panels = []
    for key, vector, components, unit, factor in _COMPONENTS:
        if key == "force" and _largest_force(shots) < 1000:
            unit, factor = "N", 1.0
        for k, name in enumerate(components):
            values: list[Any] = []
            sds: list[Any] = []
            for shot, at in zip(shots, rows, strict=True):
                found = getattr(shot.result.motion, vector, None)
                sd = getattr(shot.result.motion, f"sd_{vector}", None)
                values.append([] if found is None else pages.numbers(factor * shot.signs[k] * found[at, k], 7))
                sds.append([] if sd is None else pages.numbers(factor * sd[at, k], 3))
            if any(v is not None for series in values for v in series):
                panels.append(
                    {"key": f"{key}-{name}", "title": f"{key} {name}", "unit": unit, "values": values, "sd": sds}
                )
    return panels


def _largest_force(shots: Sequence[Shot]) -> float:
    forces = [shot.result.motion.force_N for shot in shots if shot.result.motion is not None]
    known = [np.abs(force[np.isfinite(force)]) for force in forces if force is not None]
    return max((float(force.max(initial=0.0)) for force in known), default=0.0)


def _warnings(summary: dict[str, Any]) -> str:
    """The number of warnings, and of those by which numbers are wrong."""
    levels = [level for level, _ in levels_of(summary)]
    severe = levels.count(SEVERE)
    return f"{len(levels)}, of them {severe} severe: see the report" if severe else str(len(levels))
