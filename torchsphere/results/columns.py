"""Columns of the tables of a result folder: ``track.csv`` and ``kinematics.csv``."""

from __future__ import annotations

#: Motion from the frame before: px and rad.
INCREMENTS = ("dx_px", "dy_px", "wx_rad", "wy_rad", "wz_rad")

TRACK_COLUMNS = (
    *("frame", "time_s", "status", "x_px", "y_px", "radius_px"),
    *INCREMENTS,
    *(f"sd_{name}" for name in INCREMENTS),
    *("zncc", "iterations", "qw", "qx", "qy", "qz"),
)

#: Columns of each vector over time, by its name in `Kinematics` and `SIMotion`, in the order of the file. Each vector
#: ``v`` has its standard deviations in ``sd_v``, with the same columns after ``sd_``.
KINEMATICS_COLUMNS = {
    "position_m": ("x_m", "y_m"),
    "velocity_m_s": ("vx_m_s", "vy_m_s"),
    "acceleration_m_s2": ("ax_m_s2", "ay_m_s2"),
    "force_N": ("fx_N", "fy_N"),
    "spin_rad_s": ("wx_rad_s", "wy_rad_s", "wz_rad_s"),
}
