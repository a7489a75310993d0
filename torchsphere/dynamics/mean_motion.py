"""Mean step, velocity and spin over the measured steps of a recording, each with its standard deviation.

In a sum of successive steps the errors of all poses between the first and the last cancel. The errors of these two
stay, and with them the share of each step's error that stays in all later poses, and the errors that all steps share.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from torchsphere.dynamics.depth_plane import in_depth_plane
from torchsphere.dynamics.kinematics import Kinematics
from torchsphere.dynamics.scale import Scale
from torchsphere.dynamics.shared_errors import SharedErrors
from torchsphere.dynamics.si_units import Units
from torchsphere.estimation.measurements import measured_increments, poses
from torchsphere.tracking.track import Track

Array = NDArray[np.float64]


def mean_motion(track: Track, motion: Kinematics | None) -> dict[str, Array]:
    """Means and their standard deviations, for the summary; NaN if nothing was measured.

    Parameters
    ----------
    track : Track
    motion : Kinematics or None
        Its scale, frame rate and axes are used; None if they are not known.

    Returns
    -------
    dict
        ``increment_px_rad`` (5,); with ``motion`` also ``velocity_m_s`` (2,) and ``spin_rad_s`` (3,) in its axes. Each
        has its standard deviation under the same name with ``sd_``.
    """
    step, sd = _mean_step(track, Scale(1.0, 0.0, "px"))
    means = {"increment_px_rad": step, "sd_increment_px_rad": sd}
    if motion is None:
        return means
    step, sd = _mean_step(in_depth_plane(track), motion.scale)
    units = Units(motion.scale, motion.frame_rate, motion.lab_frame)
    velocity, spin = units.rates(step)
    sd_velocity, sd_spin = units.sd_rates(sd)
    means |= {"velocity_m_s": velocity, "sd_velocity_m_s": sd_velocity}
    return means | {"spin_rad_s": spin, "sd_spin_rad_s": sd_spin}


def _mean_step(track: Track, scale: Scale) -> tuple[Array, Array]:
    """Mean (5,) of the measured steps and its standard deviation, px and rad; ``scale`` gives the lengths' error."""
    # A model without rotations reports them as 0 without a standard deviation: these are not measurements.
    has_sd = np.isfinite(np.diagonal(track.covariance, axis1=1, axis2=2))
    valid = np.repeat(measured_increments(track), (2, 3), axis=1) & has_sd
    count = valid.sum(0)
    divisor = np.where(count > 0, count, np.nan)
    mean = np.where(valid, track.increment, 0.0).sum(0) / divisor
    measured = poses([track], [np.arange(float(len(track.status)))])
    variance = np.diagonal(measured.covariance[0].numpy(), axis1=1, axis2=2)
    # A step adds its second pose's error and subtracts its first one's: within a run of steps all but the ends cancel.
    edge = np.zeros((1, valid.shape[1]), dtype=bool)
    before, after = np.concatenate((edge, valid)), np.concatenate((valid, edge))
    end_variance = np.where(before != after, variance, 0.0).sum(0)
    lasting_variance = np.where(valid, measured.drift[0].numpy(), 0.0).sum(0)
    shared = SharedErrors.of(track, scale)
    own_sd = np.hypot(np.sqrt(end_variance + lasting_variance) / divisor, shared.steady)
    return mean, shared.total_sd(mean[None], own_sd[None])[0]
