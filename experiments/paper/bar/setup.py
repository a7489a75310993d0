"""All numbers of the frontal impact, each with its source."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

Vector = tuple[float, float, float]

#: Fields that may be zero or negative; all others are above zero.
SIGNED = ("sideways_m_s", "offset_m")
NOT_NEGATIVE = ("damping", "friction")


@dataclass(frozen=True, kw_only=True)
class Setup:
    """Ball, bar, contact and shot; camera frame (x right and along the barrel, y down, z away), SI units.

    Attributes
    ----------
    ball_radius_m, ball_mass_kg : float
        Section 5.1: 30 mm, 110 g, steel. A solid sphere, rigid but for the contact.
    ball_modulus_pa, ball_poisson : float
        Of steel, not in the paper: 210 GPa and 0.3.
    bar_length_m, bar_diameter_m : float
        Section 5.1: 300 mm, 18 mm.
    bar_modulus_pa, bar_poisson : float
        Table 4: 72 GPa, 0.27.
    bar_density_kg_m3 : float
        Not in the paper: aluminium alloys have 2700 to 2800, those of 72 GPa (2024, 7075) 2780 to 2810.
    bar_axis : tuple of float
        Unit vector across the barrel: the bar lies in the image plane and the camera, on top (section 5.1), sees its
        whole length.
    modes : int
        Symmetric bending modes; the antisymmetric ones have a node at mid-span, where the ball hits. The shortest of 16
        waves is as long as the bar is thick, beyond which no beam theory means anything. Twice as many lower the first
        peak of the force by 2 % and move the others by 3 us at most.
    damping : float
        Share of the critical damping, in each mode: light, as of a bar of aluminium that hangs free. Over the contact
        of 0.75 ms it takes 1 % of the first mode's amplitude.
    bending_yield_pa, bending_hardening_pa, bending_exponent : float
        Table 4: ``a``, ``b`` and ``n`` of Johnson and Cook. An infinite ``a`` keeps the bending elastic.
    rate_coefficient, reference_rate_hz : float
        Table 4: ``c`` and the strain rate to which it refers. Softening by heat is left out: bending warms the bar by
        10 K at most.
    bending_rate_hz : float
        Strain rate in bending, taken as one number since its logarithm counts: half of what this model has on the
        surface (240 1/s, the mean over the plastic work; 6 % of strain in the end).
    contact_pressure_pa : float
        Limit of the pressure in the contact, ``p_y`` of Thornton (1997): 2.8 times the flow stress (Tabor, The Hardness
        of Metals, 1951) of table 4, which is 540 MPa at a rate of 20 000 1/s (70 m/s over the contact's radius of 4 mm)
        and a strain of 0.05 (Tabor's 0.2 a/R, half-way through the first loading). Infinite: elastic (Hertz).
    friction : float
        Coulomb's coefficient, low for steel on aluminium since the ball is painted. The ball rolls before the first
        contact ends, so that the spin follows from the offset: from 0.1 to 0.6 it changes by 0.5 %.
    creep_m_s : float
        Sliding speed at which friction has 71 % of its full value: keeps Coulomb's law smooth. Rolling is reached
        within a microsecond at the force's peak; a tenth of it would need a tenth of the step.
    speed_m_s, sideways_m_s : float
        Velocity before along x, section 5.1, and along y, table 3.
    offset_m : float
        How far the ball passes from the bar's axis, along ``x cross bar_axis``: positive is away from the camera with
        the bar along y. Not in the paper; chosen so that the ball turns by about 20 revolutions per second afterwards
        (section 5.3). The sign makes its front run behind its centre, so that correlation of translations alone
        underestimates the displacement, as in figure 8.
    spin_rad_s : tuple of float
        Spin before: figure 9 has it about y alone, of a size that the text does not give; here 1.9 rev/s.
    step_s, length_s : float
        Step of the integration, and time from the first touch to its end.
    """

    ball_radius_m: float = 15e-3
    ball_mass_kg: float = 0.110
    ball_modulus_pa: float = 210e9
    ball_poisson: float = 0.3
    bar_length_m: float = 0.300
    bar_diameter_m: float = 18e-3
    bar_modulus_pa: float = 72e9
    bar_poisson: float = 0.27
    bar_density_kg_m3: float = 2800.0
    bar_axis: Vector = (0.0, 1.0, 0.0)
    modes: int = 16
    damping: float = 0.002
    bending_yield_pa: float = 175e6
    bending_hardening_pa: float = 223e6
    bending_exponent: float = 0.37
    rate_coefficient: float = 0.1
    reference_rate_hz: float = 0.18
    bending_rate_hz: float = 100.0
    contact_pressure_pa: float = 1.5e9
    friction: float = 0.3
    creep_m_s: float = 1.0
    speed_m_s: float = 70.0
    sideways_m_s: float = 0.72
    offset_m: float = 0.7e-3
    spin_rad_s: Vector = (0.0, 12.0, 0.0)
    step_s: float = 0.1e-6
    length_s: float = 1.1e-3

    def __post_init__(self) -> None:
        """Raises if the settings describe no impact.

        Raises
        ------
        ValueError
            With the name, what was given and what was expected.
        """
        for name, value in vars(self).items():
            if name in ("bar_axis", "spin_rad_s"):
                if len(value) != 3 or not np.isfinite(value).all():
                    raise ValueError(f"{name} = {value!r}: expected three finite numbers")
            elif math.isnan(value) or (name not in SIGNED and value < 0):
                raise ValueError(f"{name} = {value!r}: expected a number that is not negative")
            elif name not in SIGNED + NOT_NEGATIVE and value == 0:
                raise ValueError(f"{name} = {value!r}: expected a number above 0")
        if abs(np.linalg.norm(self.bar_axis) - 1) > 1e-9 or abs(self.bar_axis[0]) > 1e-9:
            raise ValueError(f"bar_axis = {self.bar_axis!r}: expected a unit vector across x, such as (0, 1, 0)")
        if abs(self.offset_m) >= self.reach_m:
            raise ValueError(
                f"offset_m = {self.offset_m!r}: the ball misses the bar; expected less than {self.reach_m:g} m"
            )

    @property
    def bar_radius_m(self) -> float:
        """Half the bar's diameter."""
        return self.bar_diameter_m / 2

    @property
    def reach_m(self) -> float:
        """Distance of the ball's centre from the bar's axis at first touch."""
        return self.ball_radius_m + self.bar_radius_m

    @property
    def bar_mass_kg(self) -> float:
        """Mass of the whole bar."""
        return self.bar_density_kg_m3 * math.pi * self.bar_radius_m**2 * self.bar_length_m

    @property
    def bending_stiffness_n_m2(self) -> float:
        """``E I`` of the round section, I = pi r^4 / 4."""
        return self.bar_modulus_pa * math.pi * self.bar_radius_m**4 / 4

    @property
    def ball_inertia_kg_m2(self) -> float:
        """Inertia of a solid sphere about its centre."""
        return 0.4 * self.ball_mass_kg * self.ball_radius_m**2

    @property
    def bar_roll_inertia_kg_m2(self) -> float:
        """Inertia of the bar about its own axis."""
        return self.bar_mass_kg * self.bar_radius_m**2 / 2
