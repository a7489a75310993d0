"""The ball's motion through the impact as a table for a renderer, with the flight before and after."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import CubicHermiteSpline
from scipy.spatial.transform import Rotation, Slerp

from experiments.paper.bar.history import History
from experiments.paper.bar.setup import Vector

Array = NDArray[np.float64]

HEADER = "time_s,x_m,y_m,z_m,rx_rad,ry_rad,rz_rad"


def motion(history: History, times_s: Array) -> tuple[Array, Rotation]:
    """Positions (n, 3) in m and orientations at any times (n,) in s since first touch.

    Outside the integrated time, velocity and spin are constant; between the steps the position is a cubic
    through positions and velocities, and the spin is constant.
    """
    known = history.time_s
    inside = np.clip(times_s, known[0], known[-1])
    position = CubicHermiteSpline(known, history.position_m, history.velocity_m_s)(inside)
    orientation = Slerp(known, Rotation.from_quat(history.quaternion))(inside)
    outside, end = (times_s - inside)[:, None], np.where(times_s < known[0], 0, -1)
    turned = Rotation.from_rotvec(outside * history.spin_rad_s[end])
    return position + outside * history.velocity_m_s[end], turned * orientation


def write_table(
    history: History,
    path: Path,
    *,
    before_s: float,
    after_s: float,
    origin_m: Vector = (0.0, 0.0, 0.0),
    step_s: float = 1e-6,
) -> Path:
    """Write the ball's motion as CSV from ``before_s`` before to ``after_s`` after first touch; returns the path.

    Columns ``time_s`` (0 at first touch), ``x_m, y_m, z_m`` (the ball's centre) and ``rx_rad, ry_rad, rz_rad``, the
    rotation vector whose exponential is the orientation from body-fixed to camera axes. Camera frame: x right, y down,
    z away. The orientation is I at first touch. The ball strikes the bar's axis at ``origin_m`` in the camera frame.
    """
    if not (before_s >= 0 and after_s >= 0 and step_s > 0):
        raise ValueError(
            f"before_s = {before_s!r}, after_s = {after_s!r}, step_s = {step_s!r}: expected times that are not "
            "negative, and a step above 0"
        )
    # Whole steps to both sides, rounded up, so that first touch is a row.
    first, last = (int(np.ceil(time / step_s - 1e-9)) for time in (before_s, after_s))
    times = step_s * np.arange(-first, last + 1, dtype=np.float64)
    position, orientation = motion(history, times)
    rows = np.column_stack((times, position + np.array(origin_m), orientation.as_rotvec()))
    # 15 digits: forces are second differences of these numbers.
    np.savetxt(path, rows, fmt="%.15g", delimiter=",", header=HEADER, comments="")
    return path
