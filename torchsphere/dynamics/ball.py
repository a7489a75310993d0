"""Mass, radius and moment of inertia of the ball: they give forces, energies and the slip at the point of contact."""

from __future__ import annotations

from dataclasses import dataclass

from torchsphere.settings.limits import as_positive


@dataclass(frozen=True)
class Ball:
    """Mass (kg), radius (m) and moment of inertia (kg m^2) of a ball, and its kind in words."""

    mass_kg: float
    radius_m: float
    inertia_kg_m2: float
    kind: str


def ball(
    mass_kg: float, diameter_m: float, *, shell_m: float | None = None, inertia_kg_m2: float | None = None
) -> Ball:
    """A solid ball, a hollow ball with a shell of thickness ``shell_m``, or a ball of given inertia.

    Raises
    ------
    ValueError
        If a number is not finite and positive, the shell is thicker than the radius, or shell and inertia are given.

    Notes
    -----
    ``2/5 m R^2``, and ``2/5 m (R^5 - r^5) / (R^3 - r^3)`` for a shell between the radii r and R.
    """
    as_positive("mass_kg", mass_kg)
    as_positive("diameter_m", diameter_m)
    for name, value in (("shell_m", shell_m), ("inertia_kg_m2", inertia_kg_m2)):
        if value is not None:
            as_positive(name, value)
    if shell_m is not None and inertia_kg_m2 is not None:
        raise ValueError("ball: shell_m and inertia_kg_m2 were both given; give one of them")
    radius = diameter_m / 2
    if inertia_kg_m2 is not None:
        return Ball(mass_kg, radius, inertia_kg_m2, "of given inertia")
    if shell_m is None or shell_m == radius:
        return Ball(mass_kg, radius, 0.4 * mass_kg * radius**2, "solid")
    if shell_m > radius:
        raise ValueError(f"shell_m = {shell_m:g}: thicker than the ball's radius of {radius:g} m")
    inner = radius - shell_m
    inertia = 0.4 * mass_kg * (radius**5 - inner**5) / (radius**3 - inner**3)
    return Ball(mass_kg, radius, inertia, f"hollow, shell of {1e3 * shell_m:g} mm")
