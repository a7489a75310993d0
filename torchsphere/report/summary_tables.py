"""The numbers of a result in words, each with the digits that its uncertainty allows."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from torchsphere.report.explanations import NO_IMPACT
from torchsphere.results.reader import ResultFolder

NOT_MEASURED = "not measured"

#: Numbers of an impact in the order of a report: name in the summary, words, unit to show, factor.
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
    ("restitution_normal", "Restitution (normal speed after / before)", "", 1),
    ("restitution_tangential", "Tangential restitution", "", 1),
    ("angle_of_impact", "Angle of impact to the surface", "deg", 1),
    ("angle_of_exit", "Angle of exit to the surface", "deg", 1),
    ("spin_rate_before", "Spin before", "rev/s", 1),
    ("spin_rate_after", "Spin after", "rev/s", 1),
    ("spin_before", "Spin before (x, y, z)", "rev/s", 1),
    ("spin_after", "Spin after (x, y, z)", "rev/s", 1),
    ("energy_before", "Energy of translation before", "J", 1),
    ("energy_after", "Energy of translation after", "J", 1),
    ("energy_given", "Energy given to the target", "J", 1),
)

#: Numbers that need the ball's mass.
OF_MASS = ("peak_force", "peak_time", "mean_force", "impulse_size", "energy_before", "energy_after", "energy_given")

Section = tuple[str, list[tuple[str, str]]]


def sections(result: ResultFolder) -> list[Section]:
    """The summary's numbers, by headings."""
    found: list[Section] = []
    impact = result.summary.get("impact")
    if impact:
        rows = [
            (words, estimate(impact.get(name), unit, factor))
            for name, words, unit, factor in IMPACT
            if name in impact or (name in OF_MASS and name in ("peak_force", "energy_given"))
        ]
        found.append(("Impact", rows))
    else:
        found.append(("Impact", [("Contact", _no_impact(result))]))
    found.append(("Mean motion", _means(result)))
    found.append(("Ball and camera", _setup(result)))
    return found


def _no_impact(result: ResultFolder) -> str:
    if not result.has_steps:
        return f"{NOT_MEASURED}: no motion was measured"
    for sentence in result.summary.get("warnings", []):
        if sentence.startswith(NO_IMPACT):
            reason = sentence.removeprefix(NO_IMPACT)
            return f"{NOT_MEASURED}: {reason[:1].lower()}{reason[1:]}"
    return f"{NOT_MEASURED}: frame rate and scale are needed"


def _means(result: ResultFolder) -> list[tuple[str, str]]:
    means = result.summary.get("mean_motion", {})
    rows = []
    if "velocity_m_s" in means:
        rows.append(("Mean velocity (x, y)", _mean(means, "velocity_m_s", slice(2), "m/s")))
        rows.append(("Mean spin (x, y, z)", _mean(means, "spin_rad_s", slice(3), "rad/s")))
    rows.append(("Mean step (x, y)", _mean(means, "increment_px_rad", slice(2), "px per frame")))
    turn = _mean(means, "increment_px_rad", slice(2, 5), "deg per frame", math.degrees(1))
    return [*rows, ("Mean rotation (x, y, z)", turn)]


def _mean(means: dict[str, Any], name: str, part: slice, unit: str, factor: float = 1.0) -> str:
    """A part of a mean with its standard deviation, which results of earlier versions lack."""
    value, sd = means.get(name), means.get(f"sd_{name}")
    if value is None:
        return NOT_MEASURED
    return measured(factor * _vector(value)[part], None if sd is None else factor * _vector(sd)[part], unit)


def _setup(result: ResultFolder) -> list[tuple[str, str]]:
    summary = result.summary
    source, circle, scale = summary["input"], summary["circle"], summary.get("scale")
    rate, exposure = summary.get("frame_rate"), source.get("exposure_s")
    origin = summary.get("frame_rate_origin")
    rate_text = NOT_MEASURED if rate is None else f"{rate:,.10g} frames/s" + (f" ({origin})" if origin else "")
    size = f"{source['width_px']} x {source['height_px']} px"
    rows = [
        ("Recording", f"{source['path']}, {source['kind']}, {size}"),
        ("Frames", f"{source['first_frame']} to {source['last_frame']} of {source['frames']}"),
        ("Frame rate", "not known" if rate is None else rate_text),
        ("Exposure", "not known" if exposure is None else f"{1e6 * exposure:.4g} µs"),
        (f"Radius of the ball in frame {circle['frame']}", _radius(circle)),
    ]
    if scale:
        sd = scale.get("sd_m_per_px")
        rows.append(("Size of a pixel", measured(1e3 * scale["m_per_px"], None if sd is None else 1e3 * sd, "mm")))
    else:
        rows.append(("Size of a pixel", "not known" if not result.scale_given else "needs the frame rate as well"))
    rows.append(("Axes", str(summary.get("axes", ""))))
    return rows


def _radius(circle: dict[str, Any]) -> str:
    sd = circle.get("sd_radius")
    # Where the place is guessed the radius may be known from the frames that follow.
    if circle.get("sd_guessed") and sd > 0.5 * circle["sd_x"]:
        return f"{circle['radius']:.1f} px, to about {sd:.0f} px, not measured"
    return measured(circle["radius"], sd, "px")


def estimate(item: dict[str, Any] | None, unit: str, factor: float) -> str:
    """A number or vector of the summary with its standard deviation."""
    if item is None:
        return NOT_MEASURED
    value, sd = (_vector(item[name]) * factor for name in ("value", "sd"))
    return measured(value, sd, unit)


def measured(value: Any, sd: Any, unit: str) -> str:
    """As in 71.62 ± 0.05 m/s: digits by the standard deviation's second one; vectors in brackets."""
    values = _vector(value)
    if not np.isfinite(values).all():
        return NOT_MEASURED
    sds = np.full_like(values, np.nan) if sd is None else _vector(sd)
    texts = [_digits(v, s) for v, s in zip(values, sds, strict=True)]
    number = texts[0][0] if len(texts) == 1 else f"({', '.join(text[0] for text in texts)})"
    spread = texts[0][1] if len(texts) == 1 else f"({', '.join(text[1] for text in texts)})"
    known = bool((np.isfinite(sds) & (sds > 0)).all())
    return f"{number}{f' ± {spread}' if known else ''}{f' {unit}' if unit else ''}"


def _vector(value: Any) -> NDArray[np.float64]:
    items = value if isinstance(value, (list, tuple, np.ndarray)) else [value]
    return np.array([math.nan if v is None else v for v in np.ravel(np.array(items, dtype=object))], dtype=np.float64)


def _digits(value: float, sd: float) -> tuple[str, str]:
    """Value and standard deviation with the digits that the latter's second one leaves sense in."""
    if not (math.isfinite(sd) and sd > 0):
        return f"{value:.5g}", ""
    places = min(max(1 - math.floor(math.log10(sd)), 0), 9)
    return f"{value:.{places}f}", f"{sd:.{places}f}"
