"""Frontal impact on a target, with a change of spin."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from ..check import vector, within
from ..pose import Poses
from .contact import Contact, Kick
from .fields import Vector, array, unit_vector
from .pulse import Pulse
from .state import State

Array = NDArray[np.float64]


@dataclass(frozen=True, kw_only=True)
class FrontalImpact:
    """Flight, a contact that reverses the velocity along the target's normal and changes the spin, flight.

    The force along the normal is a half sine over the contact, or a sequence of half sines of equal length (as from a
    vibrating target). The spin changes in proportion to the velocity, so its integral is exact; the orientation is
    integrated (`render.trajectory.turning`).

    Attributes
    ----------
    touch_m : tuple of float
        The ball's centre at first touch, in the camera frame (y down).
    touch_us : float
        Time of first touch.
    contact_us : float
        Duration of the contact.
    peaks : tuple of float
        Share of the impulse in each half sine; the shares add up to 1.
    velocity_m_s : tuple of float
        Velocity before the contact.
    normal : tuple of float
        Direction in which the target pushes the ball, of any length.
    restitution : float
        Speed along the normal after the contact, divided by the speed before.
    spin_before_rev_s, spin_after_rev_s : tuple of float
        Spin about the camera's axes, revolutions per second.
    mass_g : float
        Mass of the ball.
    """

    touch_m: Vector
    touch_us: float
    contact_us: float
    peaks: tuple[float, ...] = (1.0,)
    velocity_m_s: Vector
    normal: Vector = (-1.0, 0.0, 0.0)
    restitution: float
    spin_before_rev_s: Vector = (0.0, 0.0, 0.0)
    spin_after_rev_s: Vector = (0.0, 0.0, 0.0)
    mass_g: float = 110.0

    def __post_init__(self) -> None:
        vector("touch_m", self.touch_m, 3)
        within("touch_us", self.touch_us, -math.inf)
        within("contact_us", self.contact_us, 0.0, above=True)
        vector("velocity_m_s", self.velocity_m_s, 3)
        vector("normal", self.normal, 3, nonzero=True)
        within("restitution", self.restitution, 0.0, 1.0)
        vector("spin_before_rev_s", self.spin_before_rev_s, 3)
        vector("spin_after_rev_s", self.spin_after_rev_s, 3)
        within("mass_g", self.mass_g, 0.0, above=True)
        if not self.peaks or min(self.peaks) < 0 or not math.isclose(sum(self.peaks), 1.0, abs_tol=1e-9):
            raise ValueError(
                f"peaks = {self.peaks!r}: expected one share of the impulse or more, none negative, that add up to 1"
            )
        if array(self.velocity_m_s) @ unit_vector(self.normal) >= 0:
            raise ValueError(
                f"normal = {self.normal!r}: along which the ball already leaves the target; expected the direction "
                "in which the target pushes the ball, against velocity_m_s"
            )

    @cached_property
    def _contact(self) -> Contact:
        normal, velocity = unit_vector(self.normal), array(self.velocity_m_s)
        change = -(1.0 + self.restitution) * (velocity @ normal) * normal
        before = array(self.spin_before_rev_s, 2 * np.pi)
        turn = array(self.spin_after_rev_s, 2 * np.pi) - before
        touch, length = 1e-6 * self.touch_us, 1e-6 * self.contact_us / len(self.peaks)
        kicks = tuple(
            Kick(Pulse.whole(touch + i * length, length), share * change, share * turn)
            for i, share in enumerate(self.peaks)
        )
        return Contact(touch, array(self.touch_m), velocity, np.zeros(3), before, kicks, mass_kg=1e-3 * self.mass_g)

    def state(self, times_s: Array) -> State:
        """The motion at times (n,)."""
        return self._contact.state(times_s)

    def __call__(self, times_s: Array) -> Poses:
        """The poses at times (n,)."""
        return self.state(times_s).poses
