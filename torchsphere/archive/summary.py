"""The table of an archive: a row per recording, as CSV and as Parquet."""

from __future__ import annotations

import csv
import math
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq

from torchsphere.results.atomic_output import atomic_path
from torchsphere.results.columns import Columns
from torchsphere.results.exports import write_export
from torchsphere.results.spreadsheet import neutral_cell
from torchsphere.results.vector_length import vector_length
from torchsphere.runtime.warning_levels import SEVERE
from torchsphere.settings.choices import EXPORTS

#: Radians per revolution: ``summary.json`` has the spin of an impact in rev/s, the table all spin in rad/s.
_PER_REV = 2 * math.pi

#: Columns of the strongest impact: quantity in ``summary.json`` (a vector gives its length), factor between the units.
IMPACT = {
    "speed_before_m_s": ("speed_before", 1.0),
    "speed_after_m_s": ("speed_after", 1.0),
    "spin_before_rad_s": ("spin_rate_before", _PER_REV),
    "spin_after_rad_s": ("spin_rate_after", _PER_REV),
    "peak_force_N": ("peak_force", 1.0),
    "restitution": ("restitution_normal", 1.0),
}

#: Columns of the whole recording that have a standard deviation.
MEANS = ("radius_px", "mean_speed_m_s", "mean_spin_rad_s")

#: Columns and their types. An unknown value is empty in the CSV file and null in the Parquet file.
COLUMNS: dict[str, pa.DataType] = {
    **dict.fromkeys(("recording", "state", "reason"), pa.string()),
    **dict.fromkeys(("frames", "ok"), pa.int64()),
    "frame_rate": pa.float64(),
    **{name: pa.float64() for column in (*MEANS, *IMPACT) for name in (column, f"sd_{column}")},
    **dict.fromkeys(("impacts", "warnings", "severe_warnings"), pa.int64()),
    "seconds": pa.float64(),
    **dict.fromkeys(("finished", "result"), pa.string()),
}


def measured(table: Mapping[str, Any]) -> dict[str, Any]:
    """The columns that come from the ``summary.json`` of a recording."""
    counts = table.get("frames_per_status") or {}
    circle, mean, impact = (table.get(name) or {} for name in ("circle", "mean_motion", "impact"))
    speed = vector_length(mean.get("velocity_m_s"), mean.get("sd_velocity_m_s"))
    spin = vector_length(mean.get("spin_rad_s"), mean.get("sd_spin_rad_s"))
    row = {
        "frames": sum(counts.values()),
        "ok": counts.get("ok", 0),
        "frame_rate": table.get("frame_rate"),
        "radius_px": circle.get("radius"),
        "sd_radius_px": circle.get("sd_radius"),
        "mean_speed_m_s": speed[0],
        "sd_mean_speed_m_s": speed[1],
        "mean_spin_rad_s": spin[0],
        "sd_mean_spin_rad_s": spin[1],
        "impacts": len(table.get("impacts") or ()),
        "warnings": len(table.get("warnings") or ()),
        "severe_warnings": list(table.get("warning_levels") or ()).count(SEVERE),
        "seconds": table.get("seconds"),
    }
    for column, (name, factor) in IMPACT.items():
        estimate = impact.get(name) or {}
        length, sd = vector_length(estimate.get("value"), estimate.get("sd"))
        row[column] = None if length is None else factor * length
        row[f"sd_{column}"] = None if sd is None else factor * sd
    return row


def lacking(table: Mapping[str, Any]) -> str:
    """What the result of a ``summary.json`` lacks as nobody gave it, in a sentence; empty where nothing is missing."""
    settings = table.get("settings") or {}
    has_scale = any(settings.get(name) is not None for name in ("diameter_mm", "mm_per_px"))
    needed = (
        (table.get("frame_rate") is not None, "a frame rate", "--fps"),
        (has_scale, "a scale", "--diameter-mm or --mm-per-px"),
    )
    missing = [(name, option) for is_there, name, option in needed if not is_there]
    if not missing:
        return ""
    names, options = (" and ".join(column) for column in zip(*missing, strict=True))
    return f"without {names} there are no speeds and no forces; give {options}"


def is_row(row: Mapping[str, Any]) -> bool:
    """Whether the values of a row have the types of their columns."""
    return all(_suits(row.get(name), kind) for name, kind in COLUMNS.items())


def _suits(value: Any, kind: pa.DataType) -> bool:
    if value is None:
        return True
    if pa.types.is_string(kind):
        return isinstance(value, str)
    is_number = isinstance(value, int | float) and not isinstance(value, bool)
    return (
        is_number
        and (isinstance(value, float) or abs(value) < 2**53)
        and (pa.types.is_floating(kind) or isinstance(value, int))
    )


def write(out: Path, rows: Sequence[Mapping[str, Any]], exports: Sequence[str] = ()) -> None:
    """Write ``summary.csv``, ``summary.parquet`` and the files of ``exports``, each whole or not at all."""
    for kind in exports:
        with atomic_path(out / f"summary{EXPORTS[kind]}") as part:
            write_export(part, kind, {"recordings": _arrays(rows)})
    columns = {name: pa.array([row.get(name) for row in rows], kind) for name, kind in COLUMNS.items()}
    with atomic_path(out / "summary.csv") as table, atomic_path(out / "summary.parquet") as parquet:
        pq.write_table(pa.table(columns), parquet, compression="zstd")
        with table.open("w", newline="", encoding="utf-8") as stream:
            writer = csv.writer(stream)
            writer.writerow(COLUMNS)
            writer.writerows([_cell(row.get(name)) for name in COLUMNS] for row in rows)


def _arrays(rows: Sequence[Mapping[str, Any]]) -> Columns:
    """Columns as arrays: an unknown number is NaN, an unknown text empty."""
    return {
        name: np.array([row.get(name) or "" for row in rows], dtype=object)
        if pa.types.is_string(kind)
        else np.array([row.get(name) for row in rows], dtype=np.float64)
        for name, kind in COLUMNS.items()
    }


def _cell(value: Any) -> Any:
    if isinstance(value, str):
        return neutral_cell(value)
    return format(value, ".10g") if isinstance(value, float) else value
