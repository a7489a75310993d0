"""Share of the pixels that the disc covers."""

import math

import pytest
import torch
from ball_models import RADIUS, pose, window

from torchsphere.sphere_map import projection


def test_the_disc_covers_its_area_and_the_share_falls_from_one_to_zero() -> None:
    at = pose()
    pixels = window(at)
    share, slope = projection.coverage(pixels, at.centre, RADIUS, 0.3)
    # Blur conserves area. A straight edge in place of the circle would add ten times the tolerance.
    assert float(share.sum()) == pytest.approx(math.pi * RADIUS**2, rel=2e-5)
    # The disc's area grows with its radius by the circumference.
    assert float(slope.sum()) == pytest.approx(2 * math.pi * RADIUS, rel=2e-3)
    distance = (pixels.pixels - at.centre).norm(dim=-1)
    assert float(share[distance < RADIUS - 1.8].min()) > 1 - 1e-5
    assert float(share[distance > RADIUS + 1.8].max()) < 1e-5


def test_the_share_of_a_pixel_is_the_share_of_many_rays() -> None:
    at = pose()
    pixels = window(at)
    share, _ = projection.coverage(pixels, at.centre, RADIUS, projection.MIN_BLUR_PX)
    steps = (torch.arange(40, dtype=torch.float64) + 0.5) / 40 - 0.5
    rays = pixels.pixels[:, None] + torch.cartesian_prod(steps, steps)
    counted = ((rays - at.centre).norm(dim=-1) < RADIUS).double().mean(1)
    # The curvature of the outline within a pixel, 1 / (8 R), and the spacing of the rays, 1 / 40.
    assert float((share - counted).abs().max()) < 0.02
