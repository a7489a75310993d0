"""Tables and summary of a result folder, written from a track and its kinematics."""

from __future__ import annotations

import json
import math
from collections import Counter
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
from numpy.typing import NDArray

from torchsphere.dynamics.kinematics import Kinematics
from torchsphere.geometry.orientation import quaternions
from torchsphere.results.columns import KINEMATICS_COLUMNS, TRACK_COLUMNS
from torchsphere.tracking.track import Track

#: Rows of a CSV file that are converted to text at once.
CSV_ROWS = 1000


def write_track(folder: Path, track: Track, frame_rate: float | None, first_frame: int) -> None:
    """Write ``track.csv`` and, with the full covariances, ``track.parquet``."""
    n = len(track.status)
    frame = first_frame + np.arange(n)
    time = np.full(n, np.nan) if frame_rate is None else frame / frame_rate
    sd = np.sqrt(np.diagonal(track.covariance, axis1=1, axis2=2))
    radius = np.where(np.isfinite(track.position[:, 0]), track.radius, np.nan)
    # No increment leads to the first frame.
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
    # Numbers hardly ever repeat: a dictionary of them would be a second copy of each column.
    pq.write_table(pa.table(table), folder / "track.parquet", compression="zstd", use_dictionary=["status"])


def write_kinematics(folder: Path, motion: Kinematics, first_frame: int) -> None:
    """Write ``kinematics.csv``: the time, the vectors that are known, their standard deviations, the frame's number."""
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


def status_counts(track: Track) -> dict[str, int]:
    """Number of frames per status, the most frequent first."""
    return dict(Counter(track.status.tolist()).most_common())


def _write_csv(path: Path, columns: dict[str, NDArray[Any]]) -> None:
    n = len(next(iter(columns.values())))
    # One format for a whole row takes half the time of one per number. No value needs quotation marks.
    kinds = {"i": "%d", "u": "%d", "U": "%s"}
    row = ",".join(kinds.get(column.dtype.kind, "%.10g") for column in columns.values()) + "\r\n"
    with path.open("w", newline="", encoding="utf-8") as stream:
        stream.write(",".join(columns) + "\r\n")
        # In blocks, as text takes ten times the memory of its numbers.
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
