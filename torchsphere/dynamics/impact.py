"""The impact: contact, force, impulse, restitution, energies and angles, each with its standard deviation.

All quantities but the spin are those of the image plane. Before and after are the last frame before the contact and
the first frame after it, two standard deviations away from its edges. Values are those of the smoothed motion. Standard
deviations are those of motions drawn within the errors of data and calibration.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np

from torchsphere.dynamics.ball import Ball, DrawnBall, drawn_ball
from torchsphere.dynamics.ball_of_motion import ball_of_motion
from torchsphere.dynamics.budget import OF_CONTACT, budget
from torchsphere.dynamics.draws import Draws
from torchsphere.dynamics.energy_balance import energy_balance
from torchsphere.dynamics.flights import flight_frames, in_contact, is_spin_known, without_spin
from torchsphere.dynamics.friction import friction
from torchsphere.dynamics.impact_estimate import Estimate, Impact
from torchsphere.dynamics.kinematics import FoundContact, Kinematics
from torchsphere.dynamics.peak_force import peak_force, peak_frame
from torchsphere.dynamics.rebound import Rebound, direction, dot, norm, rebound, slip, surface_angle, tangential
from torchsphere.dynamics.refusals import Meeting, why_no_contact, why_no_impact
from torchsphere.estimation.spread import sd_of_errors
from torchsphere.runtime.arrays import Array
from torchsphere.settings.limits import as_float

Quantity = Callable[[Rebound], Array]

#: Least duration of a contact whose force is resolved, frames (docs/constants.toml).
MIN_RESOLVED_FRAMES = 2.5

#: Fewest measured frames in the contact for its force and its edges, if frames are missing (docs/constants.toml).
MIN_SEEN_FRAMES = 3

#: Standard deviation of an edge of a shorter contact, frames (docs/constants.toml).
SHORT_CONTACT_SD = 0.5

_STRUCK_FROM_BEHIND = (
    "The ball was struck from behind, as by a target that moves after an earlier impact, so there is no restitution."
)
_NO_NORMAL = (
    "The target's normal was not given. The direction of the change of velocity is taken for it, so no tangential "
    "change and no coefficient of friction are stated."
)
_NO_BALL = "The ball's mass and diameter were not given, so there are no forces and energies."
_NO_SPIN = (
    "The spin was not measured, or its change in the contact cannot be told from one in flight, so neither its energy "
    "nor the energy given to the target is known."
)

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
    motion: Kinematics | None,
    ball: Ball | None = None,
    *,
    normal_deg: float | None = None,
    shell_m: float | None = None,
    inertia_kg_m2: float | None = None,
    log: bool = True,
    **options: float | None,
) -> tuple[Impact | None, str]:
    """The strongest impact of a recording, or None and the reason in one sentence; `impacts` gives all.

    Parameters
    ----------
    motion : Kinematics or None
        None if frame rate or scale are not known: then no impact can be stated.
    ball : Ball, optional
        By default a solid ball of the motion's mass and diameter. Where the motion has no mass, there are no forces,
        impulses and energies. A ball whose mass or diameter is another than the motion's is a warning.
    normal_deg : float, optional
        Direction of the target's normal, from target to ball, as an angle from the x axis towards the y axis of the
        results' frame. By default the direction of the change of velocity is taken.
    shell_m, inertia_kg_m2 : float, optional
        As for `torchsphere.ball`, where the ball is that of the motion.
    log : bool
        Hand each of `Impact.warnings` to the logger ``torchsphere``, too, at the level WARNING.
    **options : float
        ``shell_mm``, the name of the command line for `shell_m`.

    Raises
    ------
    ValueError
        If the normal is not finite, the motion is no `Kinematics`, or a shell or an inertia fits no ball.
    """
    ball, notes = ball_of_motion(motion, ball, shell_m, inertia_kg_m2, options, log=log)
    found, reason = _of_strongest_contact(motion, ball, normal_deg)
    if motion is None or len(motion.contacts) < 2:
        return found and replace(found, warnings=notes, motion=motion), reason
    # Another contact may be an impact where the one with the largest acceleration is none.
    every = _of_all_contacts(motion, ball, normal_deg)
    if not every:
        return None, reason
    found = found or max(every, key=lambda one: float(norm(one.velocity_after.value - one.velocity_before.value)))
    return replace(found, count=len(every), warnings=notes, motion=motion), ""


def impacts(
    motion: Kinematics | None,
    ball: Ball | None = None,
    *,
    normal_deg: float | None = None,
    shell_m: float | None = None,
    inertia_kg_m2: float | None = None,
    log: bool = True,
    **options: float | None,
) -> list[Impact]:
    """All impacts of a recording in the order of their times; arguments and errors as `impact`.

    After the first one, a target that moves may strike the ball from behind: such an impact has no restitution.
    """
    ball, notes = ball_of_motion(motion, ball, shell_m, inertia_kg_m2, options, log=log)
    if motion is None or not getattr(motion, "contacts", ()):
        found, _ = _of_strongest_contact(motion, ball, normal_deg)
        found_all = [found] if found is not None else []
    else:
        found_all = _of_all_contacts(motion, ball, normal_deg)
    return [replace(found, warnings=notes, motion=motion) for found in found_all]


def _of_all_contacts(motion: Kinematics, ball: Ball | None, normal_deg: float | None) -> list[Impact]:
    """The impacts among the contacts, in the order of their times."""
    found_all: list[Impact] = []
    for contact in motion.contacts:
        one = replace(motion, **vars(contact))
        found, _ = _of_strongest_contact(one, ball, normal_deg, may_drive_on=bool(found_all))
        found_all += [] if found is None else [found]
    return [replace(found, count=len(found_all)) for found in found_all]


def _of_strongest_contact(
    motion: Kinematics | None, ball: Ball | None, normal_deg: float | None, *, may_drive_on: bool = False
) -> tuple[Impact | None, str]:
    """Impact at the strongest contact, or None and the reason."""
    if normal_deg is not None and not math.isfinite(as_float(normal_deg)):
        raise ValueError(f"normal_deg = {normal_deg!r}: expected a finite angle in degrees")
    if motion is None:
        return None, "Frame rate or scale are not known, so no impact can be stated; give both."
    given: Any = motion
    if not isinstance(given, Kinematics):
        raise ValueError(f"motion: expected what torchsphere.kinematics returns, got {type(given).__name__}")
    reason = why_no_contact(motion)
    if reason or motion.contact_s is None or motion.sd_contact_s is None or motion.draws is None:
        return None, reason
    contact = FoundContact(motion.contact_s, motion.sd_contact_s, motion.draws)
    frames = flight_frames(motion, contact)
    if isinstance(frames, str):
        return None, frames
    draws, spin = contact.draws, motion.spin_rad_s[frames]
    if not is_spin_known(motion, contact):
        draws, spin = without_spin(motion, draws), np.full_like(spin, np.nan)
    part = draws.at([frame - draws.span.start for frame in frames])
    smoothed = rebound(motion.velocity_m_s[frames], spin, contact.contact_s, normal_deg)
    meeting = Meeting(smoothed, part, normal_deg, may_drive_on)
    reason = why_no_impact(meeting)
    return (None, reason) if reason else (_stated(motion, draws, meeting, frames, ball), "")


def _stated(motion: Kinematics, draws: Draws, meeting: Meeting, frames: list[int], ball: Ball | None) -> Impact:
    """The impact between the two ``frames`` of flight."""
    smoothed, part, normal_deg = meeting.smoothed, meeting.part, meeting.normal_deg
    estimates = _estimates(smoothed, part, ball, normal_deg)
    drawn_frames = [frame - draws.span.start for frame in frames]
    direction_of_force = None
    if ball is not None:
        frame, direction_of_force = peak_frame(motion, draws)
        estimates["peak_force"], estimates["peak_time"] = peak_force(motion, draws, ball, (frame, direction_of_force))
        drawn, its_ball = _drawn(part, ball, normal_deg)
        balls = its_ball or ball
        estimates["energy_balance"] = energy_balance(smoothed, drawn, ball, balls)
        if normal_deg is not None:
            estimates["friction"] = friction(smoothed, drawn, ball.radius_m, balls.radius_m)
        drawn_frames.append(frame)
    results = partial(_drawn_results, ball=ball, normal_deg=normal_deg, direction_of_force=direction_of_force)
    shares = budget(results, draws, drawn_frames)
    missing = _missing(smoothed, ball, has_normal=normal_deg is not None)
    found = Impact(**estimates, ball=ball, missing=missing, budget=shares)
    return _without_unresolved_force(_without_restitution(found) if meeting.is_driven_on else found, motion)


def _drawn_results(
    part: Draws, ball: Ball | None, normal_deg: float | None, direction_of_force: Array | None
) -> dict[str, Array]:
    """Results (s,) or (s, k) of drawn motions in the frames before and after the contact and that of the peak force."""
    drawn, its_ball = _drawn(part, ball, normal_deg)
    quantities = _quantities(its_ball, has_normal=normal_deg is not None)
    results = {name: quantity(drawn) for name, (quantity, _) in quantities.items()}
    if its_ball is not None and direction_of_force is not None:
        results["peak_force"] = its_ball.mass_kg * (part.acceleration_m_s2[:, 2] @ direction_of_force)
    return results


def _drawn(part: Draws, ball: Ball | None, normal_deg: float | None) -> tuple[Rebound, DrawnBall | None]:
    """Motions of which the first frame is before the contact and the second after it, and the ball of each."""
    drawn = rebound(part.velocity_m_s[:, :2], part.spin_rad_s[:, :2], part.contact_s, normal_deg)
    return drawn, None if ball is None else drawn_ball(ball, part.inputs.mass, part.inputs.length)


def _quantities(ball: Ball | DrawnBall | None, *, has_normal: bool) -> dict[str, tuple[Quantity, str]]:
    """Quantities that follow from the motion before and after, with their units, by their names in `Impact`."""
    quantities = _QUANTITIES | ({} if ball is None else _ball_quantities(ball))
    return {name: quantity for name, quantity in quantities.items() if has_normal or name not in _NEED_NORMAL}


def _estimates(smoothed: Rebound, part: Draws, ball: Ball | None, normal_deg: float | None) -> dict[str, Any]:
    """Estimates of `_quantities` and directions; ``part`` has the frames before and after the contact."""
    drawn, its_ball = _drawn(part, ball, normal_deg)
    of_drawn = _quantities(its_ball, has_normal=normal_deg is not None)

    def estimate(quantity: Quantity, unit: str, drawn_values: Array, *, is_direction: bool = False) -> Estimate:
        value = np.asarray(quantity(smoothed))
        error = drawn_values - value
        if is_direction:
            error = (error + 180) % 360 - 180
        return Estimate(value, sd_of_errors(error), unit)

    quantities = _quantities(ball, has_normal=normal_deg is not None)
    estimates = {name: estimate(of, unit, of_drawn[name][0](drawn)) for name, (of, unit) in quantities.items()}
    return estimates | {name: estimate(of, "deg", of(drawn), is_direction=True) for name, of in _DIRECTIONS.items()}


def _ball_quantities(ball: Ball | DrawnBall) -> dict[str, tuple[Quantity, str]]:
    """Quantities that need the ball's mass or radius."""
    mass, radius, inertia = ball.mass_kg, ball.radius_m, ball.inertia_kg_m2

    def energy(velocity: Array) -> Array:
        return np.asarray(0.5 * mass * (velocity**2).sum(-1))

    def spin_energy(spin: Array) -> Array:
        return np.asarray(0.5 * inertia * (spin**2).sum(-1))

    def impulse(r: Rebound) -> Array:
        return np.asarray(mass * norm(r.velocity_after - r.velocity_before))

    def tangential_restitution(r: Rebound) -> Array:
        before = slip(r.velocity_before, r.spin_before, r.normal, radius)
        return -slip(r.velocity_after, r.spin_after, r.normal, radius) / before

    def energy_given(r: Rebound) -> Array:
        before = energy(r.velocity_before) + spin_energy(r.spin_before)
        return before - energy(r.velocity_after) - spin_energy(r.spin_after)

    return {
        "impulse": (lambda r: np.asarray(mass)[..., None] * (r.velocity_after - r.velocity_before), "N s"),
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


def contact_frames(impact: Impact, time_s: Array) -> float:
    """Frames that the contact lasts."""
    return float(impact.duration.value) / float(np.diff(time_s).min())


def is_seen(impact: Impact, motion: Kinematics) -> bool:
    """Whether enough frames were measured in the contact for its force and its edges."""
    if motion.is_measured is None:
        return True
    inside = in_contact(motion.time_s, impact.contact_start.value, impact.contact_end.value)
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
        budget={name: shares for name, shares in impact.budget.items() if name not in OF_CONTACT},
    )


def _without_restitution(impact: Impact) -> Impact:
    """The impact of a target that strikes the ball from behind: it throws nothing back."""
    names = ("restitution_normal", "restitution_tangential")
    return replace(
        impact,
        restitution_normal=replace(impact.restitution_normal, value=np.asarray(np.nan), sd=np.asarray(np.nan)),
        restitution_tangential=_unknown(impact.restitution_tangential),
        budget={name: shares for name, shares in impact.budget.items() if name not in names},
        missing=(*impact.missing, _STRUCK_FROM_BEHIND),
    )


def _widened(estimate: Estimate, sd: float) -> Estimate:
    return replace(estimate, sd=np.hypot(estimate.sd, sd))


def _unknown(estimate: Estimate | None) -> Estimate | None:
    return estimate and replace(estimate, value=np.asarray(np.nan), sd=np.asarray(np.nan))
