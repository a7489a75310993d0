"""Limits of settings, and refusals, which name a setting as in Python or as an option of the command line."""

from __future__ import annotations

import functools
import math
from collections.abc import Callable, Sequence
from numbers import Integral, Real
from typing import Any

from torchsphere.runtime.setting_names import as_arguments, as_options
from torchsphere.settings.choices import CHANNEL_CLASSES

#: Smallest and largest radius of the region of interest, shares of the ball's radius (docs/constants.toml).
ROI = (0.1, 1.0)

#: Digits of the largest whole number that a refusal repeats.
_MOST_DIGITS = 20

#: Characters of the longest value that a refusal repeats whole.
_MOST_CHARACTERS = 200

#: Lowest and highest frame rate, 1/s (docs/constants.toml).
FRAME_RATES = (1e-6, 1e13)

#: Least and largest width of a pixel over its height: more is no pixel, but a wrong number (docs/constants.toml).
PIXEL_ASPECTS = (0.25, 4.0)


class SettingError(ValueError):
    """A refusal in one sentence with marked names of settings (`setting_names`): "`mass_g` = -3: expected ...".

    The text of the error has the names as in Python, ``marked`` the marks.
    """

    def __init__(self, sentence: str) -> None:
        super().__init__(as_arguments(sentence))
        self.marked = sentence

    def as_options(self) -> str:
        """The sentence with the names as options of the command line: "--mass-g -3: expected ..."."""
        return as_options(self.marked)

    def joined_by(self, sentence: str) -> SettingError:
        """The refusal with another ``sentence`` behind it, with marked names of settings too."""
        return SettingError(f"{self.marked}; {sentence}")


def require_positive(name: str, value: float) -> None:
    """Raise SettingError unless the value is finite and positive."""
    if not 0 < as_float(value) < math.inf:
        raise SettingError(f"`{name}` = {as_float(value):g}: expected a finite, positive number")


def require_finite(name: str, values: float | Sequence[float]) -> None:
    """Raise SettingError unless all values are finite."""
    each = values if isinstance(values, Sequence) else (values,)
    if not all(math.isfinite(as_float(value)) for value in each):
        shown = ",".join(f"{as_float(value):g}" for value in each)
        raise SettingError(f"`{name}` = {shown}: expected {'finite numbers' if len(each) > 1 else 'a finite number'}")


def require_percent(name: str, value: float) -> None:
    """Raise SettingError unless the value is a percentage from 0 to below 100."""
    require_finite(name, value)
    if not 0 <= value < 100:
        raise SettingError(f"`{name}` = {value:g}: expected 0 to below 100")


def require_within(name: str, value: Any, limits: tuple[float, float]) -> None:
    """Raise SettingError unless the value is a number within the limits."""
    low, high = limits
    if not (isinstance(value, Real) and low <= as_float(value) <= high):
        raise SettingError(f"`{name}` = {shown_value(value)}: expected a number from {low:g} to {high:g}")


def within(limits: tuple[float, float]) -> Callable[[str, Any], None]:
    """A check that raises SettingError unless the value is a number within the limits."""
    return functools.partial(require_within, limits=limits)


def require_one_of(names: Sequence[str]) -> Callable[[str, Any], None]:
    """A check that raises SettingError unless the value is one of the names."""

    def require(name: str, value: Any) -> None:
        if value not in names:
            raise SettingError(f"`{name}` = {shown_value(value)}: expected one of {', '.join(names)}")

    return require


def require_channel_class(name: str, value: Any) -> None:
    """Raise SettingError unless the value is a channel frequency class of ISO 6487 and SAE J211."""
    if value not in CHANNEL_CLASSES:
        classes = ", ".join(map(str, CHANNEL_CLASSES))
        shown = shown_value(value)
        raise SettingError(f"`{name}` = {shown}: expected one of the channel frequency classes {classes}")


