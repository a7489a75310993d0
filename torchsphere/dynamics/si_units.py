"""From px and frames to SI units, with uncertainty: the only place where px become m.

What all frames share is not in the bands of the motion's rates and is added here: scale, radius, and what steps are
steadily off by.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from torchsphere.dynamics import scale as camera
from torchsphere.dynamics.shared_errors import Shared
from torchsphere.estimation.rates import Drawn, Motion
from torchsphere.tracking.track import Track

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Draws:
    """Motions (s of them) around a contact, as likely as data and calibration leave them, as `Kinematics` has them.

    Attributes
    ----------
    velocity_m_s, acceleration_m_s2 : ndarray
        (s, m, 2).
    spin_rad_s : ndarray
        (s, m, 3).
    contact_s : ndarray
        Start and end of the contact (s, 2).
    span : slice
        Which m of the n frames these are.
    """

    velocity_m_s: Array
    acceleration_m_s2: Array
    spin_rad_s: Array
    contact_s: Array
    span: slice


@dataclass(frozen=True)
class Kinematics:
    """Motion of the ball in SI units, at the times of the frames; NaN where it was not measured.

    The smoother bridges gaps, with an uncertainty that grows into them. Local polynomials do not, and differences have
    no value in the first and the last frame. Every ``sd_`` array is the standard deviation of its namesake.

    Attributes
    ----------
    time_s : ndarray
        (n,), 0 at the first image of the recording.
    position_m, velocity_m_s, acceleration_m_s2 : ndarray
        (n, 2) as (x, y); positions from the image's first pixel.
    force_N : ndarray or None
        (n, 2), mass times acceleration; None without a mass.
    spin_rad_s, angular_acceleration_rad_s2 : ndarray
        (n, 3).
    scale : camera.Scale
    frame_rate : float
        Frames per second.
    lab_frame : bool
        False: camera frame (y down, z away from the camera). True: lab frame (y up, z towards the camera).
    mass_kg : float or None
    contact_s : ndarray or None
        Start and end (2,) of the contact; None where none was found or sought.
    sd_contact_s : ndarray or None
    draws : Draws or None
        None where no contact was found or sought.
    about : dict
        Method, parameters, effective bandwidth: for the summary.
    """

    time_s: Array
    position_m: Array
    velocity_m_s: Array
    acceleration_m_s2: Array
    force_N: Array | None  # noqa: N815  (N is newton)
    spin_rad_s: Array
    angular_acceleration_rad_s2: Array
    sd_position_m: Array
    sd_velocity_m_s: Array
    sd_acceleration_m_s2: Array
    sd_force_N: Array | None  # noqa: N815
    sd_spin_rad_s: Array
    sd_angular_acceleration_rad_s2: Array
    scale: camera.Scale
    frame_rate: float
    lab_frame: bool
    mass_kg: float | None
    contact_s: Array | None
    sd_contact_s: Array | None
    draws: Draws | None
    about: dict[str, Any]


def in_si(
    track: Track,
    motion: Motion,
    time_s: Array,
    scale: camera.Scale,
    frame_rate: float,
    mass_kg: float | None,
    lab_frame: bool,
) -> Kinematics:
    """Motion in SI units with all of its uncertainty."""
    shared = Shared.of(track, scale)
    to_si = Units.of(scale, frame_rate, lab_frame=lab_frame)
    velocity, spin = to_si.rates(motion.rate)
    acceleration, angular = to_si.rates(motion.acceleration, 2)
    sd_velocity, sd_spin = map(np.abs, to_si.rates(shared.sd(motion.rate, np.hypot(motion.sd_rate, shared.steady))))
    contact = None if motion.interval is None else motion.interval[0]
    changing = shared.steady_change(time_s * frame_rate, contact, motion.rate)
    own_acceleration = shared.sd(motion.acceleration, np.hypot(motion.sd_acceleration, changing), motion.rate[:, 4])
    sd_acceleration, sd_angular = map(np.abs, to_si.rates(own_acceleration, 2))
    position = (_filled(track.position) + motion.offset) * scale.m_per_px * to_si.axes[:2]
    sd_circle = np.nan_to_num([track.circle.sd_x, track.circle.sd_y])
    sd_position = np.hypot(np.hypot(motion.sd_offset, sd_circle) * scale.m_per_px, position * shared.scale)
    interval = None if motion.interval is None else [edges / frame_rate for edges in motion.interval]
    return Kinematics(
        time_s=time_s,
        position_m=position,
        velocity_m_s=velocity,
        acceleration_m_s2=acceleration,
        force_N=None if mass_kg is None else mass_kg * acceleration,
        spin_rad_s=spin,
        angular_acceleration_rad_s2=angular,
        sd_position_m=sd_position,
        sd_velocity_m_s=sd_velocity,
        sd_acceleration_m_s2=sd_acceleration,
        sd_force_N=None if mass_kg is None else mass_kg * sd_acceleration,
        sd_spin_rad_s=sd_spin,
        sd_angular_acceleration_rad_s2=sd_angular,
        scale=scale,
        frame_rate=frame_rate,
        lab_frame=lab_frame,
        mass_kg=mass_kg,
        contact_s=None if interval is None else interval[0],
        sd_contact_s=None if interval is None else interval[1],
        draws=None if motion.drawn is None else _draws(motion.drawn, time_s, shared, to_si),
        about=_per_second(motion.about, frame_rate),
    )


@dataclass(frozen=True)
class Units:
    """From px, rad and frames to SI units and the axes of the results."""

    m_per_px: float
    frame_rate: float
    axes: Array  # (3,), signs

    @staticmethod
    def of(scale: camera.Scale, frame_rate: float, *, lab_frame: bool) -> Units:
        """Those of results in the lab frame or the camera's."""
        return Units(scale.m_per_px, frame_rate, np.diag(camera.LAB_AXES) if lab_frame else np.ones(3))

    def rates(self, values: Array, order: int = 1) -> tuple[Array, Array]:
        """Derivatives (..., 5) of an order -> (..., 2) and (..., 3)."""
        per_time = values * self.frame_rate**order
        return per_time[..., :2] * self.m_per_px * self.axes[:2], per_time[..., 2:] * self.axes


def _draws(drawn: Drawn, time_s: Array, shared: Shared, to_si: Units) -> Draws:
    """Motions as likely as data and calibration leave them."""
    frames = time_s[drawn.span] * to_si.frame_rate
    rate, acceleration = shared.draw(drawn.rate, drawn.acceleration, frames, drawn.interval)
    velocity, spin = to_si.rates(rate)
    return Draws(velocity, to_si.rates(acceleration, 2)[0], spin, drawn.interval / to_si.frame_rate, drawn.span)


def _filled(position: Array) -> Array:
    """Positions (n, 2), on a straight line where they are not known between others."""
    frames, known = np.arange(len(position)), np.isfinite(position[:, 0])
    if not known.any():
        return position
    return np.stack([np.interp(frames, frames[known], position[known, k]) for k in (0, 1)], 1)


def _per_second(about: dict[str, Any], frame_rate: float) -> dict[str, Any]:
    """Frequencies per frame as Hz."""
    result: dict[str, Any] = {}
    for name, value in about.items():
        if name.endswith("_per_frame"):
            result[name.removesuffix("_per_frame") + "_Hz"] = {key: v * frame_rate for key, v in value.items()}
        else:
            result[name] = value
    return result
