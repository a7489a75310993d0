"""Fit of the texture map, and of the light on the ball, with the poses held fixed.

Both are linear in the grey levels.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import scipy  # imports scipy.sparse on first use: 0.1 s, which a track without a map does not need
import torch
from numpy.typing import NDArray

from torchsphere.kernels.map_equations import Products
from torchsphere.runtime import threads
from torchsphere.sphere_map import cube_map, forward_model, pixel_weights, schur
from torchsphere.sphere_map.projection import SHADING_TERMS, Pose, Projection
from torchsphere.sphere_map.state import State
from torchsphere.sphere_map.window import Window

Array = NDArray[np.float64]

#: Largest number of steps of the conjugate gradients for a map.
MAX_MAP_STEPS = 60

#: Share of the squared residuals that a change of the shading must explain, and largest number of such changes.
MIN_EXPLAINED, SHADING_ROUNDS = 0.01, 4

#: Prior standard deviation of the shading's terms: a ball that turns little does not separate light from texture.
SHADING_SD = 0.3


def fit_map(state: State, *, brightness_rounds: int = 0) -> State:
    """Fit the map to the images, and so often gains and offsets, each time followed by another fit of the map.

    The normal matrix is not updated for the new gains; the residuals are exact.
    """
    cells, projections = state.ball.cells, state.project()
    empty = torch.zeros(cube_map.coefficient_count(cells), dtype=torch.float64)
    state = replace(state, ball=replace(state.ball, coefficients=empty))
    normal = _normal_matrix(state, projections)
    observed = np.flatnonzero(normal.diagonal() > 0)
    matrix = schur.add_prior(normal, observed, cells)
    state = _improve_map(state, projections, matrix, observed)
    for _ in range(brightness_rounds):
        state = state.fit_brightness(state.predict(projections))
        state = _improve_map(state, projections, matrix, observed)
    # Coefficients that no image shows get the median of the others.
    coefficients = state.ball.coefficients.clone()
    coefficients[normal.diagonal() == 0] = coefficients[observed].median()
    return replace(state, ball=replace(state.ball, coefficients=coefficients))


def update_map(state: State, projections: list[Projection], elimination: schur.Elimination) -> State:
    """Correct the map for poses that have moved: near the limb the map does not change linearly with them."""
    observed = elimination.observed
    change = elimination.map_factor.solve(_gradient(state, projections)[observed])
    return replace(state, ball=state.ball.with_map_change(observed, change))


def _improve_map(
    state: State, projections: list[Projection], matrix: scipy.sparse.csr_matrix, observed: NDArray[np.int64]
) -> State:
    """One step of the map, by the normal ``matrix`` (k, k) of its ``observed`` coefficients (k,)."""
    gradient = _gradient(state, projections) - schur.RIDGE * state.ball.coefficients.numpy()
    change, _ = scipy.sparse.linalg.cg(matrix, gradient[observed], maxiter=MAX_MAP_STEPS)
    return replace(state, ball=state.ball.with_map_change(observed, change))


def _normal_matrix(state: State, projections: list[Projection]) -> scipy.sparse.csr_matrix:
    """Normal matrix (m, m) of the map."""
    products = Products(state.ball.cells)

    def image_design(window: Window, pose: Pose, projected: Projection) -> tuple[scipy.sparse.csr_matrix, Array]:
        design = schur.design_matrix(window, projected.stencil, projected.map_slopes(window, pose))
        return design, pixel_weights.weights(window, pose, state.profile).double().numpy()

    for design, weights in threads.each(image_design, state.windows, state.poses, projections):
        products.add(design, weights)
    return products.matrix()


def _gradient(state: State, projections: list[Projection]) -> Array:
    """Descent direction (m,) of the map's coefficients by residuals and smoothness."""

    def image_gradient(window: Window, pose: Pose, projected: Projection) -> Array:
        residual = window.levels - forward_model.grey_levels(window, projected, pose, state.ball.coefficients)
        weighted = pixel_weights.weights(window, pose, state.profile) * residual
        ray_values = window.spread(pose.gain * projected.coverage * weighted, projected.light)
        return projected.stencil.adjoint(ray_values).double().numpy()

    gradient = -schur.roughness_gradient(state.ball)
    for part in threads.each(image_gradient, state.windows, state.poses, projections):
        gradient += part
    return gradient


def fit_shading(state: State) -> State:
    """Fit the light on the ball, if a light that differs from side to side explains enough of the residuals.

    Map and light are solved for together: in turns, the map would keep the light that the map has already absorbed.
    """
    for _ in range(SHADING_ROUNDS):
        ball, equations = state.ball, _shading_equations(state)
        observed = np.flatnonzero(equations.map_normal.diagonal() > 0)
        matrix, coupling = schur.add_prior(equations.map_normal, observed, ball.cells), equations.coupling[observed]
        map_right = (equations.map_right - schur.roughness_gradient(ball))[observed]
        cg = scipy.sparse.linalg.cg
        response = np.stack([cg(matrix, column, maxiter=MAX_MAP_STEPS)[0] for column in coupling.T], 1)
        map_change, _ = cg(matrix, map_right, maxiter=MAX_MAP_STEPS)
        # The constant of the light is left out: it scales as the map does.
        reduced = (equations.light_normal - coupling.T @ response)[1:, 1:]
        gradient = (equations.light_right - coupling.T @ map_change)[1:]
        change = np.linalg.solve(reduced + np.eye(SHADING_TERMS - 1) / SHADING_SD**2, gradient)
        if change @ gradient < MIN_EXPLAINED * equations.squares:
            return state
        change = np.concatenate(([0.0], change))
        ball = ball.with_map_change(observed, map_change - response @ change)
        state = replace(state, ball=replace(ball, shading=ball.shading + torch.from_numpy(change)))
    return state


@dataclass(frozen=True)
class _ShadingEquations:
    """Normal equations of the map's m coefficients and the light's 4, and the weighted sum of squared residuals."""

    map_normal: scipy.sparse.csr_matrix  # (m, m)
    coupling: Array  # (m, 4)
    light_normal: Array  # (4, 4)
    map_right: Array  # (m,)
    light_right: Array  # (4,)
    squares: float


def _shading_equations(state: State) -> _ShadingEquations:
    """Normal equations of map and light, of all images together."""
    count, ball = cube_map.coefficient_count(state.ball.cells), state.ball
    products, map_right, light_right = Products(ball.cells), np.zeros(count), np.zeros(SHADING_TERMS)
    coupling, light_normal, squares = np.zeros((count, SHADING_TERMS)), np.zeros((SHADING_TERMS, SHADING_TERMS)), 0.0
    for window, pose in zip(state.windows, state.poses, strict=True):
        model = forward_model.linearise(window, pose, ball)
        design = schur.design_matrix(window, model.stencil, model.map_slopes)
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
    return _ShadingEquations(products.matrix(), coupling, light_normal, map_right, light_right, squares)
