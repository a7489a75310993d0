"""Acceleration and force from raw second differences of positions, filtered by a channel frequency class."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from torchsphere.dynamics.channel_filter import channel_filter, channel_filter_sd
from torchsphere.dynamics.depth_plane import in_depth_plane
from torchsphere.dynamics.kinematics import Kinematics
from torchsphere.dynamics.shared_errors import SharedErrors
from torchsphere.dynamics.units import force
from torchsphere.estimation.measurements import poses
from torchsphere.motion.track import Track
from torchsphere.runtime.arrays import Array

#: Second difference of positions, and its error by the steps between them.
SECOND_DIFFERENCE, DIFFERENCE = (1.0, -2.0, 1.0), (-1.0, 1.0)


@dataclass(frozen=True)
class FilteredMotion:
    """Filtered acceleration and force at the times of the frames; NaN where a neighbouring frame was not measured.

    Attributes
    ----------
    time_s : ndarray
        (n,).
    acceleration_m_s2, sd_acceleration_m_s2 : ndarray
        (n, 2), in the axes of the motion.
    force_N, sd_force_N : ndarray or None
        (n, 2); None without a mass.
    cfc : int
        Class of the filter.
    """

    time_s: Array
    acceleration_m_s2: Array
    sd_acceleration_m_s2: Array
    force_N: Array | None  # noqa: N815  (N is newton)
    sd_force_N: Array | None  # noqa: N815
    cfc: int


def filtered_motion(track: Track, motion: Kinematics, cfc: int) -> FilteredMotion:
    """Second central differences of the measured positions over the square of the interval, filtered.

    Parameters
    ----------
    track : Track
        Of even times.
    motion : Kinematics
        Smoothed motion of this track: it gives scale, axes and mass.
    cfc : int
        60, 180, 600 or 1000.

    Returns
    -------
    FilteredMotion
        Its standard deviations contain the noise of the poses through differences and filter, and the errors that all
        frames share. They do not contain what the filter takes from the force.

    Raises
    ------
    ValueError
        If the class is none of the four, the frame rate is less than ten times the class, or the times are not even.

    Notes
    -----
    `channel_filter` of ``(x[i-1] - 2 x[i] + x[i+1]) / T^2``; its standard deviation by `channel_filter_sd`.
    """
    rate = motion.frame_rate
    if not np.allclose(np.diff(motion.time_s) * rate, 1.0, atol=1e-3):
        raise ValueError("cfc: the frames have uneven times, and a channel frequency class needs even ones")
    shared = SharedErrors.of(track, motion.scale)
    track = in_depth_plane(track)
    acceleration = _with_ends(channel_filter(np.diff(track.position, 2, axis=0), rate, cfc))
    own = _with_ends(_own_sd(track, rate, cfc))
    per_frame = np.concatenate((acceleration, motion.angular_acceleration_rad_s2 / rate**2), 1)
    spin = motion.spin_rad_s / rate
    contacts: list[Array | None] = [contact.contact_s * rate for contact in motion.contacts]
    rates = np.concatenate((motion.velocity_m_s / motion.scale.m_per_px / rate, spin), 1)
    changes = [shared.steady_change(motion.time_s * rate, contact, rates)[:, :2] for contact in contacts or [None]]
    own5 = np.concatenate((np.hypot(own, np.max(changes, axis=0)), np.zeros((len(own), 3))), 1)
    sd = shared.total_sd(per_frame, own5, spin[:, 2])[:, :2]
    to_si = motion.scale.m_per_px * rate**2
    signs = np.array([1.0, -1.0 if motion.lab_frame else 1.0])
    acceleration, sd = acceleration * to_si * signs, sd * to_si
    pushed = force(acceleration, sd, motion.mass_kg, motion.relative_sd_mass)
    return FilteredMotion(motion.time_s, acceleration, sd, *pushed, cfc)


def _own_sd(track: Track, rate: float, cfc: int) -> Array:
    """Standard deviations (n - 2, 2) by the noise of the poses, px per frame^2."""
    measured = poses([track], [np.arange(float(len(track.status)))])
    known = np.isfinite(track.position)
    variance = np.diagonal(measured.covariance[0].numpy(), axis1=1, axis2=2)[:, :2]
    drift = measured.drift_variance[0].numpy()[:, :2]
    by_poses = channel_filter_sd(np.where(known, np.sqrt(variance), np.nan), rate, cfc, SECOND_DIFFERENCE)
    both = known[1:] & known[:-1]
    return np.hypot(by_poses, channel_filter_sd(np.where(both, np.sqrt(drift), np.nan), rate, cfc, DIFFERENCE))


def _with_ends(values: Array) -> Array:
    """Values (n, 2) from those (n - 2, 2) without the first and the last frame, in which they are NaN."""
    return np.pad(values, ((1, 1), (0, 0)), constant_values=np.nan)
