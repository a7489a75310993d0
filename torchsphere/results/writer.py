"""Write a result folder: tables, summary, figure. It appears whole or not at all."""

from __future__ import annotations

import contextlib
import json
import math
import os
import shutil
import tempfile
from collections import Counter
from collections.abc import Iterator
from pathlib import Path
from typing import Any, TextIO

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
from numpy.typing import NDArray

from torchsphere.dynamics.kinematics import Kinematics
from torchsphere.geometry.orientation import quaternions
from torchsphere.tracking.track import Track

INCREMENTS = ("dx_px", "dy_px", "wx_rad", "wy_rad", "wz_rad")

#: Rows of a table that are put into words at once.
CSV_ROWS = 1000

TRACK_COLUMNS = (
    *("frame", "time_s", "status", "x_px", "y_px", "radius_px"),
    *INCREMENTS,
    *(f"sd_{name}" for name in INCREMENTS),
    *("zncc", "iterations", "qw", "qx", "qy", "qz"),
)


def check_folder(folder: Path, overwrite: bool) -> None:
    """Raise OSError unless a result may be written to ``folder``.

    What is there already needs ``overwrite``, and even then only an earlier result is replaced, never other files.
    """
    if not folder.exists():
        _require_writable(folder)
        return
    if not folder.is_dir():
        raise FileExistsError(f"{folder} is a file; give the name of a folder for the result")
    if not any(folder.iterdir()):
        return
    if not overwrite:
        raise FileExistsError(f"{folder} exists and is not empty; give another folder, or --overwrite to replace it")
    if not any((folder / name).is_file() for name in ("summary.json", "plan.json")):
        raise FileExistsError(f"{folder} holds files that are no result of torchsphere; they are not overwritten")


def _require_writable(folder: Path) -> None:
    """Raise PermissionError where no folder can be made, by the name that was given and before the work is done."""
    above = next((parent for parent in folder.absolute().parents if parent.exists()), None)
    if above is not None and not os.access(above, os.W_OK | os.X_OK):
        raise PermissionError(f"{folder}: {above} may not be written to; give a folder for the result that may be")


@contextlib.contextmanager
def whole_folder(folder: Path, overwrite: bool) -> Iterator[Path]:
    """A new folder to write to, which takes the place of ``folder`` when the block ends without an error."""
    check_folder(folder, overwrite)
    folder.parent.mkdir(parents=True, exist_ok=True)
    new = Path(tempfile.mkdtemp(prefix=f".{folder.name}.", dir=folder.parent))
    try:
        yield new
        new.chmod(0o755)
        check_folder(folder, overwrite)
        if folder.exists():
            old = Path(tempfile.mkdtemp(prefix=f".{folder.name}.", dir=folder.parent))
            # Renamed aside and back again if need be, so that there is no moment without either result.
            folder.replace(old)
            try:
                new.replace(folder)
            except OSError:
                old.replace(folder)
                raise
            shutil.rmtree(old)
        else:
            new.replace(folder)
    finally:
        if new.exists():
            shutil.rmtree(new)


@contextlib.contextmanager
def whole_file(path: Path) -> Iterator[TextIO]:
    """A text to write to, which takes the place of the file at ``path`` when the block ends without an error."""
    path.parent.mkdir(parents=True, exist_ok=True)
    if path.exists() and not path.is_file():
        # A pipe or a terminal is written to as it is; a folder is refused by its own name.
        with path.open("w", newline="", encoding="utf-8") as stream:
            yield stream
        return
    part = path.with_name(f".{path.name}.part")
    try:
        with part.open("w", newline="", encoding="utf-8") as stream:
            yield stream
        part.replace(path)
    finally:
        part.unlink(missing_ok=True)


def write_track(folder: Path, track: Track, frame_rate: float | None, first_frame: int) -> None:
    """Write ``track.csv`` and, with the full covariances, ``track.parquet``."""
    n = len(track.status)
    frames = first_frame + np.arange(n)
    blank = np.full((1, 5), np.nan)
    sd = np.sqrt(np.diagonal(track.covariance, axis1=1, axis2=2))
    radius = np.where(np.isfinite(track.position[:, 0]), track.radius, np.nan)
    columns: dict[str, Any] = dict(
        zip(
            TRACK_COLUMNS,
            (
                *(frames, np.full(n, np.nan) if frame_rate is None else frames / frame_rate, track.status),
                *(*track.position.T, radius),
                *np.concatenate((blank, track.increment)).T,
                *np.concatenate((blank, sd)).T,
                *(track.zncc, track.iterations, *quaternions(track.orientation).T),
            ),
            strict=True,
        )
    )
    _write_csv(folder / "track.csv", columns if frame_rate is not None else columns | {"time_s": np.full(n, "")})
    covariance = np.concatenate((np.full((1, 25), np.nan), track.covariance.reshape(-1, 25)))
    table = {
        name: pa.array(column.tolist() if column.dtype.kind == "U" else column) for name, column in columns.items()
    }
    table["covariance"] = pa.FixedSizeListArray.from_arrays(pa.array(covariance.ravel()), 25)
    # A dictionary of numbers that hardly ever repeat would be one more copy of each column.
    pq.write_table(pa.table(table), folder / "track.parquet", compression="zstd", use_dictionary=["status"])


def write_kinematics(folder: Path, motion: Kinematics, first_frame: int) -> None:
    """Write ``kinematics.csv``; the frame's number is the last column: the first is the time."""
    vectors = [
        (("x_m", "y_m"), motion.position_m, motion.sd_position_m),
        (("vx_m_s", "vy_m_s"), motion.velocity_m_s, motion.sd_velocity_m_s),
        (("ax_m_s2", "ay_m_s2"), motion.acceleration_m_s2, motion.sd_acceleration_m_s2),
        (("wx_rad_s", "wy_rad_s", "wz_rad_s"), motion.spin_rad_s, motion.sd_spin_rad_s),
    ]
    if motion.force_N is not None and motion.sd_force_N is not None:
        vectors.insert(3, (("fx_N", "fy_N"), motion.force_N, motion.sd_force_N))
    columns: dict[str, NDArray[Any]] = {"time_s": motion.time_s}
    columns |= {name: value[:, k] for names, value, _ in vectors for k, name in enumerate(names)}
    columns |= {f"sd_{name}": sd[:, k] for names, _, sd in vectors for k, name in enumerate(names)}
    columns["frame"] = first_frame + np.arange(len(motion.time_s))
    _write_csv(folder / "kinematics.csv", columns)


def write_summary(folder: Path, summary: dict[str, Any]) -> None:
    """Write ``summary.json``; numbers that are not known become null."""
    text = json.dumps(_jsonable(summary), indent=2, ensure_ascii=False, allow_nan=False)
    (folder / "summary.json").write_text(text + "\n", encoding="utf-8")


def status_counts(track: Track) -> dict[str, int]:
    """Number of frames per status, the most frequent first."""
    return dict(Counter(track.status.tolist()).most_common())


def _write_csv(path: Path, columns: dict[str, NDArray[Any]]) -> None:
    n = len(next(iter(columns.values())))
    # One text for a whole row takes half the time of one per number; none of what is written needs quotation marks.
    kinds = {"i": "%d", "u": "%d", "U": "%s"}
    row = ",".join(kinds.get(column.dtype.kind, "%.10g") for column in columns.values()) + "\r\n"
    with path.open("w", newline="", encoding="utf-8") as stream:
        stream.write(",".join(columns) + "\r\n")
        for start in range(0, n, CSV_ROWS):
            # A text takes ten times the memory of its number: never all of a long recording at once.
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
