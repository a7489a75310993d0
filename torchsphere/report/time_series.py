"""Quantities of a result over time, in the units of figures and report."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from torchsphere.dynamics.scale import LAB_AXES
from torchsphere.motion.findings import Findings
from torchsphere.motion.ledger import INCREMENTS
from torchsphere.results.reader import ResultFolder, SIMotion
from torchsphere.runtime.arrays import Array
from torchsphere.sphere_map.decision import MadeMap

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


def sd_turned_rad(result: ResultFolder) -> Array | None:
    """Standard deviations (n, 3) of `ResultFolder.turned_rad`; None for results of versions that lack what is needed.

    In a sum of successive increments the errors of the poses between the first and the last cancel. Those of the two
    remain, the share of each increment's error that stays, the error that all increments share, and the radius's.
    """
    steady, share = result.summary.get("sd_steady"), result.summary.get("drift_share")
    if not isinstance(steady, dict) or share is None or not result.known.any():
        return None
    start = int(result.known.argmax())
    variance = _pose_variance(result.sd_increment[start:, 2:])
    count = np.arange(len(variance))[:, None]
    stays = np.zeros_like(variance)
    stays[1:] = share * np.cumsum(np.nan_to_num(variance[1:] + variance[:-1]), axis=0)
    shared = count * np.array([float(steady.get(name) or 0.0) for name in INCREMENTS[2:]])
    relative = float((result.summary.get("radius_effect") or {}).get("relative_sd_rotation") or 0.0)
    by_radius = relative * result.turned_rad[start:]
    sd = np.full((len(result.frame), 3), np.nan)
    sd[start:] = np.sqrt(variance[0] + variance + stays + shared**2 + by_radius**2)
    # The first angle is 0 by definition.
    sd[start] = np.where(np.isfinite(sd[start]), 0.0, np.nan)
    return np.where(np.isfinite(result.turned_rad), sd, np.nan)


def _pose_variance(sd_increment: Array) -> Array:
    """Variance (n, 3) of each pose: half the mean of the increments' to and from it."""
    half = np.full((2, len(sd_increment), 3), np.nan)
    half[0, 1:] = sd_increment[1:] ** 2 / 2
    half[1, :-1] = sd_increment[1:] ** 2 / 2
    known = np.isfinite(half)
    return np.where(known.any(0), np.where(known, half, 0.0).sum(0) / np.maximum(known.sum(0), 1), np.nan)


@dataclass(frozen=True)
class Raw:
    """Values (r, k) at times (r,), s; NaN where a frame was not measured."""

    time_s: Array
    values: Array


def raw_differences(result: ResultFolder) -> dict[str, Raw]:
    """Raw velocity (m/s), acceleration (m/s^2), force (N) and spin (rad/s) by their names; empty without SI units.

    Velocity and spin are differences of successive positions and the rotations between successive frames, at the middle
    of the interval. Accelerations are second differences of positions, at the middle frame.
    """
    scale, motion = result.summary.get("scale"), result.motion
    if motion is None or not scale or len(motion.time_s) < 3:
        return {}
    time, signs = motion.time_s, np.diag(LAB_AXES) if result.lab_frame else np.ones(3)
    position = _position(result) * scale["m_per_px"] * signs[:2]
    interval = np.diff(time)[:, None]
    velocity = np.diff(position, axis=0) / interval
    middle = 0.5 * (time[1:] + time[:-1])
    acceleration = np.diff(velocity, axis=0) / np.diff(middle)[:, None]
    found = {
        "velocity": Raw(middle, velocity),
        "acceleration": Raw(time[1:-1], acceleration),
        "spin": Raw(middle, result.increment[1:, 2:] / interval * signs),
    }
    mass = result.summary["settings"].get("mass_g")
    if mass is not None:
        found["force"] = Raw(time[1:-1], 1e-3 * mass * acceleration)
    return found


def _position(result: ResultFolder) -> Array:
    """Positions (n, 2), px; with a camera or a lens in the plane of the first depth, as those of the motion."""
    settings = result.summary["settings"]
    made = Findings.read(settings).map
    # Torch takes 1.2 s to import, and figures of an orthographic view do not need it.
    if settings.get("camera") is None and not (isinstance(made, MadeMap) and made.has_lens):
        return result.position
    from torchsphere.dynamics.depth_plane import PlaneView

    view = PlaneView.of(settings, made)
    magnification = result.radius / result.summary["circle"]["radius"]
    return result.position if view is None else view.position(result.position, magnification)
