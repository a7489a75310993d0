"""Spline coefficients of blurred images, by recursion, and the spline and its gradient at any place."""

from __future__ import annotations

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from torchsphere.kernels.jit import arrays, compiled, require_one_size, require_room

Array = NDArray[np.float32]

#: Nodes that a recursion's first value is summed up over: each is worth 0.42 of the one before.
_HORIZON = 30

_ZERO, _ONE, _TWO, _THREE, _HALF, _SIXTH = (np.float32(value) for value in (0, 1, 2, 3, 1 / 2, 1 / 6))


def coefficients(images: Tensor, kernel: Tensor, side: float, middle: float) -> Tensor:
    """Coefficients (n, h, w) of the spline through ``images`` (n, h, w) blurred by the odd, symmetric ``kernel``.

    The spline's kernel is ``middle`` at its own node and ``side`` at the neighbours. All is mirrored at the border.
    The recursion is that of M. Unser, A. Aldroubi and M. Eden, IEEE Trans. Signal Process. 41 (1993) 821,
    doi:10.1109/78.193220.
    """
    ratio = 0.5 * middle / side
    pole = (ratio * ratio - 1) ** 0.5 - ratio
    taps = (kernel[len(kernel) // 2 :] / side).float()
    found = torch.empty(images.shape)
    _coefficients(*arrays(images, taps, found), np.float32(pole))
    return found


@compiled
def _coefficients(images: Array, taps: Array, found: Array, pole: np.float32) -> None:
    _, height, width = images.shape
    along = np.empty((height, width), np.float32)
    turned = np.empty((width, height), np.float32)
    across = np.empty((width, height), np.float32)
    for n in range(len(images)):
        blur_down(images[n], taps, along)
        _recurse_down(along, pole)
        transpose(along, turned)
        blur_down(turned, taps, across)
        _recurse_down(across, pole)
        transpose(across, found[n])


@compiled
def blur_down(values: Array, taps: Array, found: Array) -> None:
    """The columns of ``values`` (h, w), mirrored, filtered by symmetric ``taps``, the middle one first: ``found``."""
    height, width = values.shape
    for y in range(height):
        for x in range(width):
            found[y, x] = taps[0] * values[y, x]
        # By two taps at once, so that what is found is read and written half as often.
        for j in range(1, len(taps), 2):
            near, far = taps[j], taps[j + 1] if j + 1 < len(taps) else _ZERO
            above, below = mirrored(y - j, height), mirrored(y + j, height)
            over, under = mirrored(y - j - 1, height), mirrored(y + j + 1, height)
            for x in range(width):
                pair = near * (values[above, x] + values[below, x])
                found[y, x] += pair + far * (values[over, x] + values[under, x])


@compiled
def _recurse_down(values: Array, pole: np.float32) -> None:
    """From values to coefficients along the columns of (h, w), in place, forth and back."""
    height, width = values.shape
    first = np.empty(width, np.float32)
    for x in range(width):
        first[x] = values[0, x]
    factor = pole
    for k in range(1, _HORIZON):
        row = mirrored(k, height)
        for x in range(width):
            first[x] += factor * values[row, x]
        factor *= pole
    for x in range(width):
        values[0, x] = first[x]
    for y in range(1, height):
        for x in range(width):
            values[y, x] += pole * values[y - 1, x]
    before, last = max(height - 2, 0), height - 1
    end = pole / (pole * pole - _ONE)
    for x in range(width):
        values[last, x] = end * (values[last, x] + pole * values[before, x])
    for y in range(height - 2, -1, -1):
        for x in range(width):
            values[y, x] = pole * (values[y + 1, x] - values[y, x])


@compiled
def mirrored(node: int, size: int) -> int:
    """The node of an axis of so many, mirrored at the first and at the last until it is one of them."""
    if size == 1:
        return 0
    while not 0 <= node < size:
        node = -node if node < 0 else 2 * (size - 1) - node
    return node


@compiled
def transpose(values: Array, found: Array) -> None:
    """``found`` (w, h) from ``values`` (h, w)."""
    # Eight lines at once: measured two thirds of the time of one after the other.
    height, width = values.shape
    whole = height - height % 8
    for y in range(0, whole, 8):
        a, b, c, d = values[y], values[y + 1], values[y + 2], values[y + 3]
        e, f, g, h = values[y + 4], values[y + 5], values[y + 6], values[y + 7]
        for x in range(width):
            row = found[x]
            row[y], row[y + 1], row[y + 2], row[y + 3] = a[x], b[x], c[x], d[x]
            row[y + 4], row[y + 5], row[y + 6], row[y + 7] = e[x], f[x], g[x], h[x]
    for y in range(whole, height):
        for x in range(width):
            found[x, y] = values[y, x]


def sample(c: Tensor, points: Tensor, sharpness: float) -> Tensor:
    """The spline with coefficients ``c`` (n, h, w) at ``points`` (n, p, 2): (n, p); see `interpolation.sample`."""
    _require_places(c, points)
    found = torch.empty(points.shape[:2])
    _sample(*arrays(c, points.mT, found), np.float32(sharpness))
    return found


def sample_with_gradient(c: Tensor, points: Tensor, sharpness: float) -> tuple[Tensor, Tensor]:
    """`sample`, and the spline's gradient (n, 2, p)."""
    _require_places(c, points)
    found, gradient = torch.empty(points.shape[:2]), torch.empty(len(points), 2, points.shape[1])
    _sample_with_gradient(*arrays(c, points.mT, found, gradient), np.float32(sharpness))
    return found, gradient


def _require_places(c: Tensor, points: Tensor) -> None:
    """Raise ValueError unless each spline has its points, and the four nodes that one takes."""
    require_room(c, 4)
    require_one_size(0, c, points)


@compiled
def _sample(c: Array, points: Array, found: Array, sharpness: np.float32) -> None:
    for n in range(len(c)):
        sample_one(c[n], points[n], sharpness, found[n])


@compiled
def sample_one(c: Array, points: Array, sharpness: np.float32, found: Array) -> None:
    """`sample` of one image ``c`` (h, w) at ``points`` (2, p): ``found`` (p,)."""
    height, width = c.shape
    levels, x, y = c.reshape(height * width), points[0], points[1]
    for i in range(len(x)):
        column, u = cell(x[i], width)
        line, v = cell(y[i], height)
        found[i] = value(levels, width, column, line, weights(u, sharpness), weights(v, sharpness))


@compiled
def _sample_with_gradient(c: Array, points: Array, found: Array, gradient: Array, sharpness: np.float32) -> None:
    _, height, width = c.shape
    for n in range(len(c)):
        levels, x, y = c[n].reshape(height * width), points[n, 0], points[n, 1]
        row, along, across = found[n], gradient[n, 0], gradient[n, 1]
        for i in range(len(x)):
            column, u = cell(x[i], width)
            line, v = cell(y[i], height)
            of_x, of_y = weights(u, sharpness), weights(v, sharpness)
            row[i] = value(levels, width, column, line, of_x, of_y)
            along[i] = value(levels, width, column, line, slopes(u, sharpness), of_y)
            across[i] = value(levels, width, column, line, of_x, slopes(v, sharpness))


@compiled
def cell(x: np.float32, size: int) -> tuple[np.int32, np.float32]:
    """First of the four nodes around a place on an axis of so many, and the place in their middle cell, 0 to 1.

    Places are held within the first and the last cell that have all four; what is no number goes to the first.
    """
    x = x if x > _ONE else _ONE
    x = x if x < np.float32(size - 2) else np.float32(size - 2)
    start = np.floor(x)
    start = start if start < np.float32(size - 3) else np.float32(size - 3)
    return np.int32(start) - np.int32(1), x - start


@compiled
def value(
    levels: Array,
    width: int,
    column: np.int32,
    line: np.int32,
    of_x: tuple[np.float32, ...],
    of_y: tuple[np.float32, ...],
) -> np.float32:
    """Weighted sum over the sixteen nodes from ``column`` and ``line`` on, of the flat image ``levels``."""
    # Without a sign: a negative index would be counted from the end, which takes a comparison each.
    at = np.uint64(np.uint32(line) * np.uint32(width) + np.uint32(column))
    return around(levels, at, np.uint64(width), of_x, of_y)


@compiled
def around(
    levels: Array, at: np.uint64, step: np.uint64, of_x: tuple[np.float32, ...], of_y: tuple[np.float32, ...]
) -> np.float32:
    """Weighted sum over four rows of four nodes, a ``step`` from each other, from the number ``at`` on."""
    total = of_y[0] * _line(levels, at, of_x)
    total += of_y[1] * _line(levels, at + step, of_x)
    total += of_y[2] * _line(levels, at + step + step, of_x)
    return total + of_y[3] * _line(levels, at + step + step + step, of_x)


@compiled
def _line(levels: Array, at: np.uint64, of_x: tuple[np.float32, ...]) -> np.float32:
    one = np.uint64(1)
    a, b, c, d = of_x
    return a * levels[at] + b * levels[at + one] + c * levels[at + one + one] + d * levels[at + one + one + one]


@compiled
def weights(t: np.float32, sharpness: np.float32) -> tuple[np.float32, ...]:
    """Weights of the four nodes around a point at the share ``t`` of its cell: `interpolation.spline_weights`."""
    squared, rest = t * t, _ONE - t
    last = (squared * _SIXTH + sharpness) * t
    first = (rest * rest * _SIXTH + sharpness) * rest
    second = _TWO * (_TWO * _SIXTH - sharpness) - squared + _THREE * last
    return first, second, _ONE - first - second - last, last


@compiled
def slopes(t: np.float32, sharpness: np.float32) -> tuple[np.float32, ...]:
    """Derivatives of `weights`."""
    rest = _ONE - t
    last, first = _HALF * t * t + sharpness, -_HALF * rest * rest - sharpness
    second = _THREE * last - _TWO * t
    return first, second, -first - second - last, last
