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

from torchsphere.kinematics import Draws, Kinematics

Array = NDArray[np.float64]

#: Share of a normal distribution within a standard deviation.
ONE_SD = 0.6827

#: Standard deviations by which the velocity has to change, in one component at least.
CHANGED = 2.0

#: Standard deviations of an edge of the contact beyond which a frame counts as one of the flight.
CLEAR = 2.0


@dataclass(frozen=True)
class Ball:
    """Mass (kg), radius (m) and moment of inertia (kg m^2) of a ball, and what it is in words."""

    mass_kg: float
    radius_m: float
    inertia_kg_m2: float
    kind: str


def ball(
    mass_kg: float,
    diameter_m: float,
    *,
    shell_m: float | None = None,
    inertia_kg_m2: float | None = None,
) -> Ball:
    """A solid ball, a hollow one with a shell of thickness ``shell_m``, or one of given inertia.

    Raises
    ------
    ValueError
        If a number is not finite and positive, the shell is thicker than the radius, or shell and inertia are given.

    Notes
    -----
    ``2/5 m R^2``, and ``2/5 m (R^5 - r^5) / (R^3 - r^3)`` for a shell between the radii r and R.
    """
    given = {"mass_kg": mass_kg, "diameter_m": diameter_m, "shell_m": shell_m, "inertia_kg_m2": inertia_kg_m2}
    for name, value in given.items():
        if value is not None and not (math.isfinite(value) and value > 0):
            raise ValueError(f"{name} = {value!r}: expected a finite, positive number")
    if shell_m is not None and inertia_kg_m2 is not None:
        raise ValueError(
            "ball: shell_m and inertia_kg_m2 were both given; the inertia needs one of them, leave one out"
        )
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


@dataclass(frozen=True)
class _State:
    """Motion before and after, and edges, of one motion (...) or of many drawn ones (s, ...)."""

    before: Array  # (..., 2)
    after: Array
    spin_before: Array  # (..., 3)
    spin_after: Array
    edges: Array
    normal: Array  # (..., 2), unit vectors


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
        return None, "No contact was found: one steady motion explains all frames as well."
    margin = CLEAR * motion.sd_contact_s
    known = np.zeros(len(motion.time_s), dtype=bool)
    known[motion.draws.span] = np.isfinite(motion.velocity_m_s[motion.draws.span]).all(1)
    earlier = np.flatnonzero(known & (motion.time_s <= motion.contact_s[0] - margin[0]))
    later = np.flatnonzero(known & (motion.time_s >= motion.contact_s[1] + margin[1]))
    if len(earlier) == 0 or len(later) == 0:
        when = "before" if len(earlier) == 0 else "after"
        return (
            None,
            f"The contact reaches the {'start' if when == 'before' else 'end'}: no flight {when} it was measured.",
        )
    edges = [int(earlier[-1]), int(later[0])]
    central = _state(motion.velocity_m_s[edges], motion.spin_rad_s[edges], motion.contact_s, normal_deg)
    if float((central.before * central.normal).sum()) >= 0:
        return None, _DRIVEN_ON if normal_deg is None else _NORMAL_AWAY.format(normal_deg)
    if not _is_changed(motion.draws, edges):
        return None, _NO_CHANGE
    return _assembled(central, motion, motion.draws, edges, thing, normal_deg), ""


def _is_changed(draws: Draws, edges: list[int]) -> bool:
    """Whether the velocity after the contact differs from that before by more than their uncertainty."""
    before, after = (draws.velocity_m_s[:, edge - draws.span.start] for edge in edges)
    change = after - before
    return bool((np.abs(change.mean(0)) > CHANGED * change.std(0)).any())


