"""A smooth motion through the rows of a table (CSV)."""

from __future__ import annotations

import csv
import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import CubicSpline
from scipy.spatial.transform import Rotation, RotationSpline

from ..check import within
from ..pose import Poses
from .state import State

Array = NDArray[np.float64]

PLACE = ("time_s", "x_m", "y_m", "z_m")
QUATERNION = ("qw", "qx", "qy", "qz")
ROTATION_VECTOR = ("rx_rad", "ry_rad", "rz_rad")

#: Largest rotation between two rows, rad: from half a turn on, its direction is ambiguous.
LARGEST_STEP_RAD = 0.9 * math.pi


@dataclass(frozen=True, kw_only=True)
class Table:
    """A motion through the rows of a CSV file.

    Between the rows the position is a cubic spline, and the orientation a rotation spline
    (`scipy.spatial.transform.RotationSpline`); both have continuous acceleration.

    Attributes
    ----------
    file : str
        CSV file with the columns ``time_s,x_m,y_m,z_m`` and the orientation from body-fixed to camera axes, either as a
        quaternion ``qw,qx,qy,qz`` or as a rotation vector ``rx_rad,ry_rad,rz_rad``. Other columns are ignored, so any
        ``truth.csv`` can be used.
    start_s : float
        Time in the table that becomes time 0, the middle of the first frame's exposure.
    mass_g : float
        Mass of the ball.
    """

    file: str
    start_s: float = 0.0
    mass_g: float = 110.0

    def __post_init__(self) -> None:
        within("start_s", self.start_s, -math.inf)
        within("mass_g", self.mass_g, 0.0, above=True)
        try:
            _ = self._curves
        except (OSError, ValueError, csv.Error) as error:
            reason = error.strerror if isinstance(error, OSError) else str(error)
            raise ValueError(f"file = {self.file!r}: {reason}") from error

    @cached_property
    def _curves(self) -> tuple[Array, CubicSpline, RotationSpline]:
        times, position, turned = read_table(Path(self.file))
        return times, CubicSpline(times, position), RotationSpline(times, turned)

    def state(self, times_s: Array) -> State:
        """The motion at times (n,).

        Raises
        ------
        ValueError
            If a time is outside of the table.
        """
        known, place, turned = self._curves
        times = np.asarray(times_s, dtype=np.float64) + self.start_s
        # The sum with start_s is rounded.
        slack = 1e-9 * (known[-1] - known[0])
        if len(times) and (times.min() < known[0] - slack or times.max() > known[-1] + slack):
            raise ValueError(
                f"file = {self.file!r}: holds the times {known[0]:g} to {known[-1]:g} s, but {times.min():g} to "
                f"{times.max():g} s were asked for (exposures included); change start_s or frames, or give more rows"
            )
        times = np.clip(times, known[0], known[-1])
        orientation = turned(times).as_matrix()
        acceleration = place(times, 2)
        # The spline's rates are in body axes.
        spin = (orientation @ turned(times, 1)[..., None])[..., 0]
        return State(place(times), orientation, place(times, 1), acceleration, 1e-3 * self.mass_g * acceleration, spin)

    def __call__(self, times_s: Array) -> Poses:
        """The poses at times (n,)."""
        return self.state(times_s).poses


def read_table(path: Path) -> tuple[Array, Array, Rotation]:
    """Times (n,) in s, positions (n, 3) in m and orientations of a CSV file; ``#`` begins a comment line.

    Raises
    ------
    ValueError
        If the table is invalid; one sentence names row and column.
    OSError
        If the file cannot be read.
    """
    try:
        text = path.read_text(encoding="utf-8-sig")
    except UnicodeDecodeError as error:
        raise ValueError("is no text file in UTF-8; expected a table with commas (CSV)") from error
    # Line numbers are those of an editor: comments and blank lines count.
    lines = [(i, line) for i, line in enumerate(text.splitlines(), 1) if line.strip() and not line.startswith("#")]
    rows = [(i, [cell.strip() for cell in row]) for (i, line) in lines for row in csv.reader([line])]
    if not rows:
        raise ValueError(f"is empty; expected a first line with the columns {', '.join(PLACE)} and an orientation")
    head, body = rows[0][1], rows[1:]
    turn = _orientation_columns(head)
    if len(body) < 2:
        raise ValueError(f"has {len(body)} rows of numbers, expected two or more")
    numbers = np.array([_numbers(line, row, head, (*PLACE, *turn)) for line, row in body])
    at = [line for line, _ in body]
    steps = np.diff(numbers[:, 0])
    if (steps <= 0).any():
        i = int((steps <= 0).argmax()) + 1
        raise ValueError(
            f"row {at[i]}, column time_s: given {numbers[i, 0]:g} after {numbers[i - 1, 0]:g}, expected rising times"
        )
    return numbers[:, 0], numbers[:, 1:4], _rotations(numbers[:, 4:], turn, at)


def _orientation_columns(head: list[str]) -> tuple[str, ...]:
    missing = [name for name in PLACE if name not in head]
    if missing:
        raise ValueError(f"lacks the column {missing[0]}; expected {', '.join(PLACE)} and an orientation")
    for columns in (QUATERNION, ROTATION_VECTOR):
        if set(columns) <= set(head):
            return columns
    raise ValueError(
        f"lacks an orientation; expected the columns {', '.join(QUATERNION)} or {', '.join(ROTATION_VECTOR)}"
    )


def _numbers(line: int, row: list[str], head: list[str], columns: Sequence[str]) -> list[float]:
    if len(row) != len(head):
        raise ValueError(f"row {line}: has {len(row)} cells, expected {len(head)} as in the first line")
    values = []
    for name in columns:
        text = row[head.index(name)]
        try:
            value = float(text)
        except ValueError:
            value = math.nan
        if not math.isfinite(value):
            raise ValueError(f"row {line}, column {name}: given {text!r}, expected a finite number")
        values.append(value)
    return values


def _rotations(values: Array, columns: tuple[str, ...], at: list[int]) -> Rotation:
    if columns == QUATERNION:
        length = np.linalg.norm(values, axis=1)
        bad = np.abs(length - 1) > 1e-3
        if bad.any():
            i = int(bad.argmax())
            raise ValueError(f"row {at[i]}, columns qw to qz: the quaternion's length is {length[i]:.6g}, expected 1")
        turned = Rotation.from_quat(np.roll(values, -1, axis=1))
    else:
        turned = Rotation.from_rotvec(values)
    steps = (turned[1:] * turned[:-1].inv()).magnitude()
    if (steps > LARGEST_STEP_RAD).any():
        i = int((steps > LARGEST_STEP_RAD).argmax()) + 1
        turn = math.degrees(steps[i - 1])
        raise ValueError(
            f"row {at[i]}, columns {columns[0]} to {columns[-1]}: turned by {turn:.0f} deg since the row before; "
            "expected less than 162 deg, or the way round is not known: give more rows"
        )
    return turned
