"""Sparse normal equations of a map: derivatives by its coefficients, and their products summed over all pixels.

Most pixels see a patch of one face of at most `SIDE` by `SIDE` coefficients: their products go to dense rows. Pixels on
a seam or near the limb go to a product of sparse matrices.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import scipy  # imports scipy.sparse on first use, which takes 0.1 s; a track without a map never does
from numpy.typing import NDArray
from torch import Tensor

from torchsphere.kernels import cube_map
from torchsphere.kernels.jit import Doubles, compiled

Array = NDArray[Any]
Numbers = NDArray[np.int32]

#: Side of the patches, and columns in a row of neighbours of a coefficient: from 7 before it to 8 behind.
SIDE, COLUMNS = 8, 16


def design(
    amount: Tensor, owner: Tensor, pixels: int, cells: int, corner: Tensor, offset: Tensor
) -> scipy.sparse.csr_matrix:
    """Derivative (p, m) of the pixels' grey levels by the map's coefficients.

    ``amount`` (q,): effect of a unit of the map along each ray; ``owner`` (q,): the ray's pixel, ascending; ``corner``
    and ``offset``: where rays meet the map of ``cells`` per face side, see `cube_map.Stencil`.
    """
    size = 6 * (cells + 3) ** 2
    index, values = np.empty(16 * len(owner), np.int32), np.empty(16 * len(owner))
    places, latest = np.zeros(pixels + 1, np.int32), np.full(size, -1, np.int32)
    x, y = offset.numpy()
    given = amount.contiguous().numpy(), owner.numpy(), corner.numpy(), x, y
    count = _design(given, cells + 3, (latest, places, index, values))
    return scipy.sparse.csr_matrix((values[:count].copy(), index[:count].copy(), places), shape=(pixels, size))


@compiled
def _design(given: tuple[Array, ...], width: int, found: tuple[Array, ...]) -> int:
    """Fill ``places``, ``index`` and ``values`` of the sparse matrix, and count the entries."""
    amount, owner, corner, x, y = given
    latest, places, index, values = found
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
                    # First entry of this coefficient for this pixel.
                    entry = count
                    latest[np.uint32(number)], index[count], values[count] = count, number, 0.0
                    count += 1
                values[np.uint32(entry)] += part * along
                number += 1
            row += width
    places[pixel + 1 :] = count
    return count


class Products:
    """Normal equations (m, m) of a map with ``cells`` per face side, summed image by image."""

    def __init__(self, cells: int) -> None:
        width = cells + 3
        self._size = 6 * width**2
        self._lines, self._columns = (n.astype(np.int32) for n in np.divmod(np.arange(self._size), width))
        self._width, self._near = width, np.zeros((self._size, SIDE, COLUMNS))
        self._far: list[scipy.sparse.csr_matrix] = []

    def add(self, design: scipy.sparse.csr_matrix, weights: Doubles) -> None:
        """Add an image with its `design` (p, m) and the weights (p,) of its pixels."""
        far = np.zeros(len(weights), np.bool_)
        given = design.indptr, design.indices, design.data, weights, self._lines, self._columns
        _near_products(given, self._width, np.empty(SIDE * SIDE), self._near.reshape(-1), far)
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
def _near_products(given: tuple[Array, ...], width: int, patch: Doubles, near: Doubles, far: NDArray[np.bool_]) -> None:
    """Add the products of pixels with small patches to ``near`` (m SIDE COLUMNS,); mark the others as ``far``.

    ``patch`` (SIDE SIDE,) is a buffer. Only coefficients in the same row or in later rows are kept.
    """
    places, index, values, weights, lines, columns = given
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
def _add_rows(amount: float, patch: Doubles, row: int, height: int, start: int, total: Doubles) -> None:
    """Add ``amount`` times the patch's rows from ``row`` on to ``total``, which is flat, from ``start`` on."""
    at = np.uint64(start)
    for source in range(row * SIDE, height * SIDE, SIDE):
        for column in range(SIDE):
            total[at + np.uint64(column)] += amount * patch[np.uint64(source) + np.uint64(column)]
        at += np.uint64(COLUMNS)


@compiled
def _gathered(near: Array, width: int, places: Numbers, index: Numbers, values: Doubles) -> None:
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
