"""A cut through the deformed mesh, coloured by its plastic strain, with the ball."""

from __future__ import annotations

import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import PolyCollection
from matplotlib.patches import Circle
from numpy.typing import NDArray

from experiments.fe.explicit.impacts import Done
from experiments.fe.mesh import FACE_CORNERS, FACES

Array = NDArray[np.float64]


def cut(done: Done) -> tuple[Array, Array]:
    """Faces (f, 4, 2) of the bricks on the plane of symmetry z = 0 at the end, in mm, and their plastic strain (f,)."""
    mesh = done.case.body().mesh
    side = mesh.side(2, 0)
    corners = mesh.elements[side][:, list(FACE_CORNERS[FACES[2][0]])]
    return done.nodes_mm[corners][:, :, :2], done.plastic_strain[side]


def draw_cut(axis: Axes, done: Done, mirrored: bool) -> PolyCollection:
    """Draw the cut and the ball; ``mirrored`` adds the other side of the plane y = 0. Returns what has the colours."""
    faces, strain = cut(done)
    if mirrored:
        faces, strain = np.concatenate((faces, faces * (1, -1))), np.concatenate((strain, strain))
    drawn = PolyCollection(list(faces), array=strain, cmap="viridis", edgecolors="0.4", linewidths=0.2)
    axis.add_collection(drawn)
    centre = done.place_mm[-1, :2]
    axis.add_patch(Circle((centre[0], centre[1]), done.case.radius_mm, fill=False, color="black", lw=1))
    axis.set_aspect("equal")
    return drawn


def edges_mm(done: Done) -> tuple[float, float]:
    """Shortest and longest edge of the mesh before the impact."""
    mesh = done.case.body().mesh
    pairs = np.concatenate([mesh.elements[:, list(p)] for p in ((0, 1), (0, 3), (0, 4))])
    length = np.linalg.norm(mesh.nodes_mm[pairs[:, 0]] - mesh.nodes_mm[pairs[:, 1]], axis=1)
    return float(length.min()), float(length.max())
