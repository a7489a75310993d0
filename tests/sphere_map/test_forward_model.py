"""The forward model: coverage, grey levels at the outline, derivatives, and agreement with the ray caster."""

import math
from dataclasses import replace

import pytest
import torch
from ball_models import RADIUS, ball, indices_and_weights, pose, window

from torchsphere.sphere_map import cube_map, forward_model
from torchsphere.sphere_map.window import cut_window
from torchsphere.synthetic import ray_caster


def test_the_disc_covers_its_area_and_the_share_falls_from_one_to_zero() -> None:
    at = pose()
    pixels = window(at)
    share, slope = forward_model.coverage(pixels, at.centre, RADIUS, 0.3)
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
    share, _ = forward_model.coverage(pixels, at.centre, RADIUS, forward_model.MIN_BLUR_PX)
    steps = (torch.arange(40, dtype=torch.float64) + 0.5) / 40 - 0.5
    rays = pixels.pixels[:, None] + torch.cartesian_prod(steps, steps)
    counted = ((rays - at.centre).norm(dim=-1) < RADIUS).double().mean(1)
    # The curvature of the outline within a pixel, 1 / (8 R), and the spacing of the rays, 1 / 40.
    assert float((share - counted).abs().max()) < 0.02


def test_the_grey_level_of_a_pixel_at_the_outline_is_the_mean_over_its_area() -> None:
    """With too few rays there, neighbouring pixels have equal errors, which bias a step."""
    at, textured = pose(), replace(ball(31), edge_blur=forward_model.MIN_BLUR_PX)
    pixels = window(at)
    steps = (torch.arange(30, dtype=torch.float64) + 0.5) / 30 - 0.5
    offsets = torch.cartesian_prod(steps, steps)
    count = len(pixels.pixels)
    dense = replace(
        pixels,
        rays=(pixels.pixels[:, None] + offsets).flatten(0, 1).T,
        ray_weights=torch.full((count * len(offsets),), 1 / len(offsets), dtype=torch.float64),
        ray_pixels=torch.arange(count).repeat_interleave(len(offsets)),
    )
    error = forward_model.predict(pixels, at, textured) - forward_model.predict(dense, at, textured)
    at_outline = ((pixels.pixels - at.centre).norm(dim=-1) - RADIUS).abs() < 0.8
    # The texture is white noise of 29 grey levels rms in cells of one px. The error is 0.54; 3 x 3 rays leave 1.36.
    assert float(error[at_outline].square().mean().sqrt()) < 0.8


@pytest.mark.parametrize("unknown", range(7), ids=["dx", "dy", "wx", "wy", "wz", "radius", "blur"])
def test_the_jacobian_is_the_difference_quotient_of_the_grey_levels(unknown: int) -> None:
    at, textured = pose(), ball()
    pixels = window(at)
    step = 1e-4

    def levels(amount: float) -> torch.Tensor:
        if unknown < 5:
            change = torch.zeros(5, dtype=torch.float64)
            change[unknown] = amount
            return forward_model.predict(pixels, forward_model.move_pose(at, change, RADIUS), textured)
        changed = replace(
            textured, radius=RADIUS + amount * (unknown == 5), edge_blur=textured.edge_blur + amount * (unknown == 6)
        )
        return forward_model.predict(pixels, at, changed)

    expected = (levels(step) - levels(-step)) / (2 * step)
    measured = forward_model.linearise(pixels, at, textured).jacobian[:, unknown]
    inner = (pixels.pixels - at.centre).norm(dim=-1) < 0.9 * RADIUS
    # Within the disc the derivative is exact, except where a ray crosses a seam of the random map.
    close = (measured - expected).abs() < 1e-3 * float(expected.abs().max())
    assert float(close[inner].double().mean()) > 0.99
    # At the outline the derivative is right in its main part: both agree in direction.
    outer = ~inner & (expected.abs() < 1e3)  # a seam makes a jump over the step of 1e-4
    assert float(outer.double().sum()) > 0.97 * float((~inner).double().sum())
    assert float(torch.nn.functional.cosine_similarity(measured[outer], expected[outer], dim=0)) > 0.95


def test_the_model_agrees_with_the_ray_caster_on_a_smooth_texture() -> None:
    """A solid pattern that is linear in space is, on the map, nearly linear in the direction."""
    grid = torch.linspace(-1.1, 1.1, 64)
    z, y, x = torch.meshgrid(grid, grid, grid, indexing="ij")
    pattern = ray_caster.Pattern(120 + 50 * x - 30 * y + 20 * z)
    at = replace(pose(), gain=1.0, offset=0.0)
    expected = ray_caster.render(
        pattern, at.centre[None], RADIUS, at.orientation[None], 40.0, shape=(60, 60), subsamples=12
    )[0]
    pixels = cut_window(expected, torch.full((60, 60), 40.0), at.centre, RADIUS, None)
    # Coefficients by least squares from many directions.
    cells = 8
    directions = torch.nn.functional.normalize(
        torch.randn(20_000, 3, generator=torch.Generator().manual_seed(3)).double(), dim=-1
    )
    index, weight = indices_and_weights(cube_map.stencil(directions.T, cells))
    count = cube_map.coefficient_count(cells)
    design = torch.zeros(len(directions), count, dtype=torch.float64).scatter_add(1, index, weight)
    levels = 120 + directions @ torch.tensor([50.0, -30.0, 20.0], dtype=torch.float64)
    coefficients = torch.linalg.lstsq(design.T @ design + 1e-9 * torch.eye(count), design.T @ levels).solution
    textured = replace(ball(cells), coefficients=coefficients, edge_blur=forward_model.MIN_BLUR_PX)
    difference = forward_model.predict(pixels, at, textured) - pixels.levels
    # The texture spans 110 grey levels, and the steps at the outline reach 140.
    assert float(difference.abs().max()) < 3.0
    assert float(difference.square().mean().sqrt()) < 0.4


def test_a_ball_that_moves_right_uncovers_background_on_its_left() -> None:
    at = pose()
    levels = torch.full((cube_map.coefficient_count(8),), 200.0, dtype=torch.float64)
    pixels = window(at)
    by_x = forward_model.linearise(pixels, at, replace(ball(), coefficients=levels)).jacobian[:, 0]
    left = pixels.pixels[:, 0] < at.centre[0] - 0.9 * RADIUS
    right = pixels.pixels[:, 0] > at.centre[0] + 0.9 * RADIUS
    # The ball is brighter than the background: pixels get darker behind the ball and brighter in front of it.
    assert float(by_x[left].sum()) < -100
    assert float(by_x[right].sum()) > 100
