"""The normal equations of map and poses together, and the map eliminated from them.

The map's coefficients are thousands, but each pixel touches a few neighbours only: their equations are sparse and are
factorised once. What the elimination leaves (the Schur complement) is small and dense, and its inverse is the
covariance of the poses with the map's own uncertainty in it.
"""

from __future__ import annotations

import functools
from dataclasses import dataclass

import numpy as np
import scipy  # which imports scipy.sparse on its first use: 0.1 s, and a track without a map has none
from numpy.typing import NDArray
from torch import Tensor

from torchsphere.kernels import map_equations
from torchsphere.kernels.map_equations import Products
from torchsphere.runtime import threads
from torchsphere.sphere_map import cube_map, pixel_weights
from torchsphere.sphere_map.cube_map import Stencil
from torchsphere.sphere_map.forward_model import Linearised
from torchsphere.sphere_map.pixel_weights import Profile
from torchsphere.sphere_map.projection import Pose
from torchsphere.sphere_map.window import Window

Array = NDArray[np.float64]

#: Weight of the second differences of the map's coefficients, and of the coefficients themselves, against a pixel's
#: noise: cells that only limbs have shown would follow their noise otherwise.
SMOOTHNESS, RIDGE = 1e-3, 2e-4

#: Unknowns that all images share: radius and edge blur.
SHARED = 2


@dataclass(frozen=True)
class Elimination:
    """The factorised map and what couples it with the poses."""

    map: scipy.sparse.linalg.SuperLU
    seen: NDArray[np.int64]
    coupling: Array
    solved: Array
    reduced_inverse: Array


def design_matrix(window: Window, look: Stencil, light: Tensor) -> scipy.sparse.csr_matrix:
    """Derivative (p, m) of the grey levels by the map's coefficients; ``light`` (q,) as in `Linearised`."""
    return map_equations.design(light, window.owner, len(window.pixels), look.cells, look.corner, look.offset)


def with_prior(normal: scipy.sparse.csr_matrix, seen: NDArray[np.int64], cells: int) -> scipy.sparse.csr_matrix:
    """Normal equations of the map's ``seen`` coefficients with what is known of them beforehand."""
    known = SMOOTHNESS * roughness_matrix(cells) + RIDGE * scipy.sparse.identity(normal.shape[0])
    return (normal + known).tocsr()[seen][:, seen]


def _factor(matrix: scipy.sparse.csr_matrix) -> scipy.sparse.linalg.SuperLU:
    """Sparse factorisation; LinAlgError where the matrix has none."""
    options = {"SymmetricMode": True}
    splu = scipy.sparse.linalg.splu
    try:
        return splu(matrix.tocsc(), permc_spec="MMD_AT_PLUS_A", diag_pivot_thresh=0.0, options=options)
    except RuntimeError as error:  # SciPy's word for a singular matrix
        raise np.linalg.LinAlgError(str(error)) from error


@functools.lru_cache(maxsize=4)
def roughness_matrix(cells: int) -> scipy.sparse.csr_matrix:
    """Matrix of the sum of squares of `cube_map.roughness`."""
    width = cells + 3
    second = scipy.sparse.diags([1.0, -2.0, 1.0], [0, 1, 2], shape=(width - 2, width))
    square, same = second.T @ second, scipy.sparse.identity(width)
    face = scipy.sparse.kron(same, square) + scipy.sparse.kron(square, same)
    return scipy.sparse.kron(scipy.sparse.identity(6), face).tocsr()


def eliminate(windows: list[Window], poses: list[Pose], model: list[Linearised], profile: Profile) -> Elimination:
    """Normal equations of map and poses together, and the map eliminated from them; ``model`` is that at the poses."""
    cells, n = model[0].look.cells, len(windows)
    count = cube_map.size(cells)
    total = 5 * n + SHARED
    products = Products(cells)
    coupling, own = np.zeros((count, total)), np.zeros((total, total))

    def of_one(window: Window, pose: Pose, now: Linearised) -> tuple[scipy.sparse.csr_matrix, Array, Array, Array]:
        design = design_matrix(window, now.look, now.light)
        weights = pixel_weights.weights(window, pose, profile).double().numpy()
        slopes = now.slopes.double().numpy()
        weighted = weights[:, None] * slopes
        return design, weights, design.T @ weighted, slopes.T @ weighted

    for i, (design, weights, between, of_pose) in enumerate(threads.each(of_one, windows, poses, model)):
        products.add(design, weights)
        columns = columns_of(i, n)
        coupling[:, columns] += between
        own[np.ix_(columns, columns)] += of_pose
    normal = products.matrix()
    seen = np.flatnonzero(normal.diagonal() > 0)
    factor = _factor(with_prior(normal, seen, cells))
    coupling = coupling[seen]
    solved = factor.solve(coupling)
    reduced = own - coupling.T @ solved
    inverse = np.linalg.inv(reduced + _held_frame(poses, float(np.diag(own)[:5].max())))
    return Elimination(factor, seen, coupling, solved, inverse)


def _held_frame(poses: list[Pose], stiffness: float) -> Array:
    """Constraint (5 n + 2, 5 n + 2) that the poses do not all turn together: the map would turn with them.

    No one pose is held, since its image would then have to fit a map that is still turning.
    """
    together = np.zeros((3, 5 * len(poses) + SHARED))
    for i, pose in enumerate(poses):
        together[:, 5 * i + 2 : 5 * i + 5] = pose.orientation.T.numpy()
    return stiffness / len(poses) * together.T @ together


def columns_of(i: int, n: int) -> list[int]:
    """Unknowns that image ``i`` of ``n`` depends on."""
    return [*range(5 * i, 5 * i + 5), *range(5 * n, 5 * n + SHARED)]
