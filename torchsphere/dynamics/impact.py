"""The impact: contact, force, impulse, restitution, energies and angles, each with its standard deviation.

All quantities but the spin are those of the image plane. Before and after are the last frame before the contact and
the first frame after it, two standard deviations away from its edges. Values are those of the smoothed motion. Standard
deviations are those of motions drawn within the errors of data and calibration.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from torchsphere.dynamics.ball import Ball
from torchsphere.dynamics.impact_estimate import Estimate, Impact
from torchsphere.dynamics.kinematics import Draws, Kinematics
from torchsphere.dynamics.rebound import (
    Rebound,
    direction,
    dot,
    flight_frames,
    is_accelerated,
    is_velocity_changed,
    norm,
    rebound,
    slip,
    surface_angle,
    tangential,
)
from torchsphere.settings.limits import as_float

Array = NDArray[np.float64]
Quantity = Callable[[Rebound], Array]

#: Share of a normal distribution within a standard deviation.
ONE_SD = 0.6827

#: Least duration of a contact whose force is resolved, frames (docs/constants.md).
MIN_RESOLVED_FRAMES = 2.5

#: Fewest measured frames in the contact for its force and its edges, if frames are missing (docs/constants.md).
MIN_SEEN_FRAMES = 3

#: Standard deviation of an edge of a shorter contact, frames (docs/constants.md).
SHORT_CONTACT_SD = 0.5

_NO_CONTACT = "No contact was found: one steady motion explains all frames as well."
_ACCELERATED = (
    "No contact was found: one steady acceleration explains all frames as well, as by gravity or drag, or if all "
    "frames lie within the contact."
)
_DRIVEN_ON = (
    "In the contact that was found the ball is driven on the way it flies, not thrown back: no target at rest does so."
)
_IN_PLACE = "The ball stays in its place, so no contact was sought."
_NO_CHANGE = (
    "The velocity after the contact that was found is that before it: this is no impact, but perhaps a few wrong or "
    "missing frames."
)
_NORMAL_AWAY = (
    "The target's normal was given as {:g} deg, which is the way that the ball flies; "
    "give the direction from target to ball."
)
_NO_NORMAL = (
    "The target's normal was not given. The direction of the change of velocity is taken for it, so no tangential "
    "change is stated."
)
_NO_BALL = "The ball's mass and diameter were not given, so there are no forces and energies."
_NO_SPIN = "The spin was not measured, so neither its energy nor the energy given to the target is known."

_QUANTITIES: dict[str, tuple[Quantity, str]] = {
    "contact_start": (lambda r: r.contact_s[..., 0], "s"),
    "contact_end": (lambda r: r.contact_s[..., 1], "s"),
    "duration": (lambda r: r.duration_s, "s"),
    "velocity_before": (lambda r: r.velocity_before, "m/s"),
    "velocity_after": (lambda r: r.velocity_after, "m/s"),
    "speed_before": (lambda r: norm(r.velocity_before), "m/s"),
    "speed_after": (lambda r: norm(r.velocity_after), "m/s"),
    "angle_of_impact": (lambda r: surface_angle(-r.velocity_before, r.normal), "deg"),
    "angle_of_exit": (lambda r: surface_angle(r.velocity_after, r.normal), "deg"),
    "restitution_normal": (lambda r: -dot(r.velocity_after, r.normal) / dot(r.velocity_before, r.normal), "1"),
    "tangential_velocity_ratio": (
        lambda r: tangential(r.velocity_after, r.normal) / tangential(r.velocity_before, r.normal),
        "1",
    ),
    "spin_before": (lambda r: r.spin_before / (2 * np.pi), "rev/s"),
    "spin_after": (lambda r: r.spin_after / (2 * np.pi), "rev/s"),
    "spin_rate_before": (lambda r: norm(r.spin_before) / (2 * np.pi), "rev/s"),
    "spin_rate_after": (lambda r: norm(r.spin_after) / (2 * np.pi), "rev/s"),
}

#: Quantities that need the target's normal.
_NEED_NORMAL = ("restitution_tangential", "tangential_velocity_ratio")

#: Angles that begin again at 360 deg.
_DIRECTIONS: dict[str, Quantity] = {
    "direction_before": lambda r: direction(r.velocity_before),
    "direction_after": lambda r: direction(r.velocity_after),
    "normal_direction": lambda r: direction(r.normal),
}


def impact(
    motion: Kinematics | None, ball: Ball | None = None, *, normal_deg: float | None = None
) -> tuple[Impact | None, str]:
    """The strongest impact of a recording, or None and the reason in one sentence; `impacts` gives all.

    Parameters
    ----------
    motion : Kinematics or None
        None if frame rate or scale are not known: then no impact can be stated.
    ball : Ball, optional
        Without it there are no forces, impulses and energies.
    normal_deg : float, optional
        Direction of the target's normal, from target to ball, as an angle from the x axis towards the y axis of the
        results' frame. By default the direction of the change of velocity is taken.

    Raises
    ------
    ValueError
        If the normal is not finite, or the motion is no `Kinematics`.
    """
    found, reason = _of_strongest_contact(motion, ball, normal_deg)
    if motion is None or len(motion.contacts) < 2:
        return found, reason
    # Another contact may be an impact where the one with the largest acceleration is none.
    every = impacts(motion, ball, normal_deg=normal_deg)
    if not every:
        return None, reason
    found = found or max(every, key=lambda one: float(norm(one.velocity_after.value - one.velocity_before.value)))
    return replace(found, count=len(every)), ""


def impacts(motion: Kinematics | None, ball: Ball | None = None, *, normal_deg: float | None = None) -> list[Impact]:
    """All impacts of a recording in the order of their times; arguments and errors as `impact`."""
    if motion is None or not getattr(motion, "contacts", ()):
        found, _ = _of_strongest_contact(motion, ball, normal_deg)
        return [found] if found is not None else []
    each = [_of_strongest_contact(replace(motion, **vars(contact)), ball, normal_deg)[0] for contact in motion.contacts]
    found_all = [found for found in each if found is not None]
    return [replace(found, count=len(found_all)) for found in found_all]


def _of_strongest_contact(
    motion: Kinematics | None, ball: Ball | None, normal_deg: float | None
) -> tuple[Impact | None, str]:
    """Impact at the strongest contact, or None and the reason."""
    if normal_deg is not None and not math.isfinite(as_float(normal_deg)):
        raise ValueError(f"normal_deg = {normal_deg!r}: expected a finite angle in degrees")
    if motion is None:
        return None, "Frame rate or scale are not known, so no impact can be stated; give both."
    given: Any = motion
    if not isinstance(given, Kinematics):
        raise ValueError(f"motion: expected what torchsphere.kinematics returns, got {type(given).__name__}")
    if not np.isfinite(motion.velocity_m_s).any():
        return None, "No frame has a velocity: too few frames in a row were measured."
    if "contact_found" not in motion.about:
        return None, f"The method {motion.about['method']!r} finds no contact; use the smoother."
    if motion.about.get("in_place"):
        return None, _IN_PLACE
    if motion.contact_s is None or motion.sd_contact_s is None or motion.draws is None:
        return None, _ACCELERATED if is_accelerated(motion) else _NO_CONTACT
    draws = motion.draws
    frames = flight_frames(motion, motion.contact_s, motion.sd_contact_s, draws.span)
    if isinstance(frames, str):
        return None, frames
    smoothed = rebound(motion.velocity_m_s[frames], motion.spin_rad_s[frames], motion.contact_s, normal_deg)
    if float((smoothed.velocity_before * smoothed.normal).sum()) >= 0:
        return None, _DRIVEN_ON if normal_deg is None else _NORMAL_AWAY.format(normal_deg)
    if not is_velocity_changed(draws, frames):
        return None, _NO_CHANGE
    drawn_frames = [frame - draws.span.start for frame in frames]
    drawn = rebound(draws.velocity_m_s[:, drawn_frames], draws.spin_rad_s[:, drawn_frames], draws.contact_s, normal_deg)
    estimates = _estimates(smoothed, drawn, ball, has_normal=normal_deg is not None)
    if ball is not None:
        estimates["peak_force"], estimates["peak_time"] = _peak_force(motion, draws, ball.mass_kg)
    missing = _missing(smoothed, ball, has_normal=normal_deg is not None)
    return _without_unresolved_force(Impact(**estimates, ball=ball, missing=missing), motion), ""


def _estimates(smoothed: Rebound, drawn: Rebound, ball: Ball | None, *, has_normal: bool) -> dict[str, Any]:
    """Quantities that follow from the motion before and after, by their names in `Impact`."""
    quantities = _QUANTITIES | ({} if ball is None else _ball_quantities(ball))
    if not has_normal:
        quantities = {name: quantity for name, quantity in quantities.items() if name not in _NEED_NORMAL}

    def estimate(quantity: Quantity, unit: str, *, is_direction: bool = False) -> Estimate:
        value = np.asarray(quantity(smoothed))
        error = quantity(drawn) - value
        if is_direction:
            error = (error + 180) % 360 - 180
        # A quantile, since a few motions with a softer contact would dominate a root mean square.
        return Estimate(value, np.asarray(np.quantile(np.abs(error), ONE_SD, axis=0)), unit)

    estimates = {name: estimate(quantity, unit) for name, (quantity, unit) in quantities.items()}
    return estimates | {name: estimate(quantity, "deg", is_direction=True) for name, quantity in _DIRECTIONS.items()}


def _ball_quantities(ball: Ball) -> dict[str, tuple[Quantity, str]]:
    """Quantities that need the ball's mass or radius."""
    mass, radius, inertia = ball.mass_kg, ball.radius_m, ball.inertia_kg_m2

    def energy(velocity: Array) -> Array:
        return np.asarray(0.5 * mass * (velocity**2).sum(-1))

    def spin_energy(spin: Array) -> Array:
        return np.asarray(0.5 * inertia * (spin**2).sum(-1))

    def impulse(r: Rebound) -> Array:
        return mass * norm(r.velocity_after - r.velocity_before)

    def tangential_restitution(r: Rebound) -> Array:
        before = slip(r.velocity_before, r.spin_before, r.normal, radius)
        return -slip(r.velocity_after, r.spin_after, r.normal, radius) / before

    def energy_given(r: Rebound) -> Array:
        before = energy(r.velocity_before) + spin_energy(r.spin_before)
        return before - energy(r.velocity_after) - spin_energy(r.spin_after)

    return {
        "impulse": (lambda r: mass * (r.velocity_after - r.velocity_before), "N s"),
        "impulse_size": (impulse, "N s"),
        "mean_force": (lambda r: impulse(r) / r.duration_s, "N"),
        "energy_before": (lambda r: energy(r.velocity_before), "J"),
        "energy_after": (lambda r: energy(r.velocity_after), "J"),
        "spin_energy_before": (lambda r: spin_energy(r.spin_before), "J"),
        "spin_energy_after": (lambda r: spin_energy(r.spin_after), "J"),
        "energy_given": (energy_given, "J"),
        "restitution_tangential": (tangential_restitution, "1"),
    }


