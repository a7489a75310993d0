"""Sentences on a result: which frames and quantities were measured or not, the reason, and the remedy."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from torchsphere.correlation.frame_status import ALL_KNOWN
from torchsphere.motion.track import why_unusable
from torchsphere.results.reader import NO_IMPACT, ResultFolder
from torchsphere.runtime.warning_levels import levels_of

#: Meaning and remedy of each status.
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
    "out_of_frame": ("most of the ball is outside the image", "Nothing to do; --frames A:B leaves these frames out."),
    "lost": (
        "the ball was not found here, or no step leads here from the frame before",
        "See with 'torchsphere info INPUT --preview ball.png' where the ball is found, and give it with --circle "
        "X,Y,R; start with --frames at a frame that shows the whole ball.",
    ),
}

#: Remedies if the circle was given.
REMEDIES_WITH_CIRCLE = {
    "not_converged": "The ball may turn or move too far from one frame to the next, or blur too much: raise the frame "
    "rate, or shorten the exposure. Check below that the circle that was given is the ball's outline.",
    "lost": "Check below that the circle that was given is the ball's outline in the first frame; start with --frames "
    "at a frame that shows the whole ball.",
}

#: Meaning and remedy of "weak_texture" if the model has no rotation.
WITHOUT_ROTATION = (
    "the translation was measured; the rotation was not, as the model 'translation' knows none",
    "Track again with --model rigid for the rotation, and for a translation that it does not bias.",
)

#: Short forms of meaning and remedy, for an empty panel.
REASONS = {
    "weak_texture": "too little pattern to tell the rotation:\nput spots of 3 to 5 px on the ball",
    "low_correlation": "the images do not match:\n{circle}, leave out what covers it with --ignore",
    "not_converged": "no motion explains the images:\nraise the frame rate, shorten the exposure, or {circle}",
    "out_of_frame": "most of the ball is outside the image:\nchoose other frames with --frames",
    "lost": "the ball was not found:\n{circle}, choose frames that show it whole with --frames",
}


@dataclass(frozen=True)
class Problem:
    """A status other than "ok": its frames, meaning and remedy."""

    frames: str
    meaning: str
    remedy: str


def verdict(result: ResultFolder) -> str:
    """A sentence on the number of measured frames."""
    n, good, located = len(result.status), int(np.isin(result.status, ALL_KNOWN).sum()), int(result.known.sum())
    if good == n:
        return f"All {n} frames were measured."
    if good == 0 and located == 0:
        return f"Nothing was measured: in none of the {n} frames was the ball found."
    # The first frame with the ball is "ok" although no step leads to this frame.
    if good <= 1 and not result.has_steps:
        return f"No motion was measured: the ball was found in {_count(located, 'frame')} of {n}, but not followed."
    unusable = why_unusable(result.status)
    if unusable:
        return f"{unusable[0].upper()}{unusable[1:]}."
    if good == 0:
        return f"The place of the ball was measured in {located} of {n} frames, its rotation in none."
    return f"{good} of {n} frames were measured in full, {n - good} were not."


def problems(result: ResultFolder) -> list[Problem]:
    """A problem for each status of the result except "ok"."""
    found = []
    for name in STATUSES:
        rows = np.flatnonzero(result.status == name)
        if name != "ok" and len(rows):
            frames = f"{_count(len(rows), 'frame')} {name.replace('_', ' ')} ({frame_runs(result.frame[rows])})"
            found.append(Problem(frames, *meaning_and_remedy(result, name)))
    return found


def meaning_and_remedy(result: ResultFolder, status: str) -> tuple[str, str]:
    """Meaning and remedy of a status in this result."""
    if result.without_rotation and status == "weak_texture":
        return WITHOUT_ROTATION
    meaning, remedy = STATUSES[status]
    return meaning, REMEDIES_WITH_CIRCLE.get(status, remedy) if result.circle_given else remedy


def missing_inputs(result: ResultFolder) -> list[str]:
    """A sentence for each missing input: the quantity that lacks it, and the option that gives the input."""
    sentences = []
    if result.summary.get("frame_rate") is None:
        sentences.append("Velocities and times are not measured: the frame rate is not known. Give it with --fps.")
    if result.motion is None and result.summary.get("scale") is None and not result.scale_given:
        sentences.append(
            "Lengths are in px, not in mm: no scale was given. Give the ball's diameter with --diameter-mm, or the "
            "size of a pixel with --mm-per-px."
        )
    if result.motion is not None and result.motion.force_N is None:
        sentences.append("Force is not measured: the mass is not known. Give it with --mass-g.")
    if result.sampled is None:
        sentences.append("No images are shown: none were kept with this result. Track again without --no-report.")
    return sentences


def warnings(result: ResultFolder, level: str) -> list[str]:
    """Warnings of a level in the summary, except those that `verdict`, `problems` and `missing_inputs` repeat."""
    repeated = ("The frame rate is not known", "No scale was given", *(() if result.has_steps else (NO_IMPACT,)))
    own = (text for of, text in levels_of(result.summary) if of == level and not text.startswith(repeated))
    return [text for text in own if "frames were not fully measured" not in text]


def why_empty(result: ResultFolder, key: str) -> str:
    """The reason why the time series ``key`` is empty, by the most frequent status other than "ok"."""
    if key in ("spin", "turned") and result.without_rotation:
        return "not measured: the model 'translation' knows no rotation;\ngive --model rigid"
    counts = {name: int((result.status == name).sum()) for name in REASONS}
    name = max(counts, key=lambda name: counts[name])
    if counts[name] == 0:
        return "not measured"
    circle = "check the circle that was given" if result.circle_given else "give the ball with --circle"
    reason = REASONS[name].format(circle=circle)
    return f"not measured: {name.replace('_', ' ')} in {counts[name]} of {len(result.status)} frames; {reason}"


def missing_for_si(result: ResultFolder) -> str:
    """The missing options for SI units, or for the force; empty if none is missing."""
    if result.motion is not None:
        return "" if result.motion.force_N is not None else "for the force give --mass-g"
    options = []
    if result.summary.get("frame_rate") is None or not np.isfinite(result.time_s).all():
        options.append("--fps")
    if result.summary.get("scale") is None and not result.scale_given:
        options.append("--diameter-mm or --mm-per-px")
    if not options:
        return ""
    units = "m/s" if result.summary["settings"].get("mass_g") is None else "m/s and N"
    return f"for {units} give {', and '.join(options)}"


def frame_runs(frames: NDArray[np.int64], most: int = 6) -> str:
    """Frame numbers as runs, as in 3, 7-9, 12; ``most`` runs at most."""
    runs = np.split(frames, np.flatnonzero(np.diff(frames) > 1) + 1)
    texts = [str(run[0]) if len(run) == 1 else f"{run[0]}-{run[-1]}" for run in runs[:most]]
    return ", ".join(texts) + (f" and {len(runs) - most} more runs" if len(runs) > most else "")


def _count(count: int, noun: str) -> str:
    return f"{count} {noun}{'' if count == 1 else 's'}"
