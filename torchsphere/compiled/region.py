"""The points of a region of interest, and what an image shows there: levels, gradients, noise."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from torchsphere.compiled.function import arrays, compiled, require_one_size, require_room
from torchsphere.compiled.spline import blur_down, transpose

Array = NDArray[np.float32]
Whole = NDArray[np.int64]

_ZERO, _ONE, _TWO, _FOUR = (np.float32(value) for value in (0, 1, 2, 4))


class Kernel(NamedTuple):
    """The spline's kernel at its own node and at the neighbours, and its derivative at the next two nodes."""

    side: np.float32
    middle: np.float32
    near: np.float32
    far: np.float32

    @classmethod
    def of(cls, values: tuple[float, ...], slopes: tuple[float, ...]) -> Kernel:
        """From values at a neighbour and at its own node, and slopes at the first and at the second neighbour."""
        return cls(*(np.float32(value) for value in (*values, *slopes)))


def front(pixels: Tensor, nearest: Tensor, radius: Tensor, limit: Tensor) -> tuple[Tensor, Tensor]:
    """The ball's front (n, 3, p) at the ``pixels`` (p, 2), and weights (n, p): 1 within ``limit`` (n,), 0 beyond.

    The pixels count from one at ``nearest`` (n, 2) from the ball's centre; ``radius`` (n,). All in px.
    """
    require_one_size(0, nearest, radius, limit)
    surface = torch.empty(len(nearest), 3, len(pixels))
    weights = torch.empty(len(nearest), len(pixels))
    _front(*arrays(pixels.T, nearest, radius, limit, surface, weights))
    return surface, weights


@compiled
def _front(pixels: Whole, nearest: Array, radius: Array, limit: Array, surface: Array, weights: Array) -> None:
    columns, lines = pixels[0], pixels[1]
    for n in range(len(nearest)):
        left, top, weight = nearest[n, 0], nearest[n, 1], weights[n]
        xs, ys, zs = surface[n, 0], surface[n, 1], surface[n, 2]
        ball, inside = radius[n] * radius[n], limit[n] * limit[n]
        for i in range(len(columns)):
            x, y = np.float32(columns[i]) + left, np.float32(lines[i]) + top
            squared = x * x + y * y
            depth = ball - squared
            xs[i], ys[i] = x, y
            zs[i] = -np.sqrt(depth if depth > _ZERO else _ZERO)
            weight[i] = _ONE if squared < inside else _ZERO


def seen_alike(surface: Tensor, weights: Tensor, turn: Tensor, radius: Tensor, share: Tensor, least: float) -> Tensor:
    """Weights (n, p) that fall where a turn changes the view of the texture: `robust.by_view`.

    ``surface`` (n, 3, p), ``weights`` (n, p), ``turn`` (n, 3, 3), ``radius`` (n,), px; ``share`` (n,) is what a
    foreshortening of 1 counts as, ``least`` the least cosine of a view.
    """
    require_one_size(0, surface, weights, turn, radius, share)
    require_one_size(-1, surface, weights)
    found = torch.empty(weights.shape)
    _seen_alike(*arrays(surface, weights, turn, radius, share, found), np.float32(least))
    return found


@compiled
def _seen_alike(
    surface: Array, weights: Array, turn: Array, radius: Array, share: Array, found: Array, least: np.float32
) -> None:
    for n in range(len(weights)):
        x, y, z, weight, row = surface[n, 0], surface[n, 1], surface[n, 2], weights[n], found[n]
        a, b, c, lowest = turn[n, 2, 0], turn[n, 2, 1], turn[n, 2, 2], least * radius[n]
        for i in range(len(x)):
            before, after = -z[i], -(a * x[i] + b * y[i] + c * z[i])
            height = before if before < after else after
            height = lowest if height < lowest else height
            misplaced = share[n] * (radius[n] / height - _ONE)
            row[i] = weight[i] / (_ONE + misplaced * misplaced)


def levels(c: Tensor, pixels: Tensor, middle: Tensor, kernel: Kernel) -> tuple[Tensor, Tensor]:
    """Values (n, p) and gradients (n, 2, p) of the splines ``c`` (n, h, w) at whole ``pixels`` (p, 2) from ``middle``.

    ``middle`` (n, 2) is that of the region, as (x, y), in px of the crop.
    """
    require_room(c, 3)
    require_one_size(0, c, middle)
    values, gradient = torch.empty(len(c), len(pixels)), torch.empty(len(c), 2, len(pixels))
    _levels(*arrays(c, pixels.T, middle, values, gradient), kernel)
    return values, gradient


