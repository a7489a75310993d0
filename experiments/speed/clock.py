"""Times of several ways to do the same, taken in turns."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

#: A way, and the number of items (pairs, frames) that a call of it takes.
Works = Mapping[str, tuple[Callable[[], Any], int]]

#: Rounds at most and at least; no round begins after this time, s.
ROUNDS, FEWEST_ROUNDS, SECONDS = 7, 2, 5.0


@dataclass(frozen=True)
class Timing:
    """Times per item, ms: wall time, and processor time of all threads."""

    wall_ms: float
    cpu_ms: float


def in_turns(works: Works, seconds: float = SECONDS) -> dict[str, Timing]:
    """The best time of each way: other programs can only make a time longer, and all ways meet the same ones."""
    best = dict.fromkeys(works, Timing(float("inf"), float("inf")))
    began = time.perf_counter()
    for done in range(ROUNDS):
        if done >= FEWEST_ROUNDS and time.perf_counter() - began > seconds:
            break
        for name, (work, items) in works.items():
            wall, cpu = time.perf_counter(), time.process_time()
            work()
            wall, cpu = time.perf_counter() - wall, time.process_time() - cpu
            scale, old = 1e3 / items, best[name]
            best[name] = Timing(min(old.wall_ms, scale * wall), min(old.cpu_ms, scale * cpu))
    return best
