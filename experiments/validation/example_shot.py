"""Accuracy on the example shot: ``python -m experiments.validation.example_shot``.

R = 50 px, 8 bit, noise 2 grey levels, speckle about 4 px from 30 to 220 grey levels, steps of about (1.4, 0.2) px with
random sub-pixel parts, rotation (0.2, 0.5, 0.2) deg per frame, 60 frames of 256 x 512; no circle is given. The
reference numbers of a hand-written numpy solver on such a shot are a bias of 0.0000 px and a standard deviation of
0.0050 px with the same pre-blur, over the region 0.9 R and with the true circle.
"""

from __future__ import annotations

import numpy as np
import torch

import torchsphere as ts
from torchsphere.geometry.orientation import chain
from torchsphere.synthetic import ray_caster

FRAMES, RADIUS, NOISE = 60, 50.0, 2.0
BACKGROUNDS, PATTERNS = (20.0, 90.0, 230.0), (0, 1, 2)


def shot(seed: int, background: float) -> tuple[torch.Tensor, np.ndarray, np.ndarray]:
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


def main() -> None:
    """Print one line per background and pattern."""
    print("| background | pattern | radius (px) | bias x, y (px) | std x, y (px) ", end="")
    print("| bias w (deg) | std w (deg) | position (px) |")
    print("|---|---|---|---|---|---|---|---|")
    for background in BACKGROUNDS:
        for seed in PATTERNS:
            images, position, increment = shot(seed, background)
            track = ts.track(images)
            if not (track.status == "ok").all():
                print(f"| {background:g} | {seed} | not all ok |")
                continue
            error = track.increment - increment
            error[:, 2:] = np.degrees(error[:, 2:])
            bias, std = error.mean(0), error.std(0)
            off = np.linalg.norm(track.position - position, axis=1).max()
            x, y = (f"{bias[k]:+.4f}" for k in (0, 1))
            turn = ", ".join(f"{v:+.4f}" for v in bias[2:])
            spread = ", ".join(f"{v:.4f}" for v in std[2:])
            print(
                f"| {background:g} | {seed} | {track.circle.radius:.2f} | {x}, {y} | {std[0]:.4f}, {std[1]:.4f} "
                f"| {turn} | {spread} | {off:.2f} |"
            )


if __name__ == "__main__":
    main()
