"""What is known of camera and ball beside the images, carried from a recording and a track to what follows from them.

The command line has names of its own for these quantities, in mm, g and %. Python takes both, see `with_option_names`.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, fields, replace
from typing import Any

from torchsphere.settings.limits import (
    FRAME_RATES,
    SettingError,
    as_float,
    as_positive,
    as_share,
    shown_value,
    unit_doubts,
)

#: Exposure over the time between frames up to which it is that time, but for rounding.
_WHOLE_INTERVAL = 1 + 1e-6

#: Names of the command line: the name in Python, and the factor to its unit.
OPTION_NAMES: dict[str, tuple[str, float]] = {
    "fps": ("frame_rate", 1.0),
    "diameter_mm": ("diameter_m", 1e-3),
    "mm_per_px": ("m_per_px", 1e-3),
    "mass_g": ("mass_kg", 1e-3),
    "shell_mm": ("shell_m", 1e-3),
    "scale_sd_percent": ("relative_sd_scale", 1e-2),
    "mass_sd_percent": ("relative_sd_mass", 1e-2),
    "fps_sd_percent": ("relative_sd_frame_rate", 1e-2),
}

#: Numbers by which a camera near the ball is described; they, and the ball's diameter, make a `Camera`.
CAMERA_NUMBERS = ("focal_px", "distance_mm", "principal_px", "distortion")

#: Quantities, and the names of their relative standard deviations.
_SDS = {
    "frame_rate": "relative_sd_frame_rate",
    "diameter_m": "relative_sd_scale",
    "m_per_px": "relative_sd_scale",
    "mass_kg": "relative_sd_mass",
}

#: Relative difference of two numbers that are the same but for rounding.
_SAME = 1e-9


@dataclass(frozen=True)
class Calibration:
    """Frame rate (1/s), the ball's diameter (m) or the size of a pixel (m), and its mass (kg); None where not known.

    The relative standard deviations are those of frame rate, diameter or size of a pixel, and mass.
    """

    frame_rate: float | None = None
    diameter_m: float | None = None
    m_per_px: float | None = None
    mass_kg: float | None = None
    relative_sd_frame_rate: float = 0.0
    relative_sd_scale: float = 0.0
    relative_sd_mass: float = 0.0

    def __post_init__(self) -> None:
        if self.diameter_m is not None and self.m_per_px is not None:
            raise ValueError("scale: give either the ball's diameter or the size of a pixel")
        for field in fields(self):
            value = getattr(self, field.name)
            # What is not known is None; a standard deviation that is not known is 0.
            if value is not None or field.default is not None:
                # Numbers of arrays and tensors become plain numbers.
                object.__setattr__(self, field.name, _CHECKS[field.name](value))

    @staticmethod
    def of_options(options: Mapping[str, Any], frame_rate: float | None) -> Calibration:
        """From options of the command line, by `OPTION_NAMES`; those of others are left out.

        ``frame_rate`` is the recording's, used where none was given.
        """
        names = {field.name for field in fields(Calibration)}
        found: dict[str, Any] = {"frame_rate": frame_rate}
        for option, (name, factor) in OPTION_NAMES.items():
            if name in names and options.get(option):
                found[name] = factor * options[option]
        return Calibration(**found)

    def options(self) -> dict[str, float]:
        """What is known, by the names and in the units of the command line, without the digits of rounding."""
        known = {option: (getattr(self, name, None), factor) for option, (name, factor) in OPTION_NAMES.items()}
        return {option: float(f"{value / factor:.12g}") for option, (value, factor) in known.items() if value}

    def overridden(self, given: Calibration, source: str) -> tuple[Calibration, tuple[str, ...]]:
        """The calibration with what was ``given`` in its place, and a sentence for each contradiction.

        ``source`` is what knew this calibration. A given scale of either kind takes the place of the known one. What
        was given without a standard deviation has the known one only where it is the same quantity.
        """
        sentences, kept = [], self
        for name, sd in _SDS.items():
            known, new = getattr(self, name), getattr(given, name)
            if new is None or (known is not None and math.isclose(known, new, rel_tol=_SAME)):
                continue
            kept = replace(kept, **{sd: 0.0})
            if known is not None:
                sentences.append(f"{source} states {name} = {known:g}; {new:g} was given and used.")
        if given.diameter_m is not None or given.m_per_px is not None:
            for name, other in (("diameter_m", "m_per_px"), ("m_per_px", "diameter_m")):
                known, new = getattr(self, name), getattr(given, other)
                if known is not None and new is not None:
                    sentences.append(f"{source} states {name} = {known:g}; {other} = {new:g} was given and used.")
            kept = replace(kept, diameter_m=None, m_per_px=None)
        news = {field.name: getattr(given, field.name) for field in fields(given)}
        return replace(kept, **{name: value for name, value in news.items() if value}), tuple(sentences)


def as_frame_rate(frame_rate: Any) -> float:
    """The frame rate as a number; ValueError where no camera has it."""
    rate = as_positive("frame_rate", frame_rate)
    if not FRAME_RATES[0] <= rate <= FRAME_RATES[1]:
        raise ValueError(
            f"frame_rate = {shown_value(frame_rate)}: expected {FRAME_RATES[0]:g} to {FRAME_RATES[1]:g} frames per "
            "second"
        )
    return rate


_LENGTH = "a finite, positive length in m"
_CHECKS: dict[str, Callable[[Any], float]] = {
    "frame_rate": as_frame_rate,
    "diameter_m": lambda value: as_positive("diameter_m", value, _LENGTH),
    "m_per_px": lambda value: as_positive("m_per_px", value, _LENGTH),
    "mass_kg": lambda value: as_positive("mass_kg", value),
    "relative_sd_frame_rate": lambda value: as_share("relative_sd_frame_rate", value),
    "relative_sd_scale": lambda value: as_share("relative_sd_scale", value),
    "relative_sd_mass": lambda value: as_share("relative_sd_mass", value),
}


def with_option_names(
    function: str, arguments: Mapping[str, Any], options: Mapping[str, Any], unset: Mapping[str, Any] | None = None
) -> dict[str, Any]:
    """The ``arguments`` of a function with ``options`` by the names of the command line, in the units of Python.

    ``unset`` has the values of arguments that were not given, by default None. Raises TypeError for other names, and
    ValueError where a quantity was given by both names or is no number.
    """
    found = dict(arguments)
    for name, value in options.items():
        own, factor = OPTION_NAMES.get(name, ("", 1.0))
        if own not in found:
            known = sorted([*arguments, *(option for option, (of, _) in OPTION_NAMES.items() if of in arguments)])
            raise TypeError(f"{function} has no argument {name!r}: these are {', '.join(known)}")
        if value is None:
            continue
        if found[own] != (unset or {}).get(own):
            raise ValueError(f"{own} and {name} were both given; they are one quantity, leave one out")
        number = as_float(value)
        if not math.isfinite(number):
            raise ValueError(f"{name} = {shown_value(value)}: expected a finite number")
        if number <= 0 and not name.endswith("_percent"):
            # The value in the unit in which it was given.
            raise ValueError(f"{name} = {shown_value(value)}: expected a finite, positive number")
        found[own] = factor * number
    return found


def implausible_units(diameter_m: float | None, mass_kg: float | None) -> tuple[str, ...]:
    """`limits.unit_doubts` about arguments of Python."""
    if diameter_m is None:
        return ()
    shown = f"{diameter_m:.3g} m", "" if mass_kg is None else f"{mass_kg:.3g} kg"
    advice = "; check the units: diameter_m is in m, mass_kg in kg, and diameter_mm and mass_g in mm and g."
    return unit_doubts(diameter_m, mass_kg, shown, advice)


def exposure_share(shutter_us: float, frame_rate: float | None) -> float:
    """The exposure time over the time between frames, at most 1; raises SettingError for a longer one.

    So it does where no ``frame_rate`` is known, 1/s.
    """
    if frame_rate is None:
        raise SettingError("`shutter_us` was given, but no frame rate is known to compare it with; give `fps`, too")
    share = 1e-6 * shutter_us * frame_rate
    if share > _WHOLE_INTERVAL:
        raise SettingError(
            f"`shutter_us` = {shutter_us:g}: longer than the {1e6 / frame_rate:.4g} us from frame to frame; "
            "give the exposure time, or correct `fps`"
        )
    return min(share, 1.0)
