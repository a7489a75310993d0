"""Johnson and Cook's flow stress, equation (11), with the actual strain rate and the heat of the plastic work."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numba
import numpy as np
from numpy.typing import NDArray

from experiments.fe.hardening import JohnsonCook

Array = NDArray[np.float64]

#: 1 kg/m^3 in t/mm^3; 1 J/(kg K) in mJ/(t K).
KG_M3, J_KG_K = 1e-12, 1e6
#: Least share of the flow stress that heat leaves, so that a molten element keeps a solution.
LEAST_SHARE = 1e-3
#: Iterations of the flow stress, and the error in units of it at which they end.
ITERATIONS, CLOSE = 40, 1e-9

# Places of the constants in the array for the loops.
LAME, SHEAR, DENSITY, YIELD, HARDENING, EXPONENT, RATE_COEFFICIENT, REFERENCE = range(8)
START_K, MELT_K, HEAT_EXPONENT, HEATING = range(8, 12)


@dataclass(frozen=True)
class Heat:
    """The factor of temperature ``1 - ((T - start) / (melt - start))^exponent``, and what warms the metal."""

    start_k: float
    melt_k: float
    exponent: float
    capacity_j_kg_k: float  # of heat
    share: float = 0.9  # of the plastic work that turns into heat (Taylor and Quinney)

    def __post_init__(self) -> None:
        """Raises if the constants are those of no material.

        Raises
        ------
        ValueError
            With the name, what was given and what was expected.
        """
        for name, value in vars(self).items():
            if not (math.isfinite(value) and value > 0):
                raise ValueError(f"{name} = {value!r}: expected a finite number above 0")
        if self.melt_k <= self.start_k:
            raise ValueError(f"melt_k = {self.melt_k!r}: expected more than start_k = {self.start_k:g}")


@dataclass(frozen=True)
class Metal:
    """An isotropic metal: elastic without ``hardening``, isothermal without ``heat``."""

    modulus_mpa: float
    poisson: float
    density_kg_m3: float
    hardening: JohnsonCook | None = None
    heat: Heat | None = None

    def __post_init__(self) -> None:
        """Raises if the constants are those of no material.

        Raises
        ------
        ValueError
            With the name, what was given and what was expected.
        """
        for name in ("modulus_mpa", "density_kg_m3"):
            value = getattr(self, name)
            if not (math.isfinite(value) and value > 0):
                raise ValueError(f"{name} = {value!r}: expected a finite number above 0")
        if not -1 < self.poisson < 0.5:
            raise ValueError(f"poisson = {self.poisson!r}: expected a number above -1 and below 0.5")

    @property
    def shear_mpa(self) -> float:
        """Shear modulus."""
        return self.modulus_mpa / 2 / (1 + self.poisson)

    @property
    def start_k(self) -> float:
        """Temperature before the impact; 0 where heat is left out."""
        return self.heat.start_k if self.heat else 0.0

    def constants(self) -> Array:
        """The constants (12,) for the loops, in mm, t, s and K."""
        lame = 2 * self.shear_mpa * self.poisson / (1 - 2 * self.poisson)
        elastic = (lame, self.shear_mpa, self.density_kg_m3 * KG_M3)
        law, heat = self.hardening, self.heat
        flow = (math.inf, 0.0, 1.0, 0.0, 1.0)
        if law:
            flow = (law.yield_mpa, law.hardening_mpa, law.exponent, law.rate_coefficient, law.reference_rate_hz)
        warm = (0.0, math.inf, 1.0, 0.0)
        if heat:
            capacity = self.density_kg_m3 * KG_M3 * heat.capacity_j_kg_k * J_KG_K
            warm = (heat.start_k, heat.melt_k, heat.exponent, heat.share / capacity)
        return np.array(elastic + flow + warm)


@numba.njit(cache=True, error_model="numpy")
def softening(metal: Array, temperature_k: float) -> float:
    """The factor of temperature of equation (11)."""
    warm = (temperature_k - metal[START_K]) / (metal[MELT_K] - metal[START_K])
    if warm <= 0.0:
        return 1.0
    return max(1.0 - warm ** metal[HEAT_EXPONENT], LEAST_SHARE)


@numba.njit(cache=True, error_model="numpy")
def flow(metal: Array, strain: float, rate: float, soft: float) -> tuple[float, float, float]:
    """Flow stress, and its slopes over the strain and over the rate; the rate counts from the reference on."""
    power = strain ** metal[EXPONENT] if strain > 0.0 else 0.0
    static = (metal[YIELD] + metal[HARDENING] * power) * soft
    factor, over_rate = 1.0, 0.0
    if rate > metal[REFERENCE]:
        factor += metal[RATE_COEFFICIENT] * math.log(rate / metal[REFERENCE])
        over_rate = static * metal[RATE_COEFFICIENT] / rate
    over_strain = metal[HARDENING] * metal[EXPONENT] * power / strain * soft * factor if strain > 0.0 else 0.0
    return static * factor, over_strain, over_rate


@numba.njit(cache=True, error_model="numpy")
def plastic_step(metal: Array, trial: float, strain: float, temperature_k: float, step_s: float, guess: float) -> float:
    """Growth of the plastic strain that brings the equivalent stress ``trial`` back to the flow stress.

    The implicit equation ``trial - 3 G growth = flow(strain + growth, growth / step_s, T)`` by Newton's way within
    shrinking limits; its left side falls and its right side rises, so that there is one solution. ``guess`` starts it.
    """
    soft = softening(metal, temperature_k)
    if trial <= flow(metal, strain, 0.0, soft)[0]:
        return 0.0
    stiff = 3.0 * metal[SHEAR]
    low, high = 0.0, trial / stiff
    growth = guess if low < guess < high else 0.5 * high
    for _ in range(ITERATIONS):
        stress, over_strain, over_rate = flow(metal, strain + growth, growth / step_s, soft)
        off = trial - stiff * growth - stress
        if abs(off) <= CLOSE * trial:
            break
        if off > 0.0:
            low = growth
        else:
            high = growth
        growth += off / (stiff + over_strain + over_rate / step_s)
        if not low < growth < high:
            growth = 0.5 * (low + high)
    return growth
