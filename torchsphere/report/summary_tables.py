"""Tables of the numbers in ``summary.json``: values with their standard deviations, rounded to significant digits."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np

from torchsphere.estimation.force_forms import HERTZ_POWER
from torchsphere.motion.ledger import INCREMENTS
from torchsphere.motion.ledger import read as read_ledger
from torchsphere.results.reader import NO_IMPACT, ResultFolder

NOT_MEASURED = "not measured"

#: Numbers of an impact, in the order of the report: key in the summary, name, unit, factor to that unit.
IMPACT: tuple[tuple[str, str, str, float], ...] = (
    ("speed_before", "Speed before", "m/s", 1),
    ("speed_after", "Speed after", "m/s", 1),
    ("velocity_before", "Velocity before (x, y)", "m/s", 1),
    ("velocity_after", "Velocity after (x, y)", "m/s", 1),
    ("contact_start", "Contact begins at", "ms", 1e3),
    ("duration", "Contact lasts", "ms", 1e3),
    ("peak_force", "Largest force", "kN", 1e-3),
    ("peak_time", "Largest force at", "ms", 1e3),
    ("mean_force", "Mean force in contact", "kN", 1e-3),
    ("impulse_size", "Impulse", "N s", 1),
    ("largest_penetration", "Largest penetration", "mm", 1e3),
    ("energy_lost_normal", "Energy lost along the normal", "J", 1),
    ("restitution_normal", "Restitution (normal speed after / before)", "", 1),
    ("restitution_tangential", "Tangential restitution", "", 1),
    ("angle_of_impact", "Angle of impact to the surface", "deg", 1),
    ("angle_of_exit", "Angle of exit to the surface", "deg", 1),
    ("spin_rate_before", "Spin before", "rev/s", 1),
    ("spin_rate_after", "Spin after", "rev/s", 1),
    ("spin_before", "Spin before (x, y, z)", "rev/s", 1),
    ("spin_after", "Spin after (x, y, z)", "rev/s", 1),
    ("energy_given", "Energy given to the target", "J", 1),
)

#: Numbers of an impact that are "not measured" without the ball's mass; the table omits other missing numbers.
ALWAYS_SHOWN = ("peak_force", "energy_given")

#: Factor of a contact stiffness from N/m^1.5 to MN/m^1.5.
STIFFNESS_FACTOR = 1e-6

#: Kinds of energy and columns of the energy balance: key in the summary and name.
ENERGIES = (("translation", "Translation"), ("spin", "Spin"), ("total", "Together"))
ENERGY_COLUMNS = (("before", "before"), ("after", "after"), ("lost", "given to the target or lost"))

#: Names of the sources of `dynamics.budget` in the report.
SOURCES = {
    "noise": "noise of the images",
    "radius": "radius of the outline",
    "scale": "diameter or size of a pixel",
    "centre": "centre of the outline",
    "steady_error": "steady error",
    "frame_rate": "frame rate",
    "mass": "mass",
}

#: Names of results that no other table has.
_BUDGET_NAMES = {name: text for name, text, _, _ in IMPACT} | {
    "energy_before": "Energy of translation before",
    "energy_after": "Energy of translation after",
    "spin_energy_before": "Energy of rotation before",
    "spin_energy_after": "Energy of rotation after",
}

#: Heads of the columns of the ledger.
LEDGER_COLUMNS = ("dx, px", "dy, px", "wx, deg", "wy, deg", "wz, deg", "x, px", "y, px", "radius, px", "scale, %")

Row = tuple[str, str]


#: Row of the angles of `torchsphere.dynamics.depth.Depth`.
OUT_OF_PLANE = "Flights against the image's plane (positive along z)"


@dataclass(frozen=True)
class Table:
    """A table of several columns; each row begins with its name, above which stands ``of``."""

    of: str
    columns: tuple[str, ...]
    rows: tuple[tuple[str, ...], ...]


def sections(result: ResultFolder) -> list[tuple[str, list[Row]]]:
    """Headings, each with its rows of a name and a value."""
    return [("Impact", _impact(result)), ("Mean motion", _mean_motion(result)), ("Ball and camera", _setup(result))]


def _impact(result: ResultFolder) -> list[Row]:
    impact = result.summary.get("impact")
    if not impact:
        return [("Contact", no_impact(result))]
    rows = []
    for key, name, unit, factor in IMPACT:
        if key in impact or key in ALWAYS_SHOWN:
            number = impact.get(key) or {}
            rows.append((name, with_sd(number.get("value"), number.get("sd"), unit, factor)))
    return rows + _contact_law(impact) + _friction(impact)


def _contact_law(impact: dict[str, Any]) -> list[Row]:
    """Stiffness of the contact, and whether the law describes it."""
    law = impact.get("contact_law")
    if not law:
        reason = impact.get("contact_law_missing")
        return [("Contact stiffness", f"{NOT_MEASURED}: {reason[:1].lower()}{reason[1:]}")] if reason else []
    stiffness = law["stiffness"]
    text = with_sd(stiffness["value"], stiffness["sd"], f"MN/m^{HERTZ_POWER:g}", STIFFNESS_FACTOR)
    return [("Contact stiffness (law of Hertz)", text), ("Law of Hertz", law["sentence"])]


def _friction(impact: dict[str, Any]) -> list[Row]:
    """Ratio of the impulses, slip, and the meaning of the ratio."""
    found = impact.get("friction")
    if not found:
        return []
    rows = (
        ("coefficient", "Tangential / normal impulse", ""),
        ("slip_before", "Slip before", "m/s"),
        ("slip_after", "Slip after", "m/s"),
    )
    texts = [(name, with_sd(found[key]["value"], found[key]["sd"], unit)) for key, name, unit in rows]
    return [*texts, ("Friction", found["sentence"])]


def energy_table(result: ResultFolder) -> Table | None:
    """The energy balance of the impact; None without an impact or a mass."""
    balance = (result.summary.get("impact") or {}).get("energy_balance")
    if not balance:
        return None

    def cells(row: dict[str, Any]) -> tuple[str, ...]:
        energies = (with_sd(row[key]["value"], row[key]["sd"], "J") for key, _ in ENERGY_COLUMNS)
        return *energies, with_sd(row["share"]["value"], row["share"]["sd"], "%", 100)

    rows = tuple((name, *cells(balance[key])) for key, name in ENERGIES)
    return Table("", (*(name for _, name in ENERGY_COLUMNS), "share of all energy before"), rows)


def no_impact(result: ResultFolder) -> str:
    """The reason why there is no impact."""
    if not result.has_steps:
        return f"{NOT_MEASURED}: no motion was measured"
    for sentence in result.summary.get("warnings", []):
        if sentence.startswith(NO_IMPACT):
            reason = sentence.removeprefix(NO_IMPACT)
            return f"{NOT_MEASURED}: {reason[:1].lower()}{reason[1:]}"
    return f"{NOT_MEASURED}: frame rate and scale are needed"


def _mean_motion(result: ResultFolder) -> list[Row]:
    means = result.summary.get("mean_motion", {})

    def mean(key: str, part: slice, unit: str, factor: float = 1.0) -> str:
        # Results of earlier versions may lack a mean or its standard deviation.
        value, sd = means.get(key), means.get(f"sd_{key}")
        return with_sd(value and value[part], sd and sd[part], unit, factor)

    rows = [
        ("Mean velocity (x, y)", mean("velocity_m_s", slice(2), "m/s")),
        *([(OUT_OF_PLANE, mean("out_of_plane_deg", slice(None), "deg"))] if means.get("out_of_plane_deg") else []),
        ("Mean spin (x, y, z)", mean("spin_rad_s", slice(3), "rad/s")),
        ("Mean step (x, y)", mean("increment_px_rad", slice(2), "px per frame")),
        ("Mean rotation (x, y, z)", mean("increment_px_rad", slice(2, 5), "deg per frame", math.degrees(1))),
    ]
    return rows if "velocity_m_s" in means else rows[-2:]


def _setup(result: ResultFolder) -> list[Row]:
    summary = result.summary
    source, circle = summary["input"], summary["circle"]
    rate, exposure = summary.get("frame_rate"), source.get("exposure_s")
    origin = f" ({summary['frame_rate_origin']})" if summary.get("frame_rate_origin") else ""
    size = f"{source['width_px']} x {source['height_px']} px"
    return [
        ("Recording", f"{source['path']}, {source['kind']}, {size}"),
        ("Frames", f"{source['first_frame']} to {source['last_frame']} of {source['frames']}"),
        ("Frame rate", "not known" if rate is None else f"{rate:,.10g} frames/s{origin}"),
        ("Exposure", "not known" if exposure is None else f"{1e6 * exposure:.4g} µs"),
        (f"Radius of the ball in frame {circle['frame']}", _radius(circle)),
        ("Size of a pixel", _pixel_size(result)),
        ("Axes", str(summary.get("axes", ""))),
    ]


def _radius(circle: dict[str, Any]) -> str:
    sd = circle.get("sd_radius")
    # If the position is guessed, the radius may still be known from later frames.
    if circle.get("sd_guessed") and sd > 0.5 * circle["sd_x"]:
        return f"{circle['radius']:.1f} px, to about {sd:.0f} px, not measured"
    return with_sd(circle["radius"], sd, "px")


def _pixel_size(result: ResultFolder) -> str:
    scale = result.summary.get("scale")
    if not scale:
        return "needs the frame rate as well" if result.scale_given else "not known"
    return with_sd(scale["m_per_px"], scale.get("sd_m_per_px"), "mm", 1e3)


def with_sd(value: Any, sd: Any, unit: str, factor: float = 1.0) -> str:
    """Value and standard deviation times ``factor``, as in "71.623 ± 0.049 m/s"; vectors are in brackets.

    The text is "not measured" if the value, or a component, is None or NaN.
    """
    values = np.atleast_1d(np.asarray(value, dtype=np.float64)) * factor
    if not np.isfinite(values).all():
        return NOT_MEASURED
    sds = np.full_like(values, np.nan) if sd is None else np.atleast_1d(np.asarray(sd, dtype=np.float64)) * factor
    pairs = zip(*map(_rounded, values, sds), strict=True)
    number, spread = (texts[0] if len(texts) == 1 else f"({', '.join(texts)})" for texts in pairs)
    known = bool((np.isfinite(sds) & (sds > 0)).all())
    return f"{number}{f' ± {spread}' if known else ''}{f' {unit}' if unit else ''}"


def _rounded(value: float, sd: float) -> tuple[str, str]:
    """Value and standard deviation, rounded to the second digit of the standard deviation."""
    if not (math.isfinite(sd) and sd > 0):
        return f"{value:.5g}", ""
    places = min(max(1 - math.floor(math.log10(sd)), 0), 9)
    return f"{value:.{places}f}", f"{sd:.{places}f}"


def budget_table(result: ResultFolder) -> Table | None:
    """The budget of the strongest impact: the share of each source in the variance of each result, in per cent.

    None without an impact, or for a result of an earlier version.
    """
    budget = (result.summary.get("impact") or {}).get("budget")
    if not budget:
        return None
    # A source without an effect on any result, as the mass where it was given as exact, has no column.
    sources = [name for name in SOURCES if any(shares.get(name) for shares in budget.values())]
    rows = tuple(
        (_BUDGET_NAMES.get(name, name), *(_per_cent(shares.get(source, 0.0)) for source in sources))
        for name, shares in budget.items()
    )
    return Table("Result", tuple(SOURCES[name] for name in sources), rows)


def _per_cent(share: float) -> str:
    """A share as whole per cent; "< 1" for less, "-" for none."""
    if share == 0:
        return "-"
    return "< 1" if share < 0.005 else f"{100 * share:.0f}"


def ledger_table(result: ResultFolder) -> Table | None:
    """The standard deviation that each source of error added to motion and outline; None for an earlier version."""
    entries = read_ledger(result.summary.get("ledger") or ())
    of_steps = [(entry.source, (*_in_deg(entry.step), *entry.circle, 100 * entry.scale)) for entry in entries]
    shared = [(f"{entry.source}: all steps alike", (*_in_deg(entry.steady), *4 * (0.0,))) for entry in entries]
    # Two digits; "-" for what a source does not add to.
    rows = tuple(
        (name, *(f"{value:.2g}" if value else "-" for value in values))
        for name, values in (*of_steps, *shared)
        if any(values)
    )
    return Table("Source", LEDGER_COLUMNS, rows) if rows else None


def _in_deg(motion: tuple[float, ...]) -> tuple[float, ...]:
    return tuple(
        math.degrees(value) if name.endswith("_rad") else value for name, value in zip(INCREMENTS, motion, strict=True)
    )
