"""The state of a ball on its trajectory, and the interface of all trajectories."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from ..pose import Poses

Array = NDArray[np.float64]


@dataclass(frozen=True)
class State:
    """The ball's motion at ``n`` times, exact, in the camera frame.

    Attributes
    ----------
    position_m : ndarray
        The ball's centre (n, 3), m.
    orientation : ndarray
        Rotation matrices (n, 3, 3) from body-fixed to camera axes.
    velocity_m_s, acceleration_m_s2 : ndarray
        (n, 3), the first and second derivative of the position.
    force_N : ndarray
        (n, 3), mass times acceleration: the sum of all forces, the weight included.
    spin_rad_s : ndarray
        Angular velocity (n, 3) in camera axes: ``dA/dt = [spin]x A``.
    """

    position_m: Array
    orientation: Array
    velocity_m_s: Array
    acceleration_m_s2: Array
    force_N: Array  # noqa: N815  (N is newton)
    spin_rad_s: Array

    @property
    def poses(self) -> Poses:
        """Position and orientation alone."""
        return Poses(self.position_m, self.orientation)


class Trajectory(Protocol):
    """A motion of the ball: poses, and their exact derivatives, at any time."""

    @property
    def mass_g(self) -> float:
        """Mass of the ball."""

    def state(self, times_s: Array) -> State:
        """The motion at times (n,); time 0 is the middle of the first frame's exposure."""

    def __call__(self, times_s: Array) -> Poses:
        """The poses at times (n,)."""