def _missing(smoothed: Rebound, ball: Ball | None, *, has_normal: bool) -> tuple[str, ...]:
    """Sentences on the quantities that are None or NaN."""
    has_spin = bool((np.isfinite(smoothed.spin_before) & np.isfinite(smoothed.spin_after)).all())
    sentences = [] if has_normal else [_NO_NORMAL]
    if ball is None:
        sentences.append(_NO_BALL)
    elif not has_spin:
        sentences.append(_NO_SPIN)
    return tuple(sentences)


def _peak_force(motion: Kinematics, draws: Draws, mass: float) -> tuple[Estimate, Estimate]:
    """Largest force and its time, between the frames by a parabola through three frames.

    To first order the error of the largest force is that of its frame. The largest forces of the drawn motions are no
    measure of this error, because noise raises every maximum.
    """
    assert motion.contact_s is not None
    start, end = motion.contact_s
    time_s, acceleration = motion.time_s[draws.span], motion.acceleration_m_s2[draws.span]
    force = mass * np.where(np.isfinite(acceleration).all(1), norm(acceleration), -np.inf)
    outside = (time_s < start) | (time_s > end)
    frame = int((force if outside.all() else np.where(outside, -np.inf, force)).argmax())
    direction = acceleration[frame] / norm(acceleration[frame])
    drawn = mass * draws.acceleration_m_s2 @ direction
    peak, peak_time = float(force[frame]), float(time_s[frame])
    if 0 < frame < len(force) - 1 and np.isfinite(force[[frame - 1, frame + 1]]).all():
        three = slice(frame - 1, frame + 2)
        vertex_time, vertex = _vertex(time_s[three], force[three])
        peak, peak_time = max(peak, float(vertex)), float(vertex_time)
    # The parabola again, because all drawn motions may have their largest force in the same frame.
    drawn_frames = np.where(outside, -np.inf, drawn).argmax(1).clip(1, len(force) - 2)
    threes = drawn_frames[:, None] + np.arange(-1, 2)
    drawn_times, _ = _vertex(time_s[threes], np.take_along_axis(drawn, threes, 1))
    sd, sd_time = float(np.std(drawn[:, frame])), float(np.nanstd(drawn_times))
    times = Estimate(np.asarray(peak_time), np.asarray(sd_time), "s")
    return Estimate(np.asarray(peak), np.asarray(sd), "N"), times


