"""The joint equations of map and poses against dense matrices."""

from dataclasses import dataclass
from typing import Any

import pytest
import torch
from ball_models import dense_rows, maps_without_seams, one_share, poses, random, rough_ball, windows
from torch import Tensor

from torchsphere.sphere_map import cube_map, elimination, forward_model
from torchsphere.sphere_map.elimination import COMMON, PER_IMAGE, PLACE, JointEquations
from torchsphere.sphere_map.forward_model import Linearisation
from torchsphere.sphere_map.map_fit import MapEquations

CELLS, N = 8, 8
COUNT, UNKNOWNS = cube_map.coefficient_count(CELLS), PER_IMAGE * N + COMMON


@dataclass(frozen=True)
class Dense:
    """The equations of eight images as dense matrices."""

    joint: JointEquations
    model: Linearisation
    of_map: Tensor  # (m, m), with the prior
    coupling: Tensor  # (m, u)
    rows: Tensor  # derivatives (p, m) of the grey levels of all images by the map
    jacobian: Tensor  # (p, u), by the other unknowns
    weights: Tensor  # (p,)

    @property
    def whole(self) -> Tensor:
        upper = torch.cat((self.of_map, self.coupling), 1)
        return torch.cat((upper, torch.cat((self.coupling.T, self.joint.normal), 1)))

    @property
    def basis(self) -> Tensor:
        """Changes (m + u, k) of map and unknowns that leave one value at the nodes that faces share."""
        return torch.block_diag(maps_without_seams(CELLS), torch.eye(UNKNOWNS, dtype=torch.float64))

    def solved(self, right: Tensor, without: int = 0) -> Tensor:
        """Solution (m + u,) for the ``right`` side (m + u,), the last ``without`` unknowns held."""
        basis = self.basis[:, : self.basis.shape[1] - without]
        return basis @ torch.linalg.solve(basis.T @ self.whole @ basis, basis.T @ right)

    @property
    def covariance(self) -> Tensor:
        basis = maps_without_seams(CELLS)
        coupling = basis.T @ self.coupling
        taken_up = coupling.T @ torch.linalg.solve(basis.T @ self.of_map @ basis, coupling)
        return torch.linalg.inv(self.joint.normal - taken_up)


@pytest.fixture(scope="module")
def dense() -> Dense:
    at, ball = poses(N), rough_ball(CELLS)
    seen = windows(at)
    weights = seen.visibility / 4
    equations = MapEquations.of(forward_model.design(seen, at, ball), weights, one_share)
    model = forward_model.linearise(seen, at, ball)
    joint = elimination.joint_equations(model, equations, at)
    pixels = model.jacobian.shape[1]
    jacobian = torch.zeros(N, pixels, UNKNOWNS, dtype=torch.float64)
    for i in range(N):
        first = PER_IMAGE * i
        jacobian[i, :, first : first + PER_IMAGE] = model.jacobian[i, :, [*range(6), 7, 8]]
        jacobian[i, :, -COMMON:] = model.jacobian[i, :, 5:7]
    rows, columns, heavy = dense_rows(equations.design), jacobian.flatten(0, 1), weights.reshape(-1, 1)
    of_map = rows.T @ (heavy * rows) + equations.prior(torch.eye(COUNT, dtype=torch.float64))
    return Dense(joint, model, of_map, rows.T @ (heavy * columns), rows, columns, weights.flatten())


@pytest.fixture
def dense_products(dense: Dense, monkeypatch: pytest.MonkeyPatch) -> None:
    """Products with the map's matrix by the dense one, which gives the same in a hundredth of the time."""
    monkeypatch.setattr(MapEquations, "times", lambda self, of_map: dense.of_map @ of_map)


def test_products_are_those_of_the_dense_matrix(dense: Dense) -> None:
    of_map, step = random(COUNT), random(UNKNOWNS, seed=8)
    found = torch.cat(dense.joint.times(of_map, step))
    expected = dense.whole @ torch.cat((of_map, step))
    assert float((found - expected)[:COUNT].abs().max()) < 1e-10 * float(expected[:COUNT].abs().max())
    assert float((found - expected)[COUNT:].abs().max()) < 1e-10 * float(expected[COUNT:].abs().max())


def test_the_normal_matrix_is_that_of_the_pixels_and_of_constraints(dense: Dense) -> None:
    of_pixels = dense.jacobian.T @ (dense.weights[:, None] * dense.jacobian)
    constraints = dense.joint.normal - of_pixels
    # Common rotation, mean gain and mean offset, which the images leave open, the prior of the blur, and held radii.
    assert int(torch.linalg.matrix_rank(constraints)) == 6 + N
    assert float(torch.linalg.eigvalsh(constraints).min()) > -1e-6 * float(of_pixels.max())


