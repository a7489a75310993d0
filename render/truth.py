"""The truth of a recording as a table: the values that a tracker should find, and the motion behind them."""

from __future__ import annotations

import csv
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from . import rotation
from .outline import circle, outline, visible
from .scene import Setup
from .shot import Shot

#: Columns that a tracker's table has, too, in its order.
TRACKED = (
    *("frame", "time_s", "x_px", "y_px", "radius_px"),
    *("dx_px", "dy_px", "wx_rad", "wy_rad", "wz_rad"),
    *("qw", "qx", "qy", "qz"),
)

#: Columns of the truth alone: the motion at the frame's time, in the camera frame.
MOTION = (
    *("x_m", "y_m", "z_m", "vx_m_s", "vy_m_s", "vz_m_s", "ax_m_s2", "ay_m_s2", "az_m_s2"),
    *("fx_N", "fy_N", "fz_N", "wx_rad_s", "wy_rad_s", "wz_rad_s"),
)

#: Columns of the ball's image: the circle fitted to the outline, and the visible share of the ball's area.
SEEN = ("outline_x_px", "outline_y_px", "outline_radius_px", "visible")


def truth(shot: Shot) -> dict[str, NDArray[Any]]:
    """The true motion, frame by frame.

    Parameters
    ----------
    shot : Shot
        The shot with ``n`` frames.

    Returns
    -------
    dict of ndarray
        Columns (n,) by name. `x_px, y_px` is the image of the ball's centre, `radius_px` the ball's radius times the
        scale at the centre's depth (on the optical axis, without distortion). `d*_px` and `w*_rad` are the increments
        from the frame before, NaN in the first: ``A_i = exp([w]x) A_(i-1)``. `q*` is the orientation since the first
        frame, ``A_i A_0^T``, without jumps of sign. Force is mass times acceleration. `outline_*` is the circle fitted
        to the outline, NaN if the camera cannot image the whole outline. `visible` is the share of the area within the
        outline that is in the image and not hidden by a still object, at the frame's time.
    """
    times, setup = shot.times_s, shot.setup
    state = shot.trajectory.state(times)
    place = setup.camera.project(state.position_m)
    scale = [setup.camera.px_per_m(depth) for depth in state.position_m[:, 2]]
    steps = np.concatenate((np.diff(place, axis=0), rotation.increments(state.orientation)), axis=1)
    turned = rotation.continuous(rotation.quaternion(state.orientation @ state.orientation[0].T))
    tracked = (
        *(np.arange(len(times)), times, *place.T, setup.ball.radius_m * np.array(scale)),
        *np.concatenate((np.full((1, 5), np.nan), steps)).T,
        *turned.T,
    )
    motion = (state.position_m, state.velocity_m_s, state.acceleration_m_s2, state.force_N, state.spin_rad_s)
    columns = (*tracked, *(column for vectors in motion for column in vectors.T), *_seen(setup, state.position_m).T)
    return dict(zip((*TRACKED, *MOTION, *SEEN), columns, strict=True))


def _seen(setup: Setup, centres_m: NDArray[np.float64]) -> NDArray[np.float64]:
    """The columns (n, 4) of `SEEN`."""
    camera, radius_m, objects = setup.camera, setup.ball.radius_m, setup.background.objects
    rows = [
        (*circle(outline(camera, centre, radius_m)), visible(camera, centre, radius_m, objects)) for centre in centres_m
    ]
    return np.array(rows)


def write_truth(path: Path, columns: dict[str, NDArray[Any]]) -> None:
    """Write the table as CSV, every number with all its digits."""
    with path.open("w", newline="", encoding="utf-8") as stream:
        writer = csv.writer(stream, lineterminator="\n")
        writer.writerow(columns)
        # repr gives the shortest text that reads back as the same number.
        writer.writerows(zip(*(map(repr, column.tolist()) for column in columns.values()), strict=True))
