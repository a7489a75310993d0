"""Read a result folder of ``torchsphere track`` back: what figures and report are drawn from, and from nothing else."""

from __future__ import annotations

import json
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
from numpy.typing import NDArray
from pyarrow import csv

from torchsphere.results.sampled_frames import Sampled, load
from torchsphere.settings.choices import STATUSES

Array = NDArray[np.float64]

#: What a summary tells of every result, and what each of these tells at least.
_SECTIONS = {
    "input": ("path", "kind", "frames", "first_frame", "last_frame", "width_px", "height_px"),
    "circle": ("radius", "frame"),
    "settings": (),
}

#: Status of frames whose translation was measured, and of those whose rotation was, too.
TRANSLATION_KNOWN, ALL_KNOWN = ("ok", "weak_texture"), ("ok",)


@dataclass(frozen=True)
class SIMotion:
    """The columns of ``kinematics.csv``: units in the names, rows are frames, every ``sd_`` a standard deviation."""

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


@dataclass(frozen=True)
class ResultFolder:
    """A result folder; n frames, px and rad, camera frame; NaN where something was not measured.

    Attributes
    ----------
    path : Path
    summary : dict
        ``summary.json``.
    frame : ndarray
        Numbers (n,) of the frames in the recording.
    time_s : ndarray
        (n,), NaN where no frame rate is known.
    status : ndarray
        Strings (n,).
    position, radius : ndarray
        Centre (n, 2) and radius (n,) of the ball in the images, px.
    increment, sd_increment : ndarray
        Motion (n, 5) that leads to each frame as (dx, dy, wx, wy, wz), and its standard deviations.
    zncc : ndarray
        (n,).
    quaternion : ndarray
        Orientation (n, 4) since the first frame as (w, x, y, z).
    motion : SIMotion or None
        In SI units, in the frame that `lab_frame` tells; None where frame rate or scale are not known.
    sampled : Sampled or None
        Some of the images and residual maps; None where none were kept.
    """

    path: Path
    summary: dict[str, Any]
    frame: NDArray[np.int64]
    time_s: Array
    status: NDArray[np.str_]
    position: Array
    radius: Array
    increment: Array
    sd_increment: Array
    zncc: Array
    quaternion: Array
    motion: SIMotion | None
    sampled: Sampled | None

    @property
    def lab_frame(self) -> bool:
        """Whether SI units are in the lab frame (y up, z towards the camera), not in the camera frame."""
        return bool(self.summary["settings"].get("lab_frame", False))

    @property
    def known(self) -> NDArray[np.bool_]:
        """Frames (n,) in which the place of the ball is known."""
        return np.isfinite(self.position[:, 0])

    @property
    def without_rotation(self) -> bool:
        """Whether the ball was tracked with a model that knows no rotation, so that none could be measured."""
        return bool(self.summary["settings"].get("model") == "translation")

    @property
    def has_steps(self) -> bool:
        """Whether a step of the ball was measured from any frame to the next."""
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
        """Start and end of the contact; None where none was found."""
        contact = self.summary.get("contact_s")
        return None if not contact or None in contact else (float(contact[0]), float(contact[1]))

    @property
    def turned_rad(self) -> Array:
        """Angles (n, 3) turned since the first measured frame: sums of the increments; NaN from where one is missing.

        About the axes of the camera frame; what the paper's figure 9 shows, and whose slope is the spin.
        """
        rotation = self.increment[:, 2:].copy()
        known = np.flatnonzero(self.known)
        if len(known):
            rotation[: known[0]] = np.nan
            rotation[known[0]] = 0.0
        start = known[0] if len(known) else len(rotation)
        angles = np.full_like(rotation, np.nan)
        angles[start:] = rotation[start:].cumsum(0)
        # A single zero is no measurement.
        return angles if np.isfinite(angles[:, 0]).sum() > 1 else np.full_like(angles, np.nan)


