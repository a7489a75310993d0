"""Position and orientation of the ball, from a trajectory for the renderer."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

#: Largest deviation of a matrix from orthonormal that counts as rounding.
_ORTHONORMAL = 1e-6


@dataclass(frozen=True)
class Poses:
    """Poses of the ball in the camera frame (x right, y down, z away from the camera).

    Attributes
    ----------
    position_m : (n, 3) ndarray
        The ball's centre, m.
    orientation : (n, 3, 3) ndarray
        Rotation matrices that take body-fixed points to the camera frame.
    """

    position_m: NDArray[np.float64]
    orientation: NDArray[np.float64]

    def __post_init__(self) -> None:
        """Check the shapes and the values."""
        n = len(self.position_m)
        if self.position_m.shape != (n, 3):
            raise ValueError(f"position_m has the shape {self.position_m.shape}: expected (n, 3)")
        if self.orientation.shape != (n, 3, 3):
            raise ValueError(f"orientation has the shape {self.orientation.shape}: expected ({n}, 3, 3)")
        if not np.isfinite(self.position_m).all():
            raise ValueError("position_m holds values that are not finite: expected a place for every time")
        gram = self.orientation @ np.swapaxes(self.orientation, 1, 2)
        if not np.allclose(gram, np.eye(3), rtol=0, atol=_ORTHONORMAL) or (np.linalg.det(self.orientation) < 0).any():
            raise ValueError("orientation holds a matrix that is no rotation: expected orthonormal, determinant +1")


#: times_s (n,) -> poses; exact at any time, as the integration over the exposure needs.
Motion = Callable[[NDArray[np.float64]], Poses]
