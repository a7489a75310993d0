"""Frames that are wrong in silence, under many disturbances: ``python -m experiments.validation.attack``.

Claim: of 10,000 frames with the status "ok" none is wrong by more than six of its stated standard deviations and by
more than 0.05 px or 0.1 deg in a step, but for textures that repeat. Nor is a position wrong by more than six of the
standard deviations of its path and by half a px.

The ball, its flight, its texture and the camera's size of image differ with the seed; the program gets the images
alone, finds the circle, and runs with its defaults. A recording that is refused counts as flagged. Results are kept in
``experiments/cache``, so that a run that was broken off goes on; ``--anew`` measures all. ``--case NAME`` prints a line
per recording, ``--quick`` takes one seed of each case, and ``--spent`` the seeds that may serve to choose constants;
none of them writes the table.
"""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation

import torchsphere as ts
from experiments.experiment import CACHE, PX_DEG, Array, cached, key_of, publish, table
from experiments.validation import seeds
from experiments.validation.attack_cases import CASES
from experiments.validation.attack_footage import Recorded

#: A frame is silent beyond all of these: standard deviations, and px and deg of a step, and px of a position.
MOST_SD, MOST_PX, MOST_DEG, MOST_PLACE_PX = 6.0, 0.05, 0.1, 0.5

#: Seeds of each case, on which no constant is chosen.
SEEDS = seeds.ATTACK


@dataclass(frozen=True)
class Score:
    """Frames of recordings by what became of them, and the worst errors of "ok" frames."""

    tried: int
    ok: int
    silent: int
    worst_sd: float  # of all steps beyond the limit in px or deg; 0 without any
    worst_px: float
    worst_deg: float
    said: str = ""  # first sentence of the warnings, or the refusal


def score(made: Recorded, track: ts.Track) -> Score:
    """Compare a track with the truth."""
    if made.rival is not None and track.circle.others and _starts_nearer(track, made.rival, made.position):
        made = replace(made, position=made.rival)
    true = np.concatenate((np.diff(made.position, axis=0), (made.turns[1:] * made.turns[:-1].inv()).as_rotvec()), 1)
    # Of a turn by nearly 180 deg, the rotation left over, not the difference of the vectors.
    left = Rotation.from_rotvec(np.nan_to_num(track.increment[:, 2:])) * Rotation.from_rotvec(true[:, 2:]).inv()
    off = np.abs(np.concatenate((track.increment[:, :2] - true[:, :2], left.as_rotvec()), 1))
    sd = np.sqrt(np.diagonal(track.covariance, axis1=1, axis2=2) + track.sd_steady**2)
    is_ok = track.status[1:] == "ok"
    beyond = (off > MOST_SD * sd) & (off * PX_DEG > np.array([MOST_PX, MOST_PX, MOST_DEG, MOST_DEG, MOST_DEG]))
    silent = is_ok & (beyond.any(1) | _misplaced(made, track, sd)[1:])
    # A frame found again is "ok" without a step to it.
    seen = np.nan_to_num(off[is_ok] * PX_DEG) if is_ok.any() else np.zeros((1, 5))
    return Score(
        tried=len(is_ok),
        ok=int(is_ok.sum()),
        silent=int(silent.sum()),
        worst_sd=float(np.where(beyond & is_ok[:, None], off / sd, 0).max()),
        worst_px=float(seen[:, :2].max()),
        worst_deg=float(seen[:, 2:].max()),
        said=track.warnings[0] if track.warnings else "",
    )


def _starts_nearer(track: ts.Track, path: Array, other: Array) -> bool:
    """Whether the first circle lies nearer to the first ``path`` (n, 2) than to the ``other``."""
    frame, first = track.circle.frame, np.array([track.circle.x, track.circle.y])
    return bool(np.linalg.norm(path[frame] - first) < np.linalg.norm(other[frame] - first))


def _misplaced(made: Recorded, track: ts.Track, sd: Array) -> Array:
    """True (n,) where a position is off by more than the errors of its path and of the first circle."""
    off = np.linalg.norm(track.position - made.position, axis=1)
    steps = np.nan_to_num(sd[:, :2]).max(1)
    circle = np.nan_to_num(np.hypot(track.circle.sd_x, track.circle.sd_y))
    path = np.concatenate(([0.0], np.sqrt(np.cumsum(steps**2)) + track.sd_steady[:2].max() * np.arange(len(steps))))
    return np.nan_to_num(off) > np.maximum(MOST_PLACE_PX, MOST_SD * (path + circle))


def measure(name: str, seed: int) -> Score:
    """The score of one recording of a case."""
    made = CASES[name](seed)
    tried = len(made.images) - 1
    try:
        track = ts.track(made.images, log=False, **made.options)
    except ValueError as refusal:
        return Score(tried, 0, 0, 0.0, 0.0, 0.0, f"refused: {refusal}")
    return score(made, track)


def compute(names: Sequence[str], chosen: Sequence[int], *, anew: bool = False, tell: bool = False) -> dict[str, Score]:
    """Scores of the cases, over all their recordings."""
    found = {}
    for name in names:
        scores = []
        for seed in chosen:
            settings = {"case": name, "seed": seed}
            if anew:
                (CACHE / f"{key_of('attack', settings)}.json").unlink(missing_ok=True)
            scores.append(Score(**cached("attack", settings, lambda name=name, seed=seed: asdict(measure(name, seed)))))
            if tell:
                print(f"{name}, {seed}: {scores[-1]}", flush=True)
        found[name] = total(scores)
    return found


def total(scores: Sequence[Score]) -> Score:
    """The sum of several recordings."""
    counts = [sum(getattr(one, name) for one in scores) for name in ("tried", "ok", "silent")]
    worst = [max(getattr(one, name) for one in scores) for name in ("worst_sd", "worst_px", "worst_deg")]
    return Score(*counts, *worst)


def rows(found: dict[str, Score]) -> str:
    """The table of the cases, with their sum."""
    head = ("disturbance", "frames", "ok", "flagged", "silent", "worst px", "worst deg")
    lines = [
        (name, s.tried, s.ok, s.tried - s.ok, s.silent or "-", f"{s.worst_px:.3f}", f"{s.worst_deg:.3f}")
        for name, s in {**found, "all": total(list(found.values()))}.items()
    ]
    return table(head, lines)


def main(arguments: Sequence[str] | None = None) -> None:
    """Measure, and write the table unless only a part was asked for."""
    parser = argparse.ArgumentParser(prog=f"python -m experiments.validation.{Path(__file__).stem}")
    parser.add_argument("--case", choices=CASES, action="append", help="only this disturbance; may be given again")
    parser.add_argument("--quick", action="store_true", help="one seed of each case")
    parser.add_argument("--anew", action="store_true", help="measure again what is in the cache")
    parser.add_argument("--seeds", type=int, default=len(SEEDS), metavar="N", help="only N seeds of each case")
    parser.add_argument("--spent", action="store_true", help="the seeds on which constants were chosen")
    options = parser.parse_args(arguments)
    every = seeds.SPENT["attack"] if options.spent else SEEDS
    names, chosen = options.case or tuple(CASES), every[: 1 if options.quick else options.seeds]
    is_part = bool(options.case or options.quick or options.spent)
    found = compute(names, chosen, anew=options.anew, tell=is_part)
    if is_part:
        print(rows(found))
    else:
        publish("attack", f"validation.attack --seeds {len(chosen)}", rows(found))


if __name__ == "__main__":
    main()
