"""Whether a ball's diameter and mass may be meant as they were given: 0.03 for 30 mm is taken, and said to be odd."""

from __future__ import annotations

import math

#: Diameters that a filmed ball may have, mm: from coarse shot for peening to a boulder.
DIAMETERS_MM = (0.5, 2000.0)

#: Mean densities that a ball may have, kg/m3: a foam ball has 15 and a table tennis ball 80; osmium has 22,600.
DENSITIES_KG_M3 = (8.0, 23_000.0)


def implausible(diameter_mm: float, mass_g: float | None, scale: str) -> tuple[str, ...]:
    """One sentence where a ball of that diameter or mass is likely to be one in another unit; none where it is not.

    ``scale`` is what the diameter comes from, as it was given: "--diameter-mm 30".
    """
    given = f"{diameter_mm:.3g} mm by {scale}"
    low, high = DIAMETERS_MM
    if not low <= diameter_mm <= high:
        return (f"The ball's diameter is {given}, which is implausible: see that the unit is mm, as it was taken so.",)
    if mass_g is None:
        return ()
    density = 1e-3 * mass_g / (math.pi / 6 * (1e-3 * diameter_mm) ** 3)
    low, high = DENSITIES_KG_M3
    if low <= density <= high:
        return ()
    return (
        f"The ball's diameter is {given} and its mass {mass_g:g} g by --mass-g {mass_g:g}, which makes {density:.2g} "
        "kg/m3 and is implausible: see that the units are mm and g, as they were taken so.",
    )
