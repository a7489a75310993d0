"""Accuracy on the example shot: ``python -m experiments.validation.example_shot``.

Claim: without a given circle the steps have a bias of 0.003 px at most, and a standard deviation of 0.005 px at most.

R = 50 px, 8 bit, noise 2 grey levels, speckle about 4 px from 30 to 220 grey levels, steps of about (1.4, 0.2) px with
random sub-pixel parts, rotation (0.2, 0.5, 0.2) deg per frame, 60 frames of 256 x 512; no circle is given. Reference
numbers of a hand-written numpy solver on such a shot: bias 0.0000 px, standard deviation 0.0050 px, with the same
pre-blur, over the region 0.9 R and with the true circle.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import torch

import torchsphere as ts
from experiments.experiment import PX_DEG, Array, publish, table
from torchsphere.geometry.orientation import chain
from torchsphere.synthetic import ray_caster

FRAMES, RADIUS, NOISE = 60, 50.0, 2.0
BACKGROUNDS, PATTERNS = (20.0, 90.0, 230.0), (0, 1, 2)


def shot(seed: int, background: float) -> tuple[torch.Tensor, Array, Array]:
    """Images (n, h, w), true positions (n, 2) and true increments (n - 1, 5)."""
    rng = np.random.default_rng(seed)
    steps = np.array([1.4, 0.2]) + rng.uniform(-0.3, 0.3, (FRAMES - 1, 2))
    turns = np.tile(np.radians([0.2, 0.5, 0.2]), (FRAMES - 1, 1))
    position = np.array([80.0, 120.0]) + rng.uniform(0, 1, 2) + np.concatenate((np.zeros((1, 2)), steps.cumsum(0)))
    orientation = chain(np.concatenate((np.zeros((1, 3)), turns)), np.ones(FRAMES, dtype=bool))
    poses = torch.from_numpy(position).float(), torch.from_numpy(orientation).float()
    clean = ray_caster.render(ray_caster.speckle(seed), poses[0], RADIUS, poses[1], background, shape=(256, 512))
    noise = NOISE * torch.randn(clean.shape, generator=torch.Generator().manual_seed(seed))
    return (clean + noise).round().clamp(0, 255), position, np.concatenate((steps, turns), 1)


@dataclass(frozen=True)
class Errors:
    """Found radius, px; errors of the increments (n - 1, 5), px and deg; largest error of a position, px."""

    radius: float
    increment: Array
    position: float

    def cells(self) -> list[str]:
        """Cells of a table."""
        bias, std = self.increment.mean(0), self.increment.std(0)
        parts = [
            ", ".join(format(v, form) for v in values[part])
            for part in (slice(0, 2), slice(2, 5))
            for values, form in ((bias, "+.4f"), (std, ".4f"))
        ]
        return [f"{self.radius:.2f}", *parts, f"{self.position:.2f}"]


def measure(seed: int, background: float) -> Errors:
    """Track one shot; raises if a frame is lost."""
    images, position, increment = shot(seed, background)
    track = ts.track(images)
    if not (track.status == "ok").all():
        raise RuntimeError(f"not all frames of pattern {seed} over {background:g} grey levels were measured")
    error = (track.increment - increment) * PX_DEG
    return Errors(track.circle.radius, error, float(np.linalg.norm(track.position - position, axis=1).max()))


def compute() -> dict[tuple[float, int], Errors]:
    """Errors by background and pattern."""
    return {(background, seed): measure(seed, background) for background in BACKGROUNDS for seed in PATTERNS}


def main() -> None:
    """Measure, and print one line per background and pattern."""
    head = ("background", "pattern", "radius (px)", "bias x, y (px)", "std x, y (px)", "bias w (deg)", "std w (deg)")
    lines = [(f"{background:g}", seed, *errors.cells()) for (background, seed), errors in compute().items()]
    publish("example_shot", "validation.example_shot", table((*head, "position (px)"), lines))


if __name__ == "__main__":
    main()
