"""A result folder of ``torchsphere track``, read back: all that figures and reports are drawn from."""

from __future__ import annotations

import json
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
from numpy.typing import NDArray
from pyarrow import csv

from torchsphere.dynamics.scale import LAB_AXES
from torchsphere.results.columns import INCREMENTS, KINEMATICS_COLUMNS
from torchsphere.results.sampled_frames import Sampled, load
from torchsphere.settings.choices import STATUSES

Array = NDArray[np.float64]

#: Sections that every ``summary.json`` has, with the keys that each section has at least.
_REQUIRED = {
    "input": ("path", "kind", "frames", "first_frame", "last_frame", "width_px", "height_px"),
    "circle": ("radius", "frame"),
    "settings": (),
}

#: Statuses of frames with a measured translation, and of frames with a measured translation and rotation.
TRANSLATION_KNOWN, ALL_KNOWN = ("ok", "weak_texture"), ("ok",)


@dataclass(frozen=True)
class SIMotion:
    """The columns of ``kinematics.csv``, a row per frame, units in the names; ``sd_`` stands for standard deviation."""

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
    """A result of n frames, px and rad, camera frame; NaN where a value was not measured.

    Attributes
    ----------
    path : Path
    summary : dict
        ``summary.json``.
    frame : ndarray
        Numbers (n,) of the frames in the recording.
    time_s : ndarray
        (n,), NaN where the frame rate is not known.
    status : ndarray
        Strings (n,).
    position, radius : ndarray
        Centre (n, 2) and radius (n,) of the ball in the images, px.
    increment, sd_increment : ndarray
        Motion (n, 5) from the frame before as (dx, dy, wx, wy, wz), and its standard deviations.
    zncc : ndarray
        (n,).
    quaternion : ndarray
        Orientation (n, 4) since the first frame as (w, x, y, z).
    motion : SIMotion or None
        Motion in SI units, in the lab frame or the camera frame (`lab_frame`); None unless frame rate and scale are
        known.
    sampled : Sampled or None
        Some of the images and their residual maps; None if none were kept.
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

        They are sums of the increments, NaN from the first missing increment on, as in figure 9 of the paper. Their
        slope is the spin.
        """
        angles = np.full((len(self.frame), 3), np.nan)
        if self.known.any():
            rotation = self.increment[self.known.argmax() :, 2:].copy()
            rotation[0] = 0.0
            angles[-len(rotation) :] = rotation.cumsum(0)
        # The zero of the first frame alone is no measurement.
        return angles if np.isfinite(angles[:, 0]).sum() > 1 else np.full_like(angles, np.nan)


def read(path: Path) -> ResultFolder:
    """Read the result folder at ``path``.

    Raises
    ------
    ValueError
        If it is not a result folder of ``torchsphere track``, or is damaged.
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
        _check_complete(summary, table, motion)
        return ResultFolder(
            path=path,
            summary=summary,
            frame=table["frame"].astype(np.int64),
            time_s=table["time_s"],
            status=table["status"].astype(np.str_),
            position=_stacked(table, ("x_px", "y_px")),
            radius=table["radius_px"],
            increment=_stacked(table, INCREMENTS),
            sd_increment=_stacked(table, INCREMENTS, "sd_"),
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
    """The damage of a result, in a few words."""


def _check_complete(summary: Any, table: dict[str, NDArray[Any]], motion: SIMotion | None) -> None:
    """Raise _DamageError if the summary lacks a section, a table lacks frames, or a status is unknown."""
    sections = summary if isinstance(summary, dict) else {}
    for name, keys in _REQUIRED.items():
        section = sections.get(name)
        if not isinstance(section, dict) or any(section.get(key) is None for key in keys):
            raise _DamageError(f"summary.json does not tell {', '.join(keys) or 'anything'} of its {name}")
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
    """Columns by name: strings for ``texts``, otherwise float64 with NaN for an empty cell."""
    with path.open(encoding="utf-8") as stream:
        head = stream.readline().strip().split(",")
    types = {name: pa.string() if name in texts else pa.float64() for name in head}
    table = csv.read_csv(path, convert_options=csv.ConvertOptions(column_types=types))
    return {name: table[name].to_numpy(zero_copy_only=False) for name in head}


def _stacked(table: dict[str, NDArray[Any]], names: tuple[str, ...], prefix: str = "") -> Array:
    return np.stack([table[prefix + name] for name in names], 1)


def _motion(path: Path) -> SIMotion:
    table = _columns(path)
    vectors: dict[str, Any] = {
        prefix + name: _stacked(table, columns, prefix) if columns[0] in table else None
        for name, columns in KINEMATICS_COLUMNS.items()
        for prefix in ("", "sd_")
    }
    return SIMotion(time_s=table["time_s"], **vectors)
