"""The answer of a report: the few numbers that a shot is filmed for, which stand right under the headline."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

from torchsphere.motion.track import why_unusable
from torchsphere.report.summary_tables import IMPACT, NOT_MEASURED, no_impact, with_sd
from torchsphere.results.reader import ResultFolder
from torchsphere.results.vector_length import vector_length

#: Keys of an impact in ``summary.json``, in the order of the answer.
OF_IMPACT = ("speed_before", "speed_after", "peak_force", "spin_rate_before", "spin_rate_after", "restitution_normal")

#: Numbers of a recording without an impact: name, key of the mean motion, its components, unit, factor. The first is
#: known with rate and scale, the second instead without.
OF_FLIGHT = (
    (("Speed", "velocity_m_s", slice(2), "m/s", 1.0), ("Step", "increment_px_rad", slice(2), "px per frame", 1.0)),
    (
        ("Spin", "spin_rad_s", slice(3), "rev/s", 0.5 / math.pi),
        ("Turn", "increment_px_rad", slice(2, 5), "deg per frame", math.degrees(1)),
    ),
)


@dataclass(frozen=True)
class Answer:
    """What the numbers are of, the names and values of those that are known, and why there is no impact."""

    about: str
    numbers: tuple[tuple[str, str], ...]
    reason: str


def answer(result: ResultFolder) -> Answer | None:
    """The answer of a result; None where nothing usable was measured."""
    if why_unusable(result.status):
        return None
    impact = result.summary.get("impact")
    if impact:
        count = len(result.summary.get("impacts") or ())
        about = f"The strongest of {count} impacts" if count > 1 else "The impact"
        return Answer(about, _of_impact(impact), "")
    # What is missing for velocities stands among what to do.
    reason = "" if result.motion is None else f"No impact: {no_impact(result).removeprefix(f'{NOT_MEASURED}: ')}"
    return Answer("The mean motion", _of_flight(result), reason)


def _of_impact(impact: dict[str, Any]) -> tuple[tuple[str, str], ...]:
    named = {key: (name.partition(" (")[0], unit, factor) for key, name, unit, factor in IMPACT}
    found = []
    for key in OF_IMPACT:
        (name, unit, factor), number = named[key], impact.get(key) or {}
        found.append((name, with_sd(number.get("value"), number.get("sd"), unit, factor)))
    return _known(found)


def _of_flight(result: ResultFolder) -> tuple[tuple[str, str], ...]:
    """Lengths of the mean motion, per second or else from frame to frame."""
    means = result.summary.get("mean_motion") or {}
    found = []
    for in_si, in_px in OF_FLIGHT:
        name, key, part, unit, factor = in_si if in_si[1] in means else in_px
        value, sd = vector_length(means.get(key), means.get(f"sd_{key}"), part)
        found.append((name, with_sd(value, sd, unit, factor)))
    return _known(found)


def _known(numbers: list[tuple[str, str]]) -> tuple[tuple[str, str], ...]:
    return tuple((name, text) for name, text in numbers if text != NOT_MEASURED)
