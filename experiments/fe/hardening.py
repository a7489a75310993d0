"""Johnson and Cook's flow stress, equation (11), as a table at one strain rate."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

#: Plastic strains of a table, dense where a power below 1 is steep. Beyond the last strain the stress is constant.
STRAINS = np.array([0, 0.0005, 0.002, 0.005, 0.01, 0.02, 0.04, 0.07, 0.12, 0.2, 0.35, 0.6, 1.0])


@dataclass(frozen=True)
class JohnsonCook:
    """The constants of equation (11) without heat: ``(a + b strain^n) (1 + c ln(rate / reference))``.

    The factor of temperature is left out: the tables are isothermal, and a plastic strain of 0.3 at 500 MPa warms
    aluminium (2800 kg/m^3, 880 J/(kg K), 0.9 of the work) by 55 K, which table 4 makes 4 % of the stress.
    """

    yield_mpa: float  # ``a``
    hardening_mpa: float  # ``b``
    exponent: float  # ``n``
    rate_coefficient: float  # ``c``
    reference_rate_hz: float  # strain rate in 1/s to which ``c`` refers

    def __post_init__(self) -> None:
        """Raises if the constants are those of no material.

        Raises
        ------
        ValueError
            With the name, what was given and what was expected.
        """
        for name, value in vars(self).items():
            if not (math.isfinite(value) and (value > 0 or (value == 0 and name == "rate_coefficient"))):
                raise ValueError(f"{name} = {value!r}: expected a finite number above 0")

    def stress_mpa(self, strain: Array, rate_hz: float) -> Array:
        """Flow stress (n,) in MPa at plastic strains (n,) and one strain rate in 1/s.

        Raises
        ------
        ValueError
            Where the rate is below the one to which the constants refer.
        """
        if not rate_hz >= self.reference_rate_hz:
            raise ValueError(
                f"rate_hz = {rate_hz!r}: expected at least {self.reference_rate_hz:g} per second, "
                "to which the constants refer"
            )
        rate = 1 + self.rate_coefficient * math.log(rate_hz / self.reference_rate_hz)
        return (self.yield_mpa + self.hardening_mpa * np.asarray(strain) ** self.exponent) * rate

    def table(self, rate_hz: float) -> Array:
        """Rows (n, 2) of stress in MPa and plastic strain, as ``*PLASTIC`` wants them."""
        return np.column_stack((self.stress_mpa(STRAINS, rate_hz), STRAINS))


#: Table 4, the aluminium bar.
ALUMINIUM = JohnsonCook(175.0, 223.0, 0.37, 0.1, 0.18)
#: Table 5, the steel plate.
STEEL = JohnsonCook(400.0, 750.0, 0.7, 0.12, 0.2)
