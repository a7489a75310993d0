"""Orientation of the ball: rotations of successive frames chained on SO(3)."""

from __future__ import annotations

import numpy as np
import torch
from kornia.geometry.liegroup import So3
from kornia.geometry.quaternion import Quaternion
from numpy.typing import NDArray


def chain(rotation: NDArray[np.float64], known: NDArray[np.bool_]) -> NDArray[np.float64]:
    """Rotation matrices (n, 3, 3) since the first known frame: ``A_i = exp([w_i]x) A_{i-1}``.

    ``rotation`` (n, 3), rad: rotation vectors since the last known frame, NaN where a rotation was not measured; the
    first known frame's is not used. ``known`` (n,): True where the ball was seen. The result is NaN in frames that are
    not known, and from a missing rotation on.
    """
    steps = np.where(known[:, None], rotation, 0.0)
    if known.any():
        steps[: known.argmax() + 1] = 0.0
    product = So3.exp(torch.from_numpy(steps))
    # Each round doubles the number of rotations in every product: log2(n) batched products.
    reach = 1
    while reach < len(steps):
        later = So3(product.q[reach:]) * So3(product.q[:-reach])
        product = So3(type(product.q)(torch.cat((product.q.data[:reach], later.q.data))))
        reach *= 2
    matrices = product.matrix().numpy()
    return np.where(known[:, None, None], matrices, np.nan)


def quaternions(orientation: NDArray[np.float64]) -> NDArray[np.float64]:
    """Unit quaternions (n, 4) as (w, x, y, z) of rotation matrices (n, 3, 3), without jumps of sign; NaN stays NaN."""
    known = np.isfinite(orientation[:, 0, 0])
    result = np.full((len(orientation), 4), np.nan)
    if known.any():
        q = So3.from_matrix(torch.from_numpy(orientation[known])).q.data.numpy()
        q = q / np.linalg.norm(q, axis=1, keepdims=True)
        turned = np.concatenate(([1.0], np.where((q[1:] * q[:-1]).sum(1) < 0, -1.0, 1.0))).cumprod()
        result[known] = q * turned[:, None] * (1.0 if q[0, 0] >= 0 else -1.0)
    return result


def matrices(quaternion: NDArray[np.float64]) -> NDArray[np.float64]:
    """Rotation matrices (n, 3, 3) of unit quaternions (n, 4) as (w, x, y, z); NaN stays NaN."""
    known = np.isfinite(quaternion).all(1)
    result = np.full((len(quaternion), 3, 3), np.nan)
    if known.any():
        result[known] = So3(Quaternion(torch.from_numpy(quaternion[known]))).matrix().numpy()
    return result


def rotation_vectors(later: NDArray[np.float64], earlier: NDArray[np.float64]) -> NDArray[np.float64]:
    """Rotation vectors (m, 3) from ``earlier`` to ``later`` orientations (m, 3, 3), rad; NaN stays NaN."""
    # SciPy's rotations load its sparse matrices, which most tracks do not need.
    from scipy.spatial.transform import Rotation

    product = later @ earlier.swapaxes(1, 2)
    vectors = np.full((len(product), 3), np.nan)
    known = np.isfinite(product).all((1, 2))
    if known.any():
        vectors[known] = Rotation.from_matrix(product[known]).as_rotvec()
    return vectors
