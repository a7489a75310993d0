"""The motion of the demo's ball in closed form: flight, a half-sine of force by a bar, flight.

The bar lies across the x axis. It throws the ball back, and its friction brakes the sliding point of contact with a
constant ratio to the normal force, until this point comes to rest at the end of the contact: Coulomb's law. As the
impulse of a half-sine over the share s of the contact, the velocity and the spin go from their first to their last
values by ``(1 - cos(pi s)) / 2``: position, velocity, spin and their rates are continuous in time.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from torchsphere.geometry.orientation import chain
from torchsphere.runtime.arrays import Array

#: Radius of the ball, px, and its moment of inertia over mass times the square of the radius: a solid ball.
RADIUS_PX, INERTIA_SHARE = 40.0, 0.4

#: Frames of the shot; start and length of the contact, frames.
FRAMES, CONTACT_START, CONTACT_LENGTH = 71, 26.3, 12.0

#: Centre in the first frame, px.
FIRST_POSITION = np.array([64.3, 92.6])

#: Velocity before the contact along x, y and z, px per frame, and spin, rad per frame.
VELOCITY_BEFORE = np.array([5.3, 0.3, 0.0])
SPIN_BEFORE = np.radians([0.1, 0.25, 0.0])

#: Velocity along x after the contact, px per frame.
REBOUND = -2.4

#: From the centre to the point of contact, px.
_TO_CONTACT = np.array([RADIUS_PX, 0.0, 0.0])

#: Steps in a frame by which the spin is integrated: the orientation is exact to 1e-8 rad.
_STEPS = 64


def _after() -> tuple[Array, Array]:
    """Velocity and spin (3,) after the contact."""
    slip = VELOCITY_BEFORE + np.cross(SPIN_BEFORE, _TO_CONTACT)
    # An impulse at the rim of a ball changes the slip by 1 + 1 / INERTIA_SHARE times the change of velocity.
    change = -slip / (1 + 1 / INERTIA_SHARE)
    change[0] = REBOUND - VELOCITY_BEFORE[0]
    # The torque of an impulse is the product of the way to its point and itself.
    spin_change = np.cross(_TO_CONTACT, change) / (INERTIA_SHARE * RADIUS_PX**2)
    return VELOCITY_BEFORE + change, SPIN_BEFORE + spin_change


VELOCITY_AFTER, SPIN_AFTER = _after()


def _passed(time: ArrayLike) -> Array:
    """Share (n, 1) of the contact that has passed at times (n,), frames."""
    return np.clip((np.asarray(time, dtype=np.float64) - CONTACT_START) / CONTACT_LENGTH, 0, 1)[:, None]


def _impulse_share(time: ArrayLike) -> Array:
    """Share (n, 1) of the impulse that the ball has got."""
    return 0.5 * (1 - np.cos(np.pi * _passed(time)))


def position(time: ArrayLike) -> Array:
    """Centres (n, 2) in the image at times (n,), frames; px."""
    moments, s = np.asarray(time, dtype=np.float64)[:, None], _passed(time)
    # The integral of the share of the impulse over the time.
    in_contact = CONTACT_LENGTH * (0.5 * s - np.sin(np.pi * s) / (2 * np.pi))
    later = np.maximum(moments - CONTACT_START - CONTACT_LENGTH, 0.0)
    change = VELOCITY_AFTER - VELOCITY_BEFORE
    return (FIRST_POSITION + moments * VELOCITY_BEFORE[:2]) + (in_contact + later) * change[:2]


def velocity(time: ArrayLike) -> Array:
    """Velocities (n, 2) in the image, px per frame."""
    return (VELOCITY_BEFORE + _impulse_share(time) * (VELOCITY_AFTER - VELOCITY_BEFORE))[:, :2]


def acceleration(time: ArrayLike) -> Array:
    """Accelerations (n, 2) in the image, px per frame^2."""
    size = 0.5 * np.pi / CONTACT_LENGTH * np.sin(np.pi * _passed(time))
    return (size * (VELOCITY_AFTER - VELOCITY_BEFORE))[:, :2]


def spin(time: ArrayLike) -> Array:
    """Spins (n, 3), rad per frame."""
    return SPIN_BEFORE + _impulse_share(time) * (SPIN_AFTER - SPIN_BEFORE)


def orientation(frames: int) -> Array:
    """Rotation matrices (n, 3, 3) of the first frames since the first one."""
    middles = (np.arange((frames - 1) * _STEPS) + 0.5) / _STEPS
    steps = np.concatenate((np.zeros((1, 3)), spin(middles) / _STEPS))
    return chain(steps, np.ones(len(steps), dtype=bool))[::_STEPS]
