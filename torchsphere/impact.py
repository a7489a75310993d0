"""The impact itself: contact, force, impulse, restitution, energies and angles, each with its standard deviation.

All quantities but the spin are those of the image plane. Before and after are the last frame before the contact
and the first one after it, by two standard deviations of its edges. Their standard deviations are those of motions
drawn from all that data and calibration leave possible; their values are those of the smoothed motion.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, fields
from typing import Any

import numpy as np
from numpy.typing import NDArray

from torchsphere.before_after import (
    State,
    along,
    angle,
    dot,
    flights,
    is_accelerated,
    is_changed,
    length,
    slip,
    state,
    to_surface,
)
from torchsphere.inertia import Ball
from torchsphere.kinematics import Draws, Kinematics
from torchsphere.peak import peak

Array = NDArray[np.float64]

#: Share of a normal distribution within a standard deviation.
ONE_SD = 0.6827


@dataclass(frozen=True)
class Estimate:
    """A number or vector, its standard deviation, and its unit."""

    value: Array
    sd: Array
    unit: str


@dataclass(frozen=True)
class Impact:
    """What happened; None where it does not follow from what is known, for which ``missing`` has the sentences.

    Attributes
    ----------
    contact_start, contact_end, duration : Estimate
    velocity_before, velocity_after, speed_before, speed_after : Estimate
    direction_before, direction_after : Estimate
        Angle from the x axis towards the y axis of the results' frame.
    normal_direction : Estimate
        The same of the target's normal, from the target to the ball: as given, or that of the change of velocity.
    angle_of_impact, angle_of_exit : Estimate
        Between path and target's surface: 90 deg is frontal.
    restitution_normal : Estimate
        Normal speed after over before.
    restitution_tangential : Estimate or None
        Minus the tangential velocity of the point of contact after over before, spin included: -1 where it slides
        without friction, 0 where it rolls off.
    tangential_velocity_ratio : Estimate or None
        Tangential velocity of the centre after over before.
    spin_before, spin_after : Estimate
        Vectors (3,), rev/s.
    spin_rate_before, spin_rate_after : Estimate
        Their lengths.
    peak_force, peak_time, impulse, impulse_size, mean_force : Estimate or None
    energy_before, energy_after : Estimate or None
        Of the translation.
    spin_energy_before, spin_energy_after : Estimate or None
    energy_given : Estimate or None
        To the target, and lost: the difference of both energies together.
    ball : Ball or None
    missing : tuple of str
    """

    contact_start: Estimate
    contact_end: Estimate
    duration: Estimate
    velocity_before: Estimate
    velocity_after: Estimate
    speed_before: Estimate
    speed_after: Estimate
    direction_before: Estimate
    direction_after: Estimate
    normal_direction: Estimate
    angle_of_impact: Estimate
    angle_of_exit: Estimate
    restitution_normal: Estimate
    restitution_tangential: Estimate | None
    tangential_velocity_ratio: Estimate | None
    spin_before: Estimate
    spin_after: Estimate
    spin_rate_before: Estimate
    spin_rate_after: Estimate
    peak_force: Estimate | None
    peak_time: Estimate | None
    impulse: Estimate | None
    impulse_size: Estimate | None
    mean_force: Estimate | None
    energy_before: Estimate | None
    energy_after: Estimate | None
    spin_energy_before: Estimate | None
    spin_energy_after: Estimate | None
    energy_given: Estimate | None
    ball: Ball | None
    missing: tuple[str, ...]

    def summary(self) -> dict[str, Any]:
        """Name -> value, sd, unit, for a table; a name that carries newtons is absent where there is no mass."""
        result: dict[str, Any] = {}
        for field in fields(self):
            item = getattr(self, field.name)
            if isinstance(item, Estimate):
                result[field.name] = {"value": item.value.tolist(), "sd": item.sd.tolist(), "unit": item.unit}
        if self.ball is not None:
            result["ball"] = vars(self.ball)
        return result | {"missing": list(self.missing)}


_NO_CONTACT = "No contact was found: one steady motion explains all frames as well."
_ACCELERATED = (
    "No contact was found: one steady acceleration explains all frames as well, as by gravity or drag, or where all "
    "frames lie within the contact."
)
_DRIVEN_ON = (
    "In the contact that was found the ball is driven on the way it flies, not thrown back, as by no target at rest."
)
_NO_CHANGE = (
    "The velocity after the contact that was found is that before it: no impact, but perhaps a few wrong or missing "
    "frames."
)
_NORMAL_AWAY = (
    "The target's normal was given as {:g} deg, which is the way that the ball flies; "
    "give the direction from target to ball."
)


def impact(
    motion: Kinematics | None, thing: Ball | None = None, *, normal_deg: float | None = None
) -> tuple[Impact | None, str]:
    """The impact of a recording, or None and why there is none.

    Parameters
    ----------
    motion : Kinematics or None
        None where frame rate or scale are not known: then no impact can be stated.
    thing : Ball, optional
        Without it there are no forces, impulses and energies.
    normal_deg : float, optional
        Direction of the target's normal, from target to ball, as an angle from the x axis towards the y axis of the
        results' frame. By default the direction of the change of velocity is taken for it.

    Raises
    ------
    ValueError
        If the normal is not finite.
    """
    if normal_deg is not None and not math.isfinite(normal_deg):
        raise ValueError(f"normal_deg = {normal_deg!r}: expected a finite angle in degrees")
    if motion is None:
        return None, "Frame rate or scale are not known, so no impact can be stated; give both."
    if not np.isfinite(motion.velocity_m_s).any():
        return None, "No frame has a velocity: fewer frames were measured in a row than that takes."
    if "contact_found" not in motion.about:
        return None, f"The method {motion.about['method']!r} finds no contact; use the smoother."
    if motion.contact_s is None or motion.sd_contact_s is None or motion.draws is None:
        return None, _ACCELERATED if is_accelerated(motion) else _NO_CONTACT
    edges = flights(motion, motion.contact_s, motion.sd_contact_s, motion.draws.span)
    if isinstance(edges, str):
        return None, edges
    central = state(motion.velocity_m_s[edges], motion.spin_rad_s[edges], motion.contact_s, normal_deg)
    if float((central.before * central.normal).sum()) >= 0:
        return None, _DRIVEN_ON if normal_deg is None else _NORMAL_AWAY.format(normal_deg)
    if not is_changed(motion.draws, edges):
        return None, _NO_CHANGE
    return _assembled(central, motion, motion.draws, edges, thing, normal_deg), ""


def _assembled(
    central: State, motion: Kinematics, draws: Draws, edges: list[int], thing: Ball | None, normal_deg: float | None
) -> Impact:
    at = [edge - draws.span.start for edge in edges]
    drawn = state(draws.velocity_m_s[:, at], draws.spin_rad_s[:, at], draws.contact_s, normal_deg)
    missing = []

    def estimate(function: Callable[[State], Array], unit: str, turns: bool = False) -> Estimate:
        value, values = np.asarray(function(central)), function(drawn)
        off = values - value
        if turns:
            off = (off + 180) % 360 - 180
        # A few motions of a softer contact would make a root mean square of what most are far from.
        return Estimate(value, np.asarray(np.quantile(np.abs(off), ONE_SD, axis=0)), unit)

    if normal_deg is None:
        missing.append("The target's normal was not given; that of the change of velocity knows no tangential change.")
    radius = None if thing is None else thing.radius_m
    if thing is None:
        missing.append("The ball's mass and diameter were not given, so there are no forces and energies.")
    elif not (np.isfinite(central.spin_before) & np.isfinite(central.spin_after)).all():
        missing.append("The spin was not measured, so neither its energy nor the one given to the target is known.")
    return Impact(
        contact_start=estimate(lambda s: s.edges[..., 0], "s"),
        contact_end=estimate(lambda s: s.edges[..., 1], "s"),
        duration=estimate(lambda s: s.edges[..., 1] - s.edges[..., 0], "s"),
        velocity_before=estimate(lambda s: s.before, "m/s"),
        velocity_after=estimate(lambda s: s.after, "m/s"),
        speed_before=estimate(lambda s: length(s.before), "m/s"),
        speed_after=estimate(lambda s: length(s.after), "m/s"),
        direction_before=estimate(lambda s: angle(s.before), "deg", True),
        direction_after=estimate(lambda s: angle(s.after), "deg", True),
        normal_direction=estimate(lambda s: angle(s.normal), "deg", True),
        angle_of_impact=estimate(lambda s: to_surface(-s.before, s.normal), "deg"),
        angle_of_exit=estimate(lambda s: to_surface(s.after, s.normal), "deg"),
        restitution_normal=estimate(lambda s: -dot(s.after, s.normal) / dot(s.before, s.normal), "1"),
        restitution_tangential=None
        if normal_deg is None or radius is None
        else estimate(lambda s: -slip(s, radius, after=True) / slip(s, radius, after=False), "1"),
        tangential_velocity_ratio=None
        if normal_deg is None
        else estimate(lambda s: dot(s.after, along(s.normal)) / dot(s.before, along(s.normal)), "1"),
        spin_before=estimate(lambda s: s.spin_before / (2 * np.pi), "rev/s"),
        spin_after=estimate(lambda s: s.spin_after / (2 * np.pi), "rev/s"),
        spin_rate_before=estimate(lambda s: length(s.spin_before) / (2 * np.pi), "rev/s"),
        spin_rate_after=estimate(lambda s: length(s.spin_after) / (2 * np.pi), "rev/s"),
        **_with_mass(motion, draws, thing, estimate),
        ball=thing,
        missing=tuple(missing),
    )


def _with_mass(
    motion: Kinematics, draws: Draws, thing: Ball | None, estimate: Callable[..., Estimate]
) -> dict[str, Estimate | None]:
    """What needs the mass; all None without."""
    names = (
        *("impulse", "impulse_size", "mean_force", "energy_before", "energy_after"),
        *("spin_energy_before", "spin_energy_after", "energy_given", "peak_force", "peak_time"),
    )
    if thing is None:
        return dict.fromkeys(names)
    mass, inertia = thing.mass_kg, thing.inertia_kg_m2

    def moving(velocity: Array) -> Array:
        return np.asarray(0.5 * mass * (velocity**2).sum(-1))

    def turning(spin: Array) -> Array:
        return np.asarray(0.5 * inertia * (spin**2).sum(-1))

    force, moment = peak(motion, draws, mass)
    found = (
        estimate(lambda s: mass * (s.after - s.before), "N s"),
        estimate(lambda s: mass * length(s.after - s.before), "N s"),
        estimate(lambda s: mass * length(s.after - s.before) / (s.edges[..., 1] - s.edges[..., 0]), "N"),
        estimate(lambda s: moving(s.before), "J"),
        estimate(lambda s: moving(s.after), "J"),
        estimate(lambda s: turning(s.spin_before), "J"),
        estimate(lambda s: turning(s.spin_after), "J"),
        estimate(
            lambda s: moving(s.before) + turning(s.spin_before) - moving(s.after) - turning(s.spin_after),
            "J",
        ),
    )
    return dict(zip(names, (*found, Estimate(*force, "N"), Estimate(*moment, "s")), strict=True))
