"""Spinning in place."""

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
class SpinInPlace:
    """A ball that turns about a fixed axis at a fixed place.

    Attributes
    ----------
    centre_m : tuple of float
        The ball's centre, in the camera frame (y down).
    spin_rev_s : tuple of float
        Spin about the camera's axes, revolutions per second; the maximum if the ball turns there and back.
    there_and_back_s : float, optional
        Period ``P`` of turning there and back, ``spin sin(2 pi t / P)``: after ``P`` the ball has its first pose again.
        None for a constant rate.
    mass_g : float
        Mass of the ball.
    """

    centre_m: Vector = (0.0, 0.0, 0.0)
    spin_rev_s: Vector
    there_and_back_s: float | None = None
    mass_g: float = 110.0

    def __post_init__(self) -> None:
        vector("centre_m", self.centre_m, 3)
        vector("spin_rev_s", self.spin_rev_s, 3)
        if self.there_and_back_s is not None:
            within("there_and_back_s", self.there_and_back_s, 0.0, above=True)
        within("mass_g", self.mass_g, 0.0, above=True)

    def state(self, times_s: Array) -> State:
        """The motion at times (n,)."""
        times = np.asarray(times_s, dtype=np.float64)[:, None]
        spin, still = array(self.spin_rev_s, 2 * np.pi), np.zeros((len(times), 3))
        if self.there_and_back_s is None:
            rate, turned = np.ones_like(times), times
        else:
            phase = 2 * np.pi * times / self.there_and_back_s
            rate = np.sin(phase)
            turned = self.there_and_back_s / np.pi * np.sin(0.5 * phase) ** 2
        return State(
            position_m=still + array(self.centre_m),
            orientation=rotation.exp(turned * spin),
            velocity_m_s=still,
            acceleration_m_s2=still,
            force_N=still,
            spin_rad_s=rate * spin,
        )

    def __call__(self, times_s: Array) -> Poses:
        """The poses at times (n,)."""
        return self.state(times_s).poses
