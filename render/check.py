"""Checks of what a user gives; every message starts with the field's name."""

from __future__ import annotations

import math
from collections.abc import Sequence


def within(name: str, value: float, low: float, high: float = math.inf, *, above: bool = False) -> None:
    """Refuse a number outside of [low, high], or of (low, high] where it has to be `above` low.

    Raises
    ------
    ValueError
        Where it is outside, or not finite.
    """
    enough = value > low if above else value >= low
    if math.isfinite(value) and enough and value <= high:
        return
    least = f"more than {low:g}" if above else f"at least {low:g}"
    most = "" if math.isinf(high) else f" and at most {high:g}"
    raise ValueError(f"{name} = {value!r}: expected a number of {least}{most}")


def one_of(name: str, value: str, choices: Sequence[str]) -> None:
    """Refuse a word that is none of the choices.

    Raises
    ------
    ValueError
        Where it is none of them.
    """
    if value not in choices:
        raise ValueError(f"{name} = {value!r}: expected one of {', '.join(choices)}")


def vector(name: str, value: Sequence[float], length: int, *, nonzero: bool = False) -> None:
    """Refuse what is not `length` finite numbers, or has no direction where one is needed.

    Raises
    ------
    ValueError
        Where it is not.
    """
    if len(value) != length or not all(math.isfinite(part) for part in value):
        raise ValueError(f"{name} = {value!r}: expected {length} finite numbers")
    if nonzero and not any(value):
        raise ValueError(f"{name} = {value!r}: expected a direction, not all zeros")
