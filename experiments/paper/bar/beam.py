"""A free-free Euler-Bernoulli beam, struck at mid-span: its modes, and the moment at which it yields.

Symmetric shapes in `s`, the distance from mid-span, with ``beta L`` a root of ``tan(x/2) + tanh(x/2) = 0``:

    phi(s) = cos(beta s) / cos(beta L/2) + cosh(beta s) / cosh(beta L/2)

which makes the integral of phi^2 over the beam L, so that each mode has the mass of the whole beam.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.integrate import quad
from scipy.linalg import eigh
from scipy.optimize import brentq

from experiments.paper.bar.setup import Setup

Array = NDArray[np.float64]

#: Points on one half of the bar, by Gauss and Legendre, for each mode, and above. With fewer than two for each, the sum
#: over them can exceed the integral for the highest modes, and yielding would then make energy.
POINTS_PER_MODE, POINTS_ABOVE = 4, 8

#: Polynomials for each of deflection and rotation: the first three frequencies are exact to 1e-9.
RITZ_TERMS = 20


@dataclass(frozen=True)
class Beam:
    """The bar by ``k`` bending modes and ``p`` points at which it may yield."""

    mass_kg: float  # of the beam, and of each mode
    omega_rad_s: Array  # angular eigenfrequencies (k,)
    middle: Array  # shapes at mid-span (k,)
    curvature_m2: Array  # second derivatives of the shapes at the points (p, k), 1/m^2
    weight_m: Array  # length of the bar per point (p,), both halves together
    stiffness_n_m2: float  # ``E I``
    # Yield moment (p,) by the accumulated plastic curvature (p,) in 1/m.
    plastic_moment_n_m: Callable[[Array], Array]


def free_roots(count: int) -> Array:
    """The first roots (count,) of ``cos(x) cosh(x) = 1`` above zero: 4.730, 7.853, 10.996, ...; each is ``beta L``.

    The even places (4.730, 10.996, ...) belong to the symmetric modes.
    """
    # Divided by cosh, so that it stays finite; each root is within 0.02 of an odd multiple of pi/2.
    guesses = (np.arange(count) + 1.5) * math.pi
    return np.array([brentq(lambda x: math.cos(x) - 1 / math.cosh(x), g - 0.1, g + 0.1, xtol=1e-14) for g in guesses])


def frequencies_hz(roots: Array, setup: Setup) -> Array:
    """Eigenfrequencies by ``omega = (beta L)^2 / L^2 sqrt(E I / (rho S))``: section 5.3.2, with alpha = (beta L)^2."""
    per_length = setup.bar_mass_kg / setup.bar_length_m
    speed = math.sqrt(setup.bending_stiffness_n_m2 / per_length)
    return (roots / setup.bar_length_m) ** 2 * speed / (2 * math.pi)


def timoshenko_hz(count: int, setup: Setup) -> Array:
    """Eigenfrequencies (count,) in Hz of the free bar with shear and rotary inertia, above those of a rigid body.

    By Ritz with Legendre's polynomials for deflection and rotation; shear coefficient of a round section by Cowper,
    J. Appl. Mech. 33 (1966) 335, DOI 10.1115/1.3625046.
    """
    coefficient = 6 * (1 + setup.bar_poisson) / (7 + 6 * setup.bar_poisson)
    shear_n = coefficient * setup.bar_modulus_pa / (2 + 2 * setup.bar_poisson) * math.pi * setup.bar_radius_m**2
    half, per_length = setup.bar_length_m / 2, setup.bar_mass_kg / setup.bar_length_m
    knots, weight = np.polynomial.legendre.leggauss(2 * RITZ_TERMS)
    value = np.polynomial.legendre.legvander(knots, RITZ_TERMS - 1)
    each = np.eye(RITZ_TERMS)
    slope = np.stack([np.polynomial.legendre.legval(knots, np.polynomial.legendre.legder(e)) for e in each], 1) / half

    def product(a: Array, b: Array) -> Array:
        return half * (a.T * weight) @ b

    zero = np.zeros((RITZ_TERMS, RITZ_TERMS))
    turned = setup.bending_stiffness_n_m2 * product(slope, slope) + shear_n * product(value, value)
    across = -shear_n * product(slope, value)
    stiffness = np.block([[shear_n * product(slope, slope), across], [across.T, turned]])
    # The square of a round section's radius of gyration is a quarter of that of its radius.
    mass = np.block([[product(value, value), zero], [zero, product(value, value) * setup.bar_radius_m**2 / 4]])
    squares = eigh(stiffness, per_length * mass, eigvals_only=True)
    return np.sqrt(squares[2 : 2 + count]) / (2 * math.pi)


def symmetric_shape(roots: Array, place: Array, derivative: int = 0) -> Array:
    """Symmetric shapes (p, k), or their second derivatives in units of 1/L^2, at places (p,) from -1/2 to 1/2, in L.

    Raises
    ------
    ValueError
        Where another derivative than 0 or 2 is asked for.
    """
    if derivative not in (0, 2):
        raise ValueError(f"derivative = {derivative!r}: expected 0 or 2")
    angle = np.abs(place)[:, None] * roots
    # cosh(x) / cosh(h), written so that it does not overflow.
    grown = (np.exp(angle - roots / 2) + np.exp(-angle - roots / 2)) / (1 + np.exp(-roots))
    waved = np.cos(angle) / np.cos(roots / 2)
    return waved + grown if derivative == 0 else roots**2 * (grown - waved)


def beam(setup: Setup) -> Beam:
    """The bar of a setup."""
    roots = free_roots(2 * setup.modes)[::2]
    knots, weight = np.polynomial.legendre.leggauss(POINTS_PER_MODE * setup.modes + POINTS_ABOVE)
    place = (knots + 1) / 4
    return Beam(
        mass_kg=setup.bar_mass_kg,
        omega_rad_s=2 * math.pi * frequencies_hz(roots, setup),
        middle=symmetric_shape(roots, np.zeros(1))[0],
        curvature_m2=symmetric_shape(roots, place, derivative=2) / setup.bar_length_m**2,
        weight_m=weight / 2 * setup.bar_length_m,
        stiffness_n_m2=setup.bending_stiffness_n_m2,
        plastic_moment_n_m=plastic_moment(setup),
    )


def plastic_moment(setup: Setup) -> Callable[[Array], Array]:
    """The fully plastic moment in N m of a plastic curvature in 1/m, by equation (11) without heat.

    The flow stress ``(a + b strain^n) rate`` with ``strain = curvature |y|`` over the whole section, the elastic core
    left out.
    """
    rate = 1 + setup.rate_coefficient * math.log(setup.bending_rate_hz / setup.reference_rate_hz)
    radius, exponent = setup.bar_radius_m, setup.bending_exponent

    def section(power: float) -> float:
        # Integral of |y|^power over the round section.
        unit = quad(lambda y: 4 * y**power * math.sqrt(1 - y * y), 0, 1)[0]
        return float(unit) * radius ** (power + 2)

    first = setup.bending_yield_pa * rate * section(1)
    growth = setup.bending_hardening_pa * rate * section(1 + exponent)
    return lambda curvature: first + growth * curvature**exponent
