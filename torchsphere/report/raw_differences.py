"""Raw differences of what was measured, in the units of the smoothed curves: the points under these curves."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from torchsphere.dynamics.scale import LAB_AXES
from torchsphere.motion.findings import Findings
from torchsphere.results.reader import ResultFolder
from torchsphere.sphere_map.decision import MadeMap

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Raw:
    """Values (r, k) at times (r,), s; NaN where a frame was not measured."""

    time_s: Array
    values: Array


def raw_differences(result: ResultFolder) -> dict[str, Raw]:
    """Raw velocity (m/s), acceleration (m/s^2), force (N) and spin (rad/s) by their names; empty without SI units.

    Velocity and spin are differences of successive positions and the rotations between successive frames, at the middle
    of the interval. Accelerations are second differences of positions, at the middle frame.
    """
    scale, motion = result.summary.get("scale"), result.motion
    if motion is None or not scale or len(motion.time_s) < 3:
        return {}
    time, signs = motion.time_s, np.diag(LAB_AXES) if result.lab_frame else np.ones(3)
    position = _position(result) * scale["m_per_px"] * signs[:2]
    interval = np.diff(time)[:, None]
    velocity = np.diff(position, axis=0) / interval
    middle = 0.5 * (time[1:] + time[:-1])
    acceleration = np.diff(velocity, axis=0) / np.diff(middle)[:, None]
    found = {
        "velocity": Raw(middle, velocity),
        "acceleration": Raw(time[1:-1], acceleration),
        "spin": Raw(middle, result.increment[1:, 2:] / interval * signs),
    }
    mass = result.summary["settings"].get("mass_g")
    if mass is not None:
        found["force"] = Raw(time[1:-1], 1e-3 * mass * acceleration)
    return found


def _position(result: ResultFolder) -> Array:
    """Positions (n, 2), px; with a camera or a lens in the plane of the first depth, as those of the motion."""
    settings = result.summary["settings"]
    made = Findings.read(settings).map
    # Torch takes 1.2 s to import, and figures of an orthographic view do not need it.
    if settings.get("camera") is None and not (isinstance(made, MadeMap) and made.has_lens):
        return result.position
    from torchsphere.dynamics.depth_plane import PlaneView

    view = PlaneView.of(settings, made)
    magnification = result.radius / result.summary["circle"]["radius"]
    return result.position if view is None else view.position(result.position, magnification)
