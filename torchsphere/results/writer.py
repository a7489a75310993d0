"""A result folder as it is written: the measurement of one recording, its tables and its ``summary.json``."""

from __future__ import annotations

import json
import math
import platform
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import kornia
import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import torch
from numpy.typing import NDArray

from torchsphere.dynamics.contact_law import ContactForce
from torchsphere.dynamics.filtered_motion import FilteredMotion
from torchsphere.dynamics.impact_estimate import Impact
from torchsphere.dynamics.kinematics import Kinematics, mean_motion
from torchsphere.dynamics.shared_errors import per_radius
from torchsphere.estimation.measurements import DRIFT_SHARE
from torchsphere.motion.ledger import INCREMENTS
from torchsphere.motion.track import Track, status_counts, why_unusable
from torchsphere.recording import Recording
from torchsphere.recording.facts import Facts
from torchsphere.request import Request
from torchsphere.results.columns import (
    covariances,
    filtered_columns,
    force_path_columns,
    motion_columns,
    track_columns,
    unit_of,
)
from torchsphere.results.exports import write_export
from torchsphere.runtime.setting_names import as_options
from torchsphere.runtime.shown_text import shown
from torchsphere.runtime.warning_levels import level_of
from torchsphere.settings.choices import EXPORTS

#: Rows of a block of a CSV file.
CSV_ROWS = 1000


@dataclass(frozen=True)
class Measurement:
    """The measurement of one recording.

    ``sha256`` is the hash of its files. ``extra_files`` (name -> source) are copied into the result folder. ``name``
    stands in the summary in place of a temporary path. ``impact`` is the strongest of all ``impacts``, each of which
    has its own of the ``contact_forces``. ``filtered`` is None unless a channel frequency class was asked for.
    """

    recording: Recording | Facts
    track: Track
    motion: Kinematics | None
    impact: Impact | None
    first_frame: int
    warnings: tuple[str, ...]
    seconds: float
    sha256: str
    extra_files: Mapping[str, Path] = field(default_factory=dict)
    name: str | None = None
    impacts: tuple[Impact, ...] = ()
    contact_forces: tuple[ContactForce, ...] = ()
    filtered: FilteredMotion | None = None


def write_track(folder: Path, track: Track, frame_rate: float | None, first_frame: int) -> None:
    """Write ``track.csv`` and, with the full covariances, ``track.parquet``."""
    columns = track_columns(track, frame_rate, first_frame)
    empty = {} if frame_rate is not None else {"time_s": np.full(len(track.status), "")}
    _write_csv(folder / "track.csv", columns | empty)
    table = {name: pa.array(v.tolist() if v.dtype.kind == "U" else v) for name, v in columns.items()}
    # The relative growth of the radius has a standard deviation only with the model pinhole6.
    table["sd_growth"] = pa.array(np.concatenate(([np.nan], track.sd_growth)))
    table["covariance"] = pa.FixedSizeListArray.from_arrays(pa.array(covariances(track).ravel()), 25)
    schema = pa.schema([_field(name, values.type) for name, values in table.items()])
    # Numbers rarely repeat, so that a dictionary would be a second copy of each column.
    whole = pa.table(table, schema=schema)
    pq.write_table(whole, folder / "track.parquet", compression="zstd", use_dictionary=["status"])


def _field(name: str, kind: pa.DataType) -> pa.Field:
    """The description of a column, with its unit."""
    unit = "px and rad, row by row" if name == "covariance" else unit_of(name)
    return pa.field(name, kind, metadata={"unit": unit} if unit else None)


def write_measurement(
    folder: Path, request: Request, done: Measurement, frame_rate: float | None, export: Sequence[str] = ()
) -> None:
    """Write the tables, ``summary.json``, and for each of ``export`` a file "result" with all of them."""
    write_track(folder, done.track, frame_rate, done.first_frame)
    tables = {
        "kinematics": {} if done.motion is None else motion_columns(done.motion, done.first_frame),
        "kinematics_cfc": {} if done.filtered is None else filtered_columns(done.filtered, done.first_frame),
        "force_path": force_path_columns(done.contact_forces, done.first_frame),
    }
    known = {name: columns for name, columns in tables.items() if columns}
    for name, columns in known.items():
        _write_csv(folder / f"{name}.csv", columns)
    contents = plain(summary(request, done, frame_rate))
    write_summary(folder, contents)
    of_track = track_columns(done.track, frame_rate, done.first_frame) | {"covariance": covariances(done.track)}
    for kind in dict.fromkeys(export):
        path = folder / f"result{EXPORTS[kind]}"
        write_export(path, kind, {"track": of_track} | known, contents["impacts"], contents)


def write_summary(folder: Path, summary: dict[str, Any]) -> None:
    """Write ``summary.json``; NaN and infinity become null."""
    text = json.dumps(plain(summary), indent=2, ensure_ascii=False, allow_nan=False)
    (folder / "summary.json").write_text(text + "\n", encoding="utf-8")


