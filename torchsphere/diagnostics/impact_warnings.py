"""What speaks against the numbers of an impact although it was found, in sentences that say what to do."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from torchsphere.dynamics.impact_estimate import Estimate, Impact
from torchsphere.dynamics.kinematics import Kinematics
from torchsphere.dynamics.peak_force import MIN_RESOLVED_FRAMES, contact_frames

#: Frames of flight before or after a contact below which a contact that the recording cuts off may pass for a shorter
#: one: of a half-sine of force whose first half was missing, up to 5 frames were taken for flight.
FEW = 6

#: Standard deviations beyond which a restitution is out of its range, and a force is one.
BEYOND = 3.0

#: Share of the contact's largest force that counts as none, and so many frames of it in a row part two impacts.
NO_FORCE, APART = 0.1, 3

#: Share of the contact's largest force that a flight does not have, further from the contact than so many frames. Of
#: nine courses of force of 14 and 40 frames, from a plateau to an exponential decay, none was doubted at noise of 1.5
#: and 7.5 um (6 shots each); a tail of 5 % came to 4 %.
OF_FLIGHT, NEAR = 0.05, 2

Array = NDArray[np.float64]


def doubts(motion: Kinematics, found: Impact) -> tuple[str, ...]:
    """Sentences on what may be wrong with an impact that was found."""
    return (
        *_little_flight(motion, found),
        *_out_of_range(found.restitution_normal),
        *_two_impacts(motion, found),
        *_short(motion, found),
    )


def _little_flight(motion: Kinematics, found: Impact) -> list[str]:
    """Whether the recording may start or end within the contact."""
    known = motion.time_s[np.isfinite(motion.velocity_m_s).all(1)]
    sides = (
        ("before", "starts", int((known <= found.contact_start.value).sum())),
        ("after", "ends", int((known >= found.contact_end.value).sum())),
    )
    return [
        f"Frames measured {side} the contact: {count}, too few to tell flight from contact. If the recording "
        f"{does} within the contact, its speeds, duration, restitution, impulse and energies are not the impact's. "
        "Measure a longer part of the recording, if there is one."
        for side, does, count in sides
        if count < FEW
    ]


def _out_of_range(restitution: Estimate) -> list[str]:
    """Whether the ball leaves as none leaves a target at rest."""
    value, margin = float(restitution.value), BEYOND * float(restitution.sd)
    if value < -margin:
        return [
            f"The normal restitution is {value:.3g}: after the contact the ball still flies the way it came. It went "
            "through its target or carried it on, or the recording ends within the contact, or shows two impacts; "
            "measure each impact alone with --frames."
        ]
    if value > 1 + margin:
        return [
            f"The normal restitution is {value:.3g}: the ball leaves faster than it came. The recording starts within "
            "the contact, or the target moves, or shows two impacts; measure each impact alone with --frames."
        ]
    return []


def _two_impacts(motion: Kinematics, found: Impact) -> list[str]:
    """Whether what is stated as one contact is two, or another one lies outside of it."""
    start, end = float(found.contact_start.value), float(found.contact_end.value)
    near = NEAR / motion.frame_rate
    inside = (motion.time_s > start) & (motion.time_s < end)
    away = (motion.time_s < start - near) | (motion.time_s > end + near)
    if not (inside.any() and away.any()):
        return []
    # Gravity is no impact.
    steady = np.nanmedian(motion.acceleration_m_s2[away], axis=0)
    size = np.linalg.norm(motion.acceleration_m_s2 - steady, axis=1)
    margin = np.linalg.norm(motion.sd_acceleration_m_s2, axis=1)
    largest = np.nanmax(size[inside], initial=0.0)
    none = inside & (size + 2 * margin < NO_FORCE * largest)
    pause = _longest_run(none & _between(inside & (size > NO_FORCE * largest)))
    # A contact that the recording cuts off goes on beside the one that was found, without a flight between them.
    free = away & (size + 2 * margin < NO_FORCE * largest)
    parted = np.logical_or.accumulate(free & (motion.time_s > end))
    parted |= np.logical_or.accumulate((free & (motion.time_s < start))[::-1])[::-1]
    pushed = np.where(away & parted & (size - BEYOND * margin > OF_FLIGHT * largest), size, 0.0)
    number = np.rint(motion.time_s * motion.frame_rate).astype(int)
    sentences = []
    if len(pause) >= APART:
        middle = number[pause[len(pause) // 2]]
        sentences.append(
            f"Within the contact, from frame {number[pause[0]]} to {number[pause[-1]]}, there is next to no force: two "
            "impacts are stated as one, with the impulse and the energy of both. Measure each alone, with --frames up "
            f"to {middle} and from {middle}."
        )
    if pushed.any():
        most = int(pushed.argmax())
        sentences.append(
            f"In frame {number[most]}, outside the contact, the ball is pushed by {100 * size[most] / largest:.0f} % "
            "of the contact's largest force: another impact, which is in none of the numbers of this one. Measure "
            "each alone with --frames."
        )
    return sentences


def _between(chosen: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """True from the first to the last of the ``chosen`` (n,)."""
    return np.logical_or.accumulate(chosen) & np.logical_or.accumulate(chosen[::-1])[::-1]


def _longest_run(chosen: NDArray[np.bool_]) -> NDArray[np.int64]:
    """Numbers of the longest run of the ``chosen`` (n,)."""
    numbers = np.flatnonzero(chosen)
    return max(np.split(numbers, np.flatnonzero(np.diff(numbers) > 1) + 1), key=len)


def _short(motion: Kinematics, found: Impact) -> list[str]:
    """Whether there are too few frames within the contact to tell its course."""
    frames = contact_frames(found, motion.time_s)
    if frames >= MIN_RESOLVED_FRAMES:
        return []
    return [
        f"The contact lasts {frames:.1f} frames, too few to see its course: its edges are known to about half a frame, "
        "and its peak and mean force are left empty. Impulse, speeds and spin stand; for the force film at a higher "
        "frame rate."
    ]
