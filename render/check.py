"""Checks of a user's values; every message starts with the field's name."""

from __future__ import annotations

import math
from collections.abc import Sequence


def within(name: str, value: float, low: float, high: float = math.inf, *, above: bool = False) -> None:
    """Refuse a number outside of [low, high]; with `above`, outside of (low, high].

    Raises
    ------
    ValueError
        If the number is outside, or not finite.
    """
    enough = value > low if above else value >= low
    if math.isfinite(value) and enough and value <= high:
        return
    least = f"more than {low:g}" if above else f"at least {low:g}"
    most = "" if math.isinf(high) else f" and at most {high:g}"
    raise ValueError(f"{name} = {value!r}: expected a number of {least}{most}")


def one_of(name: str, value: str, choices: Sequence[str]) -> None:
    """Refuse a word that is not one of the choices.

    Raises
    ------
    ValueError
        If the word is not one of the choices.
    """
    if value not in choices:
        raise ValueError(f"{name} = {value!r}: expected one of {', '.join(choices)}")


def vector(name: str, value: Sequence[float], length: int, *, nonzero: bool = False) -> None:
    """Refuse a vector that does not have `length` finite numbers; with `nonzero`, also the zero vector.

    Raises
    ------
    ValueError
        If the vector is invalid.
    """
    if len(value) != length or not all(math.isfinite(part) for part in value):
        raise ValueError(f"{name} = {value!r}: expected {length} finite numbers")
    if nonzero and not any(value):
        raise ValueError(f"{name} = {value!r}: expected a direction, not all zeros")