def _vertex(time: Array, value: Array) -> tuple[Array, Array]:
    """Time and value of the vertex of parabolas through three points (..., 3), or of the highest point if outside."""
    slopes = np.diff(value) / np.diff(time)
    curvature = (slopes[..., 1] - slopes[..., 0]) / (time[..., 2] - time[..., 0])
    highest = value.argmax(-1)[..., None]
    with np.errstate(divide="ignore", invalid="ignore"):
        vertex = 0.5 * (time[..., 0] + time[..., 1]) - 0.5 * slopes[..., 0] / curvature
    is_inside = (curvature < 0) & (vertex > time[..., 0]) & (vertex < time[..., 2])
    found = np.where(is_inside, vertex, np.take_along_axis(time, highest, -1)[..., 0])
    passed = found - time[..., 0]
    return found, value[..., 0] + slopes[..., 0] * passed + curvature * passed * (found - time[..., 1])


def contact_frames(impact: Impact, time_s: Array) -> float:
    """Frames that the contact lasts."""
    return float(impact.duration.value) / float(np.diff(time_s).min())


def is_seen(impact: Impact, motion: Kinematics) -> bool:
    """Whether enough frames were measured in the contact for its force and its edges."""
    if motion.is_measured is None:
        return True
    inside = (motion.time_s >= impact.contact_start.value) & (motion.time_s <= impact.contact_end.value)
    return int((inside & motion.is_measured).sum()) >= MIN_SEEN_FRAMES or not (inside & ~motion.is_measured).any()


