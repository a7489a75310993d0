"""Force against penetration of an impact: loading and unloading, and the energy that the loop between them encloses.

The penetration is the way of the ball's centre towards the target since first touch. It holds the deformations of ball
and target together, and the way that the target gives.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from torchsphere.dynamics.estimate import Estimate, estimated
from torchsphere.dynamics.flights import flight_frames, in_contact
from torchsphere.dynamics.impact_estimate import Impact
from torchsphere.dynamics.kinematics import FoundContact, Kinematics
from torchsphere.dynamics.rebound import dot, rebound
from torchsphere.runtime.arrays import Array

#: Fewest frames in the contact whose forces make a path (docs/constants.toml).
MIN_FRAMES = 3

#: Frames of flight on each side of the contact for drawn motions whose contact begins earlier (docs/constants.toml).
FLIGHT_FRAMES = 3


@dataclass(frozen=True)
class ForcePath:
    """Normal force and penetration in the frames of a contact.

    Attributes
    ----------
    row : ndarray
        (m,), rows of the motion.
    time_s : ndarray
        (m,).
    penetration, force : Estimate
        (m,), m and N; the penetration is positive towards the target, the force positive away from the target. An error
        of the start of the contact moves all penetrations by the same length.
    is_loading : ndarray
        (m,), bool, True while the ball still moves towards the target.
    largest_penetration : Estimate
        m, at the turning point, between the frames.
    energy_lost : Estimate
        J: loss of kinetic energy along the normal, which is the area that the path encloses.
    drawn_penetration_m, drawn_force_N : ndarray
        (s, m), of motions drawn within the errors of data and calibration.
    way_per_frame_m : float
        Way of the ball towards the target in a frame before the contact.
    """

    row: NDArray[np.int64]
    time_s: Array
    penetration: Estimate
    force: Estimate
    is_loading: NDArray[np.bool_]
    largest_penetration: Estimate
    energy_lost: Estimate
    drawn_penetration_m: Array
    drawn_force_N: Array  # noqa: N815  (N is newton)
    way_per_frame_m: float


@dataclass(frozen=True)
class _Course:
    """Motion along the normal, positive towards the target, of one motion (m,) or of many drawn ones (s, m)."""

    time_s: Array  # (m,)
    way_m: Array  # from the first frame
    velocity_m_s: Array
    acceleration_m_s2: Array


def force_path(motion: Kinematics, impact: Impact, *, normal_deg: float | None = None) -> tuple[ForcePath | None, str]:
    """Force against penetration of an impact, or None and the reason in one sentence.

    Parameters
    ----------
    motion : Kinematics
        Of the smoother, with a mass.
    impact : Impact
        One of ``impacts(motion, ball, normal_deg=...)``.
    normal_deg : float, optional
        As for that impact: the target's normal, from target to ball. By default the change of velocity gives it.

    Notes
    -----
    The penetration is the integral of the smoothed velocity from the start of the contact, by Hermite's rule
    ``h (v0 + v1) / 2 + h^2 (a0 - a1) / 12`` between two frames, and the force is mass times acceleration. Each drawn
    motion is integrated from the start of its own contact. The work of the force along the path is the change of the
    kinetic energy along the normal, so that the enclosed area is ``m (v_before^2 - v_after^2) / 2``.
    """
    found = _contact(motion, impact)
    if found is None or motion.mass_kg is None or impact.peak_force is None:
        return None, "Without the ball's mass there is no force, and so no force against penetration."
    if not np.isfinite(impact.peak_force.value):
        return None, "The contact is too short or has too few measured frames for a force against penetration."
    draws = found.draws
    frames = flight_frames(motion, found)
    if isinstance(frames, str):
        return None, frames
    inside = np.flatnonzero(in_contact(motion.time_s, *found.contact_s))
    first = max(frames[0] - FLIGHT_FRAMES, draws.span.start)
    last = min(frames[1] + FLIGHT_FRAMES, draws.span.stop - 1, len(motion.time_s) - 1)
    if len(inside) < MIN_FRAMES or not np.isfinite(motion.acceleration_m_s2[first : last + 1]).all():
        return None, f"Fewer than {MIN_FRAMES} frames in the contact have a force, so no force against penetration."
    rows, drawn_rows = slice(first, last + 1), slice(first - draws.span.start, last + 1 - draws.span.start)
    edges, drawn_edges = np.array(frames) - first, np.array(frames) - draws.span.start
    own = rebound(motion.velocity_m_s[frames], motion.spin_rad_s[frames], found.contact_s, normal_deg)
    drawn = rebound(draws.velocity_m_s[:, drawn_edges], draws.spin_rad_s[:, drawn_edges], draws.contact_s, normal_deg)
    time = motion.time_s[rows]
    course = _course(time, motion.velocity_m_s[rows], motion.acceleration_m_s2[rows], own.normal)
    courses = _course(
        time, draws.velocity_m_s[:, drawn_rows], draws.acceleration_m_s2[:, drawn_rows], drawn.normal[:, None]
    )
    return _path(course, courses, found, inside - first, edges, _masses(motion, found), first), ""


def _contact(motion: Kinematics, impact: Impact) -> FoundContact | None:
    """The contact of the motion at which the impact was found: that with the nearest start."""
    start = float(impact.contact_start.value)
    return min(motion.contacts, key=lambda contact: abs(float(contact.contact_s[0]) - start), default=None)


def _masses(motion: Kinematics, found: FoundContact) -> tuple[float, Array]:
    """The mass, kg, and those (s,) of the drawn motions."""
    assert motion.mass_kg is not None
    return motion.mass_kg, motion.mass_kg * (1 + motion.relative_sd_mass * found.draws.inputs.mass)


def _path(
    course: _Course,
    courses: _Course,
    found: FoundContact,
    inside: NDArray[np.int64],
    edges: NDArray[np.int64],
    masses: tuple[float, Array],
    first: int,
) -> ForcePath:
    """The path of frames ``inside``; ``edges`` are the frames of flight before and after, all from row ``first``."""
    mass, drawn_mass = masses
    speed = float(course.velocity_m_s[edges[0]])
    depth = course.way_m - _way_at(course, found.contact_s[0])
    depths = courses.way_m - _way_at(courses, found.draws.contact_s[:, :1])
    forces = -drawn_mass[:, None] * courses.acceleration_m_s2
    energy = _energy_lost(course.velocity_m_s[edges], mass)
    energies = _energy_lost(courses.velocity_m_s[:, edges], drawn_mass)
    largest, largest_drawn = _largest(course, depth), _largest(courses, depths)
    return ForcePath(
        row=inside + first,
        time_s=course.time_s[inside],
        penetration=estimated(depth[inside], depths[:, inside], "m"),
        force=estimated(-mass * course.acceleration_m_s2[inside], forces[:, inside], "N"),
        is_loading=course.velocity_m_s[inside] > 0,
        largest_penetration=estimated(largest, largest_drawn, "m"),
        energy_lost=estimated(energy, energies, "J"),
        drawn_penetration_m=depths[:, inside],
        drawn_force_N=forces[:, inside],
        way_per_frame_m=speed * float(np.diff(course.time_s).min()),
    )


def _course(time_s: Array, velocity: Array, acceleration: Array, normal: Array) -> _Course:
    """From velocities and accelerations (..., m, 2) and the normal (..., 2) from target to ball."""
    v, a = -dot(velocity, normal), -dot(acceleration, normal)
    h = np.diff(time_s)
    steps = h * (v[..., 1:] + v[..., :-1]) / 2 + h**2 * (a[..., :-1] - a[..., 1:]) / 12
    start = np.zeros((*v.shape[:-1], 1))
    return _Course(time_s, np.concatenate((start, steps.cumsum(-1)), -1), v, a)


def _way_at(course: _Course, moment_s: Array) -> Array:
    """The way at a moment () or at moments (s, 1): the cubic between two frames with their ways and velocities."""
    time, moment = course.time_s, np.asarray(moment_s)
    k = np.searchsorted(time, moment).clip(1, len(time) - 1)
    h = time[k] - time[k - 1]
    u = (moment - time[k - 1]) / h

    def at(values: Array, index: NDArray[np.int64]) -> Array:
        return values[index] if values.ndim == 1 else np.take_along_axis(values, index, 1)

    x0, x1 = at(course.way_m, k - 1), at(course.way_m, k)
    v0, v1 = at(course.velocity_m_s, k - 1), at(course.velocity_m_s, k)
    way = x0 * (1 + 2 * u) * (1 - u) ** 2 + x1 * u**2 * (3 - 2 * u) + h * u * (1 - u) * (v0 * (1 - u) - v1 * u)
    return np.asarray(way)


def _largest(course: _Course, depth: Array) -> Array:
    """Depth (...) at the turning point: of the deepest frame, and the way on from there to rest.

    With velocity v and deceleration a in that frame the turning point lies ``v^2 / (2 a)`` deeper.
    """
    frame = depth.argmax(-1)[..., None]
    courses = depth, course.velocity_m_s, course.acceleration_m_s2
    there, v, a = (np.take_along_axis(each, frame, -1)[..., 0] for each in courses)
    return np.asarray(np.where(a < 0, there - v**2 / (2 * np.where(a < 0, a, -1.0)), there))


def _energy_lost(velocity: Array, mass: float | Array) -> Array:
    """From velocities (..., 2) along the normal, before and after."""
    return np.asarray(0.5 * mass * (velocity[..., 0] ** 2 - velocity[..., 1] ** 2))
