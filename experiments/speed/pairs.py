"""A pair of images: `ts.correlate` and other methods from the same first guess, in turns.

Claim: at R = 50 px a pair takes 0.5 ms or less on two cores, or a quarter of OpenCV's ECC and of a plain numpy
Gauss-Newton.

Paper: 0.38 s per pair of 256 x 512 px images, in Matlab on a laptop of 2013 (section 2.3).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import numpy as np
import torch

import torchsphere as ts
from experiments.experiment import Row, table
from experiments.speed.clock import Timing, in_turns
from experiments.speed.rivals import RIVALS
from experiments.speed.scope import Scope
from experiments.validation.accuracy import Case, Shot, make_shot

RADII, BATCHES = (15, 30, 50, 100, 150), (1, 4, 8, 16, 32, 64, 128)

#: Pairs of each timing at R = 50 px, and the least number of pairs: larger balls get fewer.
PAIRS, FEWEST_PAIRS = 128, 4

#: Limits: ms per pair, and share of the rivals' time.
PAIR_MS, SHARE = 0.5, 0.25


@dataclass(frozen=True)
class Pairs:
    """Times by way for each radius, and of ours for each number of pairs at once."""

    by_radius: dict[int, dict[str, Timing]]
    by_batch: dict[int, Timing]


def _ours(shot: Shot, n: int, device: str) -> Callable[[], Any]:
    """`ts.correlate` on ``n`` pairs at once, from the mean step without rotation, as a tracker predicts."""
    images = shot.images[: n + 1].to(device)
    circles = np.column_stack((shot.position[:n], np.full(n, shot.radius)))
    start = np.array([*shot.increment[:, :2].mean(0), 0, 0, 0])

    def work() -> None:
        # The status is on the CPU, so a GPU has finished when the call returns.
        found = ts.correlate(images[:-1], images[1:], circles, start=start)
        if set(found.status) != {"ok"}:
            raise RuntimeError(f"pairs were not measured: {found.status}")

    return work


def _rival(shot: Shot, n: int, way: Callable[..., Any]) -> Callable[[], Any]:
    """A rival on the same pairs, one after the other."""
    images = shot.images[: n + 1].numpy().astype(np.uint8)
    circles = np.column_stack((shot.position[:n], np.full(n, shot.radius)))
    return lambda: [way(f, g, circle) for f, g, circle in zip(images[:-1], images[1:], circles, strict=True)]


def _all_ways(shot: Shot, n: int, threads: int, seconds: float) -> dict[str, Timing]:
    """Times of all methods on ``n`` pairs, on one thread and on all."""
    import cv2

    found: dict[str, Timing] = {}
    for count in sorted({1, threads}):
        torch.set_num_threads(count)
        cv2.setNumThreads(count)
        works = {"torchsphere": (_ours(shot, n, "cpu"), n)}
        works |= {name: (_rival(shot, n, way), n) for name, way in RIVALS.items()}
        if count == threads and torch.cuda.is_available():
            works["torchsphere, GPU"] = (_ours(shot, n, "cuda"), n)
        unit = "thread" if count == 1 else "threads"
        found |= {f"{name}, {count} {unit}": timing for name, timing in in_turns(works, seconds).items()}
    return found


@lru_cache(maxsize=len(RADII))
def _shot(radius: float, pairs: int) -> Shot:
    """The example shot at another size: the pattern grows with the ball."""
    return make_shot(Case(radius=radius, speckle=4 * max(radius / 50, 0.7), frames=pairs + 1), 0)


def compute(scope: Scope) -> Pairs:
    """Times by radius, and by number of pairs at once on one thread."""
    threads = torch.get_num_threads()
    by_radius = {}
    for radius in (50,) if scope.quick else RADII:
        pairs = max(FEWEST_PAIRS, min(PAIRS, round(PAIRS * (50 / radius) ** 2)))
        scope.say(f"pairs of R = {radius} px")
        by_radius[radius] = _all_ways(_shot(radius, pairs), pairs, threads, scope.seconds)
    torch.set_num_threads(1)
    shot = _shot(50, max(BATCHES))
    works = {str(n): (_ours(shot, n, "cpu"), n) for n in BATCHES}
    by_batch = {int(n): timing for n, timing in in_turns(works, scope.seconds).items()}
    torch.set_num_threads(threads)
    return Pairs(by_radius, by_batch)


def rows(found: Pairs) -> list[Row]:
    """The limit beside the time."""
    best = {name: timing.wall_ms for name, timing in found.by_radius[50].items() if "GPU" not in name}
    ours = min(ms for name, ms in best.items() if name.startswith("torchsphere"))
    limits = [SHARE * min(ms for name, ms in best.items() if name.startswith(way)) for way in ("OpenCV ECC", "plain")]
    limit = min(PAIR_MS, *limits)
    return [Row("speed", "a pair at R = 50 px", f"{limit:.2f} ms", f"{ours:.2f} ms", ours <= limit)]


def tables(found: Pairs) -> list[str]:
    """Tables by radius and by batch, each under a sentence."""
    times, batches = found.by_radius, found.by_batch.items()
    lines = [[name, *(f"{t[name].wall_ms:.2f} ({t[name].cpu_ms:.2f})" for t in times.values())] for name in times[50]]
    by_radius = table(("way", *(f"R = {radius} px" for radius in times)), lines)
    by_batch = table(("pairs at once", "ms"), [(n, f"{t.wall_ms:.2f} ({t.cpu_ms:.2f})") for n, t in batches])
    return [
        f"A pair of images, ms; the processor's time in brackets:\n\n{by_radius}",
        f"Pairs of R = 50 px on one thread, by the number of pairs at once:\n\n{by_batch}",
    ]
