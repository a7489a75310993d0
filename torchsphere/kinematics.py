"""From px and frames to SI units, with uncertainty: the only place where px become m.

Velocity, acceleration and spin are central differences. The increments of successive pairs share an image, whose error
enters both with opposite sign: with ``C`` the covariance of an increment, the error of one image's pose is ``C / 2``
and that of two successive increments ``-C / 2``. So a mean of two increments is better, and their difference worse,
than independent increments would be.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from torchsphere import camera
from torchsphere.drift import STEP_PER_RADIUS
from torchsphere.track import Track

#: Relative change of the rotation for a relative change of the radius. Measured at 0.5 deg per frame and R = 50 px: an
#: error of 1 px in the radius (2 %) changes the rotation by 0.021 deg (4.2 %).
ROTATION_PER_RADIUS = 2.1

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Kinematics:
    """Motion of the ball in SI units, at the times of the frames; NaN where it was not measured.

    Velocity, acceleration, force and spin need the increments before and after a frame, so that they are NaN in the
    first and the last frame and beside a gap. Every ``sd_`` array is the standard deviation of its namesake.

    Attributes
    ----------
    time_s : ndarray
        (n,), 0 at the first image of the recording.
    position_m, velocity_m_s, acceleration_m_s2 : ndarray
        (n, 2) as (x, y); positions from the image's first pixel.
    force_N : ndarray or None
        (n, 2), mass times acceleration; None without a mass.
    spin_rad_s : ndarray
        Angular velocity (n, 3).
    scale : camera.Scale
    frame_rate : float
        Frames per second.
    lab_frame : bool
        False: camera frame (y down, z away from the camera). True: lab frame (y up, z towards the camera).
    """

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
    scale: camera.Scale
    frame_rate: float
    lab_frame: bool


def kinematics(
    track: Track,
    *,
    frame_rate: float,
    diameter_m: float | None = None,
    m_per_px: float | None = None,
    mass_kg: float | None = None,
    lab_frame: bool = False,
    first_frame: int = 0,
) -> Kinematics:
    """Motion in SI units.

    Parameters
    ----------
    track : Track
        What was measured, px and frames.
    frame_rate : float
        Frames per second.
    diameter_m, m_per_px : float
        The ball's diameter, or the size of a pixel; one of both, m.
    mass_kg : float, optional
        The ball's mass, for the force.
    lab_frame : bool
        Results in the lab frame (y up, z towards the camera) instead of the camera frame.
    first_frame : int
        Number of the track's first image in the recording, where only a part was tracked.

    Returns
    -------
    Kinematics

    Raises
    ------
    ValueError
        If a number is not finite and positive, or both or neither of diameter and size of a pixel are given.

    Notes
    -----
    Velocity is increment over frame interval, force is mass times acceleration: sections 2.2 and 5 of the paper.
    """
    for name, value in (("frame_rate", frame_rate), ("mass_kg", mass_kg)):
        if value is not None and not (math.isfinite(value) and value > 0):
            raise ValueError(f"{name} = {value!r}: expected a finite, positive number")
    scale = camera.scale(track.circle, diameter_m=diameter_m, m_per_px=m_per_px)
    size, relative = scale.m_per_px, scale.sd_m_per_px / scale.m_per_px
    rate, difference, var_rate, var_difference = _central(track.increment, track.covariance)
    velocity, spin = rate[:, :2] * size * frame_rate, rate[:, 2:] * frame_rate
    acceleration = difference[:, :2] * size * frame_rate**2
    # An error of the radius is the same in all frames: it moves the velocity, and cancels in its differences.
    of_radius = STEP_PER_RADIUS * rate[:, [3, 2]] * np.nan_to_num(track.circle.sd_radius)
    sd_velocity = np.hypot(np.sqrt(var_rate[:, :2] + of_radius**2) * size * frame_rate, velocity * relative)
    sd_acceleration = np.hypot(np.sqrt(var_difference[:, :2]) * size * frame_rate**2, acceleration * relative)
    position = track.position * size
    sd_position = np.hypot(_position_sd(track) * size, position * relative)
    sd_spin = np.hypot(np.sqrt(var_rate[:, 2:]) * frame_rate, spin * _rotation_uncertainty(track))
    flip = np.diag(camera.LAB_AXES) if lab_frame else np.ones(3)
    return Kinematics(
        time_s=(first_frame + np.arange(len(track.status))) / frame_rate,
        position_m=position * flip[:2],
        velocity_m_s=velocity * flip[:2],
        acceleration_m_s2=acceleration * flip[:2],
        force_N=None if mass_kg is None else mass_kg * acceleration * flip[:2],
        spin_rad_s=spin * flip,
        sd_position_m=sd_position,
        sd_velocity_m_s=sd_velocity,
        sd_acceleration_m_s2=sd_acceleration,
        sd_force_N=None if mass_kg is None else mass_kg * sd_acceleration,
        sd_spin_rad_s=sd_spin,
        scale=scale,
        frame_rate=frame_rate,
        lab_frame=lab_frame,
    )


def _central(increment: Array, covariance: Array) -> tuple[Array, Array, Array, Array]:
    """Mean and difference (n, 5) of the increments to and from each frame, and the variances of both."""
    n = len(increment) + 1
    rate, difference, var_rate, var_difference = (np.full((n, 5), np.nan) for _ in range(4))
    before, after = increment[:-1], increment[1:]
    both = _variances(covariance)[:-1] + _variances(covariance)[1:]
    rate[1:-1], difference[1:-1] = (before + after) / 2, after - before
    # The shared image: (C + C') / 4 - (C + C') / 8, and (C + C') + (C + C') / 2.
    var_rate[1:-1], var_difference[1:-1] = both / 8, 1.5 * both
    return rate, difference, var_rate, var_difference


def _variances(covariance: Array) -> Array:
    return np.diagonal(covariance, axis1=1, axis2=2)


def _position_sd(track: Track) -> Array:
    """Standard deviation (n, 2) of the positions, px: the circle's, and the errors of the first and of this image.

    The errors of the images between cancel in the sum of the increments.
    """
    of_pose = np.full((len(track.status), 2), np.nan)
    of_pose[1:] = _variances(track.covariance)[:, :2] / 2
    seen = np.isfinite(track.position[:, 0])
    measured = seen & np.isfinite(of_pose[:, 0])
    typical = np.median(of_pose[measured], axis=0) if measured.any() else np.zeros(2)
    # A frame found again after a gap was measured like any other, without an increment of its own.
    of_pose = np.where(measured[:, None], of_pose, np.where(seen[:, None], typical, np.nan))
    circle = np.nan_to_num([track.circle.sd_x, track.circle.sd_y])
    return np.sqrt(of_pose + typical + circle**2)


def _rotation_uncertainty(track: Track) -> float:
    """Relative standard deviation of all rotations that the radius alone causes."""
    sd = track.circle.sd_radius
    return 0.0 if math.isnan(sd) else ROTATION_PER_RADIUS * sd / track.circle.radius
