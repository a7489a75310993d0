"""An elastic sphere that a pressure on a cap of its surface pushes away: displacements of its surface.

The contact lasts twenty periods of the sphere's lowest mode, so that its inertia is a body force that balances the
pressure at each moment. Legendre series of the general solution inside a sphere: A. I. Lur'e, Three-Dimensional
Problems of the Theory of Elasticity, 1964, chapter 6.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.special import eval_legendre

Array = NDArray[np.float64]

#: Terms of the series: the shortest wave is a thirtieth of the smallest cap in the study.
TERMS = 600


@dataclass(frozen=True)
class PushedSphere:
    """A sphere with a pressure on the cap about its pole; SI units.

    Attributes
    ----------
    radius_m, modulus_pa, poisson : float
    force_N : float
        Resultant of the pressure, which points from the pole to the centre.
    cap_m : float
        Radius of the cap, across the axis.
    """

    radius_m: float
    modulus_pa: float
    poisson: float
    force_N: float  # noqa: N815  (N is newton)
    cap_m: float

    def displacement(self, angle: Array) -> tuple[Array, Array]:
        """Displacement of the surface, m, outwards and away from the pole, at each ``angle`` (...), rad, from the pole.

        It is relative to the centre of mass.
        """
        nu, shear = self.poisson, self.modulus_pa / (2 + 2 * self.poisson)
        stiff = 2 * shear * (1 - nu) / (1 - 2 * nu)  # of a strain along one axis alone
        inertia = self.force_N / (4 / 3 * math.pi * self.radius_m**2)  # force per volume times the radius
        ratio = nu / (1 - nu)
        outwards, along = np.zeros_like(angle), np.zeros_like(angle)
        for n in range(TERMS + 1):
            # Stress on the surface that the terms without the body force must give, across it and along it.
            across, shearing = -self._pressure(n), 0.0
            if n == 1:
                across += inertia * (3 + 2 * ratio) / 5
                shearing = inertia * (1 - ratio) / 5
            if n == 3:
                across += inertia * 2 / 5 * (1 - ratio)
                shearing = inertia * (1 - ratio) * 2 / 15
            a, b = _amplitudes(n, nu, across / (2 * shear), shearing / (2 * shear))
            if n == 1:
                # The centre of mass stays.
                b = -2 * a + inertia / (10 * stiff)
            value, slope = eval_legendre(n, np.cos(angle)), _slope(n, angle)
            outwards += (a * (n + 1) * (n - 2 + 4 * nu) + b * n) * value
            along += (a * (n + 5 - 4 * nu) + b) * slope
        # The body force alone: along the axis, by the square of the height.
        axial = -0.5 * inertia / stiff * np.cos(angle) ** 2
        return (
            self.radius_m * (outwards + axial * np.cos(angle)),
            self.radius_m * (along - axial * np.sin(angle)),
        )

    def _pressure(self, n: int) -> float:
        """Coefficient of Legendre's polynomial in the pressure, Pa."""
        sine = self.cap_m / self.radius_m
        pressure, edge = self.force_N / (math.pi * self.cap_m**2), math.sqrt(1 - sine**2)
        if n == 0:
            return pressure * (1 - edge) / 2
        return pressure / 2 * float(eval_legendre(n - 1, edge) - eval_legendre(n + 1, edge))


def _amplitudes(n: int, nu: float, across: float, shearing: float) -> tuple[float, float]:
    """Both amplitudes of a term by the stresses on the surface, over twice the shear modulus; radii."""
    if n == 0:
        return across / (-2 - 2 * nu), 0.0
    if n == 1:
        # A translation has no stress: both conditions are one, by the balance of forces.
        return shearing / (2 + 2 * nu), 0.0
    matrix = [
        [(n + 1) * (n**2 - n - 2 - 2 * nu), n * (n - 1)],
        [n**2 + 2 * n - 1 + 2 * nu, n - 1],
    ]
    a, b = np.linalg.solve(np.array(matrix, dtype=float), [across, shearing])
    return float(a), float(b)


def _slope(n: int, angle: Array) -> Array:
    """Derivative of Legendre's polynomial of ``cos(angle)`` with respect to the angle."""
    if n == 0:
        return np.zeros_like(angle)
    cosine, sine = np.cos(angle), np.sin(angle)
    safe = np.where(sine > 1e-9, sine, 1.0)
    slope = n * (cosine * eval_legendre(n, cosine) - eval_legendre(n - 1, cosine)) / safe
    return np.where(sine > 1e-9, slope, 0.0)
