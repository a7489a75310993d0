"""Warnings on the numbers of an impact that was found, in sentences that say what to do."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from torchsphere.dynamics.ball import Ball
from torchsphere.dynamics.filtered_motion import FilteredMotion
from torchsphere.dynamics.flights import MIN_SURE_FRAMES, in_contact, is_confirmed
from torchsphere.dynamics.impact import MIN_RESOLVED_FRAMES, contact_frames, impact, impacts
from torchsphere.dynamics.impact_estimate import Estimate, Impact
from torchsphere.dynamics.kinematics import Kinematics
from torchsphere.estimation.process_model import FLIGHT_STATES
from torchsphere.results.reader import NO_IMPACT
from torchsphere.runtime.warning_levels import note, severe

#: Standard deviations beyond which a restitution is out of its range, and a force is measured (docs/constants.toml).
SIGNIFICANT_SD = 3.0

#: Share of the contact's largest force below which there is no force (docs/constants.toml).
NO_FORCE = 0.1

#: Share of the contact's largest force that is another impact, outside the contact (docs/constants.toml).
OTHER_IMPACT = 0.05

#: Distance beyond which a force is no part of the contact, frames (docs/constants.toml).
CLEARANCE_FRAMES = 2

#: Share of the largest acceleration that a channel frequency class may take without a warning (docs/constants.toml).
MAX_FILTERED_SHARE = 0.05

Mask = NDArray[np.bool_]


def found_impacts(
    motion: Kinematics, ball: Ball | None, normal_deg: float | None
) -> tuple[Impact | None, tuple[Impact, ...], tuple[str, ...]]:
    """The strongest impact or None, all impacts, and sentences on the strongest, or why there is none."""
    found, reason = impact(motion, ball, normal_deg=normal_deg, log=False)
    if found is None:
        return None, (), (note(f"{NO_IMPACT}{reason[0].lower()}{reason[1:]}"),)
    every = impacts(motion, ball, normal_deg=normal_deg, log=False)
    return found, tuple(every), (*impact_warnings(motion, found), *map(note, found.missing))


def impact_warnings(motion: Kinematics, impact: Impact) -> tuple[str, ...]:
    """Sentences on an impact whose numbers may be wrong."""
    return (
        *map(severe, _flight_warnings(motion, impact)),
        *map(severe, _restitution_warnings(impact.restitution_normal)),
        *map(severe, _force_warnings(motion, impact)),
        *_duration_warnings(motion, impact),
    )


def filter_warnings(motion: Kinematics, impact: Impact | None, filtered: FilteredMotion | None) -> tuple[str, ...]:
    """A sentence if the channel frequency class takes much of the largest acceleration in the contact."""
    if impact is None or filtered is None:
        return ()
    inside = in_contact(motion.time_s, impact.contact_start.value, impact.contact_end.value)
    largest = [
        float(np.nanmax(np.linalg.norm(values[inside], axis=1), initial=0.0))
        for values in (motion.acceleration_m_s2, filtered.acceleration_m_s2)
    ]
    share = 1 - largest[1] / largest[0] if largest[0] > 0 else 0.0
    if share <= MAX_FILTERED_SHARE:
        return ()
    return (
        f"The channel frequency class {filtered.cfc} takes {100 * share:.0f} % of the largest acceleration in the "
        "contact, which is short for this class: compare kinematics_cfc.csv only with what was filtered by the same "
        "class, and take forces from kinematics.csv.",
    )


def _flight_warnings(motion: Kinematics, impact: Impact) -> list[str]:
    """Whether the recording may start or end within the contact."""
    known = motion.time_s[np.isfinite(motion.velocity_m_s).all(1) & is_confirmed(motion)]
    sides = (
        ("before", "starts", int((known <= impact.contact_start.value).sum())),
        ("after", "ends", int((known >= impact.contact_end.value).sum())),
    )
    return [
        f"Frames measured {side} the contact: {count}, too few to tell flight from contact. If the recording "
        f"{verb} within the contact, its speeds, duration, restitution, impulse and energies are not the impact's. "
        "Measure a longer part of the recording, if there is one."
        for side, verb, count in sides
        if count < MIN_SURE_FRAMES
    ]


def _restitution_warnings(restitution: Estimate) -> list[str]:
    """Whether no target at rest gives such a restitution."""
    value, margin = float(restitution.value), SIGNIFICANT_SD * float(restitution.sd)
    if value < -margin:
        return [
            f"The normal restitution is {value:.3g}: after the contact the ball still flies the way it came. Either it "
            "went through its target or carried it on, or the recording ends within the contact or shows two impacts; "
            "measure each impact alone with `frames`."
        ]
    if value > 1 + margin:
        return [
            f"The normal restitution is {value:.3g}: the ball leaves faster than it came. Either the recording starts "
            "within the contact or shows two impacts, or the target moves; measure each impact alone with `frames`."
        ]
    return []


def _force_warnings(motion: Kinematics, impact: Impact) -> list[str]:
    """Whether the contact holds two impacts, or another impact lies outside of it."""
    start, end = float(impact.contact_start.value), float(impact.contact_end.value)
    clearance = CLEARANCE_FRAMES / motion.frame_rate
    inside = (motion.time_s > start) & (motion.time_s < end)
    outside = (motion.time_s < start - clearance) | (motion.time_s > end + clearance)
    if not (inside.any() and outside.any()):
        return []
    # Gravity is no impact.
    steady = np.nanmedian(motion.acceleration_m_s2[outside], axis=0)
    size = np.linalg.norm(motion.acceleration_m_s2 - steady, axis=1)
    sd = np.linalg.norm(motion.sd_acceleration_m_s2, axis=1)
    largest = np.nanmax(size[inside], initial=0.0)
    is_force_free = size + 2 * sd < NO_FORCE * largest
    pause = _longest_run(inside & is_force_free & _filled(inside & (size > NO_FORCE * largest)))
    # The force of a contact that the recording cuts off goes on outside: two impacts need a flight between them.
    flight = outside & is_force_free
    is_parted = np.logical_or.accumulate(flight & (motion.time_s > end))
    is_parted |= np.logical_or.accumulate((flight & (motion.time_s < start))[::-1])[::-1]
    other = np.where(outside & is_parted & (size - SIGNIFICANT_SD * sd > OTHER_IMPACT * largest), size, 0.0)
    numbers = motion.frame
    sentences = []
    # Fewer frames of a flight leave its velocity and acceleration open.
    if len(pause) >= FLIGHT_STATES:
        first, middle, last = numbers[pause[[0, len(pause) // 2, -1]]]
        sentences.append(
            f"Within the contact, from frame {first} to {last}, there is next to no force: two impacts are stated as "
            f"one, with the impulse and the energy of both. Measure each impact alone, with `frames` up to {middle} "
            f"and from {middle}."
        )
    # Impacts that were found apart have numbers of their own.
    if other.any() and impact.count == 1:
        frame = int(other.argmax())
        sentences.append(
            f"In frame {numbers[frame]}, outside the contact, the ball is pushed by {100 * other[frame] / largest:.0f} "
            "% of the contact's largest force: another impact, which the numbers do not include. Measure each impact "
            "alone with `frames`."
        )
    return sentences


def _filled(mask: Mask) -> Mask:
    """Mask that is True from the first to the last True value of the ``mask`` (n,)."""
    return np.logical_or.accumulate(mask) & np.logical_or.accumulate(mask[::-1])[::-1]


def _longest_run(mask: Mask) -> NDArray[np.int64]:
    """Indices of the longest run of True values of the ``mask`` (n,)."""
    indices = np.flatnonzero(mask)
    return max(np.split(indices, np.flatnonzero(np.diff(indices) > 1) + 1), key=len)


def _duration_warnings(motion: Kinematics, impact: Impact) -> list[str]:
    """Whether the contact has too few frames to resolve its force."""
    frames = contact_frames(impact, motion.time_s)
    if frames >= MIN_RESOLVED_FRAMES:
        return []
    sd_edge = motion.frame_rate * max(float(impact.contact_start.sd), float(impact.contact_end.sd))
    return [
        f"The contact lasts {frames:.1f} frames, too few to see its course: its edges are known to {sd_edge:.2g} "
        "frames, and its peak and mean force are left empty. Impulse, speeds and spin stand; for the force film at a "
        "higher frame rate."
    ]