def test_the_gradient_is_that_of_the_pixels(dense: Dense) -> None:
    weights = dense.weights.reshape(N, *dense.model.levels.shape[1:])
    residual = random(*weights.shape, seed=12)
    _, parts = dense.model.normal(weights, residual)
    expected = dense.jacobian.T @ (dense.weights * residual.flatten())
    torch.testing.assert_close(elimination.spread_gradient(parts), expected, atol=1e-9, rtol=0)


@pytest.mark.usefixtures("dense_products")
def test_conjugate_gradients_reach_the_dense_solution(dense: Dense) -> None:
    noise = 2 * random(len(dense.weights), seed=12)
    by_map, by_unknowns = dense.rows.T @ (dense.weights * noise), dense.jacobian.T @ (dense.weights * noise)
    exact = dense.solved(torch.cat((by_map, by_unknowns)))[COUNT:]
    sd = dense.covariance.diagonal().sqrt()
    errors = []
    for steps in (1, 10, 60):
        _, step = dense.joint.solve(by_map, by_unknowns, steps)
        errors.append(float(((step - exact) / sd).square().mean().sqrt()))
    assert errors[0] > errors[1] > errors[2]
    # In standard deviations of the unknowns. The texture is white noise, the worst case for the map's equations: ten
    # steps leave 0.08, sixty 0.01.
    assert errors[1] < 0.15
    assert errors[2] < 0.03


def test_the_approximate_solution_is_that_of_a_map_that_is_diagonal_at_its_nodes(dense: Dense) -> None:
    by_map, by_unknowns = random(COUNT), random(UNKNOWNS, seed=8)
    found = dense.joint.approximate(by_map, by_unknowns)
    of_map, step = found.of_map, found.step
    basis = maps_without_seams(CELLS)
    back = torch.linalg.pinv(basis)
    inverse = dense.joint.map.approximate_inverse(torch.eye(COUNT, dtype=torch.float64))
    of_nodes, coupling = torch.linalg.inv(back @ inverse @ back.T), basis.T @ dense.coupling
    whole = torch.cat((torch.cat((of_nodes, coupling), 1), torch.cat((coupling.T, dense.joint.normal), 1)))
    exact = dense.basis @ torch.linalg.solve(whole, torch.cat((basis.T @ by_map, by_unknowns)))
    torch.testing.assert_close(step, exact[COUNT:], rtol=1e-6, atol=1e-6 * float(exact[COUNT:].abs().max()))
    torch.testing.assert_close(of_map, exact[:COUNT], rtol=1e-6, atol=1e-6 * float(exact[:COUNT].abs().max()))


def test_a_direction_knows_its_products_with_the_coupling(dense: Dense) -> None:
    first, second = (dense.joint.approximate(random(COUNT, seed=k), random(UNKNOWNS, seed=k)) for k in (7, 8))
    found, coupling = first.plus(torch.tensor(0.3), second), dense.joint.coupling
    seen = dense.joint.seen
    torch.testing.assert_close(found.coupled[seen], coupling @ found.step)
    torch.testing.assert_close(found.coupled_back, coupling.T @ found.of_map[seen])


@pytest.mark.usefixtures("dense_products")
def test_a_ball_that_stays_has_one_centre_in_all_images(dense: Dense) -> None:
    equations = dense.joint.map
    held = elimination.joint_equations(dense.model, equations, poses(N), stays=True)
    noise = 2 * random(len(dense.weights), seed=12)
    by_map, by_unknowns = dense.rows.T @ (dense.weights * noise), dense.jacobian.T @ (dense.weights * noise)
    free, together = (
        joint.solve(by_map, by_unknowns, 60)[1][: PER_IMAGE * N].reshape(N, PER_IMAGE) for joint in (dense.joint, held)
    )
    assert float(torch.diff(free[:, :PLACE], dim=0).abs().max()) > 0.01
    assert float(torch.diff(together[:, :PLACE], dim=0).abs().max()) < 1e-9
    assert float(together[:, :PLACE].abs().max()) > 0.001
    # What a centre may do alone, a rotation does not have to make up for.
    of_turn = [float(joint.covariance[3, 3]) for joint in (dense.joint, held)]
    assert of_turn[1] < 0.85 * of_turn[0]


