"""Shots and command lines for the tests of plans."""

import math
from dataclasses import dataclass, replace
from functools import cache

import numpy as np
import torch
from scipy.spatial.transform import Rotation

from torchsphere.cli import main, plan
from torchsphere.planning.example_image import Example, rendered_examples
from torchsphere.planning.expected import Setup
from torchsphere.settings.limits import SettingError
from torchsphere.synthetic import ray_caster

MARGIN, FRAMES, SPECKLE, GREY = 12, 40, 3.5, (30.0, 220.0)

# Standard deviation that rounding to whole grey levels adds.
ROUNDING = 12**-0.5

# A ball of radius 18 px with noise, and a ball of 24 px with a blur of 3 px and a rotation of 0.6 deg per frame.
SMALL = Setup(
    speed_m_s=30.0, frame_rate=36_000, shutter_s=1e-6, px_per_mm=1.2, diameter_mm=30, mass_g=110, noise=4.0,
    direction_deg=20.0, spin_rev_s=(10.0, 20.0, -10.0),
)  # fmt: skip
BLURRED = replace(
    SMALL, speed_m_s=75.0, shutter_s=2.5e-5, px_per_mm=1.6, noise=2.0, direction_deg=0.0, spin_rev_s=(30.0, -50.0, 10.0)
)

BALL = ["--diameter-mm", "30", "--mass-g", "110"]
TEST = ["--speed", "30", "--fps", "36000", "--px-per-mm", "1.2", *BALL]
GIVEN = [*TEST, "--shutter-us", "5", "--noise", "2", "--contact-us", "200"]


@dataclass(frozen=True)
class Shot:
    """Images (n, h, w) of a flight, and the outline in the first image."""

    images: torch.Tensor
    circle: tuple[float, float, float]


def recorded(setup: Setup, seed: int, frames: int = FRAMES) -> Shot:
    """Images of the planned test, rendered by the ray caster of the package."""
    radius, step = setup.radius_px, setup.increment
    start = radius + MARGIN + np.random.default_rng(seed).uniform(0, 1, 2)
    moments = max(math.ceil(1.5 * setup.blur_px), 1)
    exposure = ((np.arange(moments) + 0.5) / moments - 0.5) * setup.shutter_s * setup.frame_rate
    times = np.arange(frames)[:, None] + exposure
    centres = start + times[..., None] * step[:2]
    orientations = Rotation.from_rotvec(times.reshape(-1, 1) * step[2:]).as_matrix()
    width, height = (int(v) for v in np.ceil(centres.max((0, 1)) + radius + MARGIN))
    pattern = ray_caster.speckle(seed, radius_px=radius, speckle_px=SPECKLE, low=GREY[0], high=GREY[1])
    poses = torch.from_numpy(centres.reshape(-1, 2)).float(), torch.from_numpy(orientations).float()
    clean = ray_caster.render(pattern, poses[0], radius, poses[1], 90.0, shape=(height, width), subsamples=4)
    clean = clean.unflatten(0, times.shape).mean(1)
    noise = setup.noise * torch.randn(clean.shape, generator=torch.Generator().manual_seed(seed + 50))
    return Shot((clean + noise).round().clamp(0, 255), (*start.tolist(), radius))


@cache
def sides(radius: float) -> tuple[Example, ...]:
    return rendered_examples(radius, SPECKLE, *GREY, seed=77)


def planned(*arguments: str) -> int:
    options = vars(main._parser().parse_args(["plan", *arguments]))
    assert options["run"] is plan.run
    try:
        return plan.run(options)
    except SettingError as error:
        raise ValueError(error.as_options()) from error
