"""The fit of the map with the poses held: products, preconditioner and conjugate gradients against dense matrices."""

from collections.abc import Callable

import pytest
import torch
from ball_models import (
    RADIUS,
    dense_rows,
    maps_without_seams,
    one_share,
    poses,
    random,
    random_directions,
    rough_ball,
    smooth_coefficients,
    windows,
)
from torch import Tensor

from torchsphere.runtime.threads import RowRunner
from torchsphere.sphere_map import cube_map, forward_model, map_fit
from torchsphere.sphere_map.map_fit import MapEquations

CELLS = 8
COUNT = cube_map.coefficient_count(CELLS)


def two_shares(part: Callable[[int, int], Tensor], n: int) -> list[Tensor]:
    return [part(0, 1), part(1, n)]


def equations(shared: RowRunner = one_share) -> MapEquations:
    """Those of three images, which show about half of the ball."""
    at = poses(3)
    seen = windows(at)
    weights = seen.visibility * random(*seen.levels.shape).abs() / 4
    return MapEquations.of(forward_model.design(seen, at, rough_ball(CELLS)), weights, shared)


@pytest.fixture(scope="module")
def of() -> MapEquations:
    return equations()


@pytest.fixture(scope="module")
def matrix(of: MapEquations) -> Tensor:
    """The matrix (m, m), with the prior, from the weights of the splines."""
    rows = dense_rows(of.design)
    return rows.T @ (of.weights.reshape(-1, 1) * rows) + of.prior(torch.eye(COUNT, dtype=torch.float64))


def test_products_are_those_of_the_dense_matrix(of: MapEquations, matrix: Tensor) -> None:
    vector = random(COUNT)
    torch.testing.assert_close(of.times(vector), matrix @ vector, atol=1e-10, rtol=0)
    # Nearly the diagonal at the nodes: the sums of the rows.
    without_prior = matrix - of.prior(torch.eye(COUNT, dtype=torch.float64))
    prior = of.heaviest * map_fit.SMOOTHNESS * map_fit.PRIOR_AT_NODES
    expected = cube_map.joined_at_seams(without_prior.sum(1) + prior, CELLS)
    torch.testing.assert_close(of.density, expected, atol=1e-10, rtol=0)


def test_the_approximate_inverse_is_symmetric_and_positive_for_maps_without_seams(of: MapEquations) -> None:
    inverse = of.approximate_inverse(torch.eye(COUNT, dtype=torch.float64))
    torch.testing.assert_close(inverse, inverse.T, atol=1e-9 * float(inverse.max()), rtol=0)
    basis = maps_without_seams(CELLS)
    found = torch.linalg.eigvalsh(inverse)
    assert float(found[-basis.shape[1] :].min()) > 1e-6 * float(found.max())
    assert float(found[: -basis.shape[1]].abs().max()) < 1e-10 * float(found.max())
    # All that it gives has one value at the nodes of an edge.
    torch.testing.assert_close(basis @ torch.linalg.lstsq(basis, inverse).solution, inverse, atol=1e-10, rtol=0)


def test_conjugate_gradients_reach_the_solution_of_the_dense_equations(of: MapEquations, matrix: Tensor) -> None:
    texture = 110 + 29 * random(COUNT, seed=11)
    levels = of.design.levels(texture) + 2 * random(*of.weights.shape, seed=8)
    start = torch.full((COUNT,), 90.0, dtype=torch.float64)
    right = of.gradient(start, levels - of.design.levels(start))
    basis = maps_without_seams(CELLS)
    exact = basis @ torch.linalg.solve(basis.T @ matrix @ basis, basis.T @ right)
    in_sight = of.density > 0.3 * of.density.max()
    errors = []
    for steps in (8, 60, 100):
        solution, rest = of.solve(right, steps)
        torch.testing.assert_close(rest, right - of.times(solution), atol=1e-8 * float(right.abs().max()), rtol=0)
        errors.append(float((solution - exact)[in_sight].square().mean().sqrt() / exact[in_sight].std()))
    # White noise as a texture; what is left of it after 8, 60 and 100 steps is 0.17, 0.005 and 0.0004.
    assert errors[0] < 0.25
    assert errors[1] < 0.01
    assert errors[2] < 0.001


def test_the_leverage_is_near_the_share_of_the_noise_that_the_map_takes_up(of: MapEquations, matrix: Tensor) -> None:
    rows = dense_rows(of.design)
    basis = maps_without_seams(CELLS)
    inverse = basis @ torch.linalg.inv(basis.T @ matrix @ basis) @ basis.T
    exact = of.weights.flatten() * (rows @ inverse * rows).sum(1)
    found = of.leverage().flatten()
    # Where the map is well determined. It is an estimate of the mean, not for single pixels.
    shown = (rows.sum(1) > 0.5) & (exact < 0.5)
    assert float(found[shown].mean()) == pytest.approx(float(exact[shown].mean()), rel=0.15)
    assert float(found.max()) <= map_fit.MAX_LEVERAGE
    assert float(found.min()) >= 0


def test_nothing_is_the_solution_of_a_right_side_of_zeros(of: MapEquations) -> None:
    solution, rest = of.solve(torch.zeros(COUNT, dtype=torch.float64), 5)
    assert float(solution.abs().max()) == 0
    assert float(rest.abs().max()) == 0


