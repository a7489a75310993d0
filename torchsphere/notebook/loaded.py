"""`load`: a result folder read back into a Python session."""

from __future__ import annotations

import math
import os
from collections.abc import Mapping
from dataclasses import dataclass, field, fields
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import pyarrow.parquet as pq

from torchsphere.dynamics.ball import Ball
from torchsphere.dynamics.energy_balance import EnergyBalance, EnergyRow
from torchsphere.dynamics.estimate import Estimate
from torchsphere.dynamics.friction import Friction
from torchsphere.dynamics.impact_estimate import Impact
from torchsphere.dynamics.kinematics import Kinematics
from torchsphere.dynamics.scale import Scale
from torchsphere.geometry.circle import Circle
from torchsphere.geometry.orientation import matrices
from torchsphere.motion import ledger
from torchsphere.motion.findings import Findings
from torchsphere.motion.ledger import INCREMENTS
from torchsphere.motion.track import Track
from torchsphere.notebook.figures import drawn
from torchsphere.recording.facts import Facts
from torchsphere.results.reader import ResultFolder, SIMotion, read
from torchsphere.runtime.arrays import Array
from torchsphere.runtime.presentation import Presented
from torchsphere.settings.calibration import Calibration

if TYPE_CHECKING:
    from matplotlib.figure import Figure


@dataclass(frozen=True)
class Result(Presented):
    """A result folder.

    Attributes
    ----------
    folder : Path
    track : Track
        With the calibration, so that ``torchsphere.kinematics(result.track)`` computes the motion again.
    motion : Kinematics or None
        The numbers of ``kinematics.csv``; None without frame rate or scale. Angular accelerations are NaN and
        `Kinematics.draws` is None: they are not kept.
    impact : Impact or None
        The strongest.
    impacts : tuple of Impact
    warnings : tuple of str
    summary : dict
        ``summary.json``.
    """

    folder: Path
    track: Track
    motion: Kinematics | None
    impact: Impact | None
    impacts: tuple[Impact, ...]
    warnings: tuple[str, ...]
    summary: dict[str, Any] = field(repr=False)
    _read: ResultFolder = field(repr=False, compare=False)

    def __repr__(self) -> str:
        parts = [repr(part) for part in (self.track, self.motion, self.impact) if part is not None]
        return f"<Result {str(self.folder)!r}: {' '.join(parts)}>"

    def plot(self, kind: str = "motion") -> Figure:
        """A figure of the report: "motion", "rotation", "quality", "force_path", "path" or "residuals".

        Raises
        ------
        ValueError
            If there is no such figure, or the folder keeps no images or no force for it.
        """
        return drawn(self._read, kind)


def load(folder: str | os.PathLike[str]) -> Result:
    """Read a result folder of ``torchsphere track``, of `Track.save` or of `Kinematics.save`.

    Parameters
    ----------
    folder : str or path

    Returns
    -------
    Result

    Raises
    ------
    ValueError
        If it is no result folder, or is damaged.
    """
    place = Path(folder)
    found = read(place)
    try:
        track = _track(found)
        motion = None if found.motion is None else _motion(found, found.motion, track)
        impacts = tuple(_impact(one, motion, len(found.summary["impacts"])) for one in found.summary["impacts"])
        strongest = found.summary["impact"]
        impact = None if strongest is None else _impact(strongest, motion, max(len(impacts), 1))
    except (KeyError, TypeError, ValueError, OSError) as error:
        raise ValueError(f"{place}: the result is damaged ({error}); track the recording again") from error
    return Result(place, track, motion, impact, impacts, track.warnings, found.summary, found)


def _track(found: ResultFolder) -> Track:
    """The track, with the full precision of ``track.parquet``."""
    summary = found.summary
    table = pq.read_table(found.path / "track.parquet")

    def columns(*names: str) -> Array:
        return np.stack([table[name].to_numpy().astype(np.float64) for name in names], 1)

    # Results of earlier versions have neither of both.
    growth = columns("sd_growth")[1:, 0] if "sd_growth" in table.column_names else np.zeros(len(found.status) - 1)
    covariance = table["covariance"].combine_chunks().flatten().to_numpy().reshape(-1, 5, 5)
    found_out = Findings.read(summary["settings"])
    known = found_out.items()
    return Track(
        position=columns("x_px", "y_px"),
        increment=columns(*INCREMENTS)[1:],
        covariance=covariance[1:],
        orientation=matrices(columns("qw", "qx", "qy", "qz")),
        zncc=columns("zncc")[:, 0],
        iterations=table["iterations"].to_numpy(),
        status=found.status,
        radius=columns("radius_px")[:, 0],
        sd_growth=growth,
        sd_steady=np.array([summary.get("sd_steady", {}).get(name, 0.0) for name in INCREMENTS]),
        circle=_circle(summary["circle"], summary["input"]["first_frame"]),
        settings={name: value for name, value in summary["settings"].items() if name not in known},
        findings=found_out,
        ledger=ledger.read(summary.get("ledger") or ()),
        warnings=tuple(summary["warnings"]),
        calibration=Calibration.of_options(summary["settings"], summary["frame_rate"]),
        first_frame=summary["input"]["first_frame"],
        facts=_facts(summary),
        times=_uneven_times(found),
    )