def _assembled(
    central: _State, motion: Kinematics, draws: Draws, edges: list[int], thing: Ball | None, normal_deg: float | None
) -> Impact:
    at = [edge - draws.span.start for edge in edges]
    drawn = _state(draws.velocity_m_s[:, at], draws.spin_rad_s[:, at], draws.contact_s, normal_deg)
    missing = []

    def estimate(function: Callable[[_State], Array], unit: str, turns: bool = False) -> Estimate:
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
    return Impact(
        contact_start=estimate(lambda s: s.edges[..., 0], "s"),
        contact_end=estimate(lambda s: s.edges[..., 1], "s"),
        duration=estimate(lambda s: s.edges[..., 1] - s.edges[..., 0], "s"),
        velocity_before=estimate(lambda s: s.before, "m/s"),
        velocity_after=estimate(lambda s: s.after, "m/s"),
        speed_before=estimate(lambda s: _length(s.before), "m/s"),
        speed_after=estimate(lambda s: _length(s.after), "m/s"),
        direction_before=estimate(lambda s: _angle(s.before), "deg", True),
        direction_after=estimate(lambda s: _angle(s.after), "deg", True),
        normal_direction=estimate(lambda s: _angle(s.normal), "deg", True),
        angle_of_impact=estimate(lambda s: _to_surface(-s.before, s.normal), "deg"),
        angle_of_exit=estimate(lambda s: _to_surface(s.after, s.normal), "deg"),
        restitution_normal=estimate(lambda s: -_dot(s.after, s.normal) / _dot(s.before, s.normal), "1"),
        restitution_tangential=None
        if normal_deg is None or radius is None
        else estimate(lambda s: -_slip(s, radius, after=True) / _slip(s, radius, after=False), "1"),
        tangential_velocity_ratio=None
        if normal_deg is None
        else estimate(lambda s: _dot(s.after, _along(s.normal)) / _dot(s.before, _along(s.normal)), "1"),
        spin_before=estimate(lambda s: s.spin_before / (2 * np.pi), "rev/s"),
        spin_after=estimate(lambda s: s.spin_after / (2 * np.pi), "rev/s"),
        spin_rate_before=estimate(lambda s: _length(s.spin_before) / (2 * np.pi), "rev/s"),
        spin_rate_after=estimate(lambda s: _length(s.spin_after) / (2 * np.pi), "rev/s"),
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

    def energies(velocity: Array, spin: Array) -> Array:
        return 0.5 * (mass * (velocity**2).sum(-1) + inertia * (spin**2).sum(-1))

    peak = _peak(motion, draws, mass)
    found = (
        estimate(lambda s: mass * (s.after - s.before), "N s"),
        estimate(lambda s: mass * _length(s.after - s.before), "N s"),
        estimate(lambda s: mass * _length(s.after - s.before) / (s.edges[..., 1] - s.edges[..., 0]), "N"),
        estimate(lambda s: energies(s.before, 0 * s.spin_before), "J"),
        estimate(lambda s: energies(s.after, 0 * s.spin_after), "J"),
        estimate(lambda s: energies(0 * s.before, s.spin_before), "J"),
        estimate(lambda s: energies(0 * s.after, s.spin_after), "J"),
        estimate(lambda s: energies(s.before, s.spin_before) - energies(s.after, s.spin_after), "J"),
    )
    return dict(zip(names, (*found, *peak), strict=True))


def _peak(motion: Kinematics, draws: Draws, mass: float) -> tuple[Estimate, Estimate]:
    """Largest force and its time, between the frames by a parabola through three of them.

    A largest value moves with its frame's error alone, to first order; the largest of each drawn motion would also be
    larger, by what noise adds to any largest value.
    """
    assert motion.contact_s is not None
    start, end = motion.contact_s
    time_s, acceleration = motion.time_s[draws.span], motion.acceleration_m_s2[draws.span]
    size = mass * np.where(np.isfinite(acceleration).all(1), _length(acceleration), -np.inf)
    outside = (time_s < start) | (time_s > end)
    inside = size if outside.all() else np.where(outside, -np.inf, size)
    at = int(inside.argmax())
    direction = acceleration[at] / _length(acceleration[at])
    drawn = mass * draws.acceleration_m_s2 @ direction
    value, moment = float(size[at]), float(time_s[at])
    if 0 < at < len(size) - 1 and np.isfinite(size[[at - 1, at + 1]]).all():
        near = slice(at - 1, at + 2)
        own, top = _vertex(time_s[near], size[near])
        value, moment = max(value, float(top)), float(own)
    # Between the frames as well: all motions may have their largest value in the same one.
    places = np.where(outside, -np.inf, drawn).argmax(1).clip(1, len(size) - 2)
    around = places[:, None] + np.arange(-1, 2)
    moments, _ = _vertex(time_s[around], np.take_along_axis(drawn, around, 1))
    spread, sd_moment = float(np.std(drawn[:, at])), float(np.nanstd(moments))
    return (
        Estimate(np.asarray(value), np.asarray(spread), "N"),
        Estimate(np.asarray(moment), np.asarray(sd_moment), "s"),
    )


def _vertex(time: Array, value: Array) -> tuple[Array, Array]:
    """Time and value at the top of parabolas through three points (..., 3): the highest point where there is no top."""
    slopes = np.diff(value) / np.diff(time)
    bend = (slopes[..., 1] - slopes[..., 0]) / (time[..., 2] - time[..., 0])
    highest = value.argmax(-1)[..., None]
    with np.errstate(divide="ignore", invalid="ignore"):
        top = 0.5 * (time[..., 0] + time[..., 1]) - 0.5 * slopes[..., 0] / bend
    is_top = (bend < 0) & (top > time[..., 0]) & (top < time[..., 2])
    moment = np.where(is_top, top, np.take_along_axis(time, highest, -1)[..., 0])
    off = moment - time[..., 0]
    return moment, value[..., 0] + slopes[..., 0] * off + bend * off * (moment - time[..., 1])


def _state(velocity: Array, spin: Array, edges: Array, normal_deg: float | None) -> _State:
    """From velocities (..., 2, 2) and spins (..., 2, 3) before and after."""
    before, after = velocity[..., 0, :], velocity[..., 1, :]
    if normal_deg is None:
        change = after - before
        normal = change / _length(change)[..., None]
    else:
        angle = np.radians(normal_deg)
        normal = np.broadcast_to(np.array([np.cos(angle), np.sin(angle)]), before.shape)
    return _State(before, after, spin[..., 0, :], spin[..., 1, :], edges, normal)


def _slip(state: _State, radius: float, *, after: bool) -> Array:
    """Tangential velocity of the point of contact, which lies at ``-radius`` times the normal."""
    velocity, spin = (state.after, state.spin_after) if after else (state.before, state.spin_before)
    return _dot(velocity, _along(state.normal)) - radius * spin[..., 2]


def _along(normal: Array) -> Array:
    """Unit vector along the surface: z x n, in either right-handed frame."""
    return np.stack((-normal[..., 1], normal[..., 0]), -1)


def _to_surface(velocity: Array, normal: Array) -> Array:
    """Angle between a velocity away from the surface and the surface, deg."""
    return np.degrees(np.arcsin(np.clip(_dot(velocity, normal) / _length(velocity), -1, 1)))


def _dot(a: Array, b: Array) -> Array:
    return np.asarray((a * b).sum(-1))


def _length(values: Array) -> Array:
    return np.asarray(np.linalg.norm(values, axis=-1))


def _angle(values: Array) -> Array:
    return np.asarray(np.degrees(np.arctan2(values[..., 1], values[..., 0])))
