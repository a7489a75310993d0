"""The flights before and after a contact, and whether enough frames of them were measured.

A flight has a place, a velocity and an acceleration along each axis, which take three frames. Two frames fit any
acceleration, so that the ball may still touch its target in them. Where the acceleration is not known to be less than
that of the contact, or is a push itself, the contact does not lie between the two sides.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from torchsphere.dynamics.draws import Draws
from torchsphere.dynamics.estimate import Estimate, estimated
from torchsphere.dynamics.kinematics import FoundContact, Kinematics
from torchsphere.estimation.process_model import FLIGHT_STATES
from torchsphere.runtime.arrays import Array

#: Distance of a flight from the contact's edge, and of its accelerations from a limit, standard deviations
#: (docs/constants.toml).
MARGIN_SD = 2.0

#: Share of the contact's mean acceleration that is a push (docs/constants.toml).
PUSH_SHARE = 0.1

#: Measured frames on a side below which the spin is tested so (docs/constants.toml).
FEW_FRAMES = 12

#: Fewest measured frames on either side that surely tell flight from contact (docs/constants.toml).
MIN_SURE_FRAMES = 6


@dataclass(frozen=True)
class Side:
    """The frames on one side of a contact, at a distance from it that holds the error of its edge."""

    name: str  # "before" or "after"
    end: str  # of the recording, "start" or "end"
    measured: NDArray[np.int64]  # rows of the motion
    next: int | None  # the row nearest to the contact that has a velocity


def in_contact(time_s: Array, start: Array | float, end: Array | float) -> NDArray[np.bool_]:
    """(n,), True at times within a contact, its edges included."""
    return np.asarray((time_s >= start) & (time_s <= end))


def sides(motion: Kinematics, contact: FoundContact) -> tuple[Side, Side]:
    """Both sides of the contact, before and after."""
    start, end = contact.contact_s + MARGIN_SD * contact.sd_contact_s * [-1, 1]
    known = np.zeros(len(motion.time_s), dtype=bool)
    known[contact.draws.span] = np.isfinite(motion.velocity_m_s[contact.draws.span]).all(1)
    measured = known & is_confirmed(motion)
    earlier, later = motion.time_s <= start, motion.time_s >= end
    before, after = np.flatnonzero(known & earlier), np.flatnonzero(known & later)
    return (
        Side("before", "start", np.flatnonzero(measured & earlier), int(before[-1]) if len(before) else None),
        Side("after", "end", np.flatnonzero(measured & later), int(after[0]) if len(after) else None),
    )


def is_confirmed(motion: Kinematics) -> NDArray[np.bool_]:
    """(n,), True in frames whose place was measured and confirmed: by a step to or from it, or by the ball's texture.

    A place that was found anew by the outline alone may be that of another object.
    """
    if motion.track is None:
        return np.ones(len(motion.time_s), dtype=bool) if motion.is_measured is None else motion.is_measured
    steps = np.isfinite(motion.track.increment[:, 0])
    beside = np.append(steps, False) | np.append(False, steps)
    return np.isfinite(motion.track.position[:, 0]) & (beside | np.isfinite(motion.track.orientation[:, 0, 0]))


def flight_frames(motion: Kinematics, contact: FoundContact) -> list[int] | str:
    """The last frame before the contact and the first one after it, or a sentence on the flight that is not known."""
    both = sides(motion, contact)
    lacking = {side.name: text for side in both if (text := _lack_of_frames(side))}
    rows = [side.next for side in both if side.next is not None]
    if not lacking and len(rows) == len(both):
        lacking = {side.name: text for side in both if (text := _lack_of_flight(motion, contact, rows, side))}
    if not lacking:
        return rows
    speeds = (_speed(motion, contact, side) for side in both if side.name not in lacking)
    return " ".join((*lacking.values(), *filter(None, speeds)))


def _lack_of_frames(side: Side) -> str:
    """A sentence if too few frames of a side were measured."""
    count = len(side.measured)
    if count == 0:
        return f"The contact reaches the {side.end}: no flight {side.name} it was measured."
    if count < FLIGHT_STATES:
        return (
            f"Only {count} measured {'frame shows' if count == 1 else 'frames show'} the flight {side.name} the "
            f"contact: {FLIGHT_STATES} are needed to tell its velocity from a push."
        )
    return ""


def _lack_of_flight(motion: Kinematics, contact: FoundContact, rows: list[int], side: Side) -> str:
    """A sentence if the data leave open whether a side is a flight, or contradict it; ``rows`` are next to the contact.

    The push is the acceleration along the change of velocity: gravity that pulls the ball to its target is none.
    """
    change = np.diff(motion.velocity_m_s[rows], axis=0)[0]
    size = max(float(np.linalg.norm(change)), float(np.finfo(np.float64).tiny))
    mean = size / float(np.diff(contact.contact_s)[0])
    push = motion.acceleration_m_s2[side.measured] @ change / size / mean
    margin = MARGIN_SD * np.hypot(*(motion.sd_acceleration_m_s2[side.measured] * change / size).T) / mean
    most, least = float((push + margin).min()), float((push - margin).min())
    frames = f"In the {len(side.measured)} measured frames {side.name} the contact that was found"
    if most >= 1:
        return f"{frames} the ball may be pushed as in the contact itself: they do not tell flight from contact."
    if least > PUSH_SHARE:
        return f"{frames} the ball is pushed, too, with {100 * least:.0f} % or more of the contact's mean force."
    return ""


def is_spin_known(motion: Kinematics, contact: FoundContact) -> bool:
    """Whether the spin stays the same in both flights, as it does in the air; True where no spin was measured.

    Through few frames a steady acceleration may explain a change in the contact.
    """
    both = [side.measured for side in sides(motion, contact)]
    if min(map(len, both)) >= FEW_FRAMES:
        return True
    rate, sd = np.abs(motion.angular_acceleration_rad_s2), motion.sd_angular_acceleration_rad_s2
    return not any((rate[rows] > MARGIN_SD * sd[rows]).all(0).any() for rows in both)


def without_spin(motion: Kinematics, draws: Draws) -> Draws:
    """The ``draws`` without spins, and with velocities as uncertain as if the rotation told nothing of them.

    Errors of positions and rotations are alike, so that a wrong spin takes the velocity with it.
    """
    covariance = np.zeros((5, 5)) if motion.track is None else np.nanmedian(motion.track.covariance, axis=0)
    place, turn, both = covariance[:2, :2], covariance[2:, 2:], covariance[:2, 2:]
    told, own = np.diagonal(both @ np.linalg.pinv(turn) @ both.T), np.diagonal(place)
    share = np.divide(told, own, out=np.zeros(2), where=(own > 0) & (told < own))
    factor = 1 / np.sqrt(1 - share)
    mean = draws.velocity_m_s.mean(0)
    wider = mean + factor * (draws.velocity_m_s - mean)
    return replace(draws, velocity_m_s=wider, spin_rad_s=np.full_like(draws.spin_rad_s, np.nan))


def _speed(motion: Kinematics, contact: FoundContact, side: Side) -> str:
    """The speed of a flight that is known although the other one is not; empty where it is not known for sure."""
    if side.next is None or len(side.measured) < MIN_SURE_FRAMES:
        return ""
    drawn = contact.draws.velocity_m_s[:, side.next - contact.draws.span.start]
    speed: Estimate = estimated(
        float(np.linalg.norm(motion.velocity_m_s[side.next])), np.linalg.norm(drawn, axis=1), "m/s"
    )
    return f"The speed {side.name} it is {speed}."
