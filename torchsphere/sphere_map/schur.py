"""Normal equations of map and poses, and the elimination of the map from them (Schur complement).

The map has thousands of coefficients, but each pixel depends on a few neighbours only: the map's equations are sparse
and are factorised once. The Schur complement is small and dense. Its inverse is the covariance of the poses, which
includes the uncertainty of the map.
"""

from __future__ import annotations

import functools
from dataclasses import dataclass

import numpy as np
import scipy  # imports scipy.sparse on first use: 0.1 s, which a track without a map does not need
from numpy.typing import NDArray
from torch import Tensor

from torchsphere.kernels import map_equations
from torchsphere.kernels.map_equations import Products
from torchsphere.runtime import threads
from torchsphere.sphere_map import cube_map, pixel_weights
from torchsphere.sphere_map.cube_map import Stencil
from torchsphere.sphere_map.forward_model import Linearisation
from torchsphere.sphere_map.projection import Pose, TexturedBall
from torchsphere.sphere_map.state import LinearisedState
from torchsphere.sphere_map.window import Window

Array = NDArray[np.float64]

#: Prior weights of the map's second differences and of its coefficients, against one pixel (docs/constants.md).
SMOOTHNESS, RIDGE = 1e-3, 2e-4

#: Number of unknowns that all images share: radius and edge blur.
SHARED_UNKNOWNS = 2


@dataclass(frozen=True)
class Elimination:
    """The factorised map equations and their coupling with the u = 5 n + 2 other unknowns."""

    map_factor: scipy.sparse.linalg.SuperLU  # factorised normal matrix of the k observed coefficients
    observed: NDArray[np.int64]  # numbers (k,) of the coefficients that the images show
    coupling: Array  # normal matrix (k, u) between map and the other unknowns
    map_response: Array  # ``coupling`` solved for the map (k, u): minus the change of the map by the other unknowns
    covariance: Array  # covariance (u, u) of the other unknowns: the inverse of the Schur complement


def design_matrix(window: Window, stencil: Stencil, map_slopes: Tensor) -> scipy.sparse.csr_matrix:
    """Derivative (p, m) of the grey levels by the map's coefficients; ``map_slopes`` (q,) as in `Linearisation`."""
    rays = map_slopes, window.ray_pixels, len(window.pixels)
    return map_equations.design(*rays, stencil.cells, stencil.corner, stencil.offset)


def add_prior(normal: scipy.sparse.csr_matrix, observed: NDArray[np.int64], cells: int) -> scipy.sparse.csr_matrix:
    """Normal matrix (k, k) of the map's ``observed`` coefficients with smoothness and ridge."""
    prior = SMOOTHNESS * roughness_matrix(cells) + RIDGE * scipy.sparse.identity(normal.shape[0])
    return (normal + prior).tocsr()[observed][:, observed]


def _factorise(matrix: scipy.sparse.csr_matrix) -> scipy.sparse.linalg.SuperLU:
    """Sparse factorisation; raises LinAlgError if the matrix is singular."""
    options = {"SymmetricMode": True}
    splu = scipy.sparse.linalg.splu
    try:
        return splu(matrix.tocsc(), permc_spec="MMD_AT_PLUS_A", diag_pivot_thresh=0.0, options=options)
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

    images = threads.each(image_equations, state.windows, state.poses, linearised.model)
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
    """Constraint (5 n + 2, 5 n + 2) against a common rotation of all poses, with which the map would rotate.

    The constraint holds no single pose: its image would have to fit a map that still rotates.
    """
    common = np.zeros((3, 5 * len(poses) + SHARED_UNKNOWNS))
    for i, pose in enumerate(poses):
        common[:, 5 * i + 2 : 5 * i + 5] = pose.orientation.T.numpy()
    return stiffness / len(poses) * common.T @ common


def image_unknowns(i: int, n: int) -> list[int]:
    """Numbers of the unknowns on which image ``i`` of ``n`` depends."""
    return [*range(5 * i, 5 * i + 5), *range(5 * n, 5 * n + SHARED_UNKNOWNS)]
