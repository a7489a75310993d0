"""A result folder of ``torchsphere track``, read back for figures and reports, and the columns of its tables."""

from __future__ import annotations

import json
import math
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
from numpy.typing import NDArray
from pyarrow import csv

from torchsphere.correlation.frame_status import STATUSES
from torchsphere.dynamics.depth import Depth
from torchsphere.dynamics.scale import LAB_AXES
from torchsphere.motion.ledger import INCREMENTS
from torchsphere.results.sampled_frames import Sampled, load
from torchsphere.runtime.arrays import Array

#: Columns of ``track.csv``: the motion from the frame before, px and rad, and all columns.
TRACK_COLUMNS = (
    *("frame", "time_s", "status", "x_px", "y_px", "radius_px"),
    *INCREMENTS,
    *(f"sd_{name}" for name in INCREMENTS),
    *("zncc", "iterations", "qw", "qx", "qy", "qz"),
)

#: Columns of ``kinematics.csv`` by the vector's name in `Kinematics` and `SIMotion`, in the order of the file. The
#: standard deviations of a vector ``v`` are ``sd_v``, with the same columns after ``sd_``.
KINEMATICS_COLUMNS = {
    "position_m": ("x_m", "y_m"),
    "velocity_m_s": ("vx_m_s", "vy_m_s"),
    "acceleration_m_s2": ("ax_m_s2", "ay_m_s2"),
    "force_N": ("fx_N", "fy_N"),
    "spin_rad_s": ("wx_rad_s", "wy_rad_s", "wz_rad_s"),
}

#: Last columns of ``kinematics.csv``, where the motion along the optical axis is measured.
DEPTH_COLUMNS = {"z_m": "z_m", "velocity_m_s": "vz_m_s", "acceleration_m_s2": "az_m_s2", "force_N": "fz_N"}

#: Columns of ``force_path.csv``.
FORCE_PATH_COLUMNS = (
    *("impact", "frame", "time_s", "branch"),
    *("penetration_m", "force_N", "sd_penetration_m", "sd_force_N"),
)

#: Sections that every ``summary.json`` has, with the keys that each section has at least.
_REQUIRED = {
    "input": ("path", "kind", "frames", "first_frame", "last_frame", "width_px", "height_px"),
    "circle": ("radius", "frame"),
    "settings": (),
}

#: Start of the warning that says why no impact is reported.
NO_IMPACT = "No impact is reported: "


@dataclass(frozen=True)
class SIMotion:
    """Columns of ``kinematics.csv``, a row per frame."""

    time_s: Array
    position_m: Array
    velocity_m_s: Array
    acceleration_m_s2: Array
    force_N: Array | None  # noqa: N815  (N is newton)
    spin_rad_s: Array
    sd_position_m: Array
    sd_velocity_m_s: Array
    sd_acceleration_m_s2: Array
    sd_force_N: Array | None  # noqa: N815
    sd_spin_rad_s: Array
    depth: Depth | None = None


@dataclass(frozen=True)
class ForcePathTable:
    """Rows of ``force_path.csv`` of one impact."""

    is_loading: NDArray[np.bool_]  # (m,)
    penetration_m: Array
    force_N: Array  # noqa: N815
    sd_penetration_m: Array
    sd_force_N: Array  # noqa: N815


