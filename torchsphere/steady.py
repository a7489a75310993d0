"""What all steps of a flight are off by alike: an error that no scatter shows, stated by the tracker."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

#: In standard deviations of one step: 0.17 (root mean square over x, y, wx, wy, 10 synthetic tracks at 0 to 1.7 deg per
#: frame) and 0.07 (5 tracks with a map).
SHARE, SHARE_ON_MAP = 0.17, 0.07

#: Least, px and rad: errors that do not depend on the images' noise, root mean square over the flights of eight
#: rendered impacts (0.0035 px, 0.004 deg, about z 0.001 deg; up to 0.0065 px in one of them). In free flight of a
#: coarser pattern it was a tenth of that, with a map a seventh.
LEAST = np.array([0.0035, 0.0035, *np.radians([0.004, 0.004, 0.001])])
LEAST_ON_MAP = LEAST / 7

Array = NDArray[np.float64]


def sd_steady(covariance: Array, on_map: bool) -> Array:
    """Standard deviation (5,) of what all steps of a flight are off by alike, px and rad.

    ``covariance`` (n, 5, 5) is that of the steps, NaN where they were not measured; ``on_map`` says whether they come
    from a map of the ball.
    """
    own = np.diagonal(covariance, axis1=1, axis2=2)
    known = np.isfinite(own)
    typical = [np.sqrt(np.median(own[known[:, k], k])) if known[:, k].any() else 0.0 for k in range(5)]
    share, least = (SHARE_ON_MAP, LEAST_ON_MAP) if on_map else (SHARE, LEAST)
    return np.hypot(share * np.array(typical), least)
