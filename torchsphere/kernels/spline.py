"""Spline coefficients of blurred images by recursion; values and gradients of the spline."""

from __future__ import annotations

import numpy as np
import torch
from torch import Tensor

from torchsphere.kernels.jit import ONE, TWO, ZERO, Floats, arrays, compiled, require_nodes, require_one_size

#: Nodes in the sum for the first value of a recursion: each weighs 0.42 of the one before.
_HORIZON = 30

_THREE, _HALF, _SIXTH = (np.float32(value) for value in (3, 1 / 2, 1 / 6))


def coefficients(images: Tensor, kernel: Tensor, side: float, middle: float) -> Tensor:
    """`interpolation.coefficients`; the spline's kernel is ``middle`` at its own node and ``side`` beside it.

    Recursion of M. Unser, A. Aldroubi and M. Eden, IEEE Trans. Signal Process. 41 (1993) 821, doi:10.1109/78.193220.
    """
    ratio = 0.5 * middle / side
    pole = (ratio * ratio - 1) ** 0.5 - ratio
    taps = (kernel[len(kernel) // 2 :] / side).float()
    found = torch.empty(images.shape)
    _coefficients(*arrays(images, taps, found), np.float32(pole))
    return found


@compiled
def _coefficients(images: Floats, taps: Floats, found: Floats, pole: np.float32) -> None:
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
def blur_down(values: Floats, taps: Floats, found: Floats) -> None:
    """Columns of ``values`` (h, w), mirrored at the ends, filtered by symmetric ``taps``, the middle one first."""
    height, width = values.shape
    for y in range(height):
        for x in range(width):
            found[y, x] = taps[0] * values[y, x]
        # Two taps at once: the result is read and written half as often.
        for j in range(1, len(taps), 2):
            near, far = taps[j], taps[j + 1] if j + 1 < len(taps) else ZERO
            above, below = mirrored(y - j, height), mirrored(y + j, height)
            over, under = mirrored(y - j - 1, height), mirrored(y + j + 1, height)
            for x in range(width):
                pair = near * (values[above, x] + values[below, x])
                found[y, x] += pair + far * (values[over, x] + values[under, x])


@compiled
def _recurse_down(values: Floats, pole: np.float32) -> None:
    """Values become coefficients along the columns (h, w), in place, forwards and backwards."""
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
    end = pole / (pole * pole - ONE)
    for x in range(width):
        values[last, x] = end * (values[last, x] + pole * values[before, x])
    for y in range(height - 2, -1, -1):
        for x in range(width):
            values[y, x] = pole * (values[y + 1, x] - values[y, x])


@compiled
def mirrored(node: int, size: int) -> int:
    """Node of an axis of ``size`` nodes, mirrored at both ends until it lies inside."""
    if size == 1:
        return 0
    while not 0 <= node < size:
        node = -node if node < 0 else 2 * (size - 1) - node
    return node


@compiled
def transpose(values: Floats, found: Floats) -> None:
    """``found`` (w, h) from ``values`` (h, w)."""
    # Eight lines at once take two thirds of the time.
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
    """`interpolation.sample`."""
    require_nodes(c, 4)
    require_one_size(0, c, points)
    found = torch.empty(points.shape[:2])
    _sample(*arrays(c, points.mT, found), np.float32(sharpness))
    return found


def sample_with_gradient(c: Tensor, points: Tensor, sharpness: float) -> tuple[Tensor, Tensor]:
    """`interpolation.sample_with_gradient`."""
    require_nodes(c, 4)
    require_one_size(0, c, points)
    found, gradient = torch.empty(points.shape[:2]), torch.empty(len(points), 2, points.shape[1])
    _sample_with_gradient(*arrays(c, points.mT, found, gradient), np.float32(sharpness))
    return found, gradient


@compiled
def _sample(c: Floats, points: Floats, found: Floats, sharpness: np.float32) -> None:
    for n in range(len(c)):
        sample_one(c[n], points[n], sharpness, found[n])


@compiled
def sample_one(c: Floats, points: Floats, sharpness: np.float32, found: Floats) -> None:
    """`sample` of one image ``c`` (h, w) at ``points`` (2, p): ``found`` (p,)."""
    height, width = c.shape
    levels, x, y = c.reshape(height * width), points[0], points[1]
    for i in range(len(x)):
        column, u = cell(x[i], width)
        line, v = cell(y[i], height)
        found[i] = value(levels, width, column, line, weights(u, sharpness), weights(v, sharpness))


@compiled
def _sample_with_gradient(c: Floats, points: Floats, found: Floats, gradient: Floats, sharpness: np.float32) -> None:
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
    """First of the four nodes around a place on an axis of ``size`` nodes, and the place in the middle cell, 0 to 1.

    Places are limited to the cells that have four nodes; NaN goes to the first.
    """
    x = x if x > ONE else ONE
    x = x if x < np.float32(size - 2) else np.float32(size - 2)
    start = np.floor(x)
    start = start if start < np.float32(size - 3) else np.float32(size - 3)
    return np.int32(start) - np.int32(1), x - start


@compiled
def value(
    levels: Floats,
    width: int,
    column: np.int32,
    line: np.int32,
    of_x: tuple[np.float32, ...],
    of_y: tuple[np.float32, ...],
) -> np.float32:
    """Weighted sum over the sixteen nodes from ``column`` and ``line`` on of the flat image ``levels``."""
    # Unsigned: a signed index is checked for counting from the end.
    at = np.uint64(np.uint32(line) * np.uint32(width) + np.uint32(column))
    return around(levels, at, np.uint64(width), of_x, of_y)


@compiled
def around(
    levels: Floats, at: np.uint64, step: np.uint64, of_x: tuple[np.float32, ...], of_y: tuple[np.float32, ...]
) -> np.float32:
    """Weighted sum over four rows of four nodes, ``step`` apart, from the number ``at`` on."""
    total = of_y[0] * _line(levels, at, of_x)
    total += of_y[1] * _line(levels, at + step, of_x)
    total += of_y[2] * _line(levels, at + step + step, of_x)
    return total + of_y[3] * _line(levels, at + step + step + step, of_x)


@compiled
def _line(levels: Floats, at: np.uint64, of_x: tuple[np.float32, ...]) -> np.float32:
    one = np.uint64(1)
    a, b, c, d = of_x
    return a * levels[at] + b * levels[at + one] + c * levels[at + one + one] + d * levels[at + one + one + one]


@compiled
def weights(t: np.float32, sharpness: np.float32) -> tuple[np.float32, ...]:
    """`interpolation.spline_weights`."""
    squared, rest = t * t, ONE - t
    last = (squared * _SIXTH + sharpness) * t
    first = (rest * rest * _SIXTH + sharpness) * rest
    second = TWO * (TWO * _SIXTH - sharpness) - squared + _THREE * last
    return first, second, ONE - first - second - last, last


@compiled
def slopes(t: np.float32, sharpness: np.float32) -> tuple[np.float32, ...]:
    """`interpolation.slope_weights`."""
    rest = ONE - t
    last, first = _HALF * t * t + sharpness, -_HALF * rest * rest - sharpness
    second = _THREE * last - TWO * t
    return first, second, -first - second - last, last
