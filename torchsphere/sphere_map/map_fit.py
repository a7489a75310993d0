"""The texture map: its fit with the poses held fixed, and its elimination from the equations of map and poses.

The grey levels are linear in the map and in the light on the ball. Each pixel depends on a few of the thousands of
coefficients: the map's equations are sparse and are factorised once. The Schur complement is small and dense, and its
inverse is the covariance of the poses.
"""

from __future__ import annotations

import functools
from dataclasses import dataclass, replace

import numpy as np
import scipy  # imports scipy.sparse on first use: 0.1 s, which a track without a map does not need
import torch
from numpy.typing import NDArray
from torch import Tensor

from torchsphere.kernels import map_equations
from torchsphere.kernels.map_equations import Products
from torchsphere.runtime import threads
from torchsphere.sphere_map import cube_map, forward_model, pixel_weights
from torchsphere.sphere_map.cube_map import Stencil
from torchsphere.sphere_map.forward_model import SHADING_TERMS, Linearisation, Pose, Projection, TexturedBall
from torchsphere.sphere_map.state import LinearisedState, State
from torchsphere.sphere_map.window import Window

Array = NDArray[np.float64]

#: Prior weights of the map's second differences and of its coefficients, against one pixel (docs/constants.md).
SMOOTHNESS, RIDGE = 1e-3, 2e-4

#: Number of unknowns that all images share: radius and edge blur.
SHARED_UNKNOWNS = 2

#: Largest number of steps of the conjugate gradients for a map.
MAX_MAP_STEPS = 60

#: Share of the squared residuals that a shading must explain, and largest number of its changes (docs/constants.md).
MIN_EXPLAINED, SHADING_ROUNDS = 0.01, 4

#: Prior standard deviation of the shading's terms (docs/constants.md).
SHADING_SD = 0.3


@dataclass(frozen=True)
class Elimination:
    """The factorised map equations and their coupling with the u = 5 n + 2 other unknowns."""

    map_factor: scipy.sparse.linalg.SuperLU  # factorised normal matrix of the k observed coefficients
    observed: NDArray[np.int64]  # numbers (k,) of the coefficients that the images show
    coupling: Array  # normal matrix (k, u) between map and the other unknowns
    map_response: Array  # ``coupling`` solved for the map (k, u): minus the change of the map by the other unknowns
    covariance: Array  # covariance (u, u) of the other unknowns: the inverse of the Schur complement


def design_matrix(window: Window, stencil: Stencil, map_slopes: Tensor) -> scipy.sparse.csr_matrix:
    """Derivative (p, m) of the grey levels by the map's coefficients; ``map_slopes`` (q,) of `Linearisation`."""
    rays = map_slopes, window.ray_pixels, len(window.pixels)
    return map_equations.design(*rays, stencil.cells, stencil.corner, stencil.offset)


def add_prior(normal: scipy.sparse.csr_matrix, observed: NDArray[np.int64], cells: int) -> scipy.sparse.csr_matrix:
    """Normal matrix (k, k) of the map's ``observed`` coefficients with smoothness and ridge."""
    prior = SMOOTHNESS * roughness_matrix(cells) + RIDGE * scipy.sparse.identity(normal.shape[0])
    return (normal + prior).tocsr()[observed][:, observed]


def _factorise(matrix: scipy.sparse.csr_matrix) -> scipy.sparse.linalg.SuperLU:
    """Sparse factorisation; raises LinAlgError if the matrix is singular."""
    settings = {"permc_spec": "MMD_AT_PLUS_A", "diag_pivot_thresh": 0.0, "options": {"SymmetricMode": True}}
    try:
        return scipy.sparse.linalg.splu(matrix.tocsc(), **settings)
    except RuntimeError as error:  # SciPy's error for a singular matrix
        raise np.linalg.LinAlgError(str(error)) from error


@functools.lru_cache(maxsize=4)
def roughness_matrix(cells: int) -> scipy.sparse.csr_matrix:
    """Matrix (m, m) of the sum of squared second differences of the coefficients along both axes of every face."""
    width = cells + 3
    second = scipy.sparse.diags([1.0, -2.0, 1.0], [0, 1, 2], shape=(width - 2, width))
    square, identity = second.T @ second, scipy.sparse.identity(width)
    face = scipy.sparse.kron(identity, square) + scipy.sparse.kron(square, identity)
    return scipy.sparse.kron(scipy.sparse.identity(6), face).tocsr()