def _write_csv(path: Path, columns: dict[str, NDArray[Any]]) -> None:
    n = len(next(iter(columns.values())))
    # A format for a whole row takes half the time of a format per number. No value needs quotation marks.
    kinds = {"i": "%d", "u": "%d", "U": "%s"}
    row = ",".join(kinds.get(column.dtype.kind, "%.10g") for column in columns.values()) + "\r\n"
    with path.open("w", newline="", encoding="utf-8") as stream:
        stream.write(",".join(columns) + "\r\n")
        # In blocks, because text takes ten times the memory of its numbers.
        for start in range(0, n, CSV_ROWS):
            block = [column[start : start + CSV_ROWS].tolist() for column in columns.values()]
            stream.writelines(row % values for values in zip(*block, strict=True))


def plain(value: Any) -> Any:
    """The value with what JSON has: lists, texts, and None for NaN and infinity."""
    if isinstance(value, dict):
        return {str(k): plain(v) for k, v in value.items()}
    if isinstance(value, (list, tuple)):
        return [plain(v) for v in value]
    if isinstance(value, np.ndarray):
        return plain(value.tolist())
    if isinstance(value, (np.floating, np.integer)):
        value = value.item()
    if isinstance(value, float) and not math.isfinite(value):
        return None
    return str(value) if isinstance(value, Path) else value


def summary(request: Request, done: Measurement, frame_rate: float | None) -> dict[str, Any]:
    """The contents of ``summary.json``; docs/results.md explains each key."""
    recording, tracked = done.recording, done.track
    circle, asked = tracked.circle, {n: value for n, value in vars(request).items() if n not in ("input", "out")}
    # Values in px stay in the camera frame.
    in_lab = done.motion is not None and done.motion.lab_frame
    return {
        "input": {
            "path": done.name or shown(str(request.input)),
            "sha256": done.sha256,
            "kind": recording.kind,
            "frames": recording.shape[0],
            "first_frame": done.first_frame,
            "last_frame": done.first_frame + len(tracked.status) - 1,
            "width_px": recording.shape[2],
            "height_px": recording.shape[1],
            "bit_depth": recording.bit_depth,
            "exposure_s": recording.exposure_s,
            "trigger_offset_frames": recording.trigger_offset_frames,
            "pixel_aspect": recording.pixel_aspect,
            "orientation": recording.orientation,
            "bayer": recording.bayer,
            "origins": dict(recording.origins),
        },
        "frame_rate": frame_rate,
        "frame_rate_origin": "given" if request.fps is not None else recording.origins.get("frame_rate"),
        "circle": {**vars(circle), "frame": done.first_frame + circle.frame, "unit": "px"},
        "radius_effect": _radius_effect(tracked),
        "drift_share": 0.0 if tracked.findings.is_on_map else DRIFT_SHARE,
        "sd_steady": dict(zip(INCREMENTS, tracked.sd_steady.tolist(), strict=True)),
        "scale": None if done.motion is None else vars(done.motion.scale),
        "frames_per_status": status_counts(tracked),
        "unusable": why_unusable(tracked.status),
        "mean_motion": mean_motion(tracked, done.motion),
        "axes": "lab frame: x right, y up, z to the camera" if in_lab else "camera frame: x right, y down",
        "settings": asked | tracked.settings | tracked.findings.items(),
        "differentiation": None if done.motion is None else done.motion.about,
        "impact": _impact(done),
        "impacts": _impacts(done),
        "contact_s": None if done.motion is None else done.motion.contact_s,
        "warnings": [as_options(sentence) for sentence in done.warnings],
        "ledger": [entry.items() for entry in tracked.ledger],
        "warning_levels": [level_of(sentence) for sentence in done.warnings],
        "seconds": round(done.seconds, 3),
        "versions": versions(),
    }


def _impacts(done: Measurement) -> list[dict[str, Any]]:
    """All impacts with what their forces against penetration give."""
    forces = done.contact_forces or (ContactForce(None, None),) * len(done.impacts)
    return [found.summary() | force.summary() for found, force in zip(done.impacts, forces, strict=True)]


def _impact(done: Measurement) -> dict[str, Any] | None:
    """The strongest impact, as it is among all."""
    if done.impact is None:
        return None
    own = done.impact.summary()
    return next((each for each in _impacts(done) if each["contact_start"] == own["contact_start"]), own)


def _radius_effect(tracked: Track) -> dict[str, float]:
    """Effect of the radius's standard deviation on the mean step (px) and on all rotations (relative)."""
    turn = float(np.linalg.norm(np.nan_to_num(tracked.increment[:, 2:4]), axis=1).mean())
    sd, (of_step, of_rotation) = tracked.circle.sd_radius, per_radius(tracked)
    return {
        "sd_radius_px": sd,
        "sd_mean_step_px": of_step * turn * sd,
        "relative_sd_rotation": of_rotation * sd / tracked.circle.radius,
    }


def versions() -> dict[str, str]:
    """Versions of the programs that computed the result."""
    from torchsphere import __version__

    return {
        "torchsphere": __version__,
        "torch": torch.__version__,
        "kornia": kornia.__version__,
        "numpy": np.__version__,
        "python": platform.python_version(),
    }