@dataclass(frozen=True)
class ResultFolder:
    """A result of n frames, px and rad, camera frame; NaN where a value was not measured."""

    path: Path
    summary: dict[str, Any]  # ``summary.json``
    frame: NDArray[np.int64]  # numbers (n,) of the frames in the recording
    time_s: Array  # (n,), NaN if the frame rate is not known
    status: NDArray[np.str_]  # (n,)
    position: Array  # centre (n, 2) of the ball
    radius: Array  # (n,)
    increment: Array  # motion (n, 5) from the frame before as (dx, dy, wx, wy, wz)
    sd_increment: Array
    zncc: Array  # (n,)
    quaternion: Array  # orientation (n, 4) since the first frame as (w, x, y, z); NaN if no rotation was measured
    motion: SIMotion | None  # None unless frame rate and scale are known
    sampled: Sampled | None  # some images and residual maps; None if the result keeps none
    force_path: ForcePathTable | None = None  # of the strongest impact; None if it has none

    @property
    def lab_frame(self) -> bool:
        """Whether `motion` is in the lab frame (y up, z towards the camera)."""
        return self.motion is not None and bool(self.summary["settings"].get("lab_frame", False))

    @property
    def axis_signs(self) -> Array:
        """Signs (3,) that turn a vector of the camera frame into the frame of `motion`, and back."""
        return np.diag(LAB_AXES) if self.lab_frame else np.ones(3)

    @property
    def known(self) -> NDArray[np.bool_]:
        """Frames (n,) in which the position of the ball is known."""
        return np.isfinite(self.position[:, 0])

    @property
    def without_rotation(self) -> bool:
        """Whether the ball was tracked with the model "translation", which has no rotation."""
        return bool(self.summary["settings"].get("model") == "translation")

    @property
    def has_steps(self) -> bool:
        """Whether the translation between any two frames was measured."""
        return bool(np.isfinite(self.increment[:, 0]).any())

    @property
    def scale_given(self) -> bool:
        """Whether the user gave the ball's diameter or the size of a pixel."""
        settings = self.summary["settings"]
        return settings.get("diameter_mm") is not None or settings.get("mm_per_px") is not None

    @property
    def circle_given(self) -> bool:
        """Whether the user gave the ball's outline."""
        return bool(self.summary["settings"].get("circle_given", False))

    @property
    def contact_s(self) -> tuple[float, float] | None:
        """Start and end of the contact; None if no contact was found."""
        contact = self.summary.get("contact_s")
        return None if not contact or None in contact else (float(contact[0]), float(contact[1]))

    @property
    def turned_rad(self) -> Array:
        """Angles (n, 3) turned since the first measured frame, about the axes of the camera frame.

        The angles are sums of increments as in figure 9 of the paper, NaN after the first missing increment.
        """
        angles = np.full((len(self.frame), 3), np.nan)
        if self.known.any():
            rotation = self.increment[self.known.argmax() :, 2:].copy()
            rotation[0] = 0.0
            angles[-len(rotation) :] = rotation.cumsum(0)
        # A single zero, that of the first frame, is no measurement.
        return angles if np.isfinite(angles[:, 0]).sum() > 1 else np.full_like(angles, np.nan)


def read(path: Path) -> ResultFolder:
    """Read a result folder; raises ValueError if ``path`` is no result of ``torchsphere track``, or is damaged."""
    if not path.exists():
        raise ValueError(f"{path}: does not exist; give the folder of a result")
    for name in ("track.csv", "summary.json"):
        if not (path / name).is_file():
            problem = f"there is no {name}, so this is no result folder of 'torchsphere track'"
            raise ValueError(f"{path}: {problem}; give the folder of a result")
    try:
        summary = json.loads((path / "summary.json").read_text(encoding="utf-8"))
        table = _columns(path / "track.csv", ("status",))
        motion = _motion(path / "kinematics.csv") if (path / "kinematics.csv").is_file() else None
        _check_complete(summary, table, motion)
        return ResultFolder(
            path=path,
            summary=summary,
            frame=_frame_numbers(table["frame"]),
            time_s=table["time_s"],
            status=table["status"].astype(np.str_),
            position=_stacked(table, ("x_px", "y_px")),
            radius=table["radius_px"],
            increment=_stacked(table, INCREMENTS),
            sd_increment=_stacked(table, INCREMENTS, "sd_"),
            zncc=table["zncc"],
            quaternion=_measured(_stacked(table, ("qw", "qx", "qy", "qz"))),
            motion=motion if motion is None else _with_angles(motion, summary.get("mean_motion") or {}),
            sampled=load(path / "frames.npz") if (path / "frames.npz").is_file() else None,
            force_path=_force_path(path / "force_path.csv", summary),
        )
    except (_DamageError, json.JSONDecodeError, UnicodeDecodeError, RecursionError, pa.ArrowInvalid) as error:
        raise ValueError(f"{path}: the result is damaged ({error}); track the recording again") from error
    except KeyError as error:
        raise ValueError(f"{path}: the result is damaged (there is no {error}); track the recording again") from error


class _DamageError(Exception):
    """Damage of a result, in a few words."""


