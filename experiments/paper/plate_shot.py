"""The oblique impact on the plate, rendered with the motion of finite elements, for figures 14 and 15.

The motion is that of the finest impact of `table5`: the ball presses the plate in, turns and leaves. The preset
``paper-plate`` gives the place of first touch, the spin before, the optics and the plate in the pictures, which stands
still and hides the part of the ball that is pressed in. The spin before is about the camera's y axis; the finite
elements add what friction gives, and leave the slip of the first, 0.3 m/s, out.
"""

from __future__ import annotations

import dataclasses
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from experiments.experiment import CACHE, Array
from experiments.fe.explicit.impacts import Done
from experiments.fe.plate import TOUCHING
from experiments.paper.bar.table import HEADER
from render import preset
from render.shot import Shot
from render.trajectory import ObliqueImpact, Table

#: Step of the flight before and after, s; as that of the records of the impact.
STEP_S = 1e-6
#: Time of the table of motion beyond the first and the last frame, for the exposure.
MARGIN_S = 20e-6


def in_camera_axes(vectors: Array, normal: Array) -> Array:
    """Vectors (n, 3) along the plate, off it and across, in the camera's axes (x right, y down, z away)."""
    off = np.asarray(normal, dtype=np.float64) / np.linalg.norm(normal)
    across = np.array((0.0, 0.0, -1.0))
    return np.asarray(vectors @ np.stack((np.cross(off, across), off, across)))


def contact_s(done: Done) -> tuple[float, float]:
    """Begin and end of the contact since first touch, by the pushes above a small share of the largest."""
    time, force = done.motion.force()
    pushing = np.flatnonzero(force[:, 1] > TOUCHING * force[:, 1].max())
    return 0.0, float(time[pushing[-1]])


def motion(done: Done, setting: ObliqueImpact, before_s: float, after_s: float) -> tuple[Array, Array, Rotation]:
    """Times (n,) since first touch, places (n, 3) in m and orientations, in the camera's axes.

    Before first touch and after what was integrated, velocity and spin are constant.
    """
    normal, start = np.array(setting.normal), 2 * np.pi * np.array(setting.spin_rev_s)
    known = done.motion.time_s
    early = STEP_S * np.arange(-np.ceil(before_s / STEP_S), 0)
    late = known[-1] + STEP_S * np.arange(1, max(0.0, np.ceil((after_s - known[-1]) / STEP_S)) + 1)
    times = np.concatenate((early, known, late))
    inside = np.clip(times, known[0], known[-1])
    at = np.searchsorted(known, inside)
    outside = (times - inside)[:, None]
    place = 1e-3 * (done.place_mm - done.place_mm[0])[at] + outside * done.motion.velocity_m_s[at]
    spin = start + in_camera_axes(done.spin_rad_s - done.spin_rad_s[0], normal)[at]
    steps = Rotation.from_rotvec(np.diff(times)[:, None] * (spin[1:] + spin[:-1]) / 2)
    turned = [Rotation.identity()]
    for step in steps:
        turned.append(step * turned[-1])
    return times, np.array(setting.touch_m) + in_camera_axes(place, normal), Rotation.concatenate(turned)


def shot_of(done: Done) -> tuple[Shot, ObliqueImpact]:
    """The shot with the motion of an impact, and the preset's motion, which says where ball and plate meet."""
    shot = preset.load("paper-plate")
    setting = shot.trajectory
    assert isinstance(setting, ObliqueImpact)
    before = 1e-6 * setting.touch_us + MARGIN_S
    times, place, turned = motion(done, setting, before, float(shot.times_s[-1]) - before + 3 * MARGIN_S)
    CACHE.mkdir(exist_ok=True)
    file: Path = CACHE / "plate-motion.csv"
    rows = np.column_stack((times, place, turned.as_rotvec()))
    # 15 digits: forces are second differences of these numbers.
    np.savetxt(file, rows, fmt="%.15g", delimiter=",", header=HEADER, comments="")
    moved = Table(file=str(file), start_s=-1e-6 * setting.touch_us, mass_g=setting.mass_g)
    return dataclasses.replace(shot, trajectory=moved), setting


def touching(times_s: Array, contact: tuple[float, float]) -> NDArray[np.bool_]:
    """Which times (n,) are in a contact."""
    return np.asarray((times_s > contact[0]) & (times_s < contact[1]))
