"""Settings that were given and had no effect, as sentences for the summary: no option is ignored silently."""

from __future__ import annotations

from torchsphere.dynamics.impact_estimate import Impact
from torchsphere.dynamics.kinematics import Kinematics
from torchsphere.request import IMPACT, KINEMATICS, POLYNOMIALS, SETTINGS, Request
from torchsphere.runtime.warning_levels import note
from torchsphere.settings.setting import Group


def unused_settings(
    request: Request, motion: Kinematics | None, impact: Impact | None, *, has_rate: bool
) -> tuple[str, ...]:
    """Sentences on settings other than their defaults that had no effect; ``has_rate`` tells of a frame rate.

    ``motion`` is None without a frame rate or a scale, ``impact`` is None if no impact was found.
    """
    of_map: tuple[str, ...] = ()
    if request.map == "off" and request.shutter_us is not None:
        of_map = _sentences(["shutter_us"], "pairs do not model the exposure: only the map of the ball does")
    return of_map + _of_motion(request, motion, impact, has_rate=has_rate)


def _of_motion(
    request: Request, motion: Kinematics | None, impact: Impact | None, *, has_rate: bool
) -> tuple[str, ...]:
    """`unused_settings` of what is computed from the motion."""
    if motion is None:
        has_scale = request.diameter_mm is not None or request.mm_per_px is not None
        needed = [(has_rate, "a frame rate (`fps`)"), (has_scale, "a scale (`diameter_mm` or `mm_per_px`)")]
        lacking = " and ".join(name for is_there, name in needed if not is_there) or "a measured motion"
        # The distance of a pinhole camera is measured in radii of the ball, so that the diameter has an effect.
        given = _given(request, KINEMATICS, POLYNOMIALS, IMPACT)
        if request.distance_mm is not None:
            given = [name for name in given if name != "diameter_mm"]
        return _sentences(given, f"without {lacking} there are no kinematics")
    method = motion.about["method"]
    sentences: list[str] = []
    if method != "savitzky-golay":
        sentences += _sentences(
            _given(request, POLYNOMIALS), f"the method {method} has neither; see `method` = savitzky-golay"
        )
    if request.mass_g is None and request.mass_sd_percent:
        sentences += _sentences(["mass_sd_percent"], "no mass was given")
    if impact is None:
        sentences += _sentences(_given(request, IMPACT), "no impact is reported")
    return tuple(sentences)


def _given(request: Request, *groups: Group) -> list[str]:
    """Names of the settings of some groups whose values are not their defaults."""
    return [
        name
        for name, setting in SETTINGS.items()
        if setting.group in groups and getattr(request, name) != setting.default
    ]


def _sentences(names: list[str], reason: str) -> tuple[str, ...]:
    """One sentence on the settings, or none without settings."""
    given = ", ".join(f"`{name}`" for name in names)
    return (note(f"Given and not used: {given}, as {reason}."),) if names else ()
