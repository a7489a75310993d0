"""The ledger of a track: which source of error added how much to its uncertainty."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Any

#: Names of the five components of an increment: px and rad.
INCREMENTS = ("dx_px", "dy_px", "wx_rad", "wy_rad", "wz_rad")


@dataclass(frozen=True)
class Entry:
    """Standard deviations that one source added; they add in squares.

    Attributes
    ----------
    source : str
        Name of the source.
    step : tuple of float
        Of one increment (5,), px and rad: the root of the median over the steps of the added variance.
    steady : tuple of float
        Of the error that all increments have in common (5,), px and rad.
    circle : tuple of float
        Of x, y and radius of the outline (3,), px.
    scale : float
        Of the size of a pixel in metres, relative, by the radius or by what was stated.
    """

    source: str
    step: tuple[float, ...] = (0.0,) * 5
    steady: tuple[float, ...] = (0.0,) * 5
    circle: tuple[float, ...] = (0.0,) * 3
    scale: float = 0.0

    @property
    def is_nothing(self) -> bool:
        """Whether the source added nothing."""
        return not (any(self.step) or any(self.steady) or any(self.circle) or self.scale)

    def items(self) -> dict[str, Any]:
        """The fields for ``summary.json``."""
        return {
            "source": self.source,
            "step": dict(zip(INCREMENTS, self.step, strict=True)),
            "steady": dict(zip(INCREMENTS, self.steady, strict=True)),
            "circle_px": dict(zip(("x", "y", "radius"), self.circle, strict=True)),
            "scale_relative": self.scale,
        }

    @classmethod
    def read(cls, items: Mapping[str, Any]) -> Entry:
        """From ``summary.json``."""
        step, steady, circle = (tuple(items[name].values()) for name in ("step", "steady", "circle_px"))
        return cls(items["source"], step, steady, circle, items["scale_relative"])


def read(items: Iterable[Mapping[str, Any]]) -> tuple[Entry, ...]:
    """The entries of a ``summary.json``."""
    return tuple(map(Entry.read, items))
