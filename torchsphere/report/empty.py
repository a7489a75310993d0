"""Why a panel has nothing to show, and what to do about it: one sentence each."""

from __future__ import annotations

import numpy as np

from torchsphere.results.reader import ResultFolder

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
