"""A result folder as it is written: the measurement of one recording, its tables and its ``summary.json``."""

from __future__ import annotations

import json
import math
import platform
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import kornia
import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import torch
from numpy.typing import NDArray

from torchsphere.dynamics.impact_estimate import Impact
from torchsphere.dynamics.kinematics import Kinematics, mean_motion
from torchsphere.dynamics.shared_errors import ROTATION_PER_RADIUS, STEP_PER_RADIUS
from torchsphere.geometry.orientation import quaternions
from torchsphere.recording import Recording
from torchsphere.request import Request
from torchsphere.results.reader import KINEMATICS_COLUMNS, TRACK_COLUMNS
from torchsphere.runtime.shown_text import shown
from torchsphere.tracking.result import Track, status_counts

#: Rows of a block of a CSV file.
CSV_ROWS = 1000


@dataclass(frozen=True)
class Measurement:
    """The measurement of one recording.

    ``sha256`` is the hash of its files. ``extra_files`` (name -> source) are copied into the result folder. ``name``
    stands in the summary in place of a temporary path. ``impact`` is the strongest of all ``impacts``.
    """

    recording: Recording
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


def write_track(folder: Path, track: Track, frame_rate: float | None, first_frame: int) -> None:
    """Write ``track.csv`` and, with the full covariances, ``track.parquet``."""
    n = len(track.status)
    frame = first_frame + np.arange(n)
    time = np.full(n, np.nan) if frame_rate is None else frame / frame_rate
    sd = np.sqrt(np.diagonal(track.covariance, axis1=1, axis2=2))
    radius = np.where(np.isfinite(track.position[:, 0]), track.radius, np.nan)
    # The first frame has no increment.
    first = np.full((1, 5), np.nan)
    values: tuple[NDArray[Any], ...] = (
        *(frame, time, track.status, *track.position.T, radius),
        *np.concatenate((first, track.increment)).T,
        *np.concatenate((first, sd)).T,
        *(track.zncc, track.iterations, *quaternions(track.orientation).T),
    )
    columns = dict(zip(TRACK_COLUMNS, values, strict=True))
    _write_csv(folder / "track.csv", columns if frame_rate is not None else columns | {"time_s": np.full(n, "")})
    covariance = np.concatenate((np.full(25, np.nan), track.covariance.ravel()))
    table = {name: pa.array(v.tolist() if v.dtype.kind == "U" else v) for name, v in columns.items()}
    table["covariance"] = pa.FixedSizeListArray.from_arrays(pa.array(covariance), 25)
    # Numbers rarely repeat, so that a dictionary would be a second copy of each column.
    pq.write_table(pa.table(table), folder / "track.parquet", compression="zstd", use_dictionary=["status"])


def write_kinematics(folder: Path, motion: Kinematics, first_frame: int) -> None:
    """Write ``kinematics.csv``: times, known vectors, their standard deviations, numbers of the frames."""
    vectors = {name: names for name, names in KINEMATICS_COLUMNS.items() if getattr(motion, name) is not None}
    columns: dict[str, NDArray[Any]] = {"time_s": motion.time_s}
    for prefix in ("", "sd_"):
        for name, names in vectors.items():
            values = getattr(motion, prefix + name)
            columns |= {prefix + column: values[:, k] for k, column in enumerate(names)}
    columns["frame"] = first_frame + np.arange(len(motion.time_s))
    _write_csv(folder / "kinematics.csv", columns)


def write_summary(folder: Path, summary: dict[str, Any]) -> None:
    """Write ``summary.json``; NaN and infinity become null."""
    text = json.dumps(_jsonable(summary), indent=2, ensure_ascii=False, allow_nan=False)
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


def _jsonable(value: Any) -> Any:
    if isinstance(value, dict):
        return {str(k): _jsonable(v) for k, v in value.items()}
    if isinstance(value, (list, tuple)):
        return [_jsonable(v) for v in value]
    if isinstance(value, np.ndarray):
        return _jsonable(value.tolist())
    if isinstance(value, (np.floating, np.integer)):
        value = value.item()
    if isinstance(value, float) and not math.isfinite(value):
        return None
    return str(value) if isinstance(value, Path) else value


def summary(request: Request, done: Measurement, frame_rate: float | None) -> dict[str, Any]:
    """The contents of ``summary.json``; docs/results.md explains each key."""
    recording, tracked = done.recording, done.track
    circle = tracked.circle
    # Values in px stay in the camera frame.
    in_lab = done.motion is not None and done.motion.lab_frame
    return {
        "input": {
            "path": done.name or shown(str(request.input)),
            "sha256": done.sha256,
            "kind": recording.kind,
            "frames": len(recording),
            "first_frame": done.first_frame,
            "last_frame": done.first_frame + len(tracked.status) - 1,
            "width_px": recording.shape[2],
            "height_px": recording.shape[1],
            "bit_depth": recording.bit_depth,
            "exposure_s": recording.exposure_s,
            "trigger_offset_frames": recording.trigger_offset_frames,
            "origins": dict(recording.origins),
        },
        "frame_rate": frame_rate,
        "frame_rate_origin": "given" if request.fps is not None else recording.origins.get("frame_rate"),
        "circle": {**vars(circle), "frame": done.first_frame + circle.frame, "unit": "px"},
        "radius_effect": _radius_effect(tracked),
        "scale": None if done.motion is None else vars(done.motion.scale),
        "frames_per_status": status_counts(tracked),
        "mean_motion": mean_motion(tracked, done.motion),
        "axes": "lab frame: x right, y up, z to the camera" if in_lab else "camera frame: x right, y down",
        "settings": {k: v for k, v in vars(request).items() if k not in ("input", "out")} | tracked.settings,
        "differentiation": None if done.motion is None else done.motion.about,
        "impact": None if done.impact is None else done.impact.summary(),
        "impacts": [found.summary() for found in done.impacts],
        "contact_s": None if done.motion is None else done.motion.contact_s,
        "warnings": list(done.warnings),
        "seconds": round(done.seconds, 3),
        "versions": versions(),
    }


def _radius_effect(tracked: Track) -> dict[str, float]:
    """Effect of the radius's standard deviation on the mean step (px) and on all rotations (relative)."""
    turn = float(np.linalg.norm(np.nan_to_num(tracked.increment[:, 2:4]), axis=1).mean())
    sd = tracked.circle.sd_radius
    return {
        "sd_radius_px": sd,
        "sd_mean_step_px": STEP_PER_RADIUS * turn * sd,
        "relative_sd_rotation": ROTATION_PER_RADIUS * sd / tracked.circle.radius,
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
