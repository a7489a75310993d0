"""A whole `ts.track` with a given circle: the default, pairs, and other methods on the same frames, in turns.

Claim: 300 frames of R = 50 px that turn by 0.57 deg per frame take 6 ms per frame, all in all, and six times OpenCV's
ECC, which measures two translations; 2,000 frames take 2 ms per frame.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
import torch

import torchsphere as ts
from experiments.experiment import Row, table
from experiments.speed.clock import Works, in_turns
from experiments.speed.footage import CALM, FAST, SPIN, Array, Footage, Motion
from experiments.speed.rivals import RIVALS
from experiments.speed.scope import Scope
from torchsphere.sphere_map.decision import MadeMap, NoMap

#: Frames at every radius; radii, px; frames at R = 50 px.
FRAMES, RADII, LENGTHS = 100, (15, 30, 50, 100, 150), (10, 30, 100, 300, 1000, 2000)

MOTIONS = {"hardly turns": CALM, "spins": SPIN, "spins fast": FAST}

#: Pairs that the other methods take: up to R = 50 px, and at least. Larger balls get fewer.
RIVAL_PAIRS, FEWEST_PAIRS = 64, 8

DEFAULT, PAIRS, ECC = "torchsphere", "torchsphere by pairs", "OpenCV ECC (two translations)"

#: Limits: ms per frame of 300 frames, share of ECC's time, ms per frame of 2,000 frames.
FRAME_MS, ECC_SHARE, LONG_MS = 6.0, 6.0, 2.0


@dataclass(frozen=True)
class Cell:
    """Times per frame by way, ms, and frames in all, well measured and on the map of the default."""

    ms: dict[str, float]
    frames: int
    ok: int
    on_map: int
    reason: str  # why the default made no map, in words

    @property
    def over_ecc(self) -> float:
        """Time of the default over that of ECC."""
        return self.ms[DEFAULT] / self.ms[ECC]


#: Cells by motion, radius and number of frames.
Cells = dict[tuple[str, int, int], Cell]


def works(images: Array, footage: Footage) -> tuple[Works, dict[str, Any]]:
    """The ways to measure these frames, and where the last track of the default is kept."""
    last: dict[str, Any] = {}

    def tracked(sphere_map: bool | None) -> Callable[[], None]:
        def work() -> None:
            last[str(sphere_map)] = ts.track(images, footage.circle(), sphere_map=sphere_map)

        return work

    def by_rival(way: Callable[[Array, Array, Array], Array], pairs: int) -> Callable[[], None]:
        circles = np.column_stack((footage.position(range(pairs)), np.full(pairs, footage.radius)))

        def work() -> None:
            for f, g, circle in zip(images[:pairs], images[1 : pairs + 1], circles, strict=True):
                way(f, g, circle)

        return work

    wanted = max(FEWEST_PAIRS, round(RIVAL_PAIRS * min(1.0, (50 / footage.radius) ** 2)))
    pairs = min(wanted, len(images) - 1)
    ways = {DEFAULT: (tracked(None), len(images)), PAIRS: (tracked(False), len(images))}
    return ways | {name: (by_rival(way, pairs), pairs) for name, way in RIVALS.items()}, last


def measured(motion: Motion, radius: int, frames: int, seconds: float) -> Cell:
    """All ways on the same frames, in turns."""
    footage = Footage(motion, float(radius))
    ways, last = works(footage.images(frames), footage)
    times = in_turns(ways, seconds)
    default = last["None"]
    made = default.findings.map
    return Cell(
        {name: timing.wall_ms for name, timing in times.items()},
        frames,
        int((default.status == "ok").sum()),
        made.frames if isinstance(made, MadeMap) else 0,
        made.reason if isinstance(made, NoMap) else "",
    )


def compute(scope: Scope) -> Cells:
    """All cells, on all cores."""
    import cv2

    cv2.setNumThreads(torch.get_num_threads())
    found: Cells = {}
    sizes = [(radius, FRAMES) for radius in RADII] + [(50, frames) for frames in LENGTHS]
    if scope.quick:
        sizes = [(50, 10), (50, 100)]
    for name, motion in MOTIONS.items():
        for radius, frames in sizes:
            if (name, radius, frames) not in found and scope.allows(frames):
                scope.say(f"R = {radius} px, {frames} frames, a ball that {name}")
                found[name, radius, frames] = measured(motion, radius, frames, scope.seconds)
    return found


def rows(found: Cells) -> list[Row]:
    """The limits beside the times."""
    results = []
    middle, long = found.get(("spins", 50, 300)), found.get(("spins", 50, 2000))
    if middle is not None:
        results.append(
            Row(
                "speed",
                "300 frames of R = 50 px at 0.57 deg per frame, circle given",
                f"{FRAME_MS:g} ms per frame, {ECC_SHARE:g} times ECC",
                f"{middle.ms[DEFAULT]:.2f} ms, {middle.over_ecc:.1f} times",
                middle.ms[DEFAULT] <= FRAME_MS and middle.over_ecc <= ECC_SHARE,
            )
        )
    if long is not None:
        ours = long.ms[DEFAULT]
        results.append(
            Row("speed", "2,000 frames of the same", f"{LONG_MS:g} ms per frame", f"{ours:.2f} ms", ours <= LONG_MS)
        )
    return results


def _lines(cells: dict[str, Cell]) -> str:
    """Table of cells by the names of their columns."""
    columns = cells.values()
    ways = next(iter(columns)).ms
    lines: list[list[str]] = [[name, *(f"{cell.ms[name]:.2f}" for cell in columns)] for name in ways]
    lines += [
        ["torchsphere over ECC", *(f"{cell.over_ecc:.1f}" for cell in columns)],
        ["frames on the map", *(f"{cell.on_map:,}" for cell in columns)],
        ["frames ok", *(f"{cell.ok:,}" for cell in columns)],
    ]
    return table(("ms per frame", *cells), lines)


def tables(found: Cells) -> list[str]:
    """Tables by radius and by length, one of each for every motion, each under a sentence."""
    parts = []
    for name, motion in MOTIONS.items():
        own = {key[1:]: cell for key, cell in found.items() if key[0] == name}
        ball = f"a ball that {name} ({motion.deg_per_frame:.2g} deg per frame)"
        radii = {f"R = {radius} px": cell for (radius, frames), cell in sorted(own.items()) if frames == FRAMES}
        lengths = {f"{frames:,} frames": cell for (radius, frames), cell in sorted(own.items()) if radius == 50}
        if len(radii) > 1:
            parts.append(f"{FRAMES} frames of {ball}, by radius:\n\n{_lines(radii)}")
        if lengths:
            parts.append(f"R = 50 px, {ball}, by number of frames:\n\n{_lines(lengths)}")
    reasons = sorted({cell.reason for cell in found.values() if cell.reason})
    if reasons:
        parts.append("Reasons for no map: " + "; ".join(reasons) + ".\n")
    return parts
