"""What was given and does not come to use, in words for the summary's warnings: no option is ignored silently."""

from __future__ import annotations

import dataclasses
from collections.abc import Iterable

from torchsphere.dynamics.impact_estimate import Impact
from torchsphere.dynamics.kinematics import Kinematics
from torchsphere.request import Request
from torchsphere.settings.limits import option

#: Settings of what follows from the track: of the kinematics, of their local polynomials, and of the impact.
OF_KINEMATICS = ("mm_per_px", "diameter_mm", "mass_g", "scale_sd_percent", "method", "lab_frame")
OF_POLYNOMIALS = ("window", "order")
OF_IMPACT = ("shell_mm", "inertia_kg_m2", "normal_deg")


def unused(request: Request, motion: Kinematics | None, found: Impact | None, *, has_rate: bool) -> tuple[str, ...]:
    """Sentences on the settings that were given, other than their defaults, and changed nothing.

    Parameters
    ----------
    request : Request
    motion : Kinematics or None
        None where frame rate or scale are not known.
    found : Impact or None
    has_rate : bool
        Whether the frame rate is known.
    """
    if motion is None:
        has_scale = request.diameter_mm is not None or request.mm_per_px is not None
        wanted = [(has_rate, "a frame rate (--fps)"), (has_scale, "a scale (--diameter-mm or --mm-per-px)")]
        lacking = " and ".join(name for there, name in wanted if not there) or "a measured motion"
        names = (*OF_KINEMATICS, *OF_POLYNOMIALS, *OF_IMPACT)
        # The distance of a pinhole camera is taken in radii, so that the diameter is of use there.
        given = [name for name in _given(request, names) if name != "diameter_mm" or request.distance_mm is None]
        return _told(given, f"without {lacking} there are no kinematics")
    method = motion.about["method"]
    said: list[str] = []
    if method != "savitzky-golay":
        said += _told(_given(request, OF_POLYNOMIALS), f"the method {method} has neither; see --method savitzky-golay")
    if found is None:
        said += _told(_given(request, OF_IMPACT), "no impact is reported")
    return tuple(said)


def _given(request: Request, names: Iterable[str]) -> list[str]:
    defaults = {field.name: field.default for field in dataclasses.fields(request)}
    return [name for name in names if getattr(request, name) != defaults[name]]


def _told(names: list[str], reason: str) -> tuple[str, ...]:
    return (f"Given and not used: {', '.join(map(option, names))}, as {reason}.",) if names else ()
