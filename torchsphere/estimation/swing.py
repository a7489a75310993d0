"""What a unit of snap becomes where the jerk is pulled back as by a spring: series without sines of small angles."""

from __future__ import annotations

import functools
import math

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

#: Integrals of the snap down to the pose.
INTEGRALS = 4

#: Terms of the series, and nodes of the integrals over squares of it: exact of a parabola, and right to 1e-9 of a swing
#: over a frame of three.
TERMS, NODES = 14, 6


def swung(duration: Array, frequency: Array) -> Array:
    """Pose, rate, acceleration, jerk and snap (..., 5) that a unit of snap has become after ``duration`` (...).

    The snap's derivative is minus the jerk times the square of the circular ``frequency`` (...). With ``x`` the angle
    turned, the states are powers of the duration times ``sum (-x^2)^m / (p + 2 m)!``, p from 4 to 0.
    """
    square = -((duration * frequency) ** 2)
    found = np.empty((*square.shape, INTEGRALS + 1))
    for power in (INTEGRALS, INTEGRALS - 1):
        total = np.zeros_like(square)
        for factor in _series(power):
            total = total * square + factor
        found[..., INTEGRALS - power] = total
    for power in reversed(range(INTEGRALS - 1)):
        found[..., INTEGRALS - power] = 1 / math.factorial(power) + square * found[..., INTEGRALS - 2 - power]
    found *= np.broadcast_to(duration, square.shape)[..., None] ** np.arange(INTEGRALS, -1, -1)
    return found


@functools.cache
def nodes() -> tuple[Array, Array]:
    """Places between 0 and 1 and weights (q,) by which Gauss integrates."""
    places, weights = np.polynomial.legendre.leggauss(NODES)
    return 0.5 * (places + 1), 0.5 * weights


@functools.cache
def _series(power: int) -> tuple[float, ...]:
    """Factors of the series, the last first; of angles up to two half turns they leave 1e-10."""
    return tuple(1 / math.factorial(power + 2 * m) for m in reversed(range(TERMS)))
