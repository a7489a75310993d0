"""Flight with pulses of force and torque, the base of all impacts."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from .pulse import Pulse
from .state import State
from .turning import Turning

Array = NDArray[np.float64]

#: Steps of the orientation's integration: smallest number over a contact, and largest angle of a step, rad.
STEPS, STEP_RAD = 256, 0.02


@dataclass(frozen=True)
class Kick:
    """A pulse, and the changes of velocity (3,), m/s, and of spin (3,), rad/s, by its whole area."""

    pulse: Pulse
    velocity_m_s: Array
    spin_rad_s: Array


@dataclass(frozen=True)
class Contact:
    """A flight with constant acceleration and spin, and the kicks that change it.

    Attributes
    ----------
    time_s : float
        Time of first touch; position, velocity and spin refer to this time.
    position_m, velocity_m_s, acceleration_m_s2, spin_rad_s : ndarray
        (3,), of the flight without the kicks.
    kicks : tuple of Kick
        None begins before `time_s`.
    mass_kg : float
        Mass of the ball.
    """

    time_s: float
    position_m: Array
    velocity_m_s: Array
    acceleration_m_s2: Array
    spin_rad_s: Array
    kicks: tuple[Kick, ...]
    mass_kg: float

    def state(self, times_s: Array) -> State:
        """The motion at times (n,); the orientation is I at time 0."""
        times = np.asarray(times_s, dtype=np.float64)
        since = (times - self.time_s)[:, None]
        position = self.position_m + since * self.velocity_m_s + 0.5 * since**2 * self.acceleration_m_s2
        velocity = self.velocity_m_s + since * self.acceleration_m_s2
        acceleration = np.tile(self.acceleration_m_s2, (len(times), 1))
        for kick in self.kicks:
            position = position + kick.pulse.delay(times)[:, None] * kick.velocity_m_s
            velocity = velocity + kick.pulse.share(times)[:, None] * kick.velocity_m_s
            acceleration = acceleration + kick.pulse.density(times)[:, None] * kick.velocity_m_s
        orientation = self._turning.orientation(times) @ self._start.T
        return State(position, orientation, velocity, acceleration, self.mass_kg * acceleration, self._spin(times))

    def _spin(self, times_s: Array) -> Array:
        kicks = (kick.pulse.share(times_s)[:, None] * kick.spin_rad_s for kick in self.kicks)
        return sum(kicks, np.tile(self.spin_rad_s, (len(times_s), 1)))

    def _angle(self, times_s: Array) -> Array:
        kicks = (kick.pulse.delay(times_s)[:, None] * kick.spin_rad_s for kick in self.kicks)
        return sum(kicks, (times_s - self.time_s)[:, None] * self.spin_rad_s)

    @cached_property
    def _turning(self) -> Turning:
        edges = np.unique([t for kick in self.kicks for t in (kick.pulse.start_s, kick.pulse.stop_s)] + [self.time_s])
        fastest = np.linalg.norm(self.spin_rad_s) + sum(np.linalg.norm(kick.spin_rad_s) for kick in self.kicks)
        count = max(STEPS, int(np.ceil(fastest * (edges[-1] - edges[0]) / STEP_RAD)))
        # A jump of the torque, at the start or the cut of a pulse, must not lie within a step.
        nodes = np.unique(np.concatenate((edges, np.linspace(edges[0], edges[-1], count + 1))))
        return Turning(self._spin, self._angle, nodes)

    @cached_property
    def _start(self) -> Array:
        return np.asarray(self._turning.orientation(np.zeros(1))[0])
