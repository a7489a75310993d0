"""Free flight."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from .. import rotation
from ..check import vector, within
from ..pose import Poses
from .fields import Vector, array
from .state import State

Array = NDArray[np.float64]


@dataclass(frozen=True, kw_only=True)
class FreeFlight:
    """Constant velocity, or constant acceleration by gravity, and a constant spin vector: ``A(t) = exp([w t]x)``.

    Attributes
    ----------
    start_m : tuple of float
        The ball's centre at time 0, in the camera frame (y down).
    velocity_m_s : tuple of float
        Velocity at time 0.
    spin_rev_s : tuple of float
        Spin about the camera's axes, revolutions per second.
    gravity_m_s2 : tuple of float
        Acceleration, for example (0, 9.81, 0) for an upright camera.
    mass_g : float
        Mass of the ball.
    """

    start_m: Vector = (0.0, 0.0, 0.0)
    velocity_m_s: Vector
    spin_rev_s: Vector = (0.0, 0.0, 0.0)
    gravity_m_s2: Vector = (0.0, 0.0, 0.0)
    mass_g: float = 110.0

    def __post_init__(self) -> None:
        vector("start_m", self.start_m, 3)
        vector("velocity_m_s", self.velocity_m_s, 3)
        vector("spin_rev_s", self.spin_rev_s, 3)
        vector("gravity_m_s2", self.gravity_m_s2, 3)
        within("mass_g", self.mass_g, 0.0, above=True)

    def state(self, times_s: Array) -> State:
        """The motion at times (n,)."""
        times = np.asarray(times_s, dtype=np.float64)[:, None]
        ones = np.ones_like(times)
        gravity, spin = array(self.gravity_m_s2), array(self.spin_rev_s, 2 * np.pi)
        start, velocity = array(self.start_m), array(self.velocity_m_s)
        return State(
            position_m=start + times * velocity + 0.5 * times**2 * gravity,
            orientation=rotation.exp(times * spin),
            velocity_m_s=velocity + times * gravity,
            acceleration_m_s2=ones * gravity,
            force_N=1e-3 * self.mass_g * ones * gravity,
            spin_rad_s=ones * spin,
        )

    def __call__(self, times_s: Array) -> Poses:
        """The poses at times (n,)."""
        return self.state(times_s).poses