def blurred_gradient(c: Tensor, pixels: Tensor, middle: Tensor, kernel: Kernel, blur: Tensor) -> Tensor:
    """The gradients (n, 2, p) of `levels` after a blur by the odd, symmetric kernel ``blur``."""
    require_room(c, 3)
    require_one_size(0, c, middle)
    found = torch.empty(len(c), 2, len(pixels))
    taps = blur[len(blur) // 2 :].float()
    _blurred_gradient(*arrays(c, pixels.T, middle, taps, found), kernel)
    return found


@compiled
def _levels(c: Array, pixels: Whole, middle: Whole, values: Array, gradient: Array, kernel: Kernel) -> None:
    for n in range(len(c)):
        column, line = middle[n, 0], middle[n, 1]
        _levels_of_one(c[n], pixels[0], pixels[1], column, line, kernel, values[n], gradient[n, 0], gradient[n, 1])


@compiled
def _blurred_gradient(c: Array, pixels: Whole, middle: Whole, taps: Array, found: Array, kernel: Kernel) -> None:
    _, height, width = c.shape
    down = np.empty((height, width), np.float32)
    turned = np.empty((width, height), np.float32)
    blurred = np.empty((width, height), np.float32)
    values = np.empty(pixels.shape[1], np.float32)
    for n in range(len(c)):
        blur_down(c[n], taps, down)
        transpose(down, turned)
        blur_down(turned, taps, blurred)
        # It lies on its side: rather than turn it back, x and y change places.
        column, line = middle[n, 1], middle[n, 0]
        _levels_of_one(blurred, pixels[1], pixels[0], column, line, kernel, values, found[n, 1], found[n, 0])


@compiled
def _levels_of_one(
    c: Array,
    columns: Whole,
    lines: Whole,
    first_column: int,
    first_line: int,
    kernel: Kernel,
    values: Array,
    along: Array,
    across: Array,
) -> None:
    height, width = c.shape
    flat = c.reshape(height * width)
    side, centre, near, far = kernel
    ratio = centre / side
    for i in range(len(columns)):
        column, line = _within(first_column + columns[i], width), _within(first_line + lines[i], height)
        left, right = _mirrored(column - 2, width), _mirrored(column + 2, width)
        above, below = _mirrored(line - 2, height), _mirrored(line + 2, height)
        total, slope_x, slope_y = _ZERO, _ZERO, _ZERO
        for step in range(-1, 2):
            weight = centre if step == 0 else side
            start, up = (line + step) * width, column + step
            row = flat[_at(start + column - 1)] + ratio * flat[_at(start + column)] + flat[_at(start + column + 1)]
            total += weight * row
            slope_x += weight * near * (flat[_at(start + column + 1)] - flat[_at(start + column - 1)])
            slope_x += weight * far * (flat[_at(start + right)] - flat[_at(start + left)])
            slope_y += weight * near * (flat[_at((line + 1) * width + up)] - flat[_at((line - 1) * width + up)])
            slope_y += weight * far * (flat[_at(below * width + up)] - flat[_at(above * width + up)])
        values[i], along[i], across[i] = side * total, slope_x, slope_y


@compiled
def _at(index: int) -> np.uint64:
    """An index that is known not to be negative; that of a sign would be checked for counting from the end."""
    return np.uint64(index)


@compiled
def _within(node: int, size: int) -> int:
    """The node, or the nearest that has neighbours on both sides."""
    node = node if node > 1 else 1
    return node if node < size - 2 else size - 2


@compiled
def _mirrored(node: int, size: int) -> int:
    """`spline.mirrored` without its loop: a node beyond an end of the axis by no more than its length."""
    node = node if node >= 0 else -node
    return node if node < size else 2 * size - 2 - node


def roughness(images: Tensor, pixels: Tensor, middle: Tensor, weights: Tensor) -> Tensor:
    """Weighted mean (n,) over a region of the absolute difference of two Laplacians of ``images`` (n, h, w).

    ``pixels`` and ``middle`` as in `levels`, ``weights`` (n, p).
    """
    require_room(images, 3)
    require_one_size(0, images, middle, weights)
    require_one_size(-1, pixels.T, weights)
    found = torch.empty(len(images))
    _roughness(*arrays(images, pixels.T, middle, weights, found))
    return found


@compiled
def _roughness(images: Array, pixels: Whole, middle: Whole, weights: Array, found: Array) -> None:
    _, height, width = images.shape
    columns, lines = pixels[0], pixels[1]
    for n in range(len(images)):
        flat, weight = images[n].reshape(height * width), weights[n]
        total, count = _ZERO, _ZERO
        for i in range(len(columns)):
            column, line = _within(middle[n, 0] + columns[i], width), _within(middle[n, 1] + lines[i], height)
            at, step, one = _at(line * width + column), np.uint64(width), np.uint64(1)
            above = flat[at - step - one] - _TWO * flat[at - step] + flat[at - step + one]
            here = flat[at - one] - _TWO * flat[at] + flat[at + one]
            below = flat[at + step - one] - _TWO * flat[at + step] + flat[at + step + one]
            total += weight[i] * abs(above - _TWO * here + below)
            count += weight[i]
        found[n] = total / (count if count > _ONE else _ONE)
