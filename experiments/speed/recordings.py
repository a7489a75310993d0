"""Whole runs of ``torchsphere track`` from a file to the report, each in a process of its own: time and memory.

Claim: 2,000 frames of an 8 bit TIFF of 256 x 512 px with a spinning ball of R = 50 px run at 300 frames per second,
including all files that are written. 20,000 frames need less than 1.5 GB of memory.
"""

from __future__ import annotations

import numpy as np

from experiments.experiment import Row, table
from experiments.speed.files import SPINNING, SWINGING, Run, measured
from experiments.speed.footage import Footage
from experiments.speed.scope import Scope

#: Suffixes of recordings with the names of their formats.
FORMATS = {"tif": "TIFF", "cih": "MRAW", "mp4": "MP4 (H.264)"}

BALLS = {"spins": SPINNING, "swings": SWINGING}

#: Runs: ball, format, frames, and option ``--map``. The spinning ball's lengths are compared.
RUNS = (
    *(("spins", kind, 2000, "auto") for kind in FORMATS),
    *(("swings", kind, 2000, "auto") for kind in FORMATS),
    *(("spins", "cih", count, "auto") for count in (500, 1000, 5000, 20000)),
    ("swings", "cih", 20000, "auto"),
    ("spins", "tif", 2000, "off"),
    ("spins", "cih", 20000, "off"),
)

QUICK_RUNS = (("spins", "tif", 300, "auto"), ("swings", "tif", 300, "auto"))

#: Repeats of the run that has a limit of time: the fastest counts.
CLAIMED, REPEATS = ("spins", "tif", 2000, "auto"), 3

#: Limits: frames per second, GB.
FRAMES_PER_S, PEAK_GB = 300.0, 1.5

#: Runs by ball, format, frames and ``--map``.
Runs = dict[tuple[str, str, int, str], Run]


def compute(scope: Scope) -> Runs:
    """Each run once, the claimed one several times."""
    found: Runs = {}
    for key in QUICK_RUNS if scope.quick else RUNS:
        ball, kind, count, sphere_map = key
        if scope.allows(count):
            footage: Footage = BALLS[ball]
            scope.say(f"{count} frames as {FORMATS[kind]}, a ball that {ball}, --map {sphere_map}")
            runs = [measured(kind, footage, count, sphere_map) for _ in range(REPEATS if key == CLAIMED else 1)]
            found[key] = min(runs, key=lambda run: run.wall_s)
    return found


def rows(found: Runs) -> list[Row]:
    """The limits beside the times."""
    results = []
    tiff, long = found.get(CLAIMED), found.get(("spins", "cih", 20000, "auto"))
    if tiff is not None:
        of_track = tiff.frames / (tiff.open_s + tiff.circle_s + tiff.follow_s)
        results.append(
            Row(
                "speed",
                "2,000 frames of a spinning ball, TIFF to report",
                f"{FRAMES_PER_S:.0f} frames/s",
                f"{tiff.rate:.0f} frames/s; opened, found and followed alone {of_track:.0f}",
                tiff.rate >= FRAMES_PER_S,
            )
        )
    if long is not None:
        results.append(
            Row(
                "speed",
                "peak memory of 20,000 frames of a spinning ball",
                f"{PEAK_GB:g} GB",
                f"{long.peak_gb:.2f} GB",
                long.peak_gb < PEAK_GB,
            )
        )
    return results


def _cells(key: tuple[str, str, int, str], run: Run) -> list[str]:
    ball, kind, count, sphere_map = key
    label = f"{count:,} frames, {FORMATS[kind]}, a ball that {ball}{', --map off' if sphere_map == 'off' else ''}"
    stages = (run.import_s, run.open_s, run.circle_s, run.follow_s, run.rest_s)
    outcome = (f"{run.peak_gb:.2f}", f"{run.ok:,}", f"{run.on_map:,}", f"{run.error_px:.3f}")
    return [label, f"{run.wall_s:.1f}", f"{run.rate:.0f}", *(f"{s:.1f}" for s in stages), *outcome]


def growth(found: Runs) -> str:
    """How the time to follow the spinning ball grows with the number of frames, in words; empty for too few runs."""
    runs = [run for (ball, kind, _, how), run in found.items() if (ball, kind, how) == ("spins", "cih", "auto")]
    if len(runs) < 3:
        return ""
    seconds = [run.follow_s for run in runs]
    slope = float(np.polyfit(np.log([run.frames for run in runs]), np.log(seconds), 1)[0])
    return f"The time to follow the spinning ball grows with the number of frames to the power {slope:.2f}.\n"


def tables(found: Runs) -> list[str]:
    """Table of the runs under a sentence, and their growth."""
    head = ("recording", "s", "frames/s", "load", "open", "find", "follow", "the rest", "peak GB")
    outcome = ("frames ok", "on the map", "largest error of position (px)")
    runs = table((*head, *outcome), [_cells(key, run) for key, run in found.items()])
    return [f"A whole `track`, in a process of its own:\n\n{runs}", *filter(None, [growth(found)])]
