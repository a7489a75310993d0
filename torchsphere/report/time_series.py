"""What figures and report show against time: quantities with their bands, in units that a person reads."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from torchsphere.dynamics.scale import LAB_AXES
from torchsphere.results.reader import ResultFolder

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Panel:
    """One quantity over n frames.

    Attributes
    ----------
    key : str
        "position", "velocity", "force", "acceleration", "spin", "turned" or "zncc".
    title, unit : str
        In words; the unit is empty for pure numbers.
    names : tuple of str
        Of its k components.
    values : ndarray
        (n, k), NaN where not measured.
    sd : ndarray or None
        Standard deviations (n, k); None where none is stated.
    """

    key: str
    title: str
    unit: str
    names: tuple[str, ...]
    values: Array
    sd: Array | None

    @property
    def label(self) -> str:
        """Title with the unit, for an axis."""
        return f"{self.title} ({self.unit})" if self.unit else self.title


@dataclass(frozen=True)
class Abscissa:
    """Where the frames (n,) stand: time where it is known, otherwise the frame's number."""

    values: Array
    title: str
    unit: str
    per_second: float | None  # units per s; None for frame numbers

    @property
    def label(self) -> str:
        """Title with the unit, for an axis."""
        return f"{self.title} ({self.unit})" if self.unit else self.title


def abscissa(result: ResultFolder) -> Abscissa:
    """Times in ms, or in s where the recording is long, or frame numbers."""
    if not np.isfinite(result.time_s).all():
        return Abscissa(result.frame.astype(np.float64), "frame", "", None)
    long = float(np.ptp(result.time_s)) > 20
    return Abscissa(result.time_s * (1 if long else 1e3), "time", "s" if long else "ms", 1.0 if long else 1e3)


def panels(result: ResultFolder) -> list[Panel]:
    """All quantities of a result: in SI units where they are known, otherwise in px and degrees per frame."""
    xy = ("x", "y")
    if result.motion is None:
        step, sd = result.increment, result.sd_increment
        shown = [
            Panel("position", "position", "px", xy, result.position, None),
            Panel("velocity", "step", "px per frame", ("dx", "dy"), step[:, :2], sd[:, :2]),
            Panel(
                "spin",
                "rotation",
                "deg per frame",
                ("x", "y", "z"),
                np.degrees(step[:, 2:]),
                np.degrees(sd[:, 2:]),
            ),
        ]
    else:
        shown = _in_si(result)
    axes = np.diag(LAB_AXES) if result.lab_frame and result.motion is not None else np.ones(3)
    turned = np.degrees(result.turned_rad) * axes
    return [
        *shown,
        Panel("turned", "turned angle", "deg", ("x", "y", "z"), turned, None),
        Panel("zncc", "correlation", "", ("ZNCC",), result.zncc[:, None], None),
    ]


def _in_si(result: ResultFolder) -> list[Panel]:
    m = result.motion
    assert m is not None
    xy = ("x", "y")
    shown = [
        Panel("position", "position", "mm", xy, 1e3 * m.position_m, 1e3 * m.sd_position_m),
        Panel("velocity", "velocity", "m/s", xy, m.velocity_m_s, m.sd_velocity_m_s),
    ]
    if m.force_N is not None and m.sd_force_N is not None:
        unit, factor = _prefixed(m.force_N, "N")
        shown.append(Panel("force", "force", unit, xy, factor * m.force_N, factor * m.sd_force_N))
    else:
        unit, factor = _prefixed(m.acceleration_m_s2, "m/s²")
        values, sd = factor * m.acceleration_m_s2, factor * m.sd_acceleration_m_s2
        shown.append(Panel("acceleration", "acceleration", unit, xy, values, sd))
    names = ("x", "y", "z")
    return [*shown, Panel("spin", "spin", "rad/s", names, m.spin_rad_s, m.sd_spin_rad_s)]


def _prefixed(values: Array, unit: str) -> tuple[str, float]:
    """The unit with the prefix that the largest value asks for, and its factor."""
    largest = float(np.nanmax(np.abs(values))) if np.isfinite(values).any() else 0.0
    return (f"k{unit}", 1e-3) if largest >= 1000 else (unit, 1.0)
