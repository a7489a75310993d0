"""Quantities of a result over time, in the units of figures and report."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from torchsphere.report.raw_differences import Raw, raw_differences
from torchsphere.report.turned_angles import sd_turned_rad
from torchsphere.results.reader import ResultFolder, SIMotion

Array = NDArray[np.float64]

XY, XYZ = ("x", "y"), ("x", "y", "z")


@dataclass(frozen=True)
class TimeSeries:
    """One quantity over n frames, with k components."""

    key: str  # "position", "velocity", "force", "acceleration", "spin", "turned" or "zncc"
    title: str
    unit: str  # empty for pure numbers
    components: tuple[str, ...]
    values: Array  # (n, k), NaN where not measured
    sd: Array | None = None  # standard deviations (n, k); None if none are stated
    raw: Raw | None = None  # raw differences of the measured values, in this unit; None if there are none

    @property
    def is_empty(self) -> bool:
        """Whether no value was measured."""
        return not np.isfinite(self.values).any()

    @property
    def has_sd(self) -> bool:
        """Whether a standard deviation is known."""
        return not self.is_empty and self.sd is not None and bool(np.isfinite(self.sd).any())


@dataclass(frozen=True)
class Abscissa:
    """Times (n,) of the frames, or their numbers if no time is known."""

    values: Array
    title: str
    unit: str
    per_second: float | None  # units per s; None for frame numbers


def axis_label(quantity: TimeSeries | Abscissa) -> str:
    """Title and unit, for an axis."""
    return f"{quantity.title} ({quantity.unit})" if quantity.unit else quantity.title


def abscissa(result: ResultFolder) -> Abscissa:
    """Times in ms, or in s for a long recording, or frame numbers."""
    if not np.isfinite(result.time_s).all():
        return Abscissa(result.frame.astype(np.float64), "frame", "", None)
    unit, per_second = ("s", 1.0) if float(np.ptp(result.time_s)) > 20 else ("ms", 1e3)
    return Abscissa(result.time_s * per_second, "time", unit, per_second)


def time_series(result: ResultFolder) -> list[TimeSeries]:
    """All quantities of a result: in SI units if they are known, otherwise in px and degrees per frame."""
    turned, sd_turned = np.degrees(result.turned_rad) * result.axis_signs, sd_turned_rad(result)
    return [
        *(_in_px(result) if result.motion is None else _with_raw(_in_si(result.motion), result)),
        TimeSeries("turned", "turned angle", "deg", XYZ, turned, None if sd_turned is None else np.degrees(sd_turned)),
        TimeSeries("zncc", "correlation", "", ("ZNCC",), result.zncc[:, None]),
    ]


def _in_px(result: ResultFolder) -> list[TimeSeries]:
    step, sd = result.increment, result.sd_increment
    turn, sd_turn = np.degrees(step[:, 2:]), np.degrees(sd[:, 2:])
    return [
        TimeSeries("position", "position", "px", XY, result.position),
        TimeSeries("velocity", "step", "px per frame", ("dx", "dy"), step[:, :2], sd[:, :2]),
        TimeSeries("spin", "rotation", "deg per frame", XYZ, turn, sd_turn),
    ]


def _in_si(m: SIMotion) -> list[TimeSeries]:
    if m.force_N is not None and m.sd_force_N is not None:
        second = _prefixed("force", "N", *_with_depth(m, "force_N"))
    else:
        second = _prefixed("acceleration", "m/s²", *_with_depth(m, "acceleration_m_s2"))
    velocity, sd_velocity = _with_depth(m, "velocity_m_s")
    return [
        TimeSeries("position", "position", "mm", XY, 1e3 * m.position_m, 1e3 * m.sd_position_m),
        TimeSeries("velocity", "velocity", "m/s", XYZ[: velocity.shape[1]], velocity, sd_velocity),
        second,
        TimeSeries("spin", "spin", "rad/s", XYZ, m.spin_rad_s, m.sd_spin_rad_s),
    ]


def _with_depth(m: SIMotion, name: str) -> tuple[Array, Array]:
    """A vector and its standard deviation (n, 2), or (n, 3) where the motion along the axis is known."""
    found: Array = getattr(m, name)
    sd: Array = getattr(m, "sd_" + name)
    if m.depth is None or getattr(m.depth, name) is None:
        return found, sd
    along, sd_along = getattr(m.depth, name), getattr(m.depth, "sd_" + name)
    return np.column_stack((found, along)), np.column_stack((sd, sd_along))


def _with_raw(series: list[TimeSeries], result: ResultFolder) -> list[TimeSeries]:
    """The time series with their raw differences in their units."""
    raw = raw_differences(result)

    def in_unit(quantity: TimeSeries) -> TimeSeries:
        found = raw.get(quantity.key)
        if found is None:
            return quantity
        factor = 1e-3 if quantity.unit.startswith("k") else 1.0
        return replace(quantity, raw=Raw(found.time_s, factor * found.values))

    return [in_unit(quantity) for quantity in series]


def _prefixed(key: str, unit: str, values: Array, sd: Array) -> TimeSeries:
    """The quantity in its unit, or in thousands of the unit if its largest value is 1000 or more."""
    largest = float(np.nanmax(np.abs(values))) if np.isfinite(values).any() else 0.0
    if largest < 1000:
        return TimeSeries(key, key, unit, XYZ[: values.shape[1]], values, sd)
    return TimeSeries(key, key, f"k{unit}", XYZ[: values.shape[1]], 1e-3 * values, 1e-3 * sd)
