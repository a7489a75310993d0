"""The forward model of the map: coverage of pixels, rays, derivatives."""

import math
from dataclasses import replace

import pytest
import torch
from shots import rotation_matrix

from torchsphere.sphere_map import cube_map, forward_model, projection
from torchsphere.sphere_map.projection import Ball, Pose
from torchsphere.sphere_map.window import cut_window
from torchsphere.synthetic import ray_caster

RADIUS = 20.0


def ball(cells: int = 8) -> Ball:
    generator = torch.Generator().manual_seed(2)
    coefficients = 60 + 100 * torch.rand(cube_map.size(cells), generator=generator, dtype=torch.float64)
    shading = torch.zeros(projection.SHADES, dtype=torch.float64)
    shading[0] = 1.0
    return Ball(RADIUS, 0.4, cells, coefficients, shading)


def pose() -> Pose:
    turned = rotation_matrix(torch.tensor([0.3, 0.5, -0.2], dtype=torch.float64))
    return Pose(torch.tensor([30.3, 29.6], dtype=torch.float64), turned, 1.1, 2.0)


def window(at: Pose) -> forward_model.Window:
    return cut_window(torch.zeros(60, 60, dtype=torch.float64), torch.full((60, 60), 40.0), at.centre, RADIUS, None)


def test_the_disc_covers_its_area_and_the_share_falls_from_one_to_zero() -> None:
    at = pose()
    pixels = window(at)
    share, slope = projection.coverage(pixels, at.centre, RADIUS, 0.3)
    # Blur conserves area; 2e-5 of it is a tenth of what a straight edge in place of the circle would add.
    assert float(share.sum()) == pytest.approx(math.pi * RADIUS**2, rel=2e-5)
    # The slope is the disc's growth with its radius: its circumference.
    assert float(slope.sum()) == pytest.approx(2 * math.pi * RADIUS, rel=2e-3)
    distance = (pixels.pixels - at.centre).norm(dim=-1)
    assert float(share[distance < RADIUS - 1.8].min()) > 1 - 1e-5
    assert float(share[distance > RADIUS + 1.8].max()) < 1e-5


def test_a_pixels_share_is_that_of_many_rays() -> None:
    at = pose()
    pixels = window(at)
    share, _ = projection.coverage(pixels, at.centre, RADIUS, projection.LEAST_BLUR_PX)
    steps = (torch.arange(40, dtype=torch.float64) + 0.5) / 40 - 0.5
    rays = pixels.pixels[:, None] + torch.cartesian_prod(steps, steps)
    counted = ((rays - at.centre).norm(dim=-1) < RADIUS).double().mean(1)
    # The curvature of the outline within a pixel, 1 / (8 R), and the grid's 1 / 40.
    assert float((share - counted).abs().max()) < 0.02


def test_every_ray_belongs_to_a_pixel_and_their_weights_sum_to_one() -> None:
    at = pose()
    pixels = window(at)
    whole = pixels.gather(pixels.part)
    torch.testing.assert_close(whole, torch.ones_like(whole), atol=1e-12, rtol=0)
    middle = pixels.gather((pixels.part * pixels.rays).T)
    torch.testing.assert_close(middle, pixels.pixels, atol=1e-12, rtol=0)


def test_what_a_pixel_at_the_outline_sees_is_the_mean_over_its_area() -> None:
    """Rays that are too few there leave errors that are alike in neighbouring pixels, and a step follows them."""
    at, seen = pose(), replace(ball(31), edge_blur=projection.LEAST_BLUR_PX)
    pixels = window(at)
    steps = (torch.arange(30, dtype=torch.float64) + 0.5) / 30 - 0.5
    offsets = torch.cartesian_prod(steps, steps)
    count = len(pixels.pixels)
    dense = replace(
        pixels,
        rays=(pixels.pixels[:, None] + offsets).flatten(0, 1).T,
        part=torch.full((count * len(offsets),), 1 / len(offsets), dtype=torch.float64),
        owner=torch.arange(count).repeat_interleave(len(offsets)),
    )
    error = forward_model.appearance(pixels, at, seen) - forward_model.appearance(dense, at, seen)
    at_outline = ((pixels.pixels - at.centre).norm(dim=-1) - RADIUS).abs() < 0.8
    # Of a white texture with cells of one px, 29 grey levels rms: 0.54, and 1.36 with three by three rays.
    assert float(error[at_outline].square().mean().sqrt()) < 0.8


