"""The sparse equations of a map: which of its coefficients each pixel sees, and their products summed over all pixels.

Nearly all pixels see a patch of one face of at most `SIDE` coefficients on a side. Their products go to dense rows of
neighbours, eight at once; those of the few on a seam or far out, where a pixel sees many, to a product of sparse
matrices.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import scipy  # which imports scipy.sparse on its first use: 0.1 s, and a track without a map has none
from numpy.typing import NDArray
from torch import Tensor

from torchsphere.kernels import cube_map
from torchsphere.kernels.jit import compiled

Array = NDArray[Any]
Double = NDArray[np.float64]
Numbers = NDArray[np.int32]

#: Side of the patches, and columns kept for each row of a coefficient's neighbours: from 7 before it to 8 behind.
SIDE, COLUMNS = 8, 16


def design(
    amount: Tensor, owner: Tensor, pixels: int, cells: int, corner: Tensor, offset: Tensor
) -> scipy.sparse.csr_matrix:
    """Derivative (p, m) of the pixels' grey levels by the map's coefficients.

    Parameters
    ----------
    amount : Tensor
        What a unit of the map adds along each ray (q,).
    owner : Tensor
        The ray's pixel (q,), in ascending order.
    pixels, cells : int
        Number of pixels, and of cells along a face.
    corner, offset : Tensor
        Where the rays meet the map: see `cube_map.Stencil`.
    """
    size = 6 * (cells + 3) ** 2
    index, values = np.empty(16 * len(owner), np.int32), np.empty(16 * len(owner))
    places, latest = np.zeros(pixels + 1, np.int32), np.full(size, -1, np.int32)
    x, y = offset.numpy()
    given = amount.contiguous().numpy(), owner.numpy(), cells + 3, corner.numpy(), x, y
    count = _design(*given, latest, places, index, values)
    return scipy.sparse.csr_matrix((values[:count].copy(), index[:count].copy(), places), shape=(pixels, size))


@compiled
def _design(
    amount: Array,
    owner: NDArray[np.int64],
    width: int,
    corner: Numbers,
    x: Array,
    y: Array,
    latest: Numbers,
    places: Numbers,
    index: Numbers,
    values: Double,
) -> int:
    """Fill ``places``, ``index`` and ``values`` of the sparse matrix, and count the entries."""
    count, first, pixel = 0, 0, -1
    for i in range(len(amount)):
        if owner[i] != pixel:
            places[pixel + 1 : owner[i] + 1] = count
            pixel, first = owner[i], count
        of_x, of_y = cube_map.weights(x[i]), cube_map.weights(y[i])
        row = corner[i]
        for across in of_y:
            part, number = amount[i] * across, row
            for along in of_x:
                entry = latest[np.uint32(number)]
                if entry < first:
                    # This pixel has not touched it yet.
                    entry = count
                    latest[np.uint32(number)], index[count], values[count] = count, number, 0.0
                    count += 1
                values[np.uint32(entry)] += part * along
                number += 1
            row += width
    places[pixel + 1 :] = count
    return count


class Products:
    """Sum of the normal equations (m, m) of a map over images, one after the other.

    Parameters
    ----------
    cells : int
        Cells along a face of the map.
    """

    def __init__(self, cells: int) -> None:
        width = cells + 3
        self._size = 6 * width**2
        self._lines, self._columns = (n.astype(np.int32) for n in np.divmod(np.arange(self._size), width))
        self._width, self._near = width, np.zeros((self._size, SIDE, COLUMNS))
        self._far: list[scipy.sparse.csr_matrix] = []

    def add(self, design: scipy.sparse.csr_matrix, weights: Double) -> None:
        """Add one image with its `design` (p, m) and the weights (p,) of its pixels."""
        far = np.zeros(len(weights), np.bool_)
        given = design.indptr, design.indices, design.data, weights, self._width, self._lines, self._columns
        _near_products(*given, np.empty(SIDE * SIDE), self._near.reshape(-1), far)
        wide = design[far]
        self._far.append(wide.multiply(np.sqrt(weights[far])[:, None]).tocsr())

    def matrix(self) -> scipy.sparse.csr_matrix:
        """The sum over all images."""
        known = np.count_nonzero(self._near[:, 0, SIDE - 1 :]) + np.count_nonzero(self._near[:, 1:])
        index, values, places = np.empty(known, np.int32), np.empty(known), np.zeros(self._size + 1, np.int32)
        _gathered(self._near, self._width, places, index, values)
        upper = scipy.sparse.csr_matrix((values, index, places), shape=(self._size, self._size))
        lower = scipy.sparse.tril(upper.T, -1)
        far = scipy.sparse.vstack(self._far, format="csr")
        return upper + lower + far.T @ far


@compiled
def _near_products(
    places: Numbers,
    index: Numbers,
    values: Double,
    weights: Double,
    width: int,
    lines: Numbers,
    columns: Numbers,
    patch: Double,
    near: Double,
    far: NDArray[np.bool_],
) -> None:
    """Add the products of the pixels with small patches to ``near`` (m SIDE COLUMNS,); tell which are ``far``.

    ``patch`` (SIDE SIDE,) is where each is laid out. Only coefficients in the same row or in the rows behind are kept.
    """
    for pixel in range(len(weights)):
        first, last = places[pixel], places[pixel + 1]
        if first == last:
            continue
        top = bottom = lines[index[first]]
        left = right = columns[index[first]]
        for k in range(first, last):
            line, column = lines[index[k]], columns[index[k]]
            top, bottom = min(top, line), max(bottom, line)
            left, right = min(left, column), max(right, column)
        if bottom - top >= SIDE or right - left >= SIDE or top // width != bottom // width:
            far[pixel] = True
            continue
        patch[:] = 0.0
        for k in range(first, last):
            patch[(lines[index[k]] - top) * SIDE + columns[index[k]] - left] = values[k]
        height = bottom - top + 1
        for k in range(first, last):
            row, column = lines[index[k]] - top, columns[index[k]] - left
            amount = weights[pixel] * values[k]
            start = index[k] * SIDE * COLUMNS + SIDE - 1 - column
            _add_rows(amount, patch, row, height, start, near)


@compiled
def _add_rows(amount: float, patch: Double, row: int, height: int, start: int, total: Double) -> None:
    """Add ``amount`` times the patch's rows from ``row`` on to the neighbours that ``start`` in the flat ``total``."""
    at = np.uint64(start)
    for source in range(row * SIDE, height * SIDE, SIDE):
        for column in range(SIDE):
            total[at + np.uint64(column)] += amount * patch[np.uint64(source) + np.uint64(column)]
        at += np.uint64(COLUMNS)


@compiled
def _gathered(near: Array, width: int, places: Numbers, index: Numbers, values: Double) -> None:
    """The upper half of the sum as a sparse matrix."""
    count = 0
    for number in range(len(near)):
        for row in range(SIDE):
            for column in range(SIDE - 1 if row == 0 else 0, COLUMNS):
                if near[number, row, column] != 0:
                    index[count] = number + row * width + column - (SIDE - 1)
                    values[count] = near[number, row, column]
                    count += 1
        places[number + 1] = count
