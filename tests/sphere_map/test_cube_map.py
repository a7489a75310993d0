"""The texture map on the faces of a cube."""

import math

import pytest
import torch

from torchsphere.sphere_map import cube_map


def directions(count: int, seed: int = 0) -> torch.Tensor:
    generator = torch.Generator().manual_seed(seed)
    return torch.nn.functional.normalize(torch.randn(3, count, generator=generator, dtype=torch.float64), dim=0)


def smooth_coefficients(cells: int) -> torch.Tensor:
    generator = torch.Generator().manual_seed(1)
    return torch.rand(cube_map.size(cells), generator=generator, dtype=torch.float64)


def test_a_map_of_ones_is_one_in_every_direction() -> None:
    look = cube_map.stencil(directions(2000), 20)
    ones = torch.ones(cube_map.size(20), dtype=torch.float64)
    # Spline weights sum to one: rounding of sixteen products.
    torch.testing.assert_close(look.value(ones), torch.ones(2000, dtype=torch.float64), atol=1e-14, rtol=0)
    assert int(look.index.min()) >= 0
    assert int(look.index.max()) < cube_map.size(20)


def test_every_face_is_used_and_no_coefficient_belongs_to_two_faces() -> None:
    axes = torch.cat((torch.eye(3), -torch.eye(3)), 1).double()
    index = cube_map.stencil(axes, 20).index
    faces = index // (23 * 23)
    assert (faces == faces[:, :1]).all()
    assert sorted(faces[:, 0].tolist()) == [0, 1, 2, 3, 4, 5]


def test_the_gradient_is_the_values_own_change() -> None:
    coefficients, places = smooth_coefficients(12), directions(300)
    # Away from the seams, across which a random map jumps.
    sorted_parts = places.abs().sort(0).values
    places = places[:, sorted_parts[2] - sorted_parts[1] > 0.01]
    _, gradient = cube_map.stencil(places, 12).value_and_gradient(coefficients)
    step = 1e-6
    for k in range(3):
        nudge = torch.zeros(3, 1, dtype=torch.float64)
        nudge[k] = step
        there, back = (cube_map.stencil(places + sign * nudge, 12).value(coefficients) for sign in (1, -1))
        # Central differences of a cubic: curvature times the step squared, and rounding over the step.
        torch.testing.assert_close(gradient[k], (there - back) / (2 * step), atol=1e-7, rtol=1e-6)


def test_the_value_depends_on_the_direction_not_on_its_length() -> None:
    coefficients, places = smooth_coefficients(12), directions(100)
    one, three = (cube_map.stencil(scale * places, 12).value(coefficients) for scale in (1.0, 3.0))
    torch.testing.assert_close(one, three, atol=1e-12, rtol=0)
    _, gradient = cube_map.stencil(places, 12).value_and_gradient(coefficients)
    assert float((gradient * places).sum(0).abs().max()) < 1e-12


@pytest.mark.parametrize("radius", [10.0, 50.0, 60.0])
def test_cells_are_as_wide_as_asked_where_the_camera_looks_straight_at_them(radius: float) -> None:
    cells = cube_map.cells_for(radius, 1.0)
    # A quarter of the circumference per face, a whole number of cells.
    assert math.pi / 2 * radius / cells == pytest.approx(1.0, abs=0.5 / cells)


def test_a_large_balls_map_is_coarser_rather_than_out_of_memory() -> None:
    assert cube_map.cells_for(200.0, 1.0) == cube_map.MOST_CELLS


def test_adding_values_to_the_coefficients_is_the_value_backwards() -> None:
    coefficients, places = smooth_coefficients(12), directions(400)
    look = cube_map.stencil(places, 12)
    amounts = torch.randn(400, generator=torch.Generator().manual_seed(2), dtype=torch.float64)
    total = look.add(amounts)
    # The two scalar products of an operator and its adjoint.
    assert float(total @ coefficients) == pytest.approx(float(amounts @ look.value(coefficients)), rel=1e-12)
    whole = (coefficients[look.index] * look.weight).sum(-1)
    torch.testing.assert_close(look.value(coefficients), whole, atol=1e-12, rtol=0)
