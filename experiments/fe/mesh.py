"""Meshes of eight-node bricks: blocks with graded edges, their faces, volumes and the share of each node."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Index = NDArray[np.int64]

#: Corners of the brick in CalculiX's order, in local coordinates from -1 to 1.
CORNERS = np.array(
    [(-1, -1, -1), (1, -1, -1), (1, 1, -1), (-1, 1, -1), (-1, -1, 1), (1, -1, 1), (1, 1, 1), (-1, 1, 1)], dtype=float
)
#: CalculiX's number of the brick's face at the low and the high end of each axis.
FACES = ((6, 4), (3, 5), (1, 2))
#: Corners of the brick's faces, by CalculiX's number.
FACE_CORNERS = {
    1: (0, 1, 2, 3),
    2: (4, 7, 6, 5),
    3: (0, 4, 5, 1),
    4: (1, 5, 6, 2),
    5: (2, 6, 7, 3),
    6: (3, 7, 4, 0),
}


@dataclass(frozen=True)
class Mesh:
    """Bricks: ``n`` nodes, ``e`` elements; numbers from 0."""

    nodes_mm: Array  # places (n, 3)
    elements: Index  # nodes of each element (e, 8), in CalculiX's order
    grid: tuple[int, int, int]  # elements along the block's three axes; the last varies fastest in both numberings

    @property
    def centres_mm(self) -> Array:
        """Means of the elements' corners (e, 3)."""
        return self.nodes_mm[self.elements].mean(axis=1)

    def moved(self, by_mm: tuple[float, float, float]) -> Mesh:
        """The mesh moved by a vector."""
        return replace(self, nodes_mm=self.nodes_mm + np.array(by_mm))

    def side(self, axis: int, end: int) -> Index:
        """Elements at the low (0) or the high (1) end of one of the axes; their face is ``FACES[axis][end]``."""
        numbers = np.arange(len(self.elements)).reshape(self.grid)
        return numbers.take(0 if end == 0 else -1, axis=axis).ravel()

    def jacobians(self) -> Array:
        """Volumes per local volume (e, 8) in mm^3 at the 2 x 2 x 2 points of Gauss."""
        points = CORNERS / np.sqrt(3)
        return np.linalg.det(np.einsum("ecx,gcl->egxl", self.nodes_mm[self.elements], _slopes(points)))

    def volumes_mm3(self) -> Array:
        """Volumes of the elements (e,), by the points of Gauss, as in CalculiX."""
        return self.jacobians().sum(axis=1)

    def shares(self) -> Array:
        """Share of the mass that each node has in CalculiX's lumped matrix (n,), sum 1.

        The diagonal of the consistent matrix, scaled to the element's mass (Hinton, Rock and Zienkiewicz, Earthquake
        Engineering and Structural Dynamics 4 (1976) 245). With sums of rows instead, the ringing of a ball in free
        flight would show in its momentum.
        """
        jacobians = self.jacobians()
        diagonal = jacobians @ _shapes(CORNERS / np.sqrt(3)) ** 2
        mass = diagonal * (jacobians.sum(axis=1) / diagonal.sum(axis=1))[:, None]
        total = np.bincount(self.elements.ravel(), mass.ravel(), minlength=len(self.nodes_mm))
        return total / total.sum()

    def thinnest_mm(self) -> float:
        """Least height of an element, volume over largest face; it limits the step of an explicit integration."""
        places = self.nodes_mm[self.elements]
        areas = []
        for corners in FACE_CORNERS.values():
            a, b, c, d = (places[:, i] for i in corners)
            areas.append(np.linalg.norm(np.cross(c - a, d - b), axis=1) / 2)
        return float((self.volumes_mm3() / np.max(areas, axis=0)).min())


def _shapes(points: Array) -> Array:
    """Shape functions (g, 8) of the brick at local points (g, 3)."""
    return np.prod(1 + points[:, None] * CORNERS, axis=2) / 8


def _slopes(points: Array) -> Array:
    """Derivatives (g, 8, 3) of the shape functions along the local axes."""
    factors = 1 + points[:, None] * CORNERS
    slopes = [CORNERS[:, i] * np.prod(np.delete(factors, i, axis=2), axis=2) for i in range(3)]
    return np.stack(slopes, axis=2) / 8


def graded(length: float, first: float, last: float) -> Array:
    """Places from 0 to a length whose spacing grows evenly in ratio from about ``first`` to about ``last``.

    Raises
    ------
    ValueError
        Where a size is not above 0, or above the length.
    """
    if not (0 < first <= length and 0 < last <= length):
        raise ValueError(f"first = {first!r}, last = {last!r}: expected element sizes above 0 and up to {length:g}")
    # The mean of sizes in geometric progression is the logarithmic mean of the first and the last.
    mean = first if np.isclose(first, last) else (last - first) / np.log(last / first)
    count = max(1, round(length / mean))
    sizes = np.geomspace(first, last, count)
    return np.concatenate(((0.0,), np.cumsum(sizes) * (length / sizes.sum())))


def block(x: Array, y: Array, z: Array) -> Mesh:
    """A block whose nodes have all combinations of the places along its three edges."""
    shape = tuple(len(places) for places in (x, y, z))
    if min(shape) < 2:
        raise ValueError(f"places along the edges: {shape}, expected at least 2 each")
    numbers = np.arange(np.prod(shape)).reshape(shape)
    nodes = np.stack(np.meshgrid(x, y, z, indexing="ij"), axis=-1).reshape(-1, 3)
    cells = (shape[0] - 1, shape[1] - 1, shape[2] - 1)
    elements = np.empty((*cells, 8), dtype=np.int64)
    for corner, local in enumerate(CORNERS):
        low = [int(at > 0) for at in local]
        elements[..., corner] = numbers[tuple(slice(i, i + n) for i, n in zip(low, cells, strict=True))]
    return Mesh(nodes, elements.reshape(-1, 8), cells)
