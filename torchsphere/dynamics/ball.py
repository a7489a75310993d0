"""Mass, radius and moment of inertia of the ball: they give forces, energies and the slip at the point of contact."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from torchsphere.runtime import warning_levels
from torchsphere.runtime.arrays import Array
from torchsphere.settings.calibration import implausible_units, with_option_names
from torchsphere.settings.limits import as_positive, as_share

#: Kind of a ball whose moment of inertia was given: the errors of mass and diameter are not in its inertia.
OF_GIVEN_INERTIA = "of given inertia"


@dataclass(frozen=True)
class Ball:
    """Mass (kg), radius (m) and moment of inertia (kg m^2) of a ball, and its kind in words.

    ``relative_sd_mass`` and ``relative_sd_diameter`` are relative standard deviations.
    """

    mass_kg: float
    radius_m: float
    inertia_kg_m2: float
    kind: str
    relative_sd_mass: float = 0.0
    relative_sd_diameter: float = 0.0


@dataclass(frozen=True)
class DrawnBall:
    """Mass, radius and moment of inertia (s,) of a ball, drawn within their errors; units as in `Ball`."""

    mass_kg: Array
    radius_m: Array
    inertia_kg_m2: Array


def ball(
    mass_kg: float | None = None,
    diameter_m: float | None = None,
    *,
    shell_m: float | None = None,
    inertia_kg_m2: float | None = None,
    relative_sd_mass: float = 0.0,
    relative_sd_diameter: float = 0.0,
    log: bool = True,
    **options: float | None,
) -> Ball:
    """A solid ball, a hollow ball with a shell of thickness ``shell_m``, or a ball of given inertia.

    Parameters
    ----------
    mass_kg, diameter_m : float
    shell_m : float, optional
    inertia_kg_m2 : float, optional
        Taken as exact.
    relative_sd_mass : float
        Relative standard deviation of the mass, as 0.01 for 1 %.
    relative_sd_diameter : float
        That of the diameter. Its error is the same as that of the diameter, or of the size of a pixel, that gave the
        scale of the motion, if that has one. The shell goes with the diameter.

    Raises
    ------
    ValueError
        If a number is not finite and positive, a relative standard deviation is not in [0, 1), the shell is thicker
        than the radius, or shell and inertia are given.

    Notes
    -----
    ``2/5 m R^2``, and ``2/5 m (R^5 - r^5) / (R^3 - r^3)`` for a shell between the radii r and R.
    """
    given = {
        "mass_kg": mass_kg,
        "diameter_m": diameter_m,
        "shell_m": shell_m,
        "relative_sd_mass": relative_sd_mass,
    }
    values = with_option_names("ball", given, options, {"relative_sd_mass": 0.0})
    mass_kg, diameter_m, shell_m, relative_sd_mass = values.values()
    inertia, kind = _inertia(mass_kg, diameter_m, shell_m, inertia_kg_m2)
    sd_mass = as_share("relative_sd_mass", relative_sd_mass)
    if log:
        warning_levels.log(implausible_units(float(diameter_m), float(mass_kg)))
    sd_diameter = as_share("relative_sd_diameter", relative_sd_diameter)
    return Ball(mass_kg, diameter_m / 2, inertia, kind, sd_mass, sd_diameter)


def drawn_ball(ball: Ball, mass: Array, length: Array) -> DrawnBall:
    """The ``ball`` with errors (s,) of its mass and of its diameter, each in its standard deviations."""
    heavier, larger = 1 + ball.relative_sd_mass * mass, 1 + ball.relative_sd_diameter * length
    by_both = np.ones_like(heavier) if ball.kind == OF_GIVEN_INERTIA else heavier * larger**2
    return DrawnBall(ball.mass_kg * heavier, ball.radius_m * larger, ball.inertia_kg_m2 * by_both)


def _inertia(
    mass_kg: float, diameter_m: float, shell_m: float | None, inertia_kg_m2: float | None
) -> tuple[float, str]:
    """Moment of inertia, kg m^2, and the kind of ball in words; ValueError as `ball`."""
    as_positive("mass_kg", mass_kg)
    as_positive("diameter_m", diameter_m)
    for name, value in (("shell_m", shell_m), ("inertia_kg_m2", inertia_kg_m2)):
        if value is not None:
            as_positive(name, value)
    if shell_m is not None and inertia_kg_m2 is not None:
        raise ValueError("ball: shell_m and inertia_kg_m2 were both given; give one of them")
    radius = diameter_m / 2
    if inertia_kg_m2 is not None:
        return inertia_kg_m2, OF_GIVEN_INERTIA
    if shell_m is None or shell_m == radius:
        return 0.4 * mass_kg * radius**2, "solid"
    if shell_m > radius:
        raise ValueError(f"shell_m = {shell_m:g}: thicker than the ball's radius of {radius:g} m")
    inner = radius - shell_m
    inertia = 0.4 * mass_kg * (radius**5 - inner**5) / (radius**3 - inner**3)
    return inertia, f"hollow, shell of {1e3 * shell_m:g} mm"