def read(path: Path) -> ResultFolder:
    """Read the result folder at ``path``.

    Raises
    ------
    ValueError
        If it is no result folder of ``torchsphere track``, or one that is damaged.
    """
    if not path.exists():
        raise ValueError(f"{path}: does not exist; give the result folder that --out named")
    for name in ("track.csv", "summary.json"):
        if not (path / name).is_file():
            raise ValueError(
                f"{path}: there is no {name}, so this is no result folder of 'torchsphere track'; give the one that "
                "--out named"
            )
    try:
        summary = json.loads((path / "summary.json").read_text(encoding="utf-8"))
        table = _columns(path / "track.csv", ("status",))
        motion = _motion(path / "kinematics.csv") if (path / "kinematics.csv").is_file() else None
        _require_whole(summary, table, motion)
        increments = ("dx_px", "dy_px", "wx_rad", "wy_rad", "wz_rad")
        return ResultFolder(
            path=path,
            summary=summary,
            frame=table["frame"].astype(np.int64),
            time_s=table["time_s"],
            status=table["status"].astype(np.str_),
            position=_stacked(table, ("x_px", "y_px")),
            radius=table["radius_px"],
            increment=_stacked(table, increments),
            sd_increment=_stacked(table, tuple(f"sd_{name}" for name in increments)),
            zncc=table["zncc"],
            quaternion=_stacked(table, ("qw", "qx", "qy", "qz")),
            motion=motion,
            sampled=load(path / "frames.npz") if (path / "frames.npz").is_file() else None,
        )
    except (_DamageError, json.JSONDecodeError, UnicodeDecodeError, pa.ArrowInvalid) as error:
        raise ValueError(f"{path}: the result is damaged ({error}); track the recording again") from error
    except KeyError as error:
        raise ValueError(f"{path}: the result is damaged (there is no {error}); track the recording again") from error


class _DamageError(Exception):
    """What is wrong with a result, in a few words."""


def _require_whole(summary: Any, table: dict[str, NDArray[Any]], motion: SIMotion | None) -> None:
    """Raise _DamageError where the summary lacks a section, a table lacks frames, or a frame has no known status."""
    sections = summary if isinstance(summary, dict) else {}
    for name, parts in _SECTIONS.items():
        section = sections.get(name)
        if not isinstance(section, dict) or any(section.get(part) is None for part in parts):
            raise _DamageError(f"summary.json does not tell {', '.join(parts) or 'anything'} of its {name}")
    for row, status in enumerate(table["status"]):
        if status not in STATUSES:
            raise _DamageError(
                f"the status of frame {summary['input']['first_frame'] + row} in track.csv is {status!r}, and none of "
                f"{', '.join(STATUSES)}"
            )
    count = summary["input"]["last_frame"] - summary["input"]["first_frame"] + 1
    lengths = {"track.csv": len(table["frame"])} | ({} if motion is None else {"kinematics.csv": len(motion.time_s)})
    for name, length in lengths.items():
        if length != count:
            raise _DamageError(f"{name} has {length} of the {count} frames")


def _columns(path: Path, texts: tuple[str, ...] = ()) -> dict[str, NDArray[Any]]:
    """Columns by name: strings where named in ``texts``, otherwise float64 with NaN where a cell is empty."""
    with path.open(encoding="utf-8") as stream:
        head = stream.readline().strip().split(",")
    types = {name: pa.string() if name in texts else pa.float64() for name in head}
    table = csv.read_csv(path, convert_options=csv.ConvertOptions(column_types=types))
    return {name: table[name].to_numpy(zero_copy_only=False) for name in head}


def _stacked(table: dict[str, NDArray[Any]], names: tuple[str, ...]) -> Array:
    return np.stack([table[name] for name in names], 1)


def _motion(path: Path) -> SIMotion:
    table = _columns(path)
    vectors = {
        "position_m": ("x_m", "y_m"),
        "velocity_m_s": ("vx_m_s", "vy_m_s"),
        "acceleration_m_s2": ("ax_m_s2", "ay_m_s2"),
        "force_N": ("fx_N", "fy_N"),
        "spin_rad_s": ("wx_rad_s", "wy_rad_s", "wz_rad_s"),
    }
    values: dict[str, Any] = {}
    for name, columns in vectors.items():
        there = columns[0] in table
        values[name] = _stacked(table, columns) if there else None
        values[f"sd_{name}"] = _stacked(table, tuple(f"sd_{c}" for c in columns)) if there else None
    return SIMotion(time_s=table["time_s"], **values)
