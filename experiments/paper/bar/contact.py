"""The force in the contact: elastic by Hertz, then plastic; unloading by Hertz on the flattened surface.

Thornton, J. Appl. Mech. 64 (1997) 383: the pressure cannot exceed ``p_y``. Until the maximum pressure reaches ``p_y``,
Hertz: ``F = 4/3 E* R^(1/2) d^(3/2)``. Beyond, linear with the same slope, ``pi R p_y``. Unloading from a force F at the
approach d follows Hertz with the larger radius of the dent, so that both the force and the radius of the contact area
are continuous; loading again follows the same curve. (Hertz in Johnson, Contact Mechanics, 1985, ch. 4.)
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property

from experiments.paper.bar.setup import Setup


@dataclass(frozen=True)
class Contact:
    """Effective modulus (``E*``, Pa), effective radius (m), and limit of the pressure (Pa)."""

    modulus_pa: float
    radius_m: float
    pressure_pa: float

    @classmethod
    def of(cls, setup: Setup) -> Contact:
        """A ball on a bar: the geometric mean of both relative radii, which is Hertz's for a nearly round area."""
        ball = (1 - setup.ball_poisson**2) / setup.ball_modulus_pa
        bar = (1 - setup.bar_poisson**2) / setup.bar_modulus_pa
        across = 1 / (1 / setup.ball_radius_m + 1 / setup.bar_radius_m)
        return cls(1 / (ball + bar), math.sqrt(across * setup.ball_radius_m), setup.contact_pressure_pa)

    @cached_property
    def yield_approach_m(self) -> float:
        """Approach in m at which the contact yields."""
        return self.radius_m * (math.pi * self.pressure_pa / (2 * self.modulus_pa)) ** 2

    def _hertz(self, radius_m: float, approach_m: float) -> float:
        return 4 / 3 * self.modulus_pa * math.sqrt(radius_m) * approach_m**1.5

    def loading(self, approach_m: float) -> float:
        """Force in N at the deepest approach so far."""
        start = self.yield_approach_m
        if approach_m <= start:
            return self._hertz(self.radius_m, max(approach_m, 0.0))
        slope = math.pi * self.radius_m * self.pressure_pa
        return self._hertz(self.radius_m, start) + slope * (approach_m - start)

    def dent(self, deepest_m: float) -> tuple[float, float]:
        """Radius of the dent and approach at which the contact ends, both in m, after the deepest approach."""
        if deepest_m <= self.yield_approach_m:
            return self.radius_m, 0.0
        force = self.loading(deepest_m)
        # Area of the contact by Thornton's equation for F > F_y.
        first = self._hertz(self.radius_m, self.yield_approach_m)
        area = (2 * force + first) / (2 * math.pi * self.pressure_pa)
        radius = 4 * self.modulus_pa * area**1.5 / (3 * force)
        return radius, deepest_m - area / radius

    def force(self, approach_m: float, deepest_m: float) -> float:
        """Force in N, never below 0, after the deepest approach so far."""
        if approach_m >= deepest_m:
            return self.loading(approach_m)
        radius, release = self.dent(deepest_m)
        return self._hertz(radius, max(approach_m - release, 0.0))

    def elastic_energy(self, approach_m: float, deepest_m: float) -> float:
        """Elastic energy in J of the contact."""
        deepest_m = max(approach_m, deepest_m)
        _, release = self.dent(deepest_m)
        return 0.4 * self.force(approach_m, deepest_m) * max(approach_m - release, 0.0)

    def plastic_work(self, deepest_m: float) -> float:
        """Plastic work in J: the work up to the deepest approach less the energy that unloading returns."""
        start = self.yield_approach_m
        if deepest_m <= start:
            return 0.0
        first, last = self._hertz(self.radius_m, start), self.loading(deepest_m)
        work = 0.4 * first * start + (first + last) / 2 * (deepest_m - start)
        return work - self.elastic_energy(deepest_m, deepest_m)
