"""The compiled loops of the map of the ball against plain NumPy in double precision."""

import numpy as np
import pytest
import torch
from ball_models import indices_and_weights
from numpy.typing import NDArray
from scipy.special import ndtr

from torchsphere.kernels import cube_map as cube_loop
from torchsphere.kernels import map_equations, sphere_projection
from torchsphere.sphere_map import cube_map, forward_model
from torchsphere.sphere_map.window import Window, cut_window

Array = NDArray[np.float64]

CELLS, RADIUS = 12, 20.0

#: Single precision has 7 digits, of places of some ten cells.
TOLERANCE = {torch.float32: 2e-5, torch.float64: 1e-12}

both = pytest.mark.parametrize("dtype", [torch.float32, torch.float64])


def directions(count: int, dtype: torch.dtype = torch.float64) -> torch.Tensor:
    generator = torch.Generator().manual_seed(1)
    return torch.nn.functional.normalize(torch.randn(3, count, generator=generator, dtype=torch.float64), dim=0).to(
        dtype
    )


def random(*shape: int, dtype: torch.dtype = torch.float64) -> torch.Tensor:
    return torch.randn(*shape, generator=torch.Generator().manual_seed(2), dtype=torch.float64).to(dtype)


def bspline(t: float) -> float:
    """The cubic B-spline around 0."""
    t = abs(t)
    return 2 / 3 - t**2 + t**3 / 2 if t < 1 else max(2 - t, 0.0) ** 3 / 6


def looked_up(direction: Array, cells: int = CELLS) -> Array:
    """Weights (m,) of all coefficients in the value of the map in one direction."""
    axis = int(np.abs(direction).argmax())
    forwards, right, up = np.roll(direction, -axis)
    face = axis + (3 if forwards < 0 else 0)
    u, v = ((np.arctan(part / abs(forwards)) * 4 / np.pi + 1) * cells / 2 for part in (right, up))
    x, y = (np.array([bspline(t - (node - 1)) for node in range(cells + 3)]) for t in (u, v))
    weights = np.zeros((6, cells + 3, cells + 3))
    weights[face] = np.outer(y, x)
    return weights.ravel()


def window(dtype: torch.dtype = torch.float64) -> Window:
    image = torch.zeros(60, 60, dtype=dtype)
    return cut_window(image, image, torch.tensor([30.3, 29.6], dtype=torch.float64), RADIUS, None)


def assert_close(found: torch.Tensor | Array, expected: Array, tolerance: float) -> None:
    np.testing.assert_allclose(np.asarray(found, float), expected, rtol=0, atol=tolerance)


@both
def test_value_slopes_and_adjoint_of_the_map_equal_a_sum_over_all_its_splines(dtype: torch.dtype) -> None:
    places, coefficients = directions(300, dtype), random(cube_map.coefficient_count(CELLS), dtype=dtype)
    look = cube_map.stencil(places, CELLS)
    design = np.stack([looked_up(place) for place in places.double().numpy().T])
    assert_close(look.value(coefficients), design @ coefficients.double().numpy(), TOLERANCE[dtype])
    value, gradient = look.value_and_gradient(coefficients)
    assert_close(value, design @ coefficients.double().numpy(), TOLERANCE[dtype])
    amounts = random(300, dtype=dtype)
    assert_close(look.adjoint(amounts), amounts.double().numpy() @ design, TOLERANCE[dtype])
    step = 1e-5
    for axis in range(3):
        nudge = step * np.eye(3)[axis]
        ahead, behind = (
            np.stack([looked_up(place + sign * nudge) for place in places.double().numpy().T]) for sign in (1, -1)
        )
        slope = (ahead - behind) @ coefficients.double().numpy() / (2 * step)
        # Truncation of the differences, at slopes of about ten per radian.
        assert_close(gradient[axis], slope, max(20 * TOLERANCE[dtype], 1e-6))


def test_a_nan_direction_gives_a_valid_index() -> None:
    corner, *_ = cube_loop.place(torch.full((3, 5), torch.nan), CELLS)
    assert int(corner.min()) >= 0
    assert int(corner.max()) + 4 * (CELLS + 3) < cube_map.coefficient_count(CELLS)


@both
def test_rays_meet_the_ball_at_the_points_of_plain_geometry(dtype: torch.dtype) -> None:
    pixels, centre = window(dtype), np.array([30.5, 29.3])
    points, weight = forward_model.surface_points(pixels, torch.from_numpy(centre), RADIUS)
    across = pixels.rays.numpy() - centre[:, None]
    distance = np.hypot(*across)
    flat = across * forward_model.MAX_RAY_DISTANCE / np.maximum(distance, forward_model.MAX_RAY_DISTANCE * RADIUS)
    assert_close(points, np.stack((*flat, -np.sqrt(1 - np.hypot(*flat) ** 2))), TOLERANCE[dtype])
    met = pixels.ray_weights.double().numpy() * (ndtr((RADIUS - distance) / forward_model.RAY_TRANSITION_PX) + 1e-9)
    whole = np.bincount(pixels.ray_pixels.numpy(), met)
    # The transition at the outline magnifies the rounding of a place ten times, and more outside.
    assert_close(weight, met / whole[pixels.ray_pixels.numpy()], max(100 * TOLERANCE[dtype], 1e-9))


