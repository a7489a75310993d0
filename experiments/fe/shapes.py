"""The bodies of both impacts as meshes: a quarter or half of a ball, a quarter of a bar, half of a plate."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from experiments.fe.mesh import Mesh, block, graded

Array = NDArray[np.float64]

#: Half the width of a shell about the middle of a round body, which is a square or a cube, as a share of that of the
#: shell at the surface, which is round. At 1/sqrt(3) a cube's corners would lie on the ball; at 0.75 none is thin.
CORE = 0.75


def rounded(square: Array, radius_mm: float) -> Array:
    """Points (n, d) of the square or cube from -1 to 1, its shells turned into circles or spheres outwards; in mm."""
    shell = np.abs(square).max(axis=1, keepdims=True)
    face = square / np.where(shell > 0, shell, 1)
    # Equal steps on the face become equal angles.
    spread = np.tan(np.pi / 4 * face)
    norm = np.linalg.norm(spread, axis=1, keepdims=True)
    direction = spread / np.where(norm > 0, norm, 1)
    return radius_mm * shell * ((1 - shell) * CORE * face + shell * direction)


def _both(half: Array) -> Array:
    return np.concatenate((-half[:0:-1], half))


def quarter_ball(radius_mm: float, size_mm: float, coarse_mm: float) -> Mesh:
    """The part y, z >= 0 of a ball about the origin; surface elements of ``size_mm`` at its pole +x (its side 0, 1)."""
    # A face of the cube spans 90 degrees.
    across = graded(1.0, *(np.array((size_mm, coarse_mm)) / (np.pi / 4 * radius_mm)))
    along = _both(graded(1.0, *np.array((coarse_mm, coarse_mm)) / radius_mm))
    mesh = block(along, across, across)
    return replace(mesh, nodes_mm=rounded(mesh.nodes_mm, radius_mm))


def half_ball(radius_mm: float, size_mm: float, coarse_mm: float) -> Mesh:
    """The part z >= 0 of a ball about the origin; surface elements of ``size_mm`` at its pole -y (its side 1, 0)."""
    across = graded(1.0, *(np.array((size_mm, coarse_mm)) / (np.pi / 4 * radius_mm)))
    along = _both(graded(1.0, *np.array((coarse_mm, coarse_mm)) / radius_mm))
    mesh = block(_both(across), along, across)
    return replace(mesh, nodes_mm=rounded(mesh.nodes_mm, radius_mm))


def quarter_bar(radius_mm: float, half_length_mm: float, size_mm: float, coarse_mm: float, long_mm: float) -> Mesh:
    """The part y, z >= 0 of a round bar along y; elements of ``size_mm`` at (-radius, 0, 0), on its side 0, 0.

    Towards the far side they grow to ``coarse_mm``, along the bar to ``long_mm``. Full integration makes elements of a
    length l too stiff in bending, by about ``0.4 (l / diameter)^2``: 3 % for 5 mm.
    """
    across = graded(1.0, *(np.array((size_mm, size_mm)) / (np.pi / 4 * radius_mm)))
    deep = graded(2.0, size_mm / radius_mm, coarse_mm / radius_mm) - 1
    mesh = block(deep, graded(half_length_mm, size_mm, long_mm), across)
    nodes = mesh.nodes_mm.copy()
    nodes[:, (0, 2)] = rounded(nodes[:, (0, 2)], radius_mm)
    return replace(mesh, nodes_mm=nodes)


def half_plate(
    length_mm: float,
    width_mm: float,
    thickness_mm: float,
    fine_mm: tuple[float, float],
    size_mm: float,
    long_mm: float,
    layers: int = 1,
) -> Mesh:
    """The part z >= 0 of a plate with its upper face at y = 0 (side 1, 1), ``layers`` elements thick.

    Elements of ``size_mm`` where x lies in the interval ``fine_mm`` and z = 0, growing to ``long_mm`` at the edges.
    """
    low, high = fine_mm
    before = graded(length_mm / 2 + low, size_mm, long_mm)
    middle = graded(high - low, size_mm, size_mm)
    after = graded(length_mm / 2 - high, size_mm, long_mm)
    x = np.concatenate((low - before[::-1], low + middle[1:], high + after[1:]))
    z = graded(width_mm / 2, size_mm, long_mm)
    return block(x, np.linspace(-thickness_mm, 0.0, layers + 1), z)
