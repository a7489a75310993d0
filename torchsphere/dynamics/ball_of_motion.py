"""The ball of an impact: as given, or by the mass and the diameter that the motion carries."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from torchsphere.dynamics.ball import Ball, ball
from torchsphere.dynamics.kinematics import Kinematics
from torchsphere.runtime import warning_levels
from torchsphere.settings.calibration import with_option_names

#: Largest relative difference of a ball's mass from that of the motion that is no contradiction (docs/constants.toml).
SAME_MASS = 1e-6

#: The same of its diameter, which the motion may have from an outline (docs/constants.toml).
SAME_DIAMETER = 0.05


def ball_of_motion(
    motion: Any,
    given: Ball | None,
    shell_m: float | None,
    inertia_kg_m2: float | None,
    options: Mapping[str, Any],
    *,
    log: bool,
) -> tuple[Ball | None, tuple[str, ...]]:
    """The ball, None where the motion has no mass, and sentences on contradictions between ball and motion.

    Raises ValueError where shell or inertia were given and there is no ball of the motion to have them.
    """
    shell_m = with_option_names("impact", {"shell_m": shell_m}, options)["shell_m"]
    has_form = shell_m is not None or inertia_kg_m2 is not None
    if not isinstance(motion, Kinematics):
        return given, ()
    if given is not None:
        if has_form:
            raise ValueError("impact: a ball was given and a shell or an inertia, too; give these to torchsphere.ball")
        notes = _contradictions(motion, given)
        if log:
            warning_levels.log(notes)
        return given, notes
    if motion.mass_kg is None or motion.diameter_m is None:
        if has_form:
            raise ValueError(
                "impact: a shell or an inertia was given, but no mass; give mass_kg to kinematics or track"
            )
        return None, ()
    of_motion = ball(
        motion.mass_kg,
        motion.diameter_m,
        shell_m=shell_m,
        inertia_kg_m2=inertia_kg_m2,
        relative_sd_mass=motion.relative_sd_mass,
        relative_sd_diameter=motion.scale.relative_sd_given,
        log=False,  # the motion has this warning
    )
    return of_motion, ()


def _contradictions(motion: Kinematics, given: Ball) -> tuple[str, ...]:
    """Sentences on a mass and a diameter that differ from those of the motion."""
    pairs = (
        ("mass", "kg", motion.mass_kg, given.mass_kg, SAME_MASS),
        ("diameter", "m", motion.diameter_m, 2 * given.radius_m, SAME_DIAMETER),
    )
    return tuple(
        f"The motion has a ball with a {name} of {known:.4g} {unit}; the ball that was given has {new:.4g} {unit}, "
        "which is used for the impact."
        for name, unit, known, new, same in pairs
        if known is not None and abs(new - known) > same * known
    )
