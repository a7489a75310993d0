"""Recordings without a ball, and balls that come late: ``python -m experiments.validation.no_ball``.

Claim: no recording without a ball is measured, and no circle in one is proposed without a doubt; and a ball that flies
through the same recordings later is found in the first frames that show the whole of it, whatever stays in the image.

The recordings are those of `no_ball_footage`: walls, textures by hand, codecs, flicker, shadows, people, cloth, leaves,
lamps, clocks and posters of a ball. A ball with speckles or without flies through each from two fifths of its frames
on. Each recording takes a line: what the search says of it, what a measurement does, and the processor's time.
Results are kept in ``experiments/cache``. ``--case NAME`` prints the lines of one recording, ``--seed N`` takes
another seed; neither writes the table.
"""

from __future__ import annotations

import argparse
import math
import time
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from pathlib import Path

import numpy as np
import torch
from torch import Tensor

import torchsphere as ts
from experiments.experiment import Array, cached, publish, table
from experiments.validation.no_ball_footage import CASES
from torchsphere.detection import ball_search
from torchsphere.geometry.circle import Circle
from torchsphere.settings.limits import SettingError
from torchsphere.synthetic import ray_caster

#: The seed of the table: the search was made on seeds from 1000 on.
SEED = 0

#: Shares of the recording in which a ball is in flight, and its radius as a share of the image's height.
FLIGHT, RADIUS = (0.4, 0.9), 0.13

#: Largest error of the centre and the radius of a ball that was found, px.
MOST_PX = 1.0

NONE, DOUBT, PROPOSED = "no circle", "in doubt", "a ball"
REFUSED, MEASURED = "refused", "measured"


@dataclass(frozen=True)
class Outcome:
    """What became of a recording."""

    size: str
    search: str  # `NONE`, `DOUBT` or `PROPOSED`
    seconds: float  # of the processor, for the search
    track: str  # `REFUSED` or `MEASURED`
    said: str
    late: tuple[str, str]  # of the same recording with a ball: speckled and plain


def with_ball(images: Tensor, seed: int, *, plain: bool) -> tuple[Tensor, Array, float]:
    """The images (n, h, w) with a ball that flies through, its centres (n, 2), NaN before and after, and its radius."""
    count, height, width = images.shape
    rng = np.random.default_rng(seed)
    radius = max(12.0, RADIUS * height)
    first, last = (round(share * count) for share in FLIGHT)
    share = (np.arange(count) - first) / (last - first)
    x = -radius + (width + 2 * radius) * share
    y = height * (rng.uniform(0.35, 0.5) + 0.6 * (share - 0.5) ** 2)
    centres = np.where(((share >= 0) & (share <= 1))[:, None], np.column_stack((x, y)), np.nan)
    low, high = (215.0, 215.001) if plain else (30.0, 230.0)
    pattern = ray_caster.speckle(seed, radius_px=radius, low=low, high=high)
    made = images.clone()
    generator = torch.Generator().manual_seed(seed)
    for frame in range(first, last + 1):
        angle = math.radians(2.0) * (frame - first)
        turned = torch.tensor(
            [[math.cos(angle), -math.sin(angle), 0.0], [math.sin(angle), math.cos(angle), 0.0], [0.0, 0.0, 1.0]]
        )
        pose = torch.from_numpy(centres[frame : frame + 1]).float(), turned[None]
        drawn = ray_caster.render(pattern, pose[0], radius, pose[1], images[frame])[0]
        noise = 2.0 * torch.randn(drawn.shape, generator=generator)
        made[frame] = torch.where(drawn == images[frame], drawn, (drawn + noise).round().clamp(0, 255))
    return made, centres, radius


def searched(images: Tensor) -> Circle | None:
    """The circle that the search proposes; None without one."""
    try:
        return ball_search.find(lambda start, stop: images[start:stop], len(images))
    except SettingError:
        return None


def late_ball(images: Tensor, seed: int, *, plain: bool) -> str:
    """What the search says of the images with a ball that comes late."""
    made, centres, radius = with_ball(images, seed, plain=plain)
    found = searched(made)
    if found is None:
        return "not found"
    x, y = centres[found.frame]
    off = max(abs(found.x - x), abs(found.y - y), abs(found.radius - radius))
    if not off <= MOST_PX:
        return "in doubt" if found.doubt else "WRONG"
    inside = (centres > radius).all(1) & (centres < np.array(images.shape[:0:-1]) - 1 - radius).all(1)
    late = found.frame - int(np.flatnonzero(inside)[0])
    return f"found{f', {late} frames late' if late > 1 else ''}{', in doubt' if found.doubt else ''}"


def measure(name: str, seed: int) -> Outcome:
    """The outcome of one recording."""
    images = CASES[name](seed)
    began = time.process_time()
    found = searched(images)
    seconds = time.process_time() - began
    search = NONE if found is None else DOUBT if found.doubt else PROPOSED
    try:
        ts.track(images, log=False)
        track, said = MEASURED, ""
    except SettingError as refusal:
        track, said = REFUSED, str(refusal)
    late = late_ball(images, seed, plain=False), late_ball(images, seed, plain=True)
    count, height, width = images.shape
    return Outcome(f"{width} x {height}, {count} frames", search, seconds, track, said, late)


def rows(found: dict[str, Outcome]) -> str:
    """The table."""
    head = (
        "recording",
        "size",
        "the search says",
        "time, s",
        "a measurement is",
        "speckled ball later",
        "plain ball later",
    )
    lines = [(name, o.size, o.search, f"{o.seconds:.1f}", o.track, *o.late) for name, o in found.items()]
    return table(head, lines)


def main(arguments: Sequence[str] | None = None) -> None:
    """Measure, and write the table unless only a part was asked for."""
    parser = argparse.ArgumentParser(prog=f"python -m experiments.validation.{Path(__file__).stem}")
    parser.add_argument("--case", choices=CASES, action="append", help="only this recording; may be given again")
    parser.add_argument("--seed", type=int, default=SEED, help="seed of the recordings")
    options = parser.parse_args(arguments)
    found = {}
    for name in options.case or CASES:
        settings = {"case": name, "seed": options.seed}
        kept = cached("no_ball", settings, lambda name=name: asdict(measure(name, options.seed)))
        found[name] = Outcome(**kept)
    if options.case or options.seed != SEED:
        print(rows(found))
    else:
        publish("no_ball", "validation.no_ball", rows(found))


if __name__ == "__main__":
    main()
