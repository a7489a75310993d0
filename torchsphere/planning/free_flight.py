"""Uncertainty measured on a free flight, without a target: table 3 of the paper for any set-up.

In free flight the velocity is constant and the force is zero, so all scatter is error, from every source at once:
noise, interpolation, blur, light (section 5.2 of the paper).
"""

from __future__ import annotations

import json
import math
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
from numpy.typing import NDArray

from torchsphere.motion.track import Track
from torchsphere.planning.expected import Setup
from torchsphere.runtime.arrays import Array
from torchsphere.settings.limits import SettingError

#: Deviation of an interval from the usual one, as a share of it, from which it is a gap.
LONGER = 0.1

#: Fewest increments that give a standard deviation, to a fifth (docs/constants.toml).
MIN_STEPS = 12

#: Least change of the velocity over the recording that is no scatter, in standard deviations (docs/constants.toml).
MIN_CHANGE_SD = 5.0

#: Least sudden change that no free flight has, as a share of the speed (docs/constants.toml).
MIN_SUDDEN_SHARE = 0.1

#: Deviation from a straight line over time of a sudden change, as a share of the change (docs/constants.toml).
MIN_NONLINEARITY = 0.1


@dataclass(frozen=True)
class Flight:
    """A measured free flight, and its set-up."""

    increment: Array  # (n - 1, 5), px and rad; NaN if not measured
    stated: Array  # median of the stated standard deviations (5,), px and rad
    setup: Setup  # speed, direction and spin as measured
    origin: str

    @property
    def velocity_m_s(self) -> Array:
        """(n - 1, 2), an increment over the frame interval."""
        return self.increment[:, :2] * self.setup.m_per_px * self.setup.frame_rate

    @property
    def force_N(self) -> Array:  # noqa: N802  (N is newton)
        """(n - 2, 2), mass times the difference of successive velocities over the interval."""
        return np.diff(self.velocity_m_s, axis=0) * self.setup.mass_kg * self.setup.frame_rate

    @property
    def spin_rad_s(self) -> Array:
        """(n - 1, 3)."""
        return self.increment[:, 2:] * self.setup.frame_rate

    @property
    def covariance(self) -> Array:
        """Covariance (5, 5) of the increments by their scatter."""
        return np.cov(self.increment[np.isfinite(self.increment).all(1)].T)

    @property
    def warnings(self) -> tuple[str, ...]:
        """A sentence if the scatter does not measure the uncertainty."""
        change = velocity_change(self.velocity_m_s)
        if change is None:
            return ()
        return (
            f"The velocity {change.text} over the recording, more than it scatters: a target, drag or gravity is in "
            "the standard deviations as well; take fewer frames, of free flight alone.",
        )


def mean_and_sd(values: Array) -> tuple[Array, Array]:
    """Mean and standard deviation (k,) of values (n, k) without their NaN entries; NaN of none, and of one alone."""
    known = np.isfinite(values)
    count = known.sum(0)
    mean = np.where(known, values, 0.0).sum(0) / np.where(count > 0, count, np.nan)
    squares = (np.where(known, values - mean, 0.0) ** 2).sum(0)
    return mean, np.sqrt(squares / np.where(count > 1, count - 1, np.nan))


class FlightCalibration(NamedTuple):
    """Values that convert px and frames to SI units; None if they are not known."""

    frame_rate: float | None = None
    diameter_mm: float | None = None
    mass_g: float | None = None
    shutter_s: float | None = None

    def required(self, origin: str) -> tuple[float, float, float]:
        """Frame rate, diameter and mass; raises ValueError if one of them is not known."""
        if self.frame_rate is None or self.diameter_mm is None or self.mass_g is None:
            named = {"fps": self.frame_rate, "diameter_mm": self.diameter_mm, "mass_g": self.mass_g}
            missing = " and ".join(f"`{name}`" for name, value in named.items() if value is None)
            raise SettingError(f"{origin}: a plan needs frame rate, diameter and mass; give {missing}")
        return self.frame_rate, self.diameter_mm, self.mass_g


def from_track(track: Track, origin: str, given: FlightCalibration) -> Flight:
    """The flight of a track.

    Raises ValueError if frame rate, diameter or mass are missing, too few increments were measured, or the ball
    stands still or does not fly freely.
    """
    _require_rotation(origin, track.settings.get("model"))
    sd = np.sqrt(np.diagonal(track.covariance, axis1=1, axis2=2))
    return _flight(_of_one_interval(track.increment, track.durations), sd, track.circle.radius, origin, given)


def _of_one_interval(increment: Array, durations: Array) -> Array:
    """The increments (n - 1, 5) without those across a gap; ``durations`` (n - 1,) are in frame intervals."""
    return np.where(np.abs(durations - 1)[:, None] > LONGER, np.nan, increment)


