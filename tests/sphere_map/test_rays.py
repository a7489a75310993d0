"""The share of each pixel that the disc covers, with its derivatives."""

import math

import pytest
import torch
from ball_models import RADIUS, distances, poses, rough_ball, windows

from torchsphere.sphere_map import forward_model, rays


def test_the_disc_covers_its_area_and_the_share_falls_from_one_to_zero() -> None:
    at = poses()
    seen = windows(at)
    blur = torch.tensor(0.3, dtype=torch.float64)
    share, by_radius, _ = rays.coverage(*seen.offsets(at.centre), rough_ball().radius, blur)
    for i in range(2):
        # Blur conserves area. A straight edge in place of the circle would add ten times the tolerance.
        assert float(share[i].sum()) == pytest.approx(math.pi * RADIUS**2, rel=2e-5)
        # The disc's area grows with its radius by the circumference.
        assert float(by_radius[i].sum()) == pytest.approx(2 * math.pi * RADIUS, rel=2e-3)
    distance = distances(seen, at)
    assert float(share[distance < RADIUS - 1.8].min()) > 1 - 1e-5
    assert float(share[distance > RADIUS + 1.8].max()) < 1e-5


def test_the_share_of_a_pixel_is_the_share_of_many_rays() -> None:
    at = poses(1)
    seen = windows(at)
    blur = torch.tensor(forward_model.MIN_BLUR_PX, dtype=torch.float64)
    x, y = seen.offsets(at.centre)
    share, _, _ = rays.coverage(x, y, rough_ball().radius, blur)
    steps = (torch.arange(40, dtype=torch.float64) + 0.5) / 40 - 0.5
    counted = torch.stack(
        [((x + a).square() + (y + b).square() < RADIUS**2).double() for a in steps for b in steps]
    ).mean(0)
    # The curvature of the outline within a pixel, 1 / (8 R), and the spacing of the rays, 1 / 40.
    assert float((share - counted).abs().max()) < 0.02


def test_the_share_is_that_of_a_blurred_straight_edge() -> None:
    at, ball = poses(1), rough_ball()
    x, y = (part[0] for part in windows(at).offsets(at.centre))
    share, by_radius, by_blur = rays.coverage(x, y, ball.radius, ball.edge_blur)
    distance, blur = (x.square() + y.square()).sqrt(), ball.edge_blur
    inwards = RADIUS - (blur**2 + 1 / 12) / (2 * RADIUS) - distance
    a, b = ((part.abs() / distance).clamp_min(rays.LEAST_NORMAL)[..., None] for part in (x, y))
    # The edge's profile across a pixel is a trapezoid: two boxes, one after the other.
    steps = (torch.arange(60, dtype=torch.float64) + 0.5) / 60 - 0.5
    places = inwards[..., None] + a * steps.repeat_interleave(60) + b * steps.repeat(60)
    density = torch.exp(-0.5 * (places / blur).square()) / (blur * math.sqrt(2 * math.pi))
    # The sums over 60 by 60 places.
    torch.testing.assert_close(share, torch.special.ndtr(places / blur).mean(-1), atol=1e-4, rtol=0)
    torch.testing.assert_close(by_radius, density.mean(-1), atol=3e-4, rtol=0)
    spread = -(density * places / blur).mean(-1) - by_radius * blur / RADIUS
    torch.testing.assert_close(by_blur, spread, atol=3e-4, rtol=0)
