"""Grey levels that are not proportional to the light: ``python -m experiments.validation.tone_curve``.

Claim: the bend of the outline by a tone curve is found by the images of the ball, and the radius is right within its
standard deviation; where the levels are proportional to the light, none is found.

Balls of R = 36 px go through 32 images at 5.2 px per frame, with noise of 2 grey levels. The light to the power of the
exponent makes the levels.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import torch
import torch.nn.functional as F  # noqa: N812  (torch's convention)
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

import torchsphere as ts
from experiments.experiment import publish, table
from torchsphere.imaging.interpolation import blur
from torchsphere.sphere_map.decision import MadeMap
from torchsphere.synthetic import ray_caster

#: First seed of the recordings, which judge nothing else, and recordings of each case.
SEED, COUNT = 90_600, 2

#: Radius, px; frames; step, px; turn per frame, deg; noise and white, grey levels.
RADIUS, FRAMES, STEP, TURN_DEG, NOISE, WHITE = 36.0, 32, 5.2, (0.5, 1.0, 1.5), 2.0, 255.0

#: Pixels that are drawn along the side of one.
FINER = 3


@dataclass(frozen=True)
class Case:
    """Exponent of the tone curve, background, as a share of white, and blur of the optics, px."""

    exponent: float
    background: float
    optics_px: float


CASES = tuple(
    Case(*values)
    for values in (
        (1.0, 0.08, 0.0),
        (1.0, 0.08, 0.7),
        (1.0, 0.08, 1.5),
        (1.0, 0.5, 0.5),
        (0.7, 0.08, 0.0),
        (0.7, 0.08, 1.0),
        (0.45, 0.02, 0.0),
        (0.45, 0.08, 0.0),
        (0.45, 0.08, 0.7),
        (0.45, 0.08, 1.5),
        (0.45, 0.5, 0.5),
        (1.6, 0.08, 0.5),
    )
)


def recording(case: Case, seed: int) -> NDArray[np.uint8]:
    """Images of a ``case`` with that seed."""
    draw, pattern = np.random.default_rng(seed), ray_caster.speckle(seed, radius_px=RADIUS, speckle_px=5.0)
    height, width = round(2 * RADIUS + 50), round(2 * RADIUS + 50 + FRAMES * STEP)
    images = []
    for number in range(FRAMES):
        turn = torch.from_numpy(Rotation.from_rotvec(number * np.radians(TURN_DEG)).as_matrix())[None].float()
        centre = FINER * (torch.tensor([[RADIUS + 25 + STEP * number, RADIUS + 22.0]]) + 0.5) - 0.5
        given = pattern, centre, FINER * RADIUS, turn, WHITE * case.background
        fine = ray_caster.render(*given, shape=(FINER * height, FINER * width), subsamples=2)
        seen = blur(fine, FINER * case.optics_px) if case.optics_px else fine
        light = (F.avg_pool2d(seen, FINER)[0].numpy() / WHITE).clip(0, 1)
        levels = WHITE * light**case.exponent + NOISE * draw.standard_normal(light.shape)
        images.append(levels.round().clip(0, WHITE).astype(np.uint8))
    return np.stack(images)


def measure(case: Case, seed: int) -> tuple[float, float, float]:
    """Bend of the outline that was found, error of the radius, px, and its standard deviation."""
    circle = RADIUS + 25, RADIUS + 22, RADIUS
    track = ts.track(recording(case, seed), circle, log=False)
    made = track.findings.map
    bend = made.edge_bend if isinstance(made, MadeMap) else np.nan
    return bend, track.circle.radius - RADIUS, track.circle.sd_radius


def main() -> None:
    """Measure and publish."""
    torch.set_num_threads(1)
    lines = []
    for number, case in enumerate(CASES):
        results = [measure(case, SEED + 10 * number + k) for k in range(COUNT)]
        bends, offs = (", ".join(f"{value:.3f}" for value in column) for column in list(zip(*results, strict=True))[:2])
        most = max(abs(off / sd) for _, off, sd in results)
        background = f"{100 * case.background:.0f} %"
        lines.append((f"{case.exponent:g}", background, f"{case.optics_px:g}", bends, offs, f"{most:.1f}"))
    head = ("exponent", "background", "blur, px", "bend found", "radius off, px", "in sd, at most")
    text = table(head, lines)
    print(text)
    publish("tone_curve", "validation.tone_curve", text)


if __name__ == "__main__":
    main()
