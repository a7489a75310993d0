"""A long elastic bar with a strain gauge: cross-section, modulus, wave speed, and where the gauge sits."""

from __future__ import annotations

import math
from dataclasses import dataclass

from torchsphere.settings.limits import as_positive

#: Wave speeds of bars, m/s (docs/constants.toml).
WAVE_SPEEDS_M_S = (100.0, 20000.0)


@dataclass(frozen=True, kw_only=True)
class Bar:
    """A bar with a strain gauge: SI units.

    Attributes
    ----------
    area_m2, modulus_pa, wave_speed_m_s : float
        Cross-section, Young's modulus, and speed of a long wave.
    distance_m : float
        From the struck end to the gauge.
    length_m : float or None
        From the struck end to the far end; None if no reflection arrives within the record.
    relative_sd : float
        Relative standard deviation of modulus times area times the gauge's sensitivity.
    """

    area_m2: float
    modulus_pa: float
    wave_speed_m_s: float
    distance_m: float
    length_m: float | None = None
    relative_sd: float = 0.0

    def __post_init__(self) -> None:
        for name in ("area_m2", "modulus_pa", "wave_speed_m_s"):
            as_positive(name, getattr(self, name), "a finite, positive number in SI units")
        if not WAVE_SPEEDS_M_S[0] <= self.wave_speed_m_s <= WAVE_SPEEDS_M_S[1]:
            raise ValueError(
                f"bar: a wave speed of {self.wave_speed_m_s:.4g} m/s, expected {WAVE_SPEEDS_M_S[0]:g} to "
                f"{WAVE_SPEEDS_M_S[1]:g}; check the units of modulus and density (steel: 210 GPa, 7850 kg/m3)"
            )
        if not (math.isfinite(self.distance_m) and self.distance_m >= 0):
            raise ValueError(f"bar: distance_m = {self.distance_m!r}: expected a finite length in m, 0 or more")
        if self.length_m is not None and not (math.isfinite(self.length_m) and self.length_m > self.distance_m):
            raise ValueError(
                f"bar: length_m = {self.length_m!r}: expected more than the gauge's distance of {self.distance_m:g} m"
            )
        if not 0 <= self.relative_sd < 1:
            raise ValueError(f"bar: relative_sd = {self.relative_sd!r}: expected a share from 0 to below 1")

    @property
    def travel_s(self) -> float:
        """Time of the wave from the struck end to the gauge."""
        return self.distance_m / self.wave_speed_m_s

    @property
    def clear_s(self) -> float:
        """Time from the arrival of the wave at the gauge to that of its reflection."""
        return math.inf if self.length_m is None else 2 * (self.length_m - self.distance_m) / self.wave_speed_m_s

    @property
    def echo_s(self) -> float:
        """Time after which the wave passes the gauge again in the same sense, reflected at both ends."""
        return math.inf if self.length_m is None else 2 * self.length_m / self.wave_speed_m_s


def bar(
    *,
    modulus_pa: float,
    distance_m: float,
    area_m2: float | None = None,
    diameter_m: float | None = None,
    density_kg_m3: float | None = None,
    wave_speed_m_s: float | None = None,
    length_m: float | None = None,
    relative_sd: float = 0.0,
) -> Bar:
    """A bar by its cross-section or its diameter (round, solid), and by its density or its wave speed.

    Raises
    ------
    ValueError
        Unless one of both is given each time, and all numbers are those of a bar.
    """
    if (area_m2 is None) == (diameter_m is None):
        raise ValueError("bar: give either its cross-section (area_m2) or its diameter (diameter_m)")
    if (density_kg_m3 is None) == (wave_speed_m_s is None):
        raise ValueError("bar: give either its density (density_kg_m3) or its wave speed (wave_speed_m_s)")
    modulus = as_positive("modulus_pa", modulus_pa)
    if area_m2 is None:
        area_m2 = math.pi / 4 * as_positive("diameter_m", diameter_m) ** 2
    if wave_speed_m_s is None:
        wave_speed_m_s = math.sqrt(modulus / as_positive("density_kg_m3", density_kg_m3))
    return Bar(
        area_m2=area_m2,
        modulus_pa=modulus,
        wave_speed_m_s=wave_speed_m_s,
        distance_m=distance_m,
        length_m=length_m,
        relative_sd=relative_sd,
    )
