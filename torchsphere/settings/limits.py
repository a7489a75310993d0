"""What a setting may be, and the refusal of one that may not: by its name in Python, or as the option typed.

Whether a ball's diameter and mass may be meant as they were given: 0.03 for 30 mm is taken, and said to be odd.
"""

from __future__ import annotations

import functools
import math
import re
from collections.abc import Callable, Sequence
from numbers import Integral, Real
from typing import Any

#: Radius of the region of interest over the ball's.
ROI = (0.1, 1.0)

#: Frames per second that a recording may have: from a day's growth to light in flight.
FRAME_RATES = (1e-6, 1e13)


class SettingError(ValueError):
    """A refusal in one sentence, in which the names of settings stand between backticks: "`mass_g` = -3: expected ...".

    The text of the error has them without, as they are called in Python.
    """

    def __init__(self, sentence: str) -> None:
        super().__init__(sentence.replace("`", ""))
        self._sentence = sentence

    def as_options(self) -> str:
        """The sentence with the names as options of the command line: "--mass-g -3: expected ..."."""
        return re.sub(r"`(\w+)`(?: =)?", lambda match: option(match[1]), self._sentence)


def option(name: str) -> str:
    """What a setting is called on the command line."""
    return f"--{name.replace('_', '-')}"


def require_positive(name: str, value: float) -> None:
    """Raise SettingError unless the value is finite and positive."""
    if not (math.isfinite(value) and value > 0):
        raise SettingError(f"`{name}` = {value:g}: expected a finite, positive number")


def require_finite(name: str, values: float | Sequence[float]) -> None:
    """Raise SettingError unless all values are finite."""
    each = values if isinstance(values, Sequence) else (values,)
    if not all(map(math.isfinite, each)):
        shown = ",".join(f"{value:g}" for value in each)
        raise SettingError(f"`{name}` = {shown}: expected {'finite numbers' if len(each) > 1 else 'a finite number'}")


def require_within(name: str, value: Any, limits: tuple[float, float]) -> None:
    """Raise SettingError unless the value is a number within the limits."""
    low, high = limits
    if not (isinstance(value, Real) and low <= float(value) <= high):
        raise SettingError(f"`{name}` = {value!r}: expected a number from {low:g} to {high:g}")


def within(limits: tuple[float, float]) -> Callable[[str, Any], None]:
    """`require_within` with the limits given."""
    return functools.partial(require_within, limits=limits)


def require_one_of(names: Sequence[str]) -> Callable[[str, Any], None]:
    """A check that raises SettingError unless the value is one of some names."""

    def require(name: str, value: Any) -> None:
        if value not in names:
            raise SettingError(f"`{name}` = {value!r}: expected one of {', '.join(names)}")

    return require


def require_switch(name: str, value: Any, allowed: str = "True or False") -> None:
    """Raise SettingError where the value of something that is on or off is a text: "off", too, would count as true."""
    if isinstance(value, str):
        raise SettingError(f"`{name}` = {value!r}: expected {allowed}")


def number(value: Any) -> float:
    """The value as a float; NaN, which no check of a range lets pass, where it is a text or no single number."""
    if isinstance(value, (str, bytes)):
        return math.nan
    try:
        return float(value)
    except (TypeError, ValueError, RuntimeError):
        return math.nan


def positive(name: str, value: Any, expected: str = "a finite, positive number") -> float:
    """The value as a float; ValueError unless it is finite and positive."""
    found = number(value)
    if not (math.isfinite(found) and found > 0):
        raise ValueError(f"{name} = {value!r}: expected {expected}")
    return found


def is_whole(value: Any) -> bool:
    """Whether the value is a whole number, Python's or NumPy's."""
    return isinstance(value, Integral) and not isinstance(value, bool)


def require_window(window: int, order: int) -> None:
    """Raise SettingError unless local polynomials of that order can be fitted to so many frames around each frame."""
    if not (is_whole(window) and is_whole(order)) or window % 2 == 0 or order < 2 or window <= order:
        raise SettingError(
            f"`window` = {window!r} with `order` = {order!r}: expected an order of 2 or more and an odd window longer "
            "than that"
        )


#: Diameters that a filmed ball may have, mm: from coarse shot for peening to a boulder.
DIAMETERS_MM = (0.5, 2000.0)

#: Mean densities that a ball may have, kg/m3: a foam ball has 15 and a table tennis ball 80; osmium has 22,600.
DENSITIES_KG_M3 = (8.0, 23_000.0)


def implausible(diameter_mm: float, mass_g: float | None, scale: str) -> tuple[str, ...]:
    """One sentence where a ball of that diameter or mass is likely to be one in another unit; none where it is not.

    ``scale`` is what the diameter comes from, as it was given: "--diameter-mm 30".
    """
    given = f"{diameter_mm:.3g} mm by {scale}"
    low, high = DIAMETERS_MM
    if not low <= diameter_mm <= high:
        return (f"The ball's diameter is {given}, which is implausible: see that the unit is mm, as it was taken so.",)
    if mass_g is None:
        return ()
    density = 1e-3 * mass_g / (math.pi / 6 * (1e-3 * diameter_mm) ** 3)
    low, high = DENSITIES_KG_M3
    if low <= density <= high:
        return ()
    return (
        f"The ball's diameter is {given} and its mass {mass_g:g} g by --mass-g {mass_g:g}, which makes {density:.2g} "
        "kg/m3 and is implausible: see that the units are mm and g, as they were taken so.",
    )