def from_result(folder: Path, given: FlightCalibration) -> Flight:
    """The flight of a result folder of ``torchsphere track``; given values replace those of its summary.

    Raises ValueError or OSError if the folder is no such result, or a value is missing.
    """
    try:
        summary = json.loads((folder / "summary.json").read_text(encoding="utf-8"))
        table = pq.read_table(folder / "track.parquet").to_pydict()
        names = ("dx_px", "dy_px", "wx_rad", "wy_rad", "wz_rad")
        values = (np.stack([np.array(table[p + name], dtype=float)[1:] for name in names], 1) for p in ("", "sd_"))
        increment, sd = values
        if summary["frame_rate"] is not None:
            times = np.array(table["time_s"], dtype=float) * summary["frame_rate"]
            increment = _of_one_interval(increment, np.diff(times))
        radius, settings = float(summary["circle"]["radius"]), summary["settings"]
        recorded = _recorded(summary, settings, radius)
    except (KeyError, TypeError, json.JSONDecodeError, pa.ArrowException) as error:
        raise ValueError(f"{folder}: is no whole result of 'torchsphere track' ({error}); track again") from error
    origin = f"result folder {folder.name}"
    _require_rotation(origin, settings.get("model"))
    known = (value if value is not None else default for value, default in zip(given, recorded, strict=True))
    return _flight(increment, sd, radius, origin, FlightCalibration(*known))


def _recorded(summary: dict[str, Any], settings: dict[str, Any], radius: float) -> FlightCalibration:
    scale, diameter, mm_per_px = summary["scale"], settings.get("diameter_mm"), settings.get("mm_per_px")
    # Without a frame rate the summary has no scale, only the settings for it.
    if scale is not None:
        mm_per_px = 1e3 * float(scale["m_per_px"])
    if mm_per_px is not None:
        diameter = 2 * radius * mm_per_px
    return FlightCalibration(summary["frame_rate"], diameter, settings["mass_g"], summary["input"]["exposure_s"])


def _require_rotation(origin: str, model: str | None) -> None:
    if model == "translation":
        raise SettingError(
            f"{origin}: it was tracked with the model 'translation', which measures no rotation, and a plan needs it; "
            "track again with `model` = rigid"
        )


def _require_steps(origin: str, complete: int, translations: int) -> None:
    """Raise ValueError if too few increments are complete, among those whose translation was measured."""
    if complete >= MIN_STEPS:
        return
    if translations >= MIN_STEPS:
        raise ValueError(
            f"{origin}: the ball shows too little texture: of {translations} increments {complete} have a rotation, "
            f"and {MIN_STEPS} are needed; put a pattern of spots on the ball, or light it so that its pattern shows"
        )
    raise ValueError(
        f"{origin}: {complete} increments were measured, and {MIN_STEPS} are needed for a standard deviation; "
        "take a longer recording"
    )


def _flight(increment: Array, sd: Array, radius: float, origin: str, known: FlightCalibration) -> Flight:
    """The flight with increments (n - 1, 5) and their standard deviations."""
    frame_rate, diameter_mm, mass_g = known.required(origin)
    valid = np.isfinite(increment).all(1)
    _require_steps(origin, int(valid.sum()), int(np.isfinite(increment[:, :2]).all(1).sum()))
    px_per_mm = 2 * radius / diameter_mm
    mean = increment[valid].mean(0)
    spin = mean[2:] * frame_rate / (2 * math.pi)
    if not mean[:2].any():
        raise ValueError(f"{origin}: the ball does not move; take a recording of its free flight")
    setup = Setup(
        speed_m_s=float(np.hypot(*mean[:2])) * 1e-3 / px_per_mm * frame_rate,
        direction_deg=math.degrees(math.atan2(mean[1], mean[0])),
        spin_rev_s=(float(spin[0]), float(spin[1]), float(spin[2])),
        frame_rate=frame_rate,
        px_per_mm=px_per_mm,
        diameter_mm=diameter_mm,
        mass_g=mass_g,
        shutter_s=known.shutter_s,
    )
    flight = Flight(increment, np.median(sd[valid], 0), setup, origin)
    change = velocity_change(flight.velocity_m_s)
    if change is not None and change.is_sudden and change.share > MIN_SUDDEN_SHARE:
        raise ValueError(
            f"{origin}: this is no free flight: the velocity {change.text}, {100 * change.share:.0f} % of the speed, "
            "as by an impact; track the frames before it alone with 'torchsphere track --frames A:B' and give that "
            "result"
        )
    return flight


class Change(NamedTuple):
    """Change of a velocity: in words, as a share of the speed, and whether it is sudden."""

    text: str
    share: float
    is_sudden: bool


def velocity_change(velocity_m_s: Array) -> Change | None:
    """The change of the velocity (m, 2) over the recording; None if it only scatters."""
    valid = np.isfinite(velocity_m_s).all(1)
    known = velocity_m_s[valid]
    third = len(known) // 3
    start, end = known[:third].mean(0), known[-third:].mean(0)
    change = end - start
    # Scatter from one increment to the next, which a slow change does not enter.
    scatter = np.diff(known, axis=0).std(0) / math.sqrt(third)
    excess = np.abs(change) - MIN_CHANGE_SD * scatter
    axis = int(excess.argmax())
    if excess[axis] <= 0:
        return None
    size, speed = abs(float(change[axis])), max(float(np.hypot(*start)), float(np.hypot(*end)))
    is_sudden = _nonlinearity(np.flatnonzero(valid), known[:, axis]) > MIN_NONLINEARITY * size
    return Change(f"along {'xy'[axis]} changes by {change[axis]:.3g} m/s", size / speed, is_sudden)


def _nonlinearity(frames: NDArray[np.int64], values: Array) -> float:
    """Deviation of values (m,) from a straight line over their frames (m,), rms, without their scatter."""
    residual = values - np.polyval(np.polyfit(frames, values, 1), frames)
    return math.sqrt(max(float(residual.var()) - float(np.diff(values).var()) / 2, 0.0))
