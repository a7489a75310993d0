"""Vectors as fields of trajectories."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

#: x, y, z in the camera frame.
Vector = tuple[float, float, float]


def array(value: Vector, factor: float = 1.0) -> NDArray[np.float64]:
    """The tuple, times a factor of units, as an array (3,)."""
    return factor * np.array(value, dtype=np.float64)


def unit_vector(value: Vector) -> NDArray[np.float64]:
    """The tuple's direction as a unit vector (3,)."""
    return np.asarray(array(value) / np.linalg.norm(value))
