"""The outcome of ``torchsphere track`` on the screen: a table of the numbers in ``summary.json``."""

from __future__ import annotations

import math
import os
import shutil
import sys
import textwrap
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, TextIO

from torchsphere.runtime.warning_levels import CAUTION, LEVELS, NOTE, SEVERE, levels_of

#: Numbers of an impact: label, key in the summary, unit, factor to that unit.
IMPACT = (
    ("speed before", "speed_before", "m/s", 1.0),
    ("speed after", "speed_after", "m/s", 1.0),
    ("spin before", "spin_rate_before", "rev/s", 1.0),
    ("spin after", "spin_rate_after", "rev/s", 1.0),
    ("contact begins", "contact_start", "ms", 1e3),
    ("contact lasts", "duration", "ms", 1e3),
    ("largest force", "peak_force", "kN", 1e-3),
    ("restitution", "restitution_normal", "", 1.0),
)

#: Numbers of a recording without an impact: label, key of the mean motion, components, unit, factor.
MEAN_MOTION = (
    ("mean velocity x, y", "velocity_m_s", slice(2), "m/s", 1.0),
    ("mean spin x, y, z", "spin_rad_s", slice(3), "rev/s", 0.5 / math.pi),
)
MEAN_STEP = (
    ("mean step x, y", "increment_px_rad", slice(2), "px per frame", 1.0),
    ("mean turn x, y, z", "increment_px_rad", slice(2, 5), "deg per frame", math.degrees(1)),
)

#: Width of the labels with the gap after them.
LABEL_WIDTH = 20

#: Escape sequences of a terminal: bold red, and back.
RED, PLAIN = "\x1b[1;31m", "\x1b[0m"


#: Labels of warnings by their level; what makes numbers wrong stands before the numbers.
LABELS = {SEVERE: "WARNING", CAUTION: "caution", NOTE: "note"}


def outcome_lines(summary: Mapping[str, Any], out: Path) -> list[str]:
    """Lines of the answer: what makes numbers wrong, the numbers, what limits them, the folder, and remarks."""
    said = dict[str, list[tuple[str, str]]]((level, []) for level in LEVELS)
    for level, sentence in levels_of(summary):
        said[level].append((LABELS[level], sentence))
    rows = [("frames", status_text(summary["frames_per_status"])), ("circle", _circle(summary["circle"]))]
    rows += [(label, value) for label, value in _motion(summary) if value]
    rows += said[CAUTION]
    rows.append(("result", str(out)))
    if (out / "report.html").is_file():
        rows.append(("report", str(out / "report.html")))
    severe = [in_red(line, sys.stdout) for line in _lines(said[SEVERE])]
    return [*severe, *_lines(rows), *_lines(said[NOTE])]


def _lines(rows: Sequence[tuple[str, str]]) -> list[str]:
    """Labels and values in two columns; in a terminal, long values go on below their beginnings."""
    width = shutil.get_terminal_size().columns - LABEL_WIDTH if sys.stdout.isatty() else 0
    wrapped = ((label, textwrap.wrap(value, width) if width > 20 else [value]) for label, value in rows)
    return [f"{label if i == 0 else '':<18}  {part}" for label, parts in wrapped for i, part in enumerate(parts)]


def status_text(counts: Mapping[str, int]) -> str:
    """Numbers of all frames and of frames per status."""
    return f"{sum(counts.values())} ({', '.join(f'{count} {name}' for name, count in counts.items())})"


def in_red(sentence: str, stream: TextIO) -> str:
    """The sentence in red if the stream is a terminal with colours; as it is elsewhere, or where NO_COLOR is set."""
    shows_colours = stream.isatty() and not os.environ.get("NO_COLOR") and os.environ.get("TERM") != "dumb"
    return f"{RED}{sentence}{PLAIN}" if shows_colours else sentence


def _circle(circle: Mapping[str, Any]) -> str:
    centre = f"{circle['x']:.2f},{circle['y']:.2f}"
    return f"{centre},{circle['radius']:.2f} px in frame {circle['frame']}, radius {_sd_of_radius(circle)}"


def _sd_of_radius(circle: Mapping[str, Any]) -> str:
    if circle.get("sd_radius") is None:
        return "as given"
    if circle.get("sd_guessed"):
        return f"to about {circle['sd_radius']:.0f} px, not measured"
    return f"± {circle['sd_radius']:.2g} px"


def _motion(summary: Mapping[str, Any]) -> list[tuple[str, str]]:
    """Labels and values of the impact or else of the mean motion; empty values were not measured."""
    impact = summary["impact"]
    if impact:
        known = ((label, impact.get(key) or {}, unit, factor) for label, key, unit, factor in IMPACT)
        return [(label, _value(of.get("value"), of.get("sd"), unit, factor)) for label, of, unit, factor in known]
    means = summary["mean_motion"]
    rows = MEAN_MOTION if "velocity_m_s" in means else MEAN_STEP
    return [
        (label, _value(means[key][part], means[f"sd_{key}"][part], unit, factor))
        for label, key, part, unit, factor in rows
    ]


def _value(value: Any, sd: Any, unit: str, factor: float) -> str:
    """Value and standard deviation; empty where a number is missing."""
    from torchsphere.report.summary_tables import with_sd

    missing = value is None or (isinstance(value, list) and None in value)
    return "" if missing else with_sd(value, sd, unit, factor)
