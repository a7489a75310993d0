"""The result of the simulated impact: motion, force and energies over time."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.signal import find_peaks

from experiments.paper.bar.setup import Setup

Array = NDArray[np.float64]

#: Least prominence of a peak of the force, as a share of the highest force.
PROMINENCE = 0.1


@dataclass(frozen=True)
class Peak:
    """Time since first touch in s, normal force in N."""

    time_s: float
    force_N: float  # noqa: N815  (N is newton)


@dataclass(frozen=True)
class History:
    """The impact at ``n`` even times, from first touch on; camera frame (x right, y down, z away).

    The bar's axis passes through the origin before the impact; the ball's orientation at first touch is I.
    """

    setup: Setup
    time_s: Array  # (n,), 0 at first touch
    position_m: Array  # of the ball (n, 3), as are velocity and spin
    velocity_m_s: Array
    spin_rad_s: Array
    quaternion: Array  # the ball's orientation (n, 4), vector first, from body-fixed to camera axes
    force_N: Array  # noqa: N815  (on the ball, (n, 3): mass times acceleration, friction included)
    normal_N: Array  # noqa: N815  (of the contact, (n,))
    approach_m: Array  # of the contact (n,)
    bar_velocity_m_s: Array  # of the bar's centre of mass (n, 3)
    middle_m: Array  # displacement of the bar's axis at mid-span (n, 3)
    bent_rad: float  # plastic bend that the bar keeps
    energy_J: dict[str, Array]  # noqa: N815  (energies (n,) by name; their sum does not change)

    @property
    def momentum_kg_m_s(self) -> Array:
        """Momentum of ball and bar (n, 3); it is constant."""
        setup = self.setup
        return setup.ball_mass_kg * self.velocity_m_s + setup.bar_mass_kg * self.bar_velocity_m_s

    @property
    def total_energy_J(self) -> Array:  # noqa: N802
        """Sum of all energies (n,); it is constant."""
        return np.sum(list(self.energy_J.values()), axis=0)

    @property
    def contacts_s(self) -> tuple[tuple[float, float], ...]:
        """Begin and end of each contact."""
        touching = np.concatenate(((0,), self.normal_N > 0, (0,))).astype(int)
        starts, stops = np.flatnonzero(np.diff(touching) > 0), np.flatnonzero(np.diff(touching) < 0)
        return tuple((float(self.time_s[i]), float(self.time_s[j - 1])) for i, j in zip(starts, stops, strict=True))

    def seen(self, interval_s: float) -> tuple[Array, Array]:
        """The normal force in N as a camera with this interval sees it, and its times in s, both (m,).

        The second difference of exact positions is the mean of the force under a triangle of one interval to each side.

        Raises
        ------
        ValueError
            Where the interval is not above the step of the integration.
        """
        step = self.setup.step_s
        if not interval_s > step:
            raise ValueError(f"interval_s = {interval_s!r}: expected more than the step of {step:g} s")
        count = round(interval_s / step)
        triangle = np.convolve(np.ones(count), np.ones(count)) / count**2
        force = np.convolve(self.normal_N, triangle)
        return step * np.arange(1 - count, len(force) + 1 - count, dtype=np.float64), force


def peaks(time_s: Array, force_N: Array) -> tuple[Peak, ...]:  # noqa: N803
    """The peaks of a force (n,) in the order of time."""
    places, _ = find_peaks(force_N, prominence=PROMINENCE * force_N.max())
    return tuple(Peak(float(time_s[i]), float(force_N[i])) for i in places)