@pytest.mark.parametrize("unknown", range(7), ids=["dx", "dy", "wx", "wy", "wz", "radius", "blur"])
def test_the_derivatives_are_the_appearances_own_change(unknown: int) -> None:
    at, seen = pose(), ball()
    pixels = window(at)
    step = 1e-4

    def look(amount: float) -> torch.Tensor:
        if unknown < 5:
            change = torch.zeros(5, dtype=torch.float64)
            change[unknown] = amount
            return forward_model.appearance(pixels, forward_model.moved(at, change, RADIUS), seen)
        wider = replace(
            seen, radius=RADIUS + amount * (unknown == 5), edge_blur=seen.edge_blur + amount * (unknown == 6)
        )
        return forward_model.appearance(pixels, at, wider)

    expected = (look(step) - look(-step)) / (2 * step)
    measured = forward_model.linearised(pixels, at, seen).slopes[:, unknown]
    inner = (pixels.pixels - at.centre).norm(dim=-1) < 0.9 * RADIUS
    # Seams of the random map apart (a ray may cross one), the derivative is exact within the disc.
    close = (measured - expected).abs() < 1e-3 * float(expected.abs().max())
    assert float(close[inner].double().mean()) > 0.99
    # At the outline its main part is right: the two agree in direction.
    outer = ~inner & (expected.abs() < 1e3)  # a seam makes a jump over the step of 1e-4
    assert float(outer.double().sum()) > 0.97 * float((~inner).double().sum())
    assert float(torch.nn.functional.cosine_similarity(measured[outer], expected[outer], dim=0)) > 0.95


def test_it_looks_like_the_ray_caster_where_the_texture_is_smooth() -> None:
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
    places = torch.nn.functional.normalize(
        torch.randn(20_000, 3, generator=torch.Generator().manual_seed(3)).double(), dim=-1
    )
    look = cube_map.stencil(places.T, cells)
    design = torch.zeros(len(places), cube_map.size(cells), dtype=torch.float64).scatter_add(1, look.index, look.weight)
    levels = 120 + places @ torch.tensor([50.0, -30.0, 20.0], dtype=torch.float64)
    coefficients = torch.linalg.lstsq(
        design.T @ design + 1e-9 * torch.eye(cube_map.size(cells)), design.T @ levels
    ).solution
    seen = replace(ball(cells), coefficients=coefficients, edge_blur=projection.LEAST_BLUR_PX)
    difference = forward_model.appearance(pixels, at, seen) - pixels.levels
    # Of 110 grey levels of texture, and steps of up to 140 at the outline.
    assert float(difference.abs().max()) < 3.0
    assert float(difference.square().mean().sqrt()) < 0.4


def test_a_ball_that_moves_right_uncovers_background_on_its_left() -> None:
    at = pose()
    bright = replace(ball(), coefficients=torch.full((cube_map.size(8),), 200.0, dtype=torch.float64))
    pixels = window(at)
    by_x = forward_model.linearised(pixels, at, bright).slopes[:, 0]
    left = pixels.pixels[:, 0] < at.centre[0] - 0.9 * RADIUS
    right = pixels.pixels[:, 0] > at.centre[0] + 0.9 * RADIUS
    # A bright ball over a dark background: darker where it leaves, brighter where it comes.
    assert float(by_x[left].sum()) < -100
    assert float(by_x[right].sum()) > 100
