"""What ends the adjustment of the map, and how many keyframes make it: ``python -m experiments.validation.adjustment``.

Claim: with the constants as they are, places and turns are as right as with ones that cost more time.

Each constant is changed by itself, and the same recordings are measured again: eleven balls of 15 to 80 px with
textures, turns, noise and seeds of their own, which judge nothing else. Times are processor times over those of the
program as it is, measured in turns.
"""

from __future__ import annotations

import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from types import ModuleType

import numpy as np
import torch
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

import torchsphere as ts
from experiments.experiment import Array, publish, table
from torchsphere.sphere_map import bundle_adjustment, elimination, keyframes, level
from torchsphere.synthetic import ray_caster

#: First seed of the recordings.
SEED = 54_000

#: Radius, px; frames; turn per frame, deg; width of the speckle, px; noise, grey levels.
BALLS = (
    (15, 60, 1.0, 3.5, 1.5),
    (25, 40, 0.6, 4, 2),
    (25, 100, 2.5, 3, 3),
    (40, 20, 0.3, 5, 2),
    (40, 71, 1.2, 4, 2),
    (50, 20, 0.57, 4, 2),
    (50, 71, 0.05, 4, 2),
    (50, 100, 0.57, 6, 4),
    (60, 24, 3.0, 5, 1),
    (80, 30, 0.8, 6, 2),
    (50, 40, 1.5, 3, 2),
)

#: Constants and what they are changed to.
CHANGES: tuple[tuple[ModuleType, str, float], ...] = (
    (elimination, "CALM_STEPS", 4),
    (elimination, "CALM_SHARE", 0.3),
    (level, "STEPS", 16),
    (level, "LEAST_LEFT", 0.05),
    (level, "LEAST_SHARE", 1),
    (bundle_adjustment, "COARSE_SETTLED_PX", 0.02),
    (keyframes, "ENOUGH_PIXELS", 0),
    (keyframes, "MIN_OF_LARGE", 6),
)


@dataclass(frozen=True)
class Recording:
    """Images of a ball with its true motion."""

    images: NDArray[np.uint8]
    position: Array  # (n, 2), px
    orientation: Array  # (n, 3, 3)
    radius: float


@dataclass(frozen=True)
class Result:
    """Errors of a recording, px, and its processor time, s."""

    place: float  # standard deviation
    turn: float  # standard deviation, on the surface
    radius: float
    seconds: float


def recording(number: int) -> Recording:
    """The recording of that ``number``."""
    radius, frames, step, speckle, noise = BALLS[number]
    draw = np.random.default_rng(SEED + number)
    axis, at = draw.normal(size=3), np.arange(frames)[:, None] - frames / 2
    angle = np.radians(step) * np.arange(frames)[:, None]
    turns = Rotation.from_rotvec(angle * axis / np.linalg.norm(axis)).as_matrix()
    path = draw.uniform(-1.2, 1.2, 2) * at + draw.uniform(-0.01, 0.01, 2) * at**2
    position = path - path.min(0) + radius + 12 + draw.uniform(-0.5, 0.5, 2)
    width, height = np.ceil(position.max(0) + radius + 12).astype(int).tolist()
    pattern = ray_caster.speckle(SEED + number, radius_px=float(radius), speckle_px=float(speckle))
    background = 60.0 + 10 * number
    images = []
    for place, turn in zip(torch.from_numpy(position).float(), torch.from_numpy(turns).float(), strict=True):
        given = pattern, place[None], float(radius), turn[None], background
        drawn = ray_caster.render(*given, shape=(height, width), subsamples=4)[0].numpy()
        images.append((drawn + noise * draw.standard_normal(drawn.shape)).round().clip(0, 255).astype(np.uint8))
    return Recording(np.stack(images), position, turns, float(radius))


def measure(made: Recording) -> Result:
    """Track the recording from its true circle."""
    before = time.process_time()
    track = ts.track(made.images, (*made.position[0].tolist(), made.radius), log=False)
    seconds = time.process_time() - before
    off = track.position - made.position
    turned = Rotation.from_matrix(track.orientation) * Rotation.from_matrix(made.orientation).inv()
    left = made.radius * (turned * turned[0].inv()).as_rotvec()
    return Result(float(off.std(0).mean()), float(left.std(0).mean()), track.circle.radius - made.radius, seconds)


@contextmanager
def changed(module: ModuleType, name: str, value: float) -> Iterator[None]:
    """The constant of a module with another value."""
    before = getattr(module, name)
    setattr(module, name, value)
    try:
        yield
    finally:
        setattr(module, name, before)


def compute() -> dict[str, list[Result]]:
    """Results of all recordings by the change."""
    measure(recording(0))
    found: dict[str, list[Result]] = {"as it is": []}
    for number in range(len(BALLS)):
        made = recording(number)
        found["as it is"].append(measure(made))
        for module, name, value in CHANGES:
            with changed(module, name, value):
                found.setdefault(f"`{name}` = {value:g}", []).append(measure(made))
    return found


def tables(found: dict[str, list[Result]]) -> str:
    """A row per change: geometric means of the errors over the recordings, the radius' error, and the time."""
    lines = []
    for name, results in found.items():
        ratios = [one.seconds / base.seconds for one, base in zip(results, found["as it is"], strict=True)]
        means = [float(np.exp(np.mean(np.log([getattr(r, e) for r in results])))) for e in ("place", "turn")]
        radius = float(np.sqrt(np.mean([r.radius**2 for r in results])))
        lines.append((name, *(f"{m:.5f}" for m in means), f"{radius:.4f}", f"{np.exp(np.mean(np.log(ratios))):.2f}"))
    return table(("constant", "place, px", "turn, px", "radius, px", "processor time"), lines)


def main() -> None:
    """Measure and publish."""
    torch.set_num_threads(1)
    text = tables(compute())
    print(text)
    publish("adjustment", "validation.adjustment", text)


if __name__ == "__main__":
    main()
