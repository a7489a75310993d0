"""Mean step, velocity and spin over the measured steps of a recording, each with its standard deviation.

A sum of successive steps leads from the first pose to the last, so that the errors of the poses between cancel; what
stays are those two, the share of each step's error that stays in all later poses, and what all steps share.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from torchsphere.dynamics.depth_plane import in_plane
from torchsphere.dynamics.kinematics import Kinematics
from torchsphere.dynamics.scale import Scale
from torchsphere.dynamics.shared_errors import Shared
from torchsphere.dynamics.si_units import Units
from torchsphere.estimation.measurements import joined, poses
from torchsphere.tracking.track import Track

Array = NDArray[np.float64]


def mean_motion(track: Track, motion: Kinematics | None) -> dict[str, Array]:
    """Means and their standard deviations, for the summary; NaN where nothing was measured.

    Parameters
    ----------
    track : Track
    motion : Kinematics or None
        Where frame rate and scale are known; its scale, frame rate and axes are used.

    Returns
    -------
    dict
        ``increment_px_rad`` (5,); with ``motion`` also ``velocity_m_s`` (2,) and ``spin_rad_s`` (3,) in its axes. Each
        has its namesake with ``sd_``.
    """
    step, sd = _mean_step(track, Scale(1.0, 0.0, "px"))
    found = {"increment_px_rad": step, "sd_increment_px_rad": sd}
    if motion is None:
        return found
    step, sd = _mean_step(in_plane(track), motion.scale)
    to_si = Units.of(motion.scale, motion.frame_rate, lab_frame=motion.lab_frame)
    velocity, spin = to_si.rates(step)
    sd_velocity, sd_spin = map(np.abs, to_si.rates(sd))
    found |= {"velocity_m_s": velocity, "sd_velocity_m_s": sd_velocity}
    return found | {"spin_rad_s": spin, "sd_spin_rad_s": sd_spin}


def _mean_step(track: Track, scale: Scale) -> tuple[Array, Array]:
    """Mean (5,) of the measured steps and its standard deviation, px and rad; ``scale`` tells what lengths share."""
    # A model without rotations has zeros for them, which are no measurement, and no standard deviation.
    stated = np.isfinite(np.diagonal(track.covariance, axis1=1, axis2=2))
    valid = np.repeat(joined(track), (2, 3), axis=1) & stated
    count = valid.sum(0)
    number = np.where(count > 0, count, np.nan)
    mean = np.where(valid, track.increment, 0.0).sum(0) / number
    measured = poses([track], [np.arange(float(len(track.status)))])
    variance = np.diagonal(measured.covariance[0].numpy(), axis1=1, axis2=2)
    # A step adds its second pose's error and takes the first one's: in a run of steps all but the ends cancel.
    edge = np.zeros((1, valid.shape[1]), dtype=bool)
    before, after = np.concatenate((edge, valid)), np.concatenate((valid, edge))
    of_ends = np.where(before != after, variance, 0.0).sum(0)
    staying = np.where(valid, measured.drift[0].numpy(), 0.0).sum(0)
    shared = Shared.of(track, scale)
    own = np.hypot(np.sqrt(of_ends + staying) / number, shared.steady)
    return mean, shared.sd(mean[None], own[None])[0]
