"""A result in plain words: what was measured, what was not and why, and the numbers with their uncertainty."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from torchsphere.report.folder import ALL_KNOWN, ResultFolder

NOT_MEASURED = "not measured"

#: What each status means, and what to do about it.
STATUSES: dict[str, tuple[str, str]] = {
    "ok": ("translation and rotation were measured", ""),
    "weak_texture": (
        "the ball shows too little pattern: its place is known from its outline, its rotation is not",
        "Put a pattern of spots on the ball, 3 to 5 px each, or light it so that its pattern shows.",
    ),
    "low_correlation": (
        "the image does not look like the one before it carried along: something covers the ball, or light or "
        "sharpness changed",
        "Look at these frames below; leave out what covers the ball with --ignore, or these frames with --frames.",
    ),
    "not_converged": (
        "no motion was found that explains the image",
        "The ball may turn or move too far from one frame to the next, or blur too much: raise the frame rate, shorten "
        "the exposure, or give the outline with --circle.",
    ),
    "out_of_frame": (
        "most of the ball is outside the image",
        "Nothing to do; --frames A:B leaves these frames out.",
    ),
    "lost": (
        "the ball was not found here, or no step leads here from the frame before",
        "See with 'torchsphere info INPUT --preview ball.png' where the ball is found, and give it with --circle "
        "X,Y,R; start with --frames at a frame that shows the whole ball.",
    ),
}

#: What to do where a circle was given already.
WITH_CIRCLE = {
    "not_converged": "The ball may turn or move too far from one frame to the next, or blur too much: raise the frame "
    "rate, or shorten the exposure. Check below that the circle that was given is the ball's outline.",
    "lost": "Check below that the circle that was given is the ball's outline in the first frame; start with --frames "
    "at a frame that shows the whole ball.",
}

#: The same of frames in which the model, not the pattern, kept the rotation from being measured.
WITHOUT_ROTATION = (
    "the translation was measured; the rotation was not, as the model 'translation' knows none",
    "Track again with --model rigid for the rotation, and for a translation that it does not bias.",
)

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

#: How the summary's warning begins that says why there is no impact.
NO_IMPACT = "No impact is reported: "

Section = tuple[str, list[tuple[str, str]]]


def verdict(result: ResultFolder) -> str:
    """One sentence: how much was measured."""
    n, good = len(result.status), int(np.isin(result.status, ALL_KNOWN).sum())
    if good == n:
        return f"All {n} frames were measured."
    placed = int(result.known.sum())
    if good == 0 and placed == 0:
        return f"Nothing was measured: in none of the {n} frames was the ball found."
    # The frame in which the ball is first found is "ok" although no step leads to it.
    if good <= 1 and not _moved(result):
        return f"No motion was measured: the ball was found in {_count(placed, 'frame')} of {n}, but not followed."
    if good == 0:
        return f"The place of the ball was measured in {placed} of {n} frames, its rotation in none."
    return f"{good} of {n} frames were measured in full, {n - good} were not."


def problems(result: ResultFolder) -> list[dict[str, str]]:
    """For each status but "ok" that occurs: which frames, what it means, and what to do."""
    found = []
    for name in STATUSES:
        meaning, remedy = told(result, name)
        rows = np.flatnonzero(result.status == name)
        if name == "ok" or len(rows) == 0:
            continue
        frames = f"{_count(len(rows), 'frame')} {name.replace('_', ' ')} ({runs(result.frame[rows])})"
        found.append({"status": name, "frames": frames, "meaning": meaning, "remedy": remedy})
    return found


def told(result: ResultFolder, name: str) -> tuple[str, str]:
    """What the status ``name`` means in this result, and what to do about it."""
    if result.without_rotation and name == "weak_texture":
        return WITHOUT_ROTATION
    meaning, remedy = STATUSES[name]
    return meaning, WITH_CIRCLE.get(name, remedy) if result.circle_given else remedy


def absent(result: ResultFolder) -> list[str]:
    """What the report lacks as a whole, and what to give so that it does not."""
    sentences = []
    if result.summary.get("frame_rate") is None:
        sentences.append("Velocities and times are not measured: the frame rate is not known. Give it with --fps.")
    if result.motion is None and result.summary.get("scale") is None and not _scale_given(result):
        sentences.append(
            "Lengths are in px, not in mm: no scale was given. Give the ball's diameter with --diameter-mm, or the "
            "size of a pixel with --mm-per-px."
        )
    if result.motion is not None and result.motion.force_N is None:
        sentences.append("Force is not measured: the mass is not known. Give it with --mass-g.")
    if result.sampled is None:
        sentences.append("No images are shown: none were kept with this result. Track again without --no-report.")
    return sentences


def _scale_given(result: ResultFolder) -> bool:
    settings = result.summary["settings"]
    return settings.get("diameter_mm") is not None or settings.get("mm_per_px") is not None


def warnings(result: ResultFolder) -> list[str]:
    """The summary's warnings but those that `absent` and `problems` say already."""
    said: tuple[str, ...] = ("The frame rate is not known", "No scale was given")
    if not _moved(result):
        # The verdict says it already: no motion was measured.
        said = (*said, NO_IMPACT)
    return [
        sentence
        for sentence in result.summary.get("warnings", [])
        if not sentence.startswith(said) and "frames were not fully measured" not in sentence
    ]


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
    if not _moved(result):
        return f"{NOT_MEASURED}: no motion was measured"
    for sentence in result.summary.get("warnings", []):
        if sentence.startswith(NO_IMPACT):
            reason = sentence.removeprefix(NO_IMPACT)
            return f"{NOT_MEASURED}: {reason[:1].lower()}{reason[1:]}"
    return f"{NOT_MEASURED}: frame rate and scale are needed"


def _moved(result: ResultFolder) -> bool:
    return bool(np.isfinite(result.increment[:, 0]).any())


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
        rows.append(("Size of a pixel", "not known" if not _scale_given(result) else "needs the frame rate as well"))
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


def runs(frames: NDArray[np.int64], most: int = 6) -> str:
    """As in 3, 7-9, 12: numbers as runs, the first few of them."""
    parts = np.split(frames, np.flatnonzero(np.diff(frames) > 1) + 1)
    texts = [str(part[0]) if len(part) == 1 else f"{part[0]}-{part[-1]}" for part in parts[:most]]
    return ", ".join(texts) + (f" and {len(parts) - most} more runs" if len(parts) > most else "")


def _count(count: int, thing: str) -> str:
    return f"{count} {thing}{'' if count == 1 else 's'}"


def _vector(value: Any) -> NDArray[np.float64]:
    items = value if isinstance(value, (list, tuple, np.ndarray)) else [value]
    return np.array([math.nan if v is None else v for v in np.ravel(np.array(items, dtype=object))], dtype=np.float64)


def _digits(value: float, sd: float) -> tuple[str, str]:
    """Value and standard deviation with the digits that the latter's second one leaves sense in."""
    if not (math.isfinite(sd) and sd > 0):
        return f"{value:.5g}", ""
    places = min(max(1 - math.floor(math.log10(sd)), 0), 9)
    return f"{value:.{places}f}", f"{sd:.{places}f}"
