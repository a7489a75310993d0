"""What was given and does not come to use, in words for the summary's warnings: no option is ignored silently."""

from __future__ import annotations

from torchsphere.dynamics.impact_estimate import Impact
from torchsphere.dynamics.kinematics import Kinematics
from torchsphere.request import IMPACT, KINEMATICS, POLYNOMIALS, SETTINGS, Request
from torchsphere.settings.limits import option_name
from torchsphere.settings.setting import Group


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
        # The distance of a pinhole camera is taken in radii, so that the diameter is of use there.
        given = _given(request, KINEMATICS, POLYNOMIALS, IMPACT)
        if request.distance_mm is not None:
            given = [name for name in given if name != "diameter_mm"]
        return _told(given, f"without {lacking} there are no kinematics")
    method = motion.about["method"]
    said: list[str] = []
    if method != "savitzky-golay":
        said += _told(_given(request, POLYNOMIALS), f"the method {method} has neither; see --method savitzky-golay")
    if found is None:
        said += _told(_given(request, IMPACT), "no impact is reported")
    return tuple(said)


def _given(request: Request, *groups: Group) -> list[str]:
    """Names of the settings of some groups that were given, other than their defaults."""
    return [
        name
        for name, setting in SETTINGS.items()
        if setting.group in groups and getattr(request, name) != setting.default
    ]


def _told(names: list[str], reason: str) -> tuple[str, ...]:
    return (f"Given and not used: {', '.join(map(option_name, names))}, as {reason}.",) if names else ()
