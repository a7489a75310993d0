"""Rotations as matrices, vectors and quaternions, always batched; ``A_{i+1} = exp([w]x) A_i`` in the camera frame."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

#: Angle, rad, below which the first terms of the series of ``(1 - cos a) / a^2`` and ``sin a / a`` are exact to double
#: precision.
_SMALL = 1e-4


def exp(vector: Array) -> Array:
    """Rotation matrices (n, 3, 3) of rotation vectors (n, 3), rad, by the formula of Rodrigues."""
    angle = np.linalg.norm(vector, axis=-1)
    small = angle < _SMALL
    safe = np.where(small, 1.0, angle)
    first = np.where(small, 1.0 - angle**2 / 6.0, np.sin(safe) / safe)
    # 2 sin^2(a/2) is 1 - cos(a) without cancellation.
    second = np.where(small, 0.5 - angle**2 / 24.0, 2.0 * np.sin(0.5 * safe) ** 2 / safe**2)
    k = cross_matrix(vector)
    return np.asarray(np.eye(3) + first[..., None, None] * k + second[..., None, None] * (k @ k))


def cross_matrix(vector: Array) -> Array:
    """The matrices (n, 3, 3) with ``[w]x v = w x v`` of vectors (n, 3)."""
    x, y, z = np.moveaxis(np.asarray(vector, dtype=np.float64), -1, 0)
    zero = np.zeros_like(x)
    return np.stack(
        (np.stack((zero, -z, y), -1), np.stack((z, zero, -x), -1), np.stack((-y, x, zero), -1)),
        axis=-2,
    )


def log(matrix: Array) -> Array:
    """Rotation vectors (n, 3) in rad, of length at most pi, of rotation matrices (n, 3, 3)."""
    q = quaternion(matrix)
    sine = np.linalg.norm(q[..., 1:], axis=-1)
    safe = np.where(sine > 0, sine, 1.0)
    # For a small angle the half angle's sine is the half angle itself.
    factor = np.where(sine > 0, 2.0 * np.arctan2(sine, q[..., 0]) / safe, 2.0)
    return np.asarray(factor[..., None] * q[..., 1:])


def quaternion(matrix: Array) -> Array:
    """Unit quaternions (n, 4) as (w, x, y, z) with w >= 0, of rotation matrices (n, 3, 3).

    The best conditioned of four formulas is used for each matrix (Shepperd 1978), so half turns are exact, too.
    """
    m = np.asarray(matrix, dtype=np.float64)
    trace = np.trace(m, axis1=-2, axis2=-1)
    diagonal = np.diagonal(m, axis1=-2, axis2=-1)
    # Products 4 q_i q_j: row i, divided by its length, is the quaternion, up to its sign.
    products = np.empty((*m.shape[:-2], 4, 4))
    products[..., 0, 0] = 1.0 + trace
    for i in range(3):
        j, k = (i + 1) % 3, (i + 2) % 3
        products[..., i + 1, i + 1] = 1.0 + 2.0 * diagonal[..., i] - trace
        products[..., 0, i + 1] = products[..., i + 1, 0] = m[..., k, j] - m[..., j, k]
        products[..., i + 1, j + 1] = products[..., j + 1, i + 1] = m[..., i, j] + m[..., j, i]
    best = np.diagonal(products, axis1=-2, axis2=-1).argmax(-1)
    q = np.take_along_axis(products, best[..., None, None], axis=-2)[..., 0, :]
    q = q / np.linalg.norm(q, axis=-1, keepdims=True)
    return np.asarray(np.where(q[..., :1] < 0, -q, q))


def continuous(quaternions: Array) -> Array:
    """The quaternions (n, 4) of successive frames without jumps of sign; the first has w >= 0."""
    q = np.asarray(quaternions, dtype=np.float64)
    sign = np.where((q[1:] * q[:-1]).sum(1) < 0, -1.0, 1.0)
    first = -1.0 if len(q) and q[0, 0] < 0 else 1.0
    return np.asarray(q * np.concatenate(([first], first * sign.cumprod()))[: len(q), None])


def from_quaternion(quaternions: Array) -> Array:
    """Rotation matrices (n, 3, 3) of quaternions (n, 4) as (w, x, y, z), of any length but zero."""
    q = np.asarray(quaternions, dtype=np.float64)
    q = q / np.linalg.norm(q, axis=-1, keepdims=True)
    k = cross_matrix(q[..., 1:])
    return np.asarray(np.eye(3) + 2.0 * q[..., 0, None, None] * k + 2.0 * (k @ k))


def compose(later: Array, earlier: Array) -> Array:
    """The rotation vectors (n, 3) of ``exp([later]x) exp([earlier]x)``, of rotation vectors (n, 3)."""
    return log(exp(later) @ exp(earlier))


def increments(orientation: Array) -> Array:
    """Rotation vectors (n - 1, 3) in rad that lead from each orientation (n, 3, 3) to the next, in the camera frame."""
    return log(orientation[1:] @ np.swapaxes(orientation[:-1], -1, -2))