def test_the_map_follows_a_further_change_of_the_unknowns(dense: Dense) -> None:
    by_map, by_unknowns = random(COUNT), random(UNKNOWNS, seed=8)
    both, map_alone = (dense.joint.approximate(by_map, values) for values in (by_unknowns, 0 * by_unknowns))
    found = dense.joint.with_map(both.of_map, map_alone.step - both.step)
    torch.testing.assert_close(found, map_alone.of_map, rtol=1e-6, atol=1e-8 * float(found.abs().max()))


def test_a_step_that_has_settled_needs_no_more_conjugate_gradients(dense: Dense, monkeypatch: Any) -> None:
    noise = 2 * random(len(dense.weights), seed=12)
    by_map, by_unknowns = dense.rows.T @ (dense.weights * noise), dense.jacobian.T @ (dense.weights * noise)
    exact = dense.solved(torch.cat((by_map, by_unknowns)))[COUNT:]
    sd, products, times = dense.covariance.diagonal().sqrt(), [], MapEquations.times
    monkeypatch.setattr(MapEquations, "times", lambda self, of_map: (products.append(1), times(self, of_map))[1])
    _, step = dense.joint.solve(by_map, by_unknowns, 200, 0.1 * sd)
    assert len(products) < 60
    # What counts as settled is a tenth of a standard deviation, and the last steps moved no unknown by more.
    assert float(((step - exact) / sd).abs().max()) < 0.5


@pytest.mark.usefixtures("dense_products")
def test_a_blur_that_is_held_stays_and_leaves_the_others_their_own_step(dense: Dense) -> None:
    noise = 2 * random(len(dense.weights), seed=12)
    by_map, by_unknowns = dense.rows.T @ (dense.weights * noise), dense.jacobian.T @ (dense.weights * noise)
    exact = dense.solved(torch.cat((by_map, by_unknowns)), without=1)[COUNT:-1]
    sd = dense.covariance.diagonal().sqrt()
    _, step = dense.joint.with_blur_held().solve(by_map, by_unknowns, 60)
    assert float(step[-1].abs()) < 1e-3 * float(sd[-1])
    assert float(((step[:-1] - exact) / sd[:-1]).square().mean().sqrt()) < 0.03


def test_an_unknown_that_all_images_share_stands_before_the_radius(dense: Dense) -> None:
    column, precision, at = random(N, dense.model.jacobian.shape[1], 1, seed=5), 4.0, PER_IMAGE * N
    model = Linearisation(dense.model.levels, torch.cat((dense.model.jacobian, column), 2))
    joint = elimination.joint_equations(model, dense.joint.map, poses(N), (precision,))
    others = [*range(at), at + 1, at + 2]
    torch.testing.assert_close(joint.normal[others][:, others], dense.joint.normal)
    weighted = dense.weights * column.flatten()
    assert float(joint.normal[at, at]) == pytest.approx(float(weighted @ column.flatten()) + precision)
    step = torch.zeros(UNKNOWNS + 1, dtype=torch.float64)
    step[at] = 1.0
    of_map, of_rest = joint.times(torch.zeros(COUNT, dtype=torch.float64), step)
    torch.testing.assert_close(of_map, dense.rows.T @ weighted)
    torch.testing.assert_close(of_rest[others], dense.jacobian.T @ weighted)


def test_the_covariance_is_near_that_of_the_dense_schur_complement(dense: Dense) -> None:
    ratio = (dense.joint.covariance.diagonal() / dense.covariance.diagonal()).sqrt()
    own = ratio[:-COMMON].reshape(N, PER_IMAGE)[:, [*range(5), 6, 7]]
    # A map that is diagonal at its nodes takes up a little less: standard deviations come out 1 to 6 % too small, that
    # of the radius 12 %.
    assert float(own.mean(0).min()) > 0.92
    assert float(own.min()) > 0.8
    assert float(ratio[-COMMON:].min()) > 0.85
    assert float(ratio.max()) < 1.02


def test_the_common_rotation_has_no_variance(dense: Dense) -> None:
    """The mean orientation defines the frame of the map."""
    turn = poses(N).orientation.permute(2, 0, 1)
    common = torch.zeros(3, UNKNOWNS, dtype=torch.float64)
    common[:, :-COMMON].reshape(3, N, PER_IMAGE)[:, :, 2:5] = turn / N
    variance = (common @ dense.joint.covariance @ common.T).diagonal()
    own = dense.joint.covariance.diagonal()[2:5]
    assert float(variance.max()) < 0.5 * float(own.min())
