"""Drop weight: falls along the image's y axis, hits, and rebounds."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from ..check import vector, within
from ..pose import Poses
from .contact import Contact, Kick
from .fields import Vector, array
from .pulse import Pulse
from .state import State

Array = NDArray[np.float64]


@dataclass(frozen=True, kw_only=True)
class DropWeight:
    """Fall under gravity, a contact with a half sine of force, rebound; gravity acts all the time.

    Attributes
    ----------
    touch_m : tuple of float
        The ball's centre at first touch, in the camera frame (y down).
    touch_us, contact_us : float
        Time of first touch, and duration of the contact.
    speed_m_s : float
        Speed of the fall at first touch.
    restitution : float
        Speed at the end of the contact over `speed_m_s`.
    gravity_m_s2 : float
        Along +y.
    spin_rev_s : tuple of float
        Spin about the camera's axes, revolutions per second; constant.
    mass_g : float
        Falling mass.
    """

    touch_m: Vector
    touch_us: float
    contact_us: float
    speed_m_s: float
    restitution: float
    gravity_m_s2: float = 9.81
    spin_rev_s: Vector = (0.0, 0.0, 0.0)
    mass_g: float

    def __post_init__(self) -> None:
        vector("touch_m", self.touch_m, 3)
        within("touch_us", self.touch_us, -math.inf)
        within("contact_us", self.contact_us, 0.0, above=True)
        within("speed_m_s", self.speed_m_s, 0.0, above=True)
        within("restitution", self.restitution, 0.0, 1.0)
        within("gravity_m_s2", self.gravity_m_s2, 0.0, 1000.0)
        vector("spin_rev_s", self.spin_rev_s, 3)
        within("mass_g", self.mass_g, 0.0, above=True)

    @cached_property
    def _contact(self) -> Contact:
        down, length = np.array([0.0, 1.0, 0.0]), 1e-6 * self.contact_us
        # The pulse also cancels gravity's impulse during the contact, so the restitution is that of the whole contact.
        change = -((1.0 + self.restitution) * self.speed_m_s + self.gravity_m_s2 * length) * down
        pulse = Pulse.whole(1e-6 * self.touch_us, length)
        return Contact(
            pulse.start_s,
            array(self.touch_m),
            self.speed_m_s * down,
            self.gravity_m_s2 * down,
            array(self.spin_rev_s, 2 * np.pi),
            (Kick(pulse, change, np.zeros(3)),),
            mass_kg=1e-3 * self.mass_g,
        )

    def state(self, times_s: Array) -> State:
        """The motion at times (n,)."""
        return self._contact.state(times_s)

    def __call__(self, times_s: Array) -> Poses:
        """The poses at times (n,)."""
        return self.state(times_s).poses