@both
def test_the_share_of_a_pixel_is_that_of_a_blurred_straight_edge(dtype: torch.dtype) -> None:
    pixels, centre, blur = window(dtype), np.array([30.5, 29.3]), 0.4
    share, slope = forward_model.coverage(pixels, torch.from_numpy(centre), RADIUS, blur)
    offset = pixels.pixels.numpy() - centre
    distance = np.hypot(*offset.T)
    inwards = RADIUS - (blur**2 + 1 / 12) / (2 * RADIUS) - distance
    a, b = np.maximum(np.abs(offset.T) / distance, 0.03)
    # The edge's profile across a pixel is a trapezoid: two boxes, one after the other.
    steps = (np.arange(200) + 0.5) / 200 - 0.5
    shift = (a[:, None, None] * steps[:, None] + b[:, None, None] * steps).reshape(len(a), -1)
    assert_close(share, ndtr((inwards[:, None] + shift) / blur).mean(1), 1e-5)
    density = np.exp(-0.5 * ((inwards[:, None] + shift) / blur) ** 2) / (blur * np.sqrt(2 * np.pi))
    assert_close(slope, density.mean(1), 2e-5)


@both
def test_grey_levels_of_rays_change_with_the_motion_of_the_surface(dtype: torch.dtype) -> None:
    points, gradient = -directions(200).abs(), random(3, 200)
    value, light, turn = random(200), random(200).abs(), torch.linalg.qr(random(3, 3))[0]
    given = (t.to(dtype).contiguous() for t in (points, value, gradient, light, turn))
    found = sphere_projection.pose_derivatives(*given, 0.1, RADIUS)
    x, y, z = points.numpy()
    slope = (turn @ gradient * light / RADIUS).numpy() * (-z > 0.1)
    expected = [(light * value).numpy(), slope[2] * x / z - slope[0], slope[2] * y / z - slope[1]]
    # A rotation w moves the ball's point under a ray by w x P: the ray then meets the point that was at -w x P.
    expected += [-(slope * np.cross(axis, points.numpy().T).T).sum(0) for axis in np.eye(3)]
    expected.append(slope[2] / z - (slope * points.numpy()).sum(0))
    assert_close(found, np.stack(expected), TOLERANCE[dtype])


@both
def test_sums_over_rays_and_values_for_rays_belong_to_their_pixels(dtype: torch.dtype) -> None:
    pixels = window(dtype)
    count, owner = len(pixels.pixels), pixels.ray_pixels.numpy()
    values, light = random(7, len(owner), dtype=dtype), random(len(owner), dtype=dtype)
    expected = np.stack([np.bincount(owner, row) for row in values.double().numpy()], 1)
    assert_close(sphere_projection.pixel_sums(values, pixels.ray_pixels, count), expected, TOLERANCE[dtype])
    each = random(count, dtype=dtype)
    assert_close(pixels.to_rays(each, light), (each.double().numpy()[owner] * light.double().numpy()), TOLERANCE[dtype])
    points, shading = directions(len(owner), dtype), random(4)
    bright = light.double().numpy() * (shading @ forward_model.shading_basis(points.double())).numpy()
    assert_close(sphere_projection.ray_light(points, light, shading), bright, TOLERANCE[dtype])


def test_the_equations_of_all_pixels_are_those_of_dense_matrices() -> None:
    """Some pixels see one patch, some a seam, and some more than a patch may hold."""
    cells, products, total = 24, map_equations.Products(24), 0.0
    for scatter in (0.05, 0.4):
        middles = directions(150).repeat_interleave(9, 1)
        places = middles + scatter * random(3, 150 * 9)
        owner, amount = torch.arange(150).repeat_interleave(9), random(150 * 9)
        look = cube_map.stencil(places, cells)
        design = map_equations.design(amount, owner, 150, cells, look.corner, look.offset)
        index, weight = indices_and_weights(look)
        dense = np.zeros((150, cube_map.coefficient_count(cells)))
        np.add.at(dense, (owner[:, None].numpy(), index.numpy()), (amount[:, None] * weight).numpy())
        assert_close(design.toarray(), dense, 1e-14)
        weights = random(150).abs().numpy()
        products.add(design, weights)
        total = total + dense.T @ (weights[:, None] * dense)
    assert_close(products.matrix().toarray(), total, 1e-12)


def test_pixels_without_rays_have_empty_rows() -> None:
    look = cube_map.stencil(directions(3), CELLS)
    design = map_equations.design(torch.ones(3).double(), torch.tensor([1, 1, 4]), 6, CELLS, look.corner, look.offset)
    assert np.diff(design.indptr).astype(bool).tolist() == [False, True, False, False, True, False]
