"""The texture map on the faces of a cube."""

import math

import pytest
import torch
from ball_models import indices_and_weights, random, random_directions

from torchsphere.sphere_map import cube_map, map_fit
from torchsphere.sphere_map.cube_map import CELLS_PER_RADIUS


def random_coefficients(cells: int) -> torch.Tensor:
    generator = torch.Generator().manual_seed(1)
    return torch.rand(cube_map.coefficient_count(cells), generator=generator, dtype=torch.float64)


def test_a_map_of_ones_is_one_in_every_direction() -> None:
    places = cube_map.places(random_directions(2000), 20)
    ones = torch.ones(cube_map.coefficient_count(20), dtype=torch.float64)
    # Spline weights sum to one, up to the rounding of sixteen products.
    torch.testing.assert_close(places.value(ones), torch.ones(2000, dtype=torch.float64), atol=1e-14, rtol=0)
    index, _ = indices_and_weights(places)
    assert int(index.min()) >= 0
    assert int(index.max()) < cube_map.coefficient_count(20)


def test_each_half_axis_has_its_own_face_and_no_coefficient_belongs_to_two_faces() -> None:
    axes = torch.cat((torch.eye(3), -torch.eye(3)), 1).double()
    index, _ = indices_and_weights(cube_map.places(axes, 20))
    faces = index // (23 * 23)
    assert (faces == faces[:, :1]).all()
    assert faces[:, 0].tolist() == [0, 1, 2, 3, 4, 5]


def test_both_faces_of_a_seam_have_their_borders_there() -> None:
    """A place on the seam is at the border of a cell, the first or the last of its face, on either side."""
    along = torch.linspace(-0.9, 0.9, 50, dtype=torch.float64)
    ones = torch.ones_like(along)
    for off in (-1e-9, 1e-9):
        places = cube_map.places(torch.stack((ones, ones + off, along)), 12)
        outermost = torch.minimum(places.offset % 1, 1 - places.offset % 1).amin(0)
        assert float(outermost.max()) < 1e-7
        assert float(places.offset.min()) >= 0
        assert float(places.offset.max()) <= 1


def test_the_gradient_is_the_difference_quotient_of_the_value() -> None:
    coefficients, directions = random_coefficients(12), random_directions(300)
    # A random map jumps at the seams; keep away from them.
    sizes = directions.abs().sort(0).values
    directions = directions[:, sizes[2] - sizes[1] > 0.01]
    _, gradient = cube_map.places(directions, 12).value_and_gradient(coefficients)
    step = 1e-6
    for k in range(3):
        shift = torch.zeros(3, 1, dtype=torch.float64)
        shift[k] = step
        after, before = (cube_map.places(directions + sign * shift, 12).value(coefficients) for sign in (1, -1))
        # Central differences of a cubic: curvature times the step squared, and rounding over the step.
        torch.testing.assert_close(gradient[k], (after - before) / (2 * step), atol=1e-7, rtol=1e-6)


def test_the_gradient_is_that_of_automatic_differentiation() -> None:
    coefficients, directions = random_coefficients(12), random_directions(300).requires_grad_()
    value, gradient = cube_map.places(directions.detach(), 12).value_and_gradient(coefficients)
    again = cube_map.places(directions, 12).value(coefficients)
    (expected,) = torch.autograd.grad(again.sum(), directions)
    torch.testing.assert_close(again.detach(), value, atol=1e-14, rtol=0)
    torch.testing.assert_close(gradient, expected, atol=1e-11, rtol=0)


def test_the_value_does_not_depend_on_the_length_of_the_direction() -> None:
    coefficients, directions = random_coefficients(12), random_directions(100)
    unit, triple = (cube_map.places(scale * directions, 12).value(coefficients) for scale in (1.0, 3.0))
    torch.testing.assert_close(unit, triple, atol=1e-12, rtol=0)
    _, gradient = cube_map.places(directions, 12).value_and_gradient(coefficients)
    assert float((gradient * directions).sum(0).abs().max()) < 1e-12


