"""Eigenfrequencies of a meshed body at rest, from the very forces that the explicit solver integrates."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import coo_matrix, csc_matrix, diags
from scipy.sparse.linalg import eigsh

from experiments.fe.explicit.elements import add_forces
from experiments.fe.explicit.solver import Body

Array = NDArray[np.float64]

#: Displacement in mm of the differences, so small that strains stay elastic.
SMALL_MM = 1e-7
#: Below this share of the shift a frequency is that of a rigid motion.
RIGID = 0.2


def stiffness(body: Body) -> csc_matrix:
    """Stiffness (3 n, 3 n) in N/mm, by moving each node of each brick a little in each direction."""
    mesh, metal = body.mesh, body.metal.constants()
    first, volume = np.arange(8)[None, :], mesh.volumes_mm3()
    blocks = np.empty((len(mesh.elements), 24, 24))
    for e, corners in enumerate(mesh.elements):
        places = mesh.nodes_mm[corners]
        for column in range(24):
            force, velocity = np.zeros((8, 3)), np.zeros((8, 3))
            velocity.flat[column] = SMALL_MM
            state = np.zeros((1, 3, 3)), np.zeros((1, 3, 4)), np.zeros(1), np.full(1, body.metal.start_k)
            # A step of a second, beside which the bulk viscosity is nothing.
            add_forces(metal, first, volume[e : e + 1], places, velocity, *state, 1.0, force, np.zeros(4))
            blocks[e, :, column] = -force.ravel() / SMALL_MM
    dof = (3 * mesh.elements[:, :, None] + np.arange(3)).reshape(-1, 24)
    rows, columns = np.repeat(dof, 24, axis=1).ravel(), np.tile(dof, 24).ravel()
    size = mesh.nodes_mm.size
    return coo_matrix((blocks.ravel(), (rows, columns)), shape=(size, size)).tocsc()


def frequencies_hz(body: Body, near_hz: float, count: int = 4) -> Array:
    """The lowest eigenfrequencies in Hz without those of rigid motions, of which at most 4 may be free.

    ``near_hz`` is what is expected of the first one; ``body.held`` is held.
    """
    scale = 1 / np.sqrt(np.repeat(body.node_mass_t, 3))
    free = ~body.held.ravel()
    weighted = diags(scale) @ stiffness(body) @ diags(scale)
    inner = weighted[free][:, free].tocsc()
    shift = (2 * math.pi * near_hz) ** 2
    # Below zero, where the matrix has no eigenvalue and can be factored.
    squares = eigsh((inner + inner.T) / 2, k=count + 4, sigma=-shift, which="LM", return_eigenvectors=False)
    found = np.sqrt(np.maximum(np.sort(squares), 0.0)) / (2 * math.pi)
    return np.asarray(found[found > RIGID * near_hz][:count])