def _uneven_times(found: ResultFolder) -> Array | None:
    """Times of the frames in frame intervals; None where they are evenly spaced, or not known."""
    rate = found.summary["frame_rate"]
    if rate is None or np.allclose(found.time_s * rate, found.frame, rtol=0, atol=1e-6 * max(len(found.frame), 1)):
        return None
    return found.time_s * rate


def _circle(circle: Mapping[str, Any], first_frame: int) -> Circle:
    names = {one.name for one in fields(Circle)}
    known = {name: value for name, value in circle.items() if name in names}
    unknown = {name: math.nan for name in known if name.startswith("sd_") and known[name] is None}
    others = tuple((x, y, radius) for x, y, radius in known.get("others", ()))
    return Circle(**known | unknown | {"frame": circle["frame"] - first_frame, "others": others})


def _facts(summary: Mapping[str, Any]) -> Facts:
    source = summary["input"]
    is_stated = summary.get("frame_rate_origin") not in (None, "given")
    return Facts(
        path=Path(source["path"]),
        kind=source["kind"],
        shape=(source["frames"], source["height_px"], source["width_px"]),
        frame_rate=summary["frame_rate"] if is_stated else None,
        **{name: source.get(name) for name in ("bit_depth", "exposure_s", "trigger_offset_frames")},
        **{name: source.get(name) for name in ("pixel_aspect", "bayer")},
        orientation=source.get("orientation", 1),
        origins=source.get("origins") or {},
    )


def _motion(found: ResultFolder, motion: SIMotion, track: Track) -> Kinematics:
    """The numbers of ``kinematics.csv`` with what summary.json says of them."""
    summary = found.summary
    scale = Scale(**summary["scale"])
    contact, impact = summary.get("contact_s"), summary.get("impact") or {}
    sds = [(impact.get(name) or {}).get("sd") for name in ("contact_start", "contact_end")]
    unknown = np.full((len(motion.time_s), 3), np.nan)
    return Kinematics(
        **vars(motion),
        angular_acceleration_rad_s2=unknown,
        sd_angular_acceleration_rad_s2=unknown,
        scale=scale,
        frame_rate=summary["frame_rate"],
        lab_frame=found.lab_frame,
        mass_kg=track.calibration.mass_kg,
        contact_s=None if not contact else np.asarray(contact, dtype=np.float64),
        sd_contact_s=None if not contact else np.array([math.nan if sd is None else sd for sd in sds]),
        draws=None,
        about={**(summary["differentiation"] or {}), "loaded": True},
        is_measured=np.isfinite(track.position[:, 0]),
        relative_sd_frame_rate=track.calibration.relative_sd_frame_rate,
        relative_sd_mass=track.calibration.relative_sd_mass,
        diameter_m=2 * track.circle.radius * scale.m_per_px,
        track=track,
    )


def _impact(items: Mapping[str, Any], motion: Kinematics | None, count: int) -> Impact:
    """An impact of summary.json, without the quantities of its contact force."""
    known = {one.name for one in fields(Impact)}
    estimates: dict[str, Any] = {
        name: _estimate(item) for name, item in items.items() if name in known and _is_estimate(item)
    }
    balance, friction, ball = (items.get(name) for name in ("energy_balance", "friction", "ball"))
    rows = {
        name: EnergyRow(**{column: _estimate(item) for column, item in row.items()})
        for name, row in (balance or {}).items()
    }
    words: dict[str, Any] = {n: _estimate(i) if _is_estimate(i) else i for n, i in (friction or {}).items()}
    return Impact(
        **estimates,
        energy_balance=EnergyBalance(**rows) if rows else None,
        friction=Friction(**words) if words else None,
        ball=None if ball is None else Ball(**ball),
        missing=tuple(items.get("missing", ())),
        budget=items.get("budget", {}),
        count=count,
        motion=motion,
    )


def _is_estimate(item: Any) -> bool:
    return isinstance(item, dict) and {"value", "sd", "unit"} <= item.keys()


def _estimate(item: Mapping[str, Any]) -> Estimate:
    """A number with its unit; null is NaN."""
    value, sd = (np.asarray(item[name], dtype=np.float64) for name in ("value", "sd"))
    return Estimate(value, sd, item["unit"])
