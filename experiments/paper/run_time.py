"""Section 3, the time of a pair: ``python -m experiments.paper.run_time``.

Claim: a sequence of 114 images of 256 x 512 px takes 43 s, which is 0.38 s for the motion between two images.

Here: the 114 images of `bar_shot` (128 x 512 px), the five modes of torchsphere from image to image, circle given. The
second of two runs counts, since the first compiles.
"""

from __future__ import annotations

import time
from dataclasses import dataclass

import torchsphere as ts
from experiments.experiment import Row, cached, claims
from experiments.paper import bar_shot

#: Seconds for a pair, of the paper.
PAPER_S = 0.38


@dataclass(frozen=True)
class Result:
    """Pairs, and seconds for all of them."""

    pairs: int
    seconds: float


def compute() -> Result:
    """The shot of the bar, pair by pair."""
    footage = bar_shot.compute().footage

    def make() -> float:
        seconds = 0.0
        for _ in range(2):
            begin = time.perf_counter()
            ts.track(footage.images, footage.circle, sphere_map=False, log=False)
            seconds = time.perf_counter() - begin
        return seconds

    return Result(len(footage.images) - 1, float(cached("run_time", [footage.key], make)))


def rows(result: Result) -> list[Row]:
    """The claim."""
    each = result.seconds / result.pairs
    ours = f"{1e3 * each:.1f} ms for a pair, {result.seconds:.2f} s for {result.pairs} pairs"
    return [Row("run_time", "the time to measure the motion between two images", "0.38 s", ours, each <= PAPER_S)]


def main() -> None:
    """Measure and print the claim."""
    print(claims(rows(compute())))


if __name__ == "__main__":
    main()
