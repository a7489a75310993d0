"""Oblique impact: a long contact on an inclined plane, with friction that spins the ball up."""

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

#: A tangential force ``f`` on a solid sphere (inertia 2/5 m r^2) changes the slip of its contact point at the rate
#: ``f / m + r^2 f / (2/5 m r^2) = 7/2 f / m``.
SLIP_PER_VELOCITY = 3.5


@dataclass(frozen=True, kw_only=True)
class ObliqueImpact:
    """Flight, a curved path while the ball slides or rolls on a plane, flight.

    The normal force is a half sine. Coulomb friction ``mu N`` acts on the contact point against its slip
    ``v_t + w x r`` until the slip ends; then the ball rolls without friction. Velocity and spin change together: the
    torque is ``r x F``, with ``r`` from the centre to the plane; the inertia is that of a solid sphere.

    Attributes
    ----------
    touch_m : tuple of float
        The ball's centre at first touch, in the camera frame (y down).
    touch_us, contact_us : float
        Time of first touch, and duration of the contact.
    velocity_m_s, spin_rev_s : tuple of float
        Velocity, and spin in revolutions per second about the camera's axes, before the contact.
    normal : tuple of float
        Normal of the plane, towards the ball, of any length.
    restitution : float
        Speed along the normal after the contact, divided by the speed before.
    friction : float
        Coefficient of friction.
    diameter_mm, mass_g : float
        Diameter and mass of the ball; the default diameter in a preset is that of its table `ball`.
    """

    touch_m: Vector
    touch_us: float
    contact_us: float
    velocity_m_s: Vector
    spin_rev_s: Vector = (0.0, 0.0, 0.0)
    normal: Vector
    restitution: float
    friction: float
    diameter_mm: float
    mass_g: float = 28.0

    def __post_init__(self) -> None:
        vector("touch_m", self.touch_m, 3)
        within("touch_us", self.touch_us, -math.inf)
        within("contact_us", self.contact_us, 0.0, above=True)
        vector("velocity_m_s", self.velocity_m_s, 3)
        vector("spin_rev_s", self.spin_rev_s, 3)
        vector("normal", self.normal, 3, nonzero=True)
        within("restitution", self.restitution, 0.0, 1.0)
        within("friction", self.friction, 0.0, 10.0)
        within("diameter_mm", self.diameter_mm, 0.0, above=True)
        within("mass_g", self.mass_g, 0.0, above=True)
        if array(self.velocity_m_s) @ unit_vector(self.normal) >= 0:
            raise ValueError(
                f"normal = {self.normal!r}: along which the ball already leaves the plane; expected the plane's "
                "normal on the ball's side, against velocity_m_s"
            )

    @property
    def _slip_m_s(self) -> Array:
        """Velocity (3,) of the contact point over the plane at first touch."""
        normal, velocity = unit_vector(self.normal), array(self.velocity_m_s)
        spin = array(self.spin_rev_s, 2 * np.pi)
        arm = -0.5e-3 * self.diameter_mm * normal
        return np.asarray(velocity - (velocity @ normal) * normal + np.cross(spin, arm))

    @cached_property
    def _contact(self) -> Contact:
        normal, velocity = unit_vector(self.normal), array(self.velocity_m_s)
        touch, length = 1e-6 * self.touch_us, 1e-6 * self.contact_us
        approach = -float(velocity @ normal)
        push = Kick(Pulse.whole(touch, length), (1.0 + self.restitution) * approach * normal, np.zeros(3))
        kicks = (push, self._rub(push)) if self.friction > 0 and np.linalg.norm(self._slip_m_s) > 0 else (push,)
        return Contact(
            touch,
            array(self.touch_m),
            velocity,
            np.zeros(3),
            array(self.spin_rev_s, 2 * np.pi),
            kicks,
            mass_kg=1e-3 * self.mass_g,
        )

    def _rub(self, push: Kick) -> Kick:
        """The kick of the friction, cut off at the end of the slip."""
        slip = self._slip_m_s
        speed = float(np.linalg.norm(slip))
        whole = self.friction * float(np.linalg.norm(push.velocity_m_s))
        change = -whole * slip / speed
        # J / I of the torque r x F, for the inertia 2/5 m r^2 and the arm -r n.
        arm = -0.5e-3 * self.diameter_mm * unit_vector(self.normal)
        spin = np.cross(arm, change) / (0.4 * (arm @ arm))
        # The share of the pulse that stops the slip; sin^2 inverted gives its time.
        share = min(1.0, speed / (SLIP_PER_VELOCITY * whole))
        begin, length = push.pulse.start_s, push.pulse.duration_s
        stop = begin + length * 2.0 / np.pi * float(np.arcsin(np.sqrt(share)))
        return Kick(Pulse(begin, length, stop), change, spin)

    def state(self, times_s: Array) -> State:
        """The motion at times (n,)."""
        return self._contact.state(times_s)

    def __call__(self, times_s: Array) -> Poses:
        """The poses at times (n,)."""
        return self.state(times_s).poses
