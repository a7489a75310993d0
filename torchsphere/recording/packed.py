"""Unpack grey levels of 10 and 12 bits that cameras store without gaps, most significant bits first."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray


def unpack_10(data: NDArray[np.uint8]) -> NDArray[np.uint16]:
    """Unpack five bytes into four 10-bit values.

    Parameters
    ----------
    data : ndarray of uint8, shape (..., 5 m)

    Returns
    -------
    ndarray of uint16, shape (..., 4 m)
    """
    five = data.reshape(*data.shape[:-1], -1, 5)
    values = np.empty((*five.shape[:-1], 4), np.uint16)
    for k in range(4):
        high, low = five[..., k].astype(np.uint16), five[..., k + 1]
        # Value k starts 2 k bits into byte k.
        values[..., k] = ((high << (2 * k + 2)) & 0x3FF) | (low >> (6 - 2 * k))
    return values.reshape(*data.shape[:-1], -1)


def unpack_12(data: NDArray[np.uint8]) -> NDArray[np.uint16]:
    """Unpack three bytes into two 12-bit values.

    Parameters
    ----------
    data : ndarray of uint8, shape (..., 3 m)

    Returns
    -------
    ndarray of uint16, shape (..., 2 m)
    """
    three = data.reshape(*data.shape[:-1], -1, 3)
    values = np.empty((*three.shape[:-1], 2), np.uint16)
    first, middle, last = three[..., 0], three[..., 1], three[..., 2]
    np.left_shift(first, 4, out=values[..., 0], dtype=np.uint16)
    values[..., 0] |= middle >> 4
    np.left_shift(middle & 0x0F, 8, out=values[..., 1], dtype=np.uint16)
    values[..., 1] |= last
    return values.reshape(*data.shape[:-1], -1)
