"""What speaks against the numbers of an impact although it was found, in sentences that say what to do."""

from __future__ import annotations

import numpy as np

from torchsphere.estimates import Estimate, Impact
from torchsphere.kinematics import Kinematics
from torchsphere.short_contact import SHORT, frames_of

#: Frames of flight before or after a contact below which a contact that the recording cuts off may pass for a shorter
#: one: of a half-sine of force whose first half was missing, up to 5 frames were taken for flight.
FEW = 6

#: Standard deviations beyond which a restitution is out of its range.
BEYOND = 3.0


def doubts(motion: Kinematics, found: Impact) -> tuple[str, ...]:
    """Sentences on what may be wrong with an impact that was found."""
    return (*_little_flight(motion, found), *_out_of_range(found.restitution_normal), *_short(motion, found))


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


def _short(motion: Kinematics, found: Impact) -> list[str]:
    """Whether there are too few frames within the contact to tell its course."""
    frames = frames_of(found, motion.time_s)
    if frames >= SHORT:
        return []
    return [
        f"The contact lasts {frames:.1f} frames, too few to see its course: its edges are known to about half a frame, "
        "and its peak and mean force are left empty. Impulse, speeds and spin stand; for the force film at a higher "
        "frame rate."
    ]