def _check_complete(summary: Any, table: dict[str, NDArray[Any]], motion: SIMotion | None) -> None:
    """Raise _DamageError if the summary lacks a section, a table lacks frames, or a status is unknown."""
    sections = summary if isinstance(summary, dict) else {}
    for name, keys in _REQUIRED.items():
        section = sections.get(name)
        if not isinstance(section, dict) or any(section.get(key) is None for key in keys):
            raise _DamageError(f"summary.json does not tell {', '.join(keys) or 'anything'} of its {name}")
    _check_scale(summary.get("scale"))
    first = summary["input"]["first_frame"]
    for row, status in enumerate(table["status"]):
        if status not in STATUSES:
            frame = f"frame {first + row} in track.csv"
            raise _DamageError(f"the status of {frame} is {status!r}, and none of {', '.join(STATUSES)}")
    count = summary["input"]["last_frame"] - first + 1
    lengths = {"track.csv": len(table["frame"])} | ({} if motion is None else {"kinematics.csv": len(motion.time_s)})
    for name, length in lengths.items():
        if length != count:
            raise _DamageError(f"{name} has {length} of the {count} frames")


def _check_scale(scale: Any) -> None:
    """Raise _DamageError for a scale whose size of a pixel, m, or its standard deviation is no number."""
    told: dict[str, Any] = {"m_per_px": None, "sd_m_per_px": None} | (scale if isinstance(scale, dict) else {})
    size, sd = told["m_per_px"], told["sd_m_per_px"]
    is_whole = _is_number(size) and size > 0 and (sd is None or _is_number(sd))
    if scale is not None and not is_whole:
        raise _DamageError(f"summary.json tells no size of a pixel as its scale, but {str(scale)[:100]}")


def _is_number(value: Any) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool) and -math.inf < value < math.inf


def _frame_numbers(column: Array) -> NDArray[np.int64]:
    if not (np.isfinite(column) & (np.abs(column) < 2**53)).all():
        raise _DamageError("a frame in track.csv has no number")
    return column.astype(np.int64)


def _columns(path: Path, texts: tuple[str, ...] = ()) -> dict[str, NDArray[Any]]:
    """Columns by name: strings for ``texts``, otherwise float64 with NaN for an empty cell."""
    with path.open(encoding="utf-8") as stream:
        head = stream.readline().strip().split(",")
    types = {name: pa.string() if name in texts else pa.float64() for name in head}
    table = csv.read_csv(path, convert_options=csv.ConvertOptions(column_types=types))
    return {name: table[name].to_numpy(zero_copy_only=False) for name in head}


def _stacked(table: dict[str, NDArray[Any]], names: tuple[str, ...], prefix: str = "") -> Array:
    return np.stack([table[prefix + name] for name in names], 1)


def _measured(quaternion: Array) -> Array:
    """The orientations (n, 4); that of the first frame alone, which is 1 by definition, is no measurement."""
    return quaternion if np.isfinite(quaternion[:, 0]).sum() > 1 else np.full_like(quaternion, np.nan)


def _motion(path: Path) -> SIMotion:
    table = _columns(path)
    vectors: dict[str, Any] = {
        prefix + name: _stacked(table, columns, prefix) if columns[0] in table else None
        for name, columns in KINEMATICS_COLUMNS.items()
        for prefix in ("", "sd_")
    }
    return SIMotion(time_s=table["time_s"], depth=_depth(table), **vectors)


def _depth(table: dict[str, NDArray[Any]]) -> Depth | None:
    """The motion along the optical axis; None where the table has none."""
    if DEPTH_COLUMNS["z_m"] not in table:
        return None
    known: dict[str, Any] = {
        prefix + name: table.get(prefix + column) for prefix in ("", "sd_") for name, column in DEPTH_COLUMNS.items()
    }
    return Depth(**known)


def _with_angles(motion: SIMotion, means: dict[str, Any]) -> SIMotion:
    """The motion with the angles of its flights, which the ``means`` of the summary have."""
    if motion.depth is None:
        return motion
    angles, sds = (tuple(means.get(name, ())) for name in ("out_of_plane_deg", "sd_out_of_plane_deg"))
    return replace(motion, depth=replace(motion.depth, out_of_plane_deg=angles, sd_out_of_plane_deg=sds))


def _force_path(path: Path, summary: dict[str, Any]) -> ForcePathTable | None:
    """The rows of the strongest impact."""
    strongest = summary.get("impact")
    if not path.is_file() or not strongest:
        return None
    starts = [impact.get("contact_start") for impact in summary.get("impacts", [])]
    if strongest.get("contact_start") not in starts:
        return None
    table = _columns(path, ("branch",))
    rows = table["impact"] == starts.index(strongest["contact_start"]) + 1
    numbers: dict[str, Any] = {name: table[name][rows] for name in FORCE_PATH_COLUMNS[4:]}
    return ForcePathTable(is_loading=table["branch"][rows] == "loading", **numbers) if rows.any() else None
