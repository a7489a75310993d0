"""Motion before and after an impact, of one motion or of many drawn ones, and what its vectors say of the target."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from torchsphere.dynamics.kinematics import Draws, Kinematics

#: Standard deviations by which the velocity has to change, in one component at least.
CHANGED = 2.0

#: Standard deviations from which on an acceleration is none of noise.
ACCELERATED = 5.0

#: Standard deviations of an edge of the contact beyond which a frame counts as one of the flight.
CLEAR = 2.0

Array = NDArray[np.float64]


@dataclass(frozen=True)
class State:
    """Motion before and after, and edges, of one motion (...) or of many drawn ones (s, ...)."""

    before: Array  # (..., 2)
    after: Array
    spin_before: Array  # (..., 3)
    spin_after: Array
    edges: Array
    normal: Array  # (..., 2), unit vectors


def flights(motion: Kinematics, contact_s: Array, sd_contact_s: Array, span: slice) -> list[int] | str:
    """The last frame before the contact and the first one after it; a sentence where there is none.

    ``contact_s`` are its start and end with their standard deviations, and ``span`` the frames that were drawn.
    """
    margin = CLEAR * sd_contact_s
    known = np.zeros(len(motion.time_s), dtype=bool)
    known[span] = np.isfinite(motion.velocity_m_s[span]).all(1)
    earlier = np.flatnonzero(known & (motion.time_s <= contact_s[0] - margin[0]))
    later = np.flatnonzero(known & (motion.time_s >= contact_s[1] + margin[1]))
    if len(earlier) == 0:
        return "The contact reaches the start: no flight before it was measured."
    if len(later) == 0:
        return "The contact reaches the end: no flight after it was measured."
    return [int(earlier[-1]), int(later[0])]


def is_accelerated(motion: Kinematics) -> bool:
    """Whether an acceleration was measured in some frame, beyond what noise makes of many."""
    return bool((np.abs(motion.acceleration_m_s2) > ACCELERATED * motion.sd_acceleration_m_s2).any())


def is_changed(draws: Draws, edges: list[int]) -> bool:
    """Whether the velocity after the contact differs from that before by more than their uncertainty."""
    before, after = (draws.velocity_m_s[:, edge - draws.span.start] for edge in edges)
    change = after - before
    return bool((np.abs(change.mean(0)) > CHANGED * change.std(0)).any())


def state(velocity: Array, spin: Array, edges: Array, normal_deg: float | None) -> State:
    """From velocities (..., 2, 2) and spins (..., 2, 3) before and after."""
    before, after = velocity[..., 0, :], velocity[..., 1, :]
    if normal_deg is None:
        change = after - before
        normal = change / length(change)[..., None]
    else:
        angle = np.radians(normal_deg)
        normal = np.broadcast_to(np.array([np.cos(angle), np.sin(angle)]), before.shape)
    return State(before, after, spin[..., 0, :], spin[..., 1, :], edges, normal)


def slip(state: State, radius: float, *, after: bool) -> Array:
    """Tangential velocity of the point of contact, which lies at ``-radius`` times the normal."""
    velocity, spin = (state.after, state.spin_after) if after else (state.before, state.spin_before)
    return dot(velocity, along(state.normal)) - radius * spin[..., 2]


def along(normal: Array) -> Array:
    """Unit vector along the surface: z x n, in either right-handed frame."""
    return np.stack((-normal[..., 1], normal[..., 0]), -1)


def to_surface(velocity: Array, normal: Array) -> Array:
    """Angle between a velocity away from the surface and the surface, deg."""
    return np.degrees(np.arcsin(np.clip(dot(velocity, normal) / length(velocity), -1, 1)))


def dot(a: Array, b: Array) -> Array:
    """Products (...) of vectors (..., k)."""
    return np.asarray((a * b).sum(-1))


def length(values: Array) -> Array:
    """Lengths (...) of vectors (..., k)."""
    return np.asarray(np.linalg.norm(values, axis=-1))


def angle(values: Array) -> Array:
    """Directions (...) of vectors (..., 2), from x towards y, deg."""
    return np.asarray(np.degrees(np.arctan2(values[..., 1], values[..., 0])))
