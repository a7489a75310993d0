"""The texture map on the faces of a cube."""

import math

import pytest
import torch
from ball_models import indices_and_weights

from torchsphere.sphere_map import cube_map


def random_directions(count: int, seed: int = 0) -> torch.Tensor:
    generator = torch.Generator().manual_seed(seed)
    return torch.nn.functional.normalize(torch.randn(3, count, generator=generator, dtype=torch.float64), dim=0)


def random_coefficients(cells: int) -> torch.Tensor:
    generator = torch.Generator().manual_seed(1)
    return torch.rand(cube_map.coefficient_count(cells), generator=generator, dtype=torch.float64)


def test_a_map_of_ones_is_one_in_every_direction() -> None:
    stencil = cube_map.stencil(random_directions(2000), 20)
    ones = torch.ones(cube_map.coefficient_count(20), dtype=torch.float64)
    # Spline weights sum to one, up to the rounding of sixteen products.
    torch.testing.assert_close(stencil.value(ones), torch.ones(2000, dtype=torch.float64), atol=1e-14, rtol=0)
    index, _ = indices_and_weights(stencil)
    assert int(index.min()) >= 0
    assert int(index.max()) < cube_map.coefficient_count(20)


def test_each_half_axis_has_its_own_face_and_no_coefficient_belongs_to_two_faces() -> None:
    axes = torch.cat((torch.eye(3), -torch.eye(3)), 1).double()
    index, _ = indices_and_weights(cube_map.stencil(axes, 20))
    faces = index // (23 * 23)
    assert (faces == faces[:, :1]).all()
    assert sorted(faces[:, 0].tolist()) == [0, 1, 2, 3, 4, 5]


def test_the_gradient_is_the_difference_quotient_of_the_value() -> None:
    coefficients, directions = random_coefficients(12), random_directions(300)
    # A random map jumps at the seams; keep away from them.
    sizes = directions.abs().sort(0).values
    directions = directions[:, sizes[2] - sizes[1] > 0.01]
    _, gradient = cube_map.stencil(directions, 12).value_and_gradient(coefficients)
    step = 1e-6
    for k in range(3):
        shift = torch.zeros(3, 1, dtype=torch.float64)
        shift[k] = step
        after, before = (cube_map.stencil(directions + sign * shift, 12).value(coefficients) for sign in (1, -1))
        # Central differences of a cubic: curvature times the step squared, and rounding over the step.
        torch.testing.assert_close(gradient[k], (after - before) / (2 * step), atol=1e-7, rtol=1e-6)


def test_the_value_does_not_depend_on_the_length_of_the_direction() -> None:
    coefficients, directions = random_coefficients(12), random_directions(100)
    unit, triple = (cube_map.stencil(scale * directions, 12).value(coefficients) for scale in (1.0, 3.0))
    torch.testing.assert_close(unit, triple, atol=1e-12, rtol=0)
    _, gradient = cube_map.stencil(directions, 12).value_and_gradient(coefficients)
    assert float((gradient * directions).sum(0).abs().max()) < 1e-12


@pytest.mark.parametrize("radius", [10.0, 50.0, 60.0])
def test_cells_that_face_the_camera_have_the_requested_width(radius: float) -> None:
    cells = cube_map.cells_per_face(radius, 1.0)
    # A quarter of the circumference per face, in a whole number of cells.
    assert math.pi / 2 * radius / cells == pytest.approx(1.0, abs=0.5 / cells)


def test_the_map_of_a_large_ball_has_wider_cells_to_limit_the_memory() -> None:
    assert cube_map.cells_per_face(200.0, 1.0) == cube_map.MAX_CELLS


def test_value_and_adjoint_are_adjoint_operators_with_the_stencils_weights() -> None:
    coefficients, directions = random_coefficients(12), random_directions(400)
    stencil = cube_map.stencil(directions, 12)
    amounts = torch.randn(400, generator=torch.Generator().manual_seed(2), dtype=torch.float64)
    total = stencil.adjoint(amounts)
    # The two scalar products of an operator and its adjoint are equal.
    assert float(total @ coefficients) == pytest.approx(float(amounts @ stencil.value(coefficients)), rel=1e-12)
    index, weight = indices_and_weights(stencil)
    torch.testing.assert_close(stencil.value(coefficients), (coefficients[index] * weight).sum(-1), atol=1e-12, rtol=0)