def roughness_gradient(ball: TexturedBall) -> Array:
    """Half the gradient (m,) of the smoothness term by the ball's coefficients."""
    return SMOOTHNESS * (roughness_matrix(ball.cells) @ ball.coefficients.numpy())


def eliminate(linearised: LinearisedState) -> Elimination:
    """Set up the normal equations of map and poses, and eliminate the map."""
    state, cells = linearised.state, linearised.state.ball.cells
    n = len(state.windows)
    unknowns = 5 * n + SHARED_UNKNOWNS
    products = Products(cells)
    coupling, poses_normal = np.zeros((cube_map.coefficient_count(cells), unknowns)), np.zeros((unknowns, unknowns))

    def image_equations(
        window: Window, pose: Pose, model: Linearisation
    ) -> tuple[scipy.sparse.csr_matrix, Array, Array, Array]:
        design = design_matrix(window, model.stencil, model.map_slopes)
        weights = pixel_weights.weights(window, pose, state.profile).double().numpy()
        jacobian = model.jacobian.double().numpy()
        weighted = weights[:, None] * jacobian
        return design, weights, design.T @ weighted, jacobian.T @ weighted

    images = threads.parallel_map(image_equations, state.windows, state.poses, linearised.model)
    for i, (design, weights, image_coupling, image_normal) in enumerate(images):
        products.add(design, weights)
        columns = image_unknowns(i, n)
        coupling[:, columns] += image_coupling
        poses_normal[np.ix_(columns, columns)] += image_normal
    map_normal = products.matrix()
    observed = np.flatnonzero(map_normal.diagonal() > 0)
    factor = _factorise(add_prior(map_normal, observed, cells))
    coupling = coupling[observed]
    response = factor.solve(coupling)
    reduced = poses_normal - coupling.T @ response
    constraint = _frame_constraint(state.poses, float(np.diag(poses_normal)[:5].max()))
    return Elimination(factor, observed, coupling, response, np.linalg.inv(reduced + constraint))


def _frame_constraint(poses: list[Pose], stiffness: float) -> Array:
    """Constraint (5 n + 2, 5 n + 2) against a common rotation of all poses and the map; no single pose is fixed."""
    common = np.zeros((3, 5 * len(poses) + SHARED_UNKNOWNS))
    for i, pose in enumerate(poses):
        common[:, 5 * i + 2 : 5 * i + 5] = pose.orientation.T.numpy()
    return stiffness / len(poses) * common.T @ common


def image_unknowns(i: int, n: int) -> list[int]:
    """Numbers of the unknowns on which image ``i`` of ``n`` depends."""
    return [*range(5 * i, 5 * i + 5), *range(5 * n, 5 * n + SHARED_UNKNOWNS)]


def fit_map(state: State, *, brightness_rounds: int = 0) -> State:
    """Fit the map to the images, and so often gains and offsets, each time followed by another fit of the map.

    The normal matrix is not updated for the new gains; the residuals are exact.
    """
    cells, projections = state.ball.cells, state.project()
    empty = torch.zeros(cube_map.coefficient_count(cells), dtype=torch.float64)
    state = replace(state, ball=replace(state.ball, coefficients=empty))
    normal = _normal_matrix(state, projections)
    observed = np.flatnonzero(normal.diagonal() > 0)
    matrix = add_prior(normal, observed, cells)
    state = _improve_map(state, projections, matrix, observed)
    for _ in range(brightness_rounds):
        state = state.fit_brightness(state.predict(projections))
        state = _improve_map(state, projections, matrix, observed)
    # Coefficients that no image shows get the median of the others.
    coefficients = state.ball.coefficients.clone()
    coefficients[normal.diagonal() == 0] = coefficients[observed].median()
    return replace(state, ball=replace(state.ball, coefficients=coefficients))


def update_map(state: State, projections: list[Projection], elimination: Elimination) -> State:
    """Correct the map for poses that have moved: near the limb the map does not change linearly with them."""
    observed = elimination.observed
    change = elimination.map_factor.solve(_gradient(state, projections)[observed])
    return replace(state, ball=state.ball.with_map_change(observed, change))


