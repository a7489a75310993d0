"""A rigid ball that pushes the nodes of a surface out, with friction after Coulomb.

A node under the ball's surface is pushed by a spring of its own along the ball's radius. Friction opposes the slip, as
strong as the pressure allows and never stronger than what stops the node within the step.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numba
import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Index = NDArray[np.int64]

# Places of the sums of the contact: elastic energy, and work of friction, in mJ.
CONTACT_ENERGY, FRICTION_WORK = range(2)


@dataclass(frozen=True)
class Sphere:
    """A solid rigid ball at the start, in the bodies' axes.

    ``parts`` is the whole ball over the part that the mesh sees, 2 for each plane of symmetry; ``free`` and
    ``spin_free`` are the directions and axes of its motion, which planes of symmetry forbid.
    """

    radius_mm: float
    mass_kg: float
    centre_mm: tuple[float, float, float]
    velocity_m_s: tuple[float, float, float]
    spin_rad_s: tuple[float, float, float] = (0.0, 0.0, 0.0)
    friction: float = 0.0
    parts: int = 1
    free: tuple[bool, bool, bool] = (True, True, True)
    spin_free: tuple[bool, bool, bool] = (True, True, True)

    def __post_init__(self) -> None:
        """Raises if this is no ball.

        Raises
        ------
        ValueError
            With the name, what was given and what was expected.
        """
        for name, least in (("radius_mm", 0.0), ("mass_kg", 0.0)):
            value = getattr(self, name)
            if not (math.isfinite(value) and value > least):
                raise ValueError(f"{name} = {value!r}: expected a finite number above {least:g}")
        if not 0 <= self.friction < math.inf:
            raise ValueError(f"friction = {self.friction!r}: expected a finite number from 0 on")

    @property
    def mass_t(self) -> float:
        """Mass in t."""
        return 1e-3 * self.mass_kg

    @property
    def inertia_t_mm2(self) -> float:
        """Inertia of a solid sphere about its centre."""
        return 0.4 * self.mass_t * self.radius_mm**2


@numba.njit(cache=True, error_model="numpy")
def add_contact(
    surface: Index,
    spring: Array,
    rubbed: Array,
    mass: Array,
    nodes: Array,
    velocity: Array,
    ball: Array,
    radius_mm: float,
    friction: float,
    step_s: float,
    force: Array,
    push: Array,
    work: Array,
) -> None:
    """Add the contact's forces to those of the nodes (n, 3).

    ``surface`` (s,) are the nodes that may touch, ``spring`` (s,) their springs in N/mm, ``rubbed`` (s, 3) their
    friction at the last step, then at this one. ``ball`` (3, 3) is centre, velocity and spin. ``push`` (2, 3) becomes
    force and moment on the ball, ``work`` (2,) is brought up to date.
    """
    push[:] = 0.0
    work[CONTACT_ENERGY] = 0.0
    away, slip, rub = np.empty(3), np.empty(3), np.empty(3)
    for s in range(surface.shape[0]):
        n = surface[s]
        apart, old = 0.0, 0.0
        for i in range(3):
            away[i], rub[i] = nodes[n, i] - ball[0, i], 0.0
            apart += away[i] ** 2
            old += abs(rubbed[s, i])
        if apart >= radius_mm * radius_mm and old == 0.0:
            continue
        apart = math.sqrt(apart)
        along = 0.0
        for i in range(3):
            j, k = (i + 1) % 3, (i + 2) % 3
            slip[i] = velocity[n, i] - ball[1, i] - (ball[2, j] * away[k] - ball[2, k] * away[j])
            along += slip[i] * away[i] / apart
        speed = 0.0
        for i in range(3):
            away[i] /= apart
            speed += (slip[i] - along * away[i]) ** 2
        speed = math.sqrt(speed)
        depth = max(radius_mm - apart, 0.0)
        pressing = spring[s] * depth
        if speed > 0.0 and step_s > 0.0:
            share = min(friction * pressing, mass[n] * speed / step_s) / speed
            for i in range(3):
                rub[i] = -share * (slip[i] - along * away[i])
        for i in range(3):
            # Friction before and after this step, each for half of it.
            work[FRICTION_WORK] -= 0.5 * step_s * (rubbed[s, i] + rub[i]) * slip[i]
            rubbed[s, i] = rub[i]
            force[n, i] += pressing * away[i] + rub[i]
            push[0, i] -= pressing * away[i] + rub[i]
        for i in range(3):
            j, k = (i + 1) % 3, (i + 2) % 3
            push[1, i] -= apart * (away[j] * rub[k] - away[k] * rub[j])
        work[CONTACT_ENERGY] += 0.5 * pressing * depth