@pytest.mark.parametrize("radius", [10.0, 50.0, 60.0])
def test_cells_have_the_requested_width_to_a_tenth(radius: float) -> None:
    cells = cube_map.cells_per_face(radius, 1.0)
    assert cells == pytest.approx(CELLS_PER_RADIUS * radius, abs=0.5)
    middle = torch.tensor([0.0, 0.0, -1.0], dtype=torch.float64)
    edge = torch.tensor([math.sqrt(0.5), 0.0, -math.sqrt(0.5) - 1e-12], dtype=torch.float64)
    steps = [cube_map.places(at[:, None], cells).by_direction[..., 0] for at in (middle, edge)]
    # Cells per radian along x in the middle, and along the great circle at the middle of an edge.
    towards = torch.tensor([[1.0, 0.0, 0.0], [math.sqrt(0.5), 0.0, math.sqrt(0.5)]], dtype=torch.float64)
    widths = [radius / float((step @ across).abs().max()) for step, across in zip(steps, towards, strict=True)]
    assert widths[0] == pytest.approx(0.9, rel=0.04)
    assert widths[1] == pytest.approx(1.12, rel=0.04)


def test_the_map_of_a_large_ball_has_wider_cells_to_limit_the_memory() -> None:
    assert cube_map.cells_per_face(400.0, 1.0) == cube_map.MAX_CELLS
    assert cube_map.cells_per_face(1.0, 8.0) == 4


def test_value_and_adjoint_are_adjoint_operators_with_the_weights_of_the_splines() -> None:
    coefficients, places = random_coefficients(12), cube_map.places(random_directions(400), 12)
    amounts = random(400)
    total = places.adjoint(amounts, len(coefficients))
    # The two scalar products of an operator and its adjoint are equal.
    assert float(total @ coefficients) == pytest.approx(float(amounts @ places.value(coefficients)), rel=1e-12)
    index, weight = indices_and_weights(places)
    torch.testing.assert_close(places.value(coefficients), (coefficients[index] * weight).sum(-1), atol=1e-12, rtol=0)


def test_several_columns_give_what_each_gives_alone() -> None:
    places, count = cube_map.places(random_directions(60).reshape(3, 5, 12), 6), cube_map.coefficient_count(6)
    maps, amounts = random(count, 3), random(5, 12, 3)
    values, sums = places.value(maps), places.adjoint(amounts, count)
    assert values.shape == (5, 12, 3)
    for k in range(3):
        torch.testing.assert_close(values[..., k], places.value(maps[:, k]), atol=1e-12, rtol=0)
        torch.testing.assert_close(sums[:, k], places.adjoint(amounts[..., k], count), atol=1e-12, rtol=0)


def test_nodes_on_an_edge_lie_at_one_place_of_all_faces_that_share_them() -> None:
    cells = 6
    shared = cube_map.faces_of_nodes(torch.ones(1, dtype=torch.float64), cells)
    # Nodes on the lines of 12 edges: five within the edge and one beyond each end; and eight corners.
    assert [int((shared == count).sum()) for count in (2, 3)] == [2 * 12 * 7, 3 * 8]


def test_a_map_whose_nodes_are_joined_does_not_jump_at_a_seam() -> None:
    cells = 24
    values = random(cube_map.coefficient_count(cells))
    joined = cube_map.joined_at_seams(values, cells) / cube_map.faces_of_nodes(values, cells)
    # Directions close to the edge between the first and the second axis, on both sides, from corner to corner.
    along = torch.linspace(-0.9999, 0.9999, 60, dtype=torch.float64)
    ones = torch.ones_like(along)
    sides = [cube_map.places(torch.stack((ones, ones + off, along)), cells) for off in (-1e-9, 1e-9)]
    jumps = [
        float((sides[1].value(of) - sides[0].value(of)).abs().max())
        for of in (map_fit.to_nodes(values, cells), map_fit.to_nodes(joined, cells))
    ]
    assert jumps[0] > 1
    assert jumps[1] < 1e-6
