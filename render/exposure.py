"""The shutter: a frame is the mean of the light while the shutter is open."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from .check import within


@dataclass(frozen=True)
class Shutter:
    """When the sensor collects light; a frame's time is the middle of its exposure.

    Attributes
    ----------
    exposure_s : float
        Time for which the shutter is open, s; 0 freezes the motion.
    subframes : int
        Number of true poses within the exposure at which the ball is rendered; the frame is the mean of these
        pictures. Between two poses the ball should move by less than about 0.3 px.
    """

    exposure_s: float = 0.0
    subframes: int = 1

    def __post_init__(self) -> None:
        """Check the values."""
        within("exposure_s", self.exposure_s, 0.0)
        within("subframes", self.subframes, 1)

    def times_s(self, middle_s: float) -> NDArray[np.float64]:
        """Times within an exposure at which the ball is rendered: the middles of equal parts.

        Parameters
        ----------
        middle_s : float
            Time of the frame, s.

        Returns
        -------
        (subframes,) ndarray
            Times, s; a single time if the exposure is 0.
        """
        count = self.subframes if self.exposure_s > 0 else 1
        return middle_s + self.exposure_s * ((np.arange(count) + 0.5) / count - 0.5)
