"""From px and frames to SI units, with uncertainty: the only place where px become m.

Velocity, acceleration and spin come from a smoother by default (`torchsphere.smooth`), or from local polynomials. What
all frames share is not in the smoother's bands and is added here: scale, radius, and what steps are steadily off by.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from torchsphere import camera
from torchsphere.choices import METHODS, ORDER, WINDOW
from torchsphere.differentiate import Drawn, Motion, polynomials, smoothed
from torchsphere.plane import in_plane
from torchsphere.setting import FRAME_RATES
from torchsphere.shared import ROTATION_PER_RADIUS, Shared
from torchsphere.track import Track

__all__ = ["METHODS", "ROTATION_PER_RADIUS", "Draws", "Kinematics", "kinematics", "kinematics_of_many"]

#: Frames up to which the smoother is run: it keeps 32 x 15 x 15 numbers per frame, 0.06 MB, three times that in
#: contact, and takes 5 ms with the search for the contact. A recording of an impact has some hundreds; a longer one
#: gets local polynomials, and says so.
SMOOTHED_UP_TO = 1500

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


def kinematics(
    track: Track,
    *,
    frame_rate: float,
    diameter_m: float | None = None,
    m_per_px: float | None = None,
    relative_sd_scale: float = 0.0,
    mass_kg: float | None = None,
    lab_frame: bool = False,
    first_frame: int = 0,
    times_s: Array | None = None,
    method: str = "smoother",
    window: int = WINDOW,
    order: int = ORDER,
) -> Kinematics:
    """Motion in SI units.

    Parameters
    ----------
    track : Track
        What was measured, px and frames; with a camera it is brought into the plane of the first depth.
    frame_rate : float
        Frames per second.
    diameter_m, m_per_px : float
        The ball's diameter, or the size of a pixel; one of both, m.
    relative_sd_scale : float
        Relative standard deviation of that diameter or size.
    mass_kg : float, optional
        The ball's mass, for the force.
    lab_frame : bool
        Results in the lab frame (y up, z towards the camera) instead of the camera frame.
    first_frame : int
        Number of the track's first image in the recording, where only a part was tracked.
    times_s : ndarray, optional
        Times of the track's frames (n,), s, where they are not even.
    method : str
        "smoother" (up to `SMOOTHED_UP_TO` frames, then as the next), "savitzky-golay" or "differences".
    window, order : int
        Frames (odd) and order of the polynomials of Savitzky and Golay.

    Returns
    -------
    Kinematics

    Raises
    ------
    ValueError
        If a number is not finite and positive, both or neither of diameter and size of a pixel are given, the times do
        not rise, or the method is not known.

    Notes
    -----
    Velocity is increment over frame interval, force is mass times acceleration: sections 2.2 and 5 of the paper.
    """
    scale = _scale(track, frame_rate, diameter_m, m_per_px, relative_sd_scale, mass_kg)
    track = in_plane(track)
    times = _times(track, frame_rate, first_frame, times_s)
    if method not in METHODS:
        raise ValueError(f"method = {method!r}: expected one of {', '.join(METHODS)}")
    if method == "smoother" and len(times) <= SMOOTHED_UP_TO:
        motion = smoothed([track], [times])[0]
    elif method == "smoother":
        motion = polynomials(track, times, "savitzky-golay", window, order)
        motion.about["instead_of_smoother"] = (
            f"the smoother is for recordings of up to {SMOOTHED_UP_TO} frames, this one has {len(times)}; "
            "take the frames around the impact alone"
        )
    else:
        motion = polynomials(track, times, method, window, order)
    return _in_si(track, motion, times / frame_rate, scale, frame_rate, mass_kg, lab_frame)


def kinematics_of_many(
    tracks: Sequence[Track],
    *,
    frame_rate: float,
    diameter_m: float | None = None,
    m_per_px: float | None = None,
    relative_sd_scale: float = 0.0,
    mass_kg: float | None = None,
    lab_frame: bool = False,
) -> list[Kinematics]:
    """Smoothed motion of recordings that share frame rate and calibration, all at once; arguments as `kinematics`.

    Raises
    ------
    ValueError
        As `kinematics`.
    """
    tracks = [in_plane(track) for track in tracks]
    scales = [_scale(track, frame_rate, diameter_m, m_per_px, relative_sd_scale, mass_kg) for track in tracks]
    times = [_times(track, frame_rate, 0, None) for track in tracks]
    motions = smoothed(tracks, times) if tracks else []
    return [
        _in_si(track, motion, moments / frame_rate, scale, frame_rate, mass_kg, lab_frame)
        for track, motion, moments, scale in zip(tracks, motions, times, scales, strict=True)
    ]


def _scale(
    track: Track,
    frame_rate: float,
    diameter_m: float | None,
    m_per_px: float | None,
    relative_sd: float,
    mass_kg: float | None,
) -> camera.Scale:
    for name, value in (("frame_rate", frame_rate), ("mass_kg", mass_kg)):
        if value is not None and not (math.isfinite(value) and value > 0):
            raise ValueError(f"{name} = {value!r}: expected a finite, positive number")
    if not FRAME_RATES[0] <= frame_rate <= FRAME_RATES[1]:
        raise ValueError(
            f"frame_rate = {frame_rate!r}: expected {FRAME_RATES[0]:g} to {FRAME_RATES[1]:g} frames per second"
        )
    if not (math.isfinite(relative_sd) and 0 <= relative_sd < 1):
        raise ValueError(f"relative_sd_scale = {relative_sd!r}: expected a share from 0 to below 1")
    found = camera.scale(track.circle, diameter_m=diameter_m, m_per_px=m_per_px)
    if relative_sd == 0:
        return found
    origin = found.origin.replace(", taken as exact", "") + f", itself known to {100 * relative_sd:.2g} %"
    return camera.Scale(found.m_per_px, math.hypot(found.sd_m_per_px, found.m_per_px * relative_sd), origin)


def _times(track: Track, frame_rate: float, first_frame: int, times_s: Array | None) -> Array:
    """Times of the frames (n,), in frames."""
    n = len(track.status)
    if times_s is None:
        return first_frame + np.arange(float(n))
    times = np.asarray(times_s, dtype=np.float64)
    if times.shape != (n,) or not np.isfinite(times).all() or (np.diff(times) <= 0).any():
        raise ValueError(f"times_s: expected {n} finite, rising times, one per frame, got an array {times.shape}")
    return times * frame_rate


def _in_si(
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
    axes = np.diag(camera.LAB_AXES) if lab_frame else np.ones(3)
    to_si = _Units(scale.m_per_px, frame_rate, axes)
    velocity, spin = to_si.rates(motion.rate)
    acceleration, angular = to_si.rates(motion.acceleration, 2)
    sd_velocity, sd_spin = map(np.abs, to_si.rates(shared.sd(motion.rate, np.hypot(motion.sd_rate, shared.steady))))
    contact = None if motion.interval is None else motion.interval[0]
    changing = shared.steady_change(time_s * frame_rate, contact, motion.rate)
    own_acceleration = shared.sd(motion.acceleration, np.hypot(motion.sd_acceleration, changing), motion.rate[:, 4])
    sd_acceleration, sd_angular = map(np.abs, to_si.rates(own_acceleration, 2))
    position = (_filled(track.position) + motion.offset) * scale.m_per_px * axes[:2]
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
class _Units:
    """From px, rad and frames to SI units and the axes of the results."""

    m_per_px: float
    frame_rate: float
    axes: Array  # (3,), signs

    def rates(self, values: Array, order: int = 1) -> tuple[Array, Array]:
        """Derivatives (..., 5) of an order -> (..., 2) and (..., 3)."""
        per_time = values * self.frame_rate**order
        return per_time[..., :2] * self.m_per_px * self.axes[:2], per_time[..., 2:] * self.axes


def _draws(drawn: Drawn, time_s: Array, shared: Shared, to_si: _Units) -> Draws:
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
