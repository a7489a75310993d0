"""Why a motion has no impact: a table of conditions, each with the sentence that is said where it holds."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from torchsphere.dynamics.draws import Draws
from torchsphere.dynamics.kinematics import Kinematics
from torchsphere.dynamics.rebound import Rebound, dot

#: Least change of the velocity in one component that is an impact, in standard deviations (docs/constants.toml).
MIN_CHANGE_SD = 2.0

#: Least acceleration that noise does not explain, in standard deviations (docs/constants.toml).
MIN_ACCELERATION_SD = 5.0


@dataclass(frozen=True)
class Meeting:
    """The smoothed motion before and after a contact, and what decides whether it is an impact."""

    smoothed: Rebound
    part: Draws  # in the frames before and after the contact alone
    normal_deg: float | None
    may_drive_on: bool  # whether the target may strike the ball from behind, after an earlier impact

    @property
    def is_driven_on(self) -> bool:
        """Whether the ball comes to the contact on the way that the contact drives it."""
        return bool(dot(self.smoothed.velocity_before, self.smoothed.normal) >= 0)

    @property
    def is_struck_from_behind(self) -> bool:
        """Whether the ball is driven on as it may be."""
        change = self.smoothed.velocity_after - self.smoothed.velocity_before
        return self.is_driven_on and self.may_drive_on and bool(dot(change, self.smoothed.normal) > 0)


def _lacks_contact(motion: Kinematics) -> bool:
    return motion.contact_s is None or motion.sd_contact_s is None or motion.draws is None


def _is_accelerated(motion: Kinematics) -> bool:
    """Whether some frame has an acceleration that noise does not explain."""
    return bool((np.abs(motion.acceleration_m_s2) > MIN_ACCELERATION_SD * motion.sd_acceleration_m_s2).any())


def _is_unchanged(meeting: Meeting) -> bool:
    """Whether the velocities before and after differ by no more than their uncertainty."""
    change = meeting.part.velocity_m_s[:, 1] - meeting.part.velocity_m_s[:, 0]
    return not (np.abs(change.mean(0)) > MIN_CHANGE_SD * change.std(0)).any()


#: Why a motion has no contact between two flights, the first that holds.
OF_MOTION: tuple[tuple[Callable[[Kinematics], bool], str], ...] = (
    (
        lambda motion: not np.isfinite(motion.velocity_m_s).any(),
        "No frame has a velocity: too few frames in a row were measured.",
    ),
    (
        lambda motion: "contact_found" not in motion.about,
        "The method {method!r} finds no contact; use the smoother.",
    ),
    (
        lambda motion: bool(motion.about.get("in_place")),
        "The ball stays in its place, so no contact was sought.",
    ),
    (
        lambda motion: bool(motion.about.get("loaded")),
        "The motion was loaded from a result folder, which keeps no drawn motions: take the impacts that were loaded "
        "with it, or torchsphere.kinematics of the loaded track.",
    ),
    (
        lambda motion: _lacks_contact(motion) and _is_accelerated(motion),
        "No contact was found: one steady acceleration explains all frames as well, as by gravity or drag, or if all "
        "frames lie within the contact.",
    ),
    (
        _lacks_contact,
        "No contact was found: one steady motion explains all frames as well.",
    ),
)

#: Why a contact between two flights is no impact, the first that holds.
OF_MEETING: tuple[tuple[Callable[[Meeting], bool], str], ...] = (
    (
        lambda meeting: meeting.is_driven_on and not meeting.is_struck_from_behind and meeting.normal_deg is None,
        "In the contact that was found the ball is driven on the way it flies, not thrown back: no target at rest does "
        "so.",
    ),
    (
        lambda meeting: meeting.is_driven_on and not meeting.is_struck_from_behind,
        "The target's normal was given as {normal_deg:g} deg, which is the way that the ball flies; give the direction "
        "from target to ball.",
    ),
    (
        _is_unchanged,
        "The velocity after the contact that was found is that before it: this is no impact, but perhaps a few wrong "
        "or missing frames.",
    ),
)


def why_no_contact(motion: Kinematics) -> str:
    """Why the motion has no contact between flights; empty where it has one."""
    found = (sentence.format_map(motion.about) for holds, sentence in OF_MOTION if holds(motion))
    return next(found, "")


def why_no_impact(meeting: Meeting) -> str:
    """Why the contact is no impact; empty where it is one."""
    found = (sentence.format_map(vars(meeting)) for holds, sentence in OF_MEETING if holds(meeting))
    return next(found, "")