def require_switch(name: str, value: Any, allowed: str = "True or False") -> None:
    """Raise SettingError for a text in place of a switch, as even the text "off" is true."""
    if isinstance(value, str):
        raise SettingError(f"`{name}` = {shown_value(value)}: expected {allowed}")


def as_float(value: Any) -> float:
    """The value as a float; NaN, which fails every check of a range, for a text or several numbers."""
    if isinstance(value, (str, bytes)):
        return math.nan
    try:
        return float(value)
    except (TypeError, ValueError, RuntimeError):
        return math.nan
    except OverflowError:
        return math.inf if value > 0 else -math.inf


def shown_value(value: Any) -> str:
    """A value as in a refusal: a whole number of hundreds of digits by its length, a long text by its start."""
    if isinstance(value, Integral) and abs(value) >= 10**_MOST_DIGITS:
        return f"a number of more than {_MOST_DIGITS} digits"
    shown = repr(value)
    return shown if len(shown) <= _MOST_CHARACTERS else f"{shown[:_MOST_CHARACTERS]}..."


def as_positive(name: str, value: Any, expected: str = "a finite, positive number") -> float:
    """The value as a float; ValueError unless it is finite and positive."""
    found = as_float(value)
    if not (math.isfinite(found) and found > 0):
        raise ValueError(f"{name} = {shown_value(value)}: expected {expected}")
    return found


def as_share(name: str, value: Any) -> float:
    """The value as a float; ValueError unless it is in [0, 1)."""
    found = as_float(value)
    if not 0 <= found < 1:
        raise ValueError(f"{name} = {shown_value(value)}: expected a share from 0 to below 1")
    return found


def is_whole(value: Any) -> bool:
    """Whether the value is a whole number, Python's or NumPy's."""
    return isinstance(value, Integral) and not isinstance(value, bool)


def require_window(window: int, order: int) -> None:
    """Raise SettingError unless local polynomials of this order fit a window of frames."""
    if not (is_whole(window) and is_whole(order)) or window % 2 == 0 or order < 2 or window <= order:
        raise SettingError(
            f"`window` = {shown_value(window)} with `order` = {shown_value(order)}: expected an order of 2 or more and "
            "an odd window longer than that"
        )


#: Plausible diameters of a ball, mm (docs/constants.toml).
DIAMETERS_MM = (0.5, 2000.0)

#: Plausible mean densities of a ball, kg/m3 (docs/constants.toml).
DENSITIES_KG_M3 = (8.0, 23_000.0)


def unit_doubts(diameter_m: float, mass_kg: float | None, shown: tuple[str, str], advice: str) -> tuple[str, ...]:
    """A sentence if the diameter or the mass is likely in another unit, with both as ``shown`` and an ``advice``."""
    diameter, mass = shown
    if not DIAMETERS_MM[0] <= 1e3 * diameter_m <= DIAMETERS_MM[1]:
        return (f"The ball's diameter is {diameter}, which is implausible{advice}",)
    density = None if mass_kg is None else mass_kg / (math.pi / 6 * diameter_m**3)
    if density is None or DENSITIES_KG_M3[0] <= density <= DENSITIES_KG_M3[1]:
        return ()
    makes = f"which makes {density:.2g} kg/m3 and is implausible"
    return (f"The ball's diameter is {diameter} and its mass {mass}, {makes}{advice}",)


def unit_warnings(diameter_mm: float, mass_g: float | None, scale: str) -> tuple[str, ...]:
    """`unit_doubts` about the options of the command line; ``scale`` is the setting that gives the diameter."""
    shown = f"{diameter_mm:.3g} mm by {scale}", "" if mass_g is None else f"{mass_g:g} g by `mass_g` = {mass_g:g}"
    advice = ": check that the unit is mm." if mass_g is None else ": check that the units are mm and g."
    return unit_doubts(1e-3 * diameter_mm, None if mass_g is None else 1e-3 * mass_g, shown, advice)
