"""Columns of the tables of a result, with their units: for CSV and Parquet files, exports and data frames."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from torchsphere.dynamics.contact_law import ContactForce
from torchsphere.dynamics.filtered_motion import FilteredMotion
from torchsphere.dynamics.kinematics import Kinematics
from torchsphere.geometry.orientation import quaternions
from torchsphere.motion.track import Track
from torchsphere.results.reader import DEPTH_COLUMNS, FORCE_PATH_COLUMNS, KINEMATICS_COLUMNS, TRACK_COLUMNS

Columns = dict[str, NDArray[Any]]

#: Ends of the names of columns, the longest first, and their units.
_UNITS = (
    *(("_m_s2", "m/s^2"), ("_rad_s2", "rad/s^2"), ("_rad_s", "rad/s"), ("_m_s", "m/s")),
    *(("_px", "px"), ("_rad", "rad"), ("_N", "N"), ("_m", "m"), ("_s", "s")),
)

#: Units of columns whose names do not end in them.
_OTHER_UNITS = {"frame_rate": "1/s", "seconds": "s", "restitution": "1", "sd_restitution": "1", "zncc": "1"}


def unit_of(column: str) -> str:
    """The unit of a column by its name; empty for words and counts, "1" for ratios."""
    if column in _OTHER_UNITS or column in ("qw", "qx", "qy", "qz"):
        return _OTHER_UNITS.get(column, "1")
    return next((unit for end, unit in _UNITS if column.endswith(end)), "")


def track_columns(track: Track, frame_rate: float | None, first_frame: int) -> Columns:
    """Columns of ``track.csv``; times are NaN without a frame rate."""
    n = len(track.status)
    frame = first_frame + np.arange(n)
    time = np.full(n, np.nan) if frame_rate is None else (frame if track.times is None else track.times) / frame_rate
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
    return dict(zip(TRACK_COLUMNS, values, strict=True))


def covariances(track: Track) -> NDArray[np.float64]:
    """Covariances (n, 5, 5) of the increments that lead to the frames; NaN for the first frame."""
    return np.concatenate((np.full((1, 5, 5), np.nan), track.covariance))


def motion_columns(motion: Kinematics, first_frame: int) -> Columns:
    """Columns of ``kinematics.csv``: times, known vectors, their standard deviations, numbers of the frames, depth."""
    columns, depth = _vectors(motion, tuple(KINEMATICS_COLUMNS), first_frame), motion.depth
    if depth is None:
        return columns
    known = {name: column for name, column in DEPTH_COLUMNS.items() if getattr(depth, name) is not None}
    return columns | {
        prefix + column: getattr(depth, prefix + name) for prefix in ("", "sd_") for name, column in known.items()
    }


def filtered_columns(motion: FilteredMotion, first_frame: int) -> Columns:
    """Columns of ``kinematics_cfc.csv``: filtered acceleration and force."""
    return _vectors(motion, ("acceleration_m_s2", "force_N"), first_frame)


def _vectors(motion: Kinematics | FilteredMotion, wanted: tuple[str, ...], first_frame: int) -> Columns:
    vectors = {name: KINEMATICS_COLUMNS[name] for name in wanted if getattr(motion, name) is not None}
    columns: Columns = {"time_s": motion.time_s}
    for prefix in ("", "sd_"):
        for name, names in vectors.items():
            values = getattr(motion, prefix + name)
            columns |= {prefix + column: values[:, k] for k, column in enumerate(names)}
    columns["frame"] = first_frame + np.arange(len(motion.time_s))
    return columns


def force_path_columns(forces: Sequence[ContactForce], first_frame: int) -> Columns:
    """Columns of ``force_path.csv``, a row per frame in a contact; none if no impact has a force."""
    blocks = [
        (
            np.full(len(path.row), number),
            first_frame + path.row,
            path.time_s,
            np.where(path.is_loading, "loading", "unloading"),
            *(path.penetration.value, path.force.value, path.penetration.sd, path.force.sd),
        )
        for number, path in enumerate((force.path for force in forces), start=1)
        if path is not None
    ]
    columns = [np.concatenate(column) for column in zip(*blocks, strict=True)]
    return dict(zip(FORCE_PATH_COLUMNS, columns, strict=True)) if blocks else {}
