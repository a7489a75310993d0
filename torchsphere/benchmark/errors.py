"""Errors of a prediction, frame by frame, against the exact motion."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from torchsphere.benchmark.predictions import Prediction, rotation_vectors

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Truth:
    """Exact motion of n frames.

    Attributes
    ----------
    position : ndarray
        Centre (n, 2), px.
    orientation : ndarray
        Rotation matrices (n, 3, 3).
    visible : ndarray
        Share (n,) of the outline's area that is in the image and not covered.
    shows_rotation : bool
        Whether a rotation can be seen at all; a ball without a pattern does not show any.
    """

    position: Array
    orientation: Array
    visible: Array
    shows_rotation: bool = True


def errors_of(truth: Truth, prediction: Prediction) -> tuple[Array, Array, Array, Array]:
    """Errors of step and place (n - 1, 2), px, of step and orientation (n - 1, 3), deg, of the frames from 1 on.

    The error of a rotation is the rotation vector that leads from the true one to the stated one. A step of which only
    some components are stated has these alone, by their difference.
    """
    step = prediction.increment - _true_steps(truth)
    whole = np.isfinite(prediction.increment[:, 2:]).all(1)
    step[whole, 2:] = rotation_vectors(
        _matrices(prediction.increment[whole, 2:]),
        (truth.orientation[1:] @ truth.orientation[:-1].swapaxes(1, 2))[whole],
    )
    since = truth.orientation @ truth.orientation[0].T
    turn = np.degrees(rotation_vectors(prediction.orientation[1:], since[1:]))
    return step[:, :2], np.degrees(step[:, 2:]), (prediction.position - truth.position)[1:], turn


def _true_steps(truth: Truth) -> Array:
    """True increments (n - 1, 5), px and rad."""
    turn = rotation_vectors(truth.orientation[1:], truth.orientation[:-1])
    return np.concatenate((np.diff(truth.position, axis=0), turn), 1)


def _matrices(vectors: Array) -> Array:
    """Rotation matrices (m, 3, 3) of rotation vectors (m, 3), rad."""
    return Rotation.from_rotvec(vectors).as_matrix().reshape(-1, 3, 3)
