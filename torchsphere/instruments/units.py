"""Units of a file's columns: as given, as the file states them, or SI units."""

from __future__ import annotations

import math
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from torchsphere.runtime.warning_levels import severe

#: Standard acceleration of free fall, m/s^2.
STANDARD_GRAVITY_M_S2 = 9.80665

#: Characters that loggers write in one way or another.
_SAME = str.maketrans({"µ": "u", "μ": "u", "²": "2", "⁻": "-", "ε": "e", "^": None, "*": None, "·": None, " ": None})

#: A unit in brackets at the end of a name.
_BRACKETS = re.compile(r"[\[(<]([^\])>]*)[\])>]\s*$")

#: Units of other quantities, by which a line of units is known; an oscilloscope counts samples in a "sequence".
_OTHERS = frozenset({"v", "mv", "volt", "volts", "mv/v", "a", "ma", "ampere", "n", "kn", "pa", "bar", "sequence"})


@dataclass(frozen=True)
class Quantity:
    """A quantity with its units in SI units, the first of which is 1, and with other ways of writing them."""

    name: str
    option: str  # the setting that gives its unit
    factors: Mapping[str, float]
    written: Mapping[str, str]

    @property
    def si(self) -> str:
        """Its SI unit."""
        return next(iter(self.factors))

    def unit(self, text: str) -> str | None:
        """The unit that a text such as "m/s²" means; None if it is none of this quantity."""
        plain = _plain(text)
        return next((unit for unit in self.factors if _plain(unit) == plain), self.written.get(plain))

    def factor(self, text: str) -> float:
        """Size of a unit, or of a number of SI units, in SI units; ValueError for other texts."""
        unit = self.unit(text)
        factor = float(text) if unit is None else self.factors[unit]
        if not (math.isfinite(factor) and factor > 0):
            raise ValueError(text)
        return factor

    def stated(self, column: str, unit: str) -> str | None:
        """The unit of a column by the text of its unit, or by the end of its name, as in "t_ms" or "a / g"."""
        ends = [unit] if unit else [column[place.end() :] for place in re.finditer(r"^|[_/ ]+", column)]
        return next(filter(None, map(self.unit, ends)), None)


TIME = Quantity(
    "time",
    "time_unit",
    {"s": 1.0, "ms": 1e-3, "us": 1e-6, "ns": 1e-9},
    {"sec": "s", "second": "s", "seconds": "s", "sekunden": "s", "msec": "ms", "milliseconds": "ms", "usec": "us"},
)

ACCELERATION = Quantity(
    "acceleration",
    "unit",
    {"m/s^2": 1.0, "mm/s^2": 1e-3, "g": STANDARD_GRAVITY_M_S2, "mg": 1e-3 * STANDARD_GRAVITY_M_S2},
    dict.fromkeys(("m_s2", "m_s_2", "m/s/s", "ms-2", "m.s-2", "mps2", "m/sec2"), "m/s^2")
    | dict.fromkeys(("mm_s2", "mm/s/s", "mms-2", "mm/sec2"), "mm/s^2")
    | dict.fromkeys(("gn", "g0", "g_n", "gee"), "g"),
)

STRAIN = Quantity(
    "strain",
    "unit",
    {"strain": 1.0, "percent": 1e-2, "mm/m": 1e-3, "microstrain": 1e-6},
    {"m/m": "strain", "mm/mm": "strain", "e": "strain", "%": "percent", "millistrain": "mm/m"}
    | dict.fromkeys(("um/m", "ue", "ustrain"), "microstrain"),
)


def _plain(text: str) -> str:
    return text.translate(_SAME).lower()


def in_brackets(name: str) -> str:
    """The unit in brackets at the end of a name, as in "acc [g]"; empty without brackets."""
    found = _BRACKETS.search(name)
    return found[1].strip() if found else ""


def is_unit(text: str) -> bool:
    """Whether a text is a unit and no name: it stands in brackets, or is known."""
    known = any(quantity.unit(text) for quantity in (TIME, ACCELERATION, STRAIN))
    return known or _plain(text) in _OTHERS or _BRACKETS.match(text) is not None


def are_units(texts: Sequence[str]) -> bool:
    """Whether the texts of a line are units: all are known, or the first one in letters is a unit of time."""
    in_letters = next((text for text in texts if any(map(str.isalpha, text))), "")
    return bool(texts) and (all(map(is_unit, texts)) or TIME.unit(in_brackets(in_letters) or in_letters) is not None)


def converted(quantity: Quantity, column: str, stated: str, given: str | None) -> tuple[float, str, tuple[str, ...]]:
    """Factor of a column to SI units, a sentence on where its unit is from, and warnings.

    Parameters
    ----------
    quantity : Quantity
        What the column holds.
    column, stated : str
        Its name, and the text of its unit in the file, or "".
    given : str or None
        A unit, or the size of the file's unit in SI units, which wins.
    """
    by_file = quantity.stated(column, stated)
    if given is not None:
        factor = quantity.factor(given)
        contradicts = by_file is not None and not math.isclose(factor, quantity.factors[by_file])
        warning = f"Column {column!r} is in {by_file} by the file, and was taken as in {given} by `{quantity.option}`"
        said = f"{given}{'' if quantity.unit(given) else f' {quantity.si}'}, as given"
        return factor, said, (severe(warning),) if contradicts else ()
    if by_file is not None:
        return quantity.factors[by_file], f"{by_file}, as the file states", ()
    said = f"{quantity.si}, as nothing states another"
    if not stated:
        return 1.0, said, ()
    warning = f"Column {column!r} is in {stated!r}, no unit of {quantity.name}, and was taken as {quantity.si}"
    sizes = f"a unit, or the number of {quantity.si} in one {stated}"
    return 1.0, said, (severe(f"{warning}; give `{quantity.option}`: {sizes}"),)