def _improve_map(
    state: State, projections: list[Projection], matrix: scipy.sparse.csr_matrix, observed: NDArray[np.int64]
) -> State:
    """One step of the map, by the normal ``matrix`` (k, k) of its ``observed`` coefficients (k,)."""
    gradient = _gradient(state, projections) - RIDGE * state.ball.coefficients.numpy()
    change, _ = scipy.sparse.linalg.cg(matrix, gradient[observed], maxiter=MAX_MAP_STEPS)
    return replace(state, ball=state.ball.with_map_change(observed, change))


def _normal_matrix(state: State, projections: list[Projection]) -> scipy.sparse.csr_matrix:
    """Normal matrix (m, m) of the map."""
    products = Products(state.ball.cells)

    def image_design(window: Window, pose: Pose, projected: Projection) -> tuple[scipy.sparse.csr_matrix, Array]:
        design = design_matrix(window, projected.stencil, projected.map_slopes(window, pose))
        return design, pixel_weights.weights(window, pose, state.profile).double().numpy()

    for design, weights in threads.parallel_map(image_design, state.windows, state.poses, projections):
        products.add(design, weights)
    return products.matrix()


def _gradient(state: State, projections: list[Projection]) -> Array:
    """Descent direction (m,) of the map's coefficients by residuals and smoothness."""

    def image_gradient(window: Window, pose: Pose, projected: Projection) -> Array:
        residual = window.levels - forward_model.grey_levels(window, projected, pose, state.ball.coefficients)
        weighted = pixel_weights.weights(window, pose, state.profile) * residual
        ray_values = window.to_rays(pose.gain * projected.coverage * weighted, projected.light)
        return projected.stencil.adjoint(ray_values).double().numpy()

    gradient = -roughness_gradient(state.ball)
    for part in threads.parallel_map(image_gradient, state.windows, state.poses, projections):
        gradient += part
    return gradient


def fit_shading(state: State) -> State:
    """Fit the light on the ball, if a light that differs from side to side explains enough of the residuals.

    Map and light are solved for together: in turns, the map would keep the light that the map has already absorbed.
    """
    for _ in range(SHADING_ROUNDS):
        changed = _change_shading(state)
        if changed is None:
            return state
        state = changed
    return state


def _change_shading(state: State) -> State | None:
    """One step of map and light together; None if the change of the light explains too little."""
    count, ball = cube_map.coefficient_count(state.ball.cells), state.ball
    products, map_right, light_right = Products(ball.cells), np.zeros(count), np.zeros(SHADING_TERMS)
    coupling, light_normal, squares = np.zeros((count, SHADING_TERMS)), np.zeros((SHADING_TERMS, SHADING_TERMS)), 0.0
    for window, pose in zip(state.windows, state.poses, strict=True):
        model = forward_model.linearise(window, pose, ball)
        design = design_matrix(window, model.stencil, model.map_slopes)
        by_light = forward_model.shading_jacobian(window, pose, ball).double().numpy()
        weights = pixel_weights.weights(window, pose, state.profile).double().numpy()
        residual = (window.levels - model.levels).double().numpy()
        weighted = design.multiply(weights[:, None]).tocsr()
        products.add(design, weights)
        map_right += weighted.T @ residual
        coupling += weighted.T @ by_light
        light_normal += by_light.T @ (weights[:, None] * by_light)
        light_right += by_light.T @ (weights * residual)
        squares += float(weights @ residual**2)
    map_normal, cg = products.matrix(), scipy.sparse.linalg.cg
    observed = np.flatnonzero(map_normal.diagonal() > 0)
    matrix, coupling = add_prior(map_normal, observed, ball.cells), coupling[observed]
    response = np.stack([cg(matrix, column, maxiter=MAX_MAP_STEPS)[0] for column in coupling.T], 1)
    map_change, _ = cg(matrix, (map_right - roughness_gradient(ball))[observed], maxiter=MAX_MAP_STEPS)
    # The constant of the light is left out: it scales as the map does.
    reduced = (light_normal - coupling.T @ response)[1:, 1:]
    gradient = (light_right - coupling.T @ map_change)[1:]
    change = np.linalg.solve(reduced + np.eye(SHADING_TERMS - 1) / SHADING_SD**2, gradient)
    if change @ gradient < MIN_EXPLAINED * squares:
        return None
    change = np.concatenate(([0.0], change))
    ball = ball.with_map_change(observed, map_change - response @ change)
    return replace(state, ball=replace(ball, shading=ball.shading + torch.from_numpy(change)))
