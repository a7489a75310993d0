"""Standard deviations of the turned angles, which are sums of increments."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from torchsphere.motion.ledger import INCREMENTS
from torchsphere.results.reader import ResultFolder

Array = NDArray[np.float64]


def sd_turned_rad(result: ResultFolder) -> Array | None:
    """Standard deviations (n, 3) of `ResultFolder.turned_rad`; None for results of versions that lack what is needed.

    In a sum of successive increments the errors of the poses between the first and the last cancel. Those of the two
    remain, the share of each increment's error that stays, the error that all increments share, and the radius's.
    """
    steady, share = result.summary.get("sd_steady"), result.summary.get("drift_share")
    if not isinstance(steady, dict) or share is None or not result.known.any():
        return None
    start = int(result.known.argmax())
    variance = _pose_variance(result.sd_increment[start:, 2:])
    count = np.arange(len(variance))[:, None]
    stays = np.zeros_like(variance)
    stays[1:] = share * np.cumsum(np.nan_to_num(variance[1:] + variance[:-1]), axis=0)
    shared = count * np.array([float(steady.get(name) or 0.0) for name in INCREMENTS[2:]])
    relative = float((result.summary.get("radius_effect") or {}).get("relative_sd_rotation") or 0.0)
    by_radius = relative * result.turned_rad[start:]
    sd = np.full((len(result.frame), 3), np.nan)
    sd[start:] = np.sqrt(variance[0] + variance + stays + shared**2 + by_radius**2)
    # The first angle is 0 by definition.
    sd[start] = np.where(np.isfinite(sd[start]), 0.0, np.nan)
    return np.where(np.isfinite(result.turned_rad), sd, np.nan)


def _pose_variance(sd_increment: Array) -> Array:
    """Variance (n, 3) of each pose: half the mean of the increments' to and from it."""
    half = np.full((2, len(sd_increment), 3), np.nan)
    half[0, 1:] = sd_increment[1:] ** 2 / 2
    half[1, :-1] = sd_increment[1:] ** 2 / 2
    known = np.isfinite(half)
    return np.where(known.any(0), np.where(known, half, 0.0).sum(0) / np.maximum(known.sum(0), 1), np.nan)
