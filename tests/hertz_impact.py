"""Impacts of a ball on an elastic or lossy half-space, with exact force, penetration, stiffness and losses."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from experiments.validation.simulated_impacts import MASS_KG, RATE, SPEED_M_S, Push, Simulated, simulated

#: Steps of the integration of a contact.
STEPS = 40_000


@dataclass(frozen=True, eq=False)
class Contact:
    """Force (N), penetration (m) and velocity into the target (m/s) over the time (s) since first touch."""

    time_s: np.ndarray
    penetration_m: np.ndarray
    force_N: np.ndarray  # noqa: N815
    velocity_m_s: np.ndarray
    stiffness: float  # N/m^power

    @property
    def energy_lost(self) -> float:
        return 0.5 * MASS_KG * (self.velocity_m_s[0] ** 2 - self.velocity_m_s[-1] ** 2)


def contact(duration_frames: float, *, power: float = 1.5, unloading_power: float | None = None) -> Contact:
    """A contact of ``F = K d^power``; it unloads from the largest force with another power of ``d / d_max``.

    ``duration_frames`` is the duration of the whole contact, which sets the stiffness.
    """
    # Without units (m = v = K = 1), by velocity Verlet; the scales follow from the duration.
    dt = 5.0 / STEPS
    d, v, f = 0.0, 1.0, 0.0
    rows = [(0.0, d, f, v)]
    largest = None
    while d > 0 or len(rows) == 1:
        half = v - 0.5 * dt * f
        d += dt * half
        if half < 0 and largest is None:
            largest = rows[-1][1]
        if d <= 0:
            break
        shape = d**power if largest is None else largest**power * (d / largest) ** (unloading_power or power)
        f = shape
        v = half - 0.5 * dt * f
        rows.append((len(rows) * dt, d, f, v))
    time, depth, force, velocity = np.array(rows).T
    unit_s = duration_frames / RATE / time[-1]
    unit_m = SPEED_M_S * unit_s
    unit_n = MASS_KG * unit_m / unit_s**2
    return Contact(time * unit_s, depth * unit_m, force * unit_n, velocity * SPEED_M_S, unit_n / unit_m**power)


def impact(
    made: Contact, *, frames: int = 90, start: float = 35.3, noise_m: float = 1.5e-6, seed: int = 0
) -> Simulated:
    """The contact filmed: the ball flies in +x onto a target whose normal is 180 deg."""
    length = made.time_s[-1]
    push = Push(lambda share: np.interp(share * length, made.time_s, made.force_N), start, length * RATE, -1.0)
    return simulated([push], frames, noise_m, seed)