def test_the_gradient_descends_the_squares_and_the_prior(of: MapEquations) -> None:
    levels, at = 90 + 20 * random(*of.weights.shape, seed=8), 90 + 20 * random(COUNT, seed=9)
    at.requires_grad_()
    squares = (of.weights * (levels - of.design.levels(at)).square()).sum() / 2
    (expected,) = torch.autograd.grad(squares, at)
    found = of.gradient(at.detach(), levels - of.design.levels(at.detach())) + of.prior(at.detach())
    torch.testing.assert_close(found, -expected, atol=1e-8, rtol=0)


def test_the_result_does_not_depend_on_how_images_are_shared_out(of: MapEquations) -> None:
    vector, residual = random(COUNT), 20 * random(*of.weights.shape)
    alone, shared = of, equations(two_shares)
    torch.testing.assert_close(alone.times(vector), shared.times(vector), atol=1e-9, rtol=0)
    torch.testing.assert_close(alone.gradient(vector, residual), shared.gradient(vector, residual), atol=1e-9, rtol=0)


def test_to_nodes_and_from_nodes_are_inverse_and_their_own_transposes() -> None:
    values, others = random(COUNT, 3), random(COUNT, 3, seed=9)
    torch.testing.assert_close(map_fit.from_nodes(map_fit.to_nodes(values, CELLS), CELLS), values, atol=1e-10, rtol=0)
    for function in (map_fit.to_nodes, map_fit.from_nodes):
        products = (function(values, CELLS) * others).sum(), (values * function(others, CELLS)).sum()
        torch.testing.assert_close(*products)
        alone = torch.stack([function(column, CELLS) for column in values.T], 1)
        torch.testing.assert_close(function(values, CELLS), alone, atol=1e-10, rtol=0)


@pytest.mark.parametrize("function", [map_fit.to_nodes, map_fit.from_nodes])
@pytest.mark.parametrize("shape", [(COUNT,), (COUNT, 5)])
def test_loops_and_torch_agree_on_nodes(function: Callable[[Tensor, int], Tensor], shape: tuple[int, ...]) -> None:
    values = random(*shape)
    found = function(values.float(), CELLS)
    assert found.dtype == torch.float32
    torch.testing.assert_close(found.double(), function(values, CELLS), atol=1e-5, rtol=0)


def test_loops_and_torch_agree_on_the_prior() -> None:
    coefficients = random(COUNT)
    found = map_fit.prior_gradient(coefficients.float(), CELLS)
    torch.testing.assert_close(found.double(), map_fit.prior_gradient(coefficients, CELLS), atol=1e-5, rtol=0)


def test_from_nodes_gives_the_values_of_the_map_at_its_inner_nodes() -> None:
    coefficients = random(COUNT)
    nodes = map_fit.from_nodes(coefficients, CELLS).reshape(6, CELLS + 3, CELLS + 3)
    # The front of the first face: the direction of the half axis meets the node in the middle of the face.
    value = cube_map.places(torch.tensor([[1.0], [0.0], [0.0]]).double(), CELLS).value(coefficients)
    assert float(nodes[0, CELLS // 2 + 1, CELLS // 2 + 1]) == pytest.approx(float(value), abs=1e-12)


@pytest.mark.parametrize(("fine", "within", "everywhere"), [(2 * CELLS, 5e-4, 0.015), (11, 0.02, 0.03)])
def test_a_refined_map_keeps_its_values(fine: int, within: float, everywhere: float) -> None:
    coefficients, directions = smooth_coefficients(CELLS), random_directions(500)
    before = cube_map.places(directions, CELLS).value(coefficients)
    after = cube_map.places(directions, fine).value(map_fit.refined(coefficients, CELLS, fine))
    # Cells that divide the former ones hold the same cubics, but for the outermost, which end with another slope. Other
    # cells hold the values at their nodes; the waves of this texture are six of the former cells long.
    sizes = directions.abs().sort(0).values
    middle = sizes[2] > 2 * sizes[1]
    errors = (after - before) / before.std()
    assert float(errors[middle].square().mean().sqrt()) < within
    assert float(errors.square().mean().sqrt()) < everywhere
    flat = map_fit.refined(torch.full((COUNT,), 100.0, dtype=torch.float64), CELLS, fine)
    torch.testing.assert_close(flat, torch.full_like(flat, 100.0), atol=1e-9, rtol=0)


def test_the_prior_is_a_symmetric_matrix_that_leaves_even_maps_alone() -> None:
    identity = torch.eye(COUNT, dtype=torch.float64)
    matrix = map_fit.prior_gradient(identity, CELLS)
    smooth = matrix - map_fit.RIDGE * (identity - identity.mean(0))
    torch.testing.assert_close(smooth, smooth.T, atol=1e-12, rtol=0)
    assert float(torch.linalg.eigvalsh(matrix + matrix.T).min()) > -1e-10
    assert float(map_fit.prior_gradient(torch.full((COUNT,), RADIUS).double(), CELLS).abs().max()) < 1e-9


def test_rougher_maps_cost_more() -> None:
    """Squared second differences grow with the fourth power of the frequency."""
    width = CELLS + 3
    x = torch.arange(width, dtype=torch.float64)
    costs = []
    for frequency in (0.3, 0.6):
        face = torch.cos(frequency * x).expand(6, width, width).flatten()
        costs.append(
            float(face @ map_fit.prior_gradient(face, CELLS)) - map_fit.RIDGE * float((face - face.mean()) @ face)
        )
    assert costs[1] / costs[0] == pytest.approx(16, rel=0.35)
