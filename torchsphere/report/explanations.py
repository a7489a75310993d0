"""A result in plain words: what was measured, what was not and why."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from torchsphere.results.reader import ALL_KNOWN, ResultFolder

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

#: How the summary's warning begins that says why there is no impact.
NO_IMPACT = "No impact is reported: "


def verdict(result: ResultFolder) -> str:
    """One sentence: how much was measured."""
    n, good = len(result.status), int(np.isin(result.status, ALL_KNOWN).sum())
    if good == n:
        return f"All {n} frames were measured."
    placed = int(result.known.sum())
    if good == 0 and placed == 0:
        return f"Nothing was measured: in none of the {n} frames was the ball found."
    # The frame in which the ball is first found is "ok" although no step leads to it.
    if good <= 1 and not result.has_steps:
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


def warnings(result: ResultFolder) -> list[str]:
    """The summary's warnings but those that `absent` and `problems` say already."""
    said: tuple[str, ...] = ("The frame rate is not known", "No scale was given")
    if not result.has_steps:
        # The verdict says it already: no motion was measured.
        said = (*said, NO_IMPACT)
    return [
        sentence
        for sentence in result.summary.get("warnings", [])
        if not sentence.startswith(said) and "frames were not fully measured" not in sentence
    ]


def runs(frames: NDArray[np.int64], most: int = 6) -> str:
    """As in 3, 7-9, 12: numbers as runs, the first few of them."""
    parts = np.split(frames, np.flatnonzero(np.diff(frames) > 1) + 1)
    texts = [str(part[0]) if len(part) == 1 else f"{part[0]}-{part[-1]}" for part in parts[:most]]
    return ", ".join(texts) + (f" and {len(parts) - most} more runs" if len(parts) > most else "")


def _count(count: int, thing: str) -> str:
    return f"{count} {thing}{'' if count == 1 else 's'}"


#: Per status, what keeps frames from being measured and what to do.
REASONS = {
    "weak_texture": "too little pattern to tell the rotation:\nput spots of 3 to 5 px on the ball",
    "low_correlation": "the images do not match:\n{circle}, leave out what covers it with --ignore",
    "not_converged": "no motion explains the images:\nraise the frame rate, shorten the exposure, or {circle}",
    "out_of_frame": "most of the ball is outside the image:\nchoose other frames with --frames",
    "lost": "the ball was not found:\n{circle}, choose frames that show it whole with --frames",
}

#: What to do about the circle: where it was found, and where it was given.
FOUND, GIVEN = "give the ball with --circle", "check the circle that was given"


def why_empty(result: ResultFolder, key: str) -> str:
    """Why the panel ``key`` of `panels.panels` is empty, by the status that most of the frames have but "ok"."""
    if key in ("spin", "turned") and result.without_rotation:
        return "not measured: the model 'translation' knows no rotation;\ngive --model rigid"
    counts = {name: int((result.status == name).sum()) for name in REASONS}
    name = max(counts, key=lambda name: counts[name])
    if counts[name] == 0:
        return "not measured"
    reason = REASONS[name].format(circle=GIVEN if result.circle_given else FOUND)
    return f"not measured: {name.replace('_', ' ')} in {counts[name]} of {len(result.status)} frames; {reason}"


def not_in_si(result: ResultFolder) -> str:
    """What to give so that figures are in SI units, or have the force; empty where nothing is missing."""
    if result.motion is not None:
        return "" if result.motion.force_N is not None else "for the force give --mass-g"
    missing = []
    if result.summary.get("frame_rate") is None or not np.isfinite(result.time_s).all():
        missing.append("--fps")
    settings = result.summary["settings"]
    if result.summary.get("scale") is None and not result.scale_given:
        missing.append("--diameter-mm or --mm-per-px")
    if not missing:
        return ""
    units = "m/s" if settings.get("mass_g") is None else "m/s and N"
    return f"for {units} give {', and '.join(missing)}"