def _unseen_s(impact: Impact, motion: Kinematics) -> float:
    """Time between the measured frames around the contact, s."""
    times = motion.time_s if motion.is_measured is None else motion.time_s[motion.is_measured]
    before, after = times[times < impact.contact_start.value], times[times > impact.contact_end.value]
    first = before[-1] if len(before) else motion.time_s[0]
    last = after[0] if len(after) else motion.time_s[-1]
    return float(last - first)


def _without_unresolved_force(impact: Impact, motion: Kinematics) -> Impact:
    """The impact without its force if the contact is too short to resolve it, or too few of its frames were measured.

    Impulse, speeds and spin remain, because they follow from the flights before and after.
    """
    if contact_frames(impact, motion.time_s) >= MIN_RESOLVED_FRAMES and is_seen(impact, motion):
        return impact
    time_s = motion.time_s
    sd_edge = SHORT_CONTACT_SD * float(np.diff(time_s).min())
    if not is_seen(impact, motion):
        # An edge may lie anywhere between the measured frames around the contact: a uniform distribution.
        sd_edge = max(sd_edge, _unseen_s(impact, motion) / math.sqrt(12))
    return replace(
        impact,
        contact_start=_widened(impact.contact_start, sd_edge),
        contact_end=_widened(impact.contact_end, sd_edge),
        duration=_widened(impact.duration, sd_edge * np.sqrt(2)),
        peak_force=_unknown(impact.peak_force),
        mean_force=_unknown(impact.mean_force),
        peak_time=impact.peak_time and _widened(impact.peak_time, sd_edge),
    )


def _widened(estimate: Estimate, sd: float) -> Estimate:
    return replace(estimate, sd=np.hypot(estimate.sd, sd))


def _unknown(estimate: Estimate | None) -> Estimate | None:
    return estimate and replace(estimate, value=np.asarray(np.nan), sd=np.asarray(np.nan))
