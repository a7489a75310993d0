"""The impact itself: contact, force, impulse, restitution, energies and angles, each with its standard deviation.

All quantities but the spin are those of the image plane. Before and after are the last frame before the contact
and the first one after it, by two standard deviations of its edges. Their standard deviations are those of motions
drawn from all that data and calibration leave possible; their values are those of the smoothed motion.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from torchsphere.dynamics.ball import Ball
from torchsphere.dynamics.impact_estimate import Estimate, Impact
from torchsphere.dynamics.kinematics import Draws, Kinematics
from torchsphere.dynamics.peak_force import as_far_as_seen, peak
from torchsphere.dynamics.rebound import (
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
from torchsphere.settings.limits import number

Array = NDArray[np.float64]

#: Share of a normal distribution within a standard deviation.
ONE_SD = 0.6827


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
        If the normal is not finite, or the motion is no `Kinematics`.
    """
    if normal_deg is not None and not math.isfinite(number(normal_deg)):
        raise ValueError(f"normal_deg = {normal_deg!r}: expected a finite angle in degrees")
    if motion is None:
        return None, "Frame rate or scale are not known, so no impact can be stated; give both."
    given: Any = motion
    if not isinstance(given, Kinematics):
        raise ValueError(f"motion: expected what torchsphere.kinematics returns, got {type(given).__name__}")
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
    found = _assembled(central, motion, motion.draws, edges, thing, normal_deg)
    return as_far_as_seen(found, motion.time_s), ""


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
