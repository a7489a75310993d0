"""Grey levels and gradients of images at the whole pixels of a region.

Whole lines are computed and the region's points picked from them: eight columns at once beat single points.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
import torch
from torch import Tensor

from torchsphere.kernels.jit import ONE, TWO, ZERO, Floats, Integers, arrays, compiled, require_nodes, require_one_size
from torchsphere.kernels.spline import blur_down, transpose


class Kernel(NamedTuple):
    """Values of the spline's kernel beside and at its own node, and its derivative at the next two nodes."""

    side: np.float32
    middle: np.float32
    near: np.float32
    far: np.float32


def levels(c: Tensor, pixels: Tensor, middle: Tensor, kernel: Kernel) -> tuple[Tensor, Tensor]:
    """`reference_lookup.levels`."""
    require_nodes(c, 3)
    require_one_size(0, c, middle)
    values, gradient = torch.empty(len(c), len(pixels)), torch.empty(len(c), 2, len(pixels))
    _levels(*arrays(c, pixels.T, middle, values, gradient), kernel)
    return values, gradient


def blurred_gradient(c: Tensor, pixels: Tensor, middle: Tensor, kernel: Kernel, blur: Tensor) -> Tensor:
    """`reference_lookup.blurred_gradient`, by the odd, symmetric kernel ``blur``."""
    require_nodes(c, 3)
    require_one_size(0, c, middle)
    found = torch.empty(len(c), 2, len(pixels))
    taps = blur[len(blur) // 2 :].float()
    _blurred_gradient(*arrays(c, pixels.T, middle, taps, found), kernel)
    return found


def roughness(images: Tensor, pixels: Tensor, middle: Tensor, weights: Tensor) -> Tensor:
    """Weighted mean (n,) of the absolute difference of two Laplacians: `reference_lookup.roughness`."""
    require_nodes(images, 3)
    require_one_size(0, images, middle, weights)
    require_one_size(-1, pixels.T, weights)
    found = torch.empty(len(images))
    _roughness(*arrays(images, pixels.T, middle, weights, found))
    return found


@compiled
def _levels(c: Floats, pixels: Integers, middle: Integers, values: Floats, gradient: Floats, kernel: Kernel) -> None:
    _, height, width = c.shape
    smooth, steep = np.empty(width + 2, np.float32), np.empty(width + 2, np.float32)
    line = np.empty((3, width), np.float32)
    for n in range(len(c)):
        start = 0
        while start < pixels.shape[1]:
            end = _end_of_line(pixels[1], start)
            _down(c[n], _within(middle[n, 1] + pixels[1, start], height), kernel, smooth, steep)
            _mirror_ends(smooth)
            _mirror_ends(steep)
            _weighed(smooth, kernel, line[0])
            _sloped(smooth, kernel, line[1])
            _weighed(steep, kernel, line[2])
            for i in range(start, end):
                at = _at(_within(middle[n, 0] + pixels[0, i], width))
                values[n, i], gradient[n, 0, i], gradient[n, 1, i] = line[0, at], line[1, at], line[2, at]
            start = end


@compiled
def _blurred_gradient(
    c: Floats, pixels: Integers, middle: Integers, taps: Floats, found: Floats, kernel: Kernel
) -> None:
    _, height, width = c.shape
    down = np.empty((height, width), np.float32)
    turned = np.empty((width, height), np.float32)
    blurred = np.empty((width, height), np.float32)
    for n in range(len(c)):
        blur_down(c[n], taps, down)
        transpose(down, turned)
        blur_down(turned, taps, blurred)
        # The result is transposed: x and y change places.
        _gradient(blurred, (pixels[1], pixels[0], middle[n, 1], middle[n, 0]), kernel, found[n, 1], found[n, 0])


@compiled
def _gradient(c: Floats, places: tuple[Any, ...], kernel: Kernel, along: Floats, across: Floats) -> None:
    """Gradient of the spline point by point: for a few points of each line."""
    columns, lines, first_column, first_line = places
    height, width = c.shape
    flat = c.reshape(height * width)
    side, centre, near, far = kernel
    for i in range(len(columns)):
        column, line = _within(first_column + columns[i], width), _within(first_line + lines[i], height)
        left, right = _mirrored(column - 2, width), _mirrored(column + 2, width)
        above, below = _mirrored(line - 2, height) * width, _mirrored(line + 2, height) * width
        slope_x, slope_y = ZERO, ZERO
        for step in range(-1, 2):
            weight = centre if step == 0 else side
            start, up = (line + step) * width, column + step
            slope_x += weight * near * (flat[_at(start + column + 1)] - flat[_at(start + column - 1)])
            slope_x += weight * far * (flat[_at(start + right)] - flat[_at(start + left)])
            slope_y += weight * near * (flat[_at((line + 1) * width + up)] - flat[_at((line - 1) * width + up)])
            slope_y += weight * far * (flat[_at(below + up)] - flat[_at(above + up)])
        along[i], across[i] = slope_x, slope_y


@compiled
def _roughness(images: Floats, pixels: Integers, middle: Integers, weights: Floats, found: Floats) -> None:
    _, height, width = images.shape
    bent, line = np.empty(width, np.float32), np.zeros(width, np.float32)
    for n in range(len(images)):
        start, total, count = 0, ZERO, ZERO
        while start < pixels.shape[1]:
            end = _end_of_line(pixels[1], start)
            _laplacians(images[n], _within(middle[n, 1] + pixels[1, start], height), bent, line)
            for i in range(start, end):
                total += weights[n, i] * line[_at(_within(middle[n, 0] + pixels[0, i], width))]
                count += weights[n, i]
            start = end
        found[n] = total / (count if count > ONE else ONE)


@compiled
def _laplacians(image: Floats, line: int, bent: Floats, found: Floats) -> None:
    """Absolute difference of two Laplacians on a line, without its first and last place; ``bent`` is room for it."""
    for x in range(len(found)):
        bent[x] = image[line - 1, x] - TWO * image[line, x] + image[line + 1, x]
    for x in range(1, len(found) - 1):
        found[x] = abs(bent[x - 1] - TWO * bent[x] + bent[x + 1])


@compiled
def _end_of_line(lines: Integers, start: int) -> int:
    """First point behind ``start`` on another line."""
    end = start + 1
    while end < len(lines) and lines[end] == lines[start]:
        end += 1
    return end


@compiled
def _down(c: Floats, line: int, kernel: Kernel, smooth: Floats, steep: Floats) -> None:
    """The spline ``c`` (h, w) and its derivative down the image on a line, with a spare place at either end."""
    height, width = c.shape
    before, behind = line - 1, line + 1
    above, below = _mirrored(line - 2, height), _mirrored(line + 2, height)
    side, centre, near, far = kernel
    for x in range(width):
        smooth[x + 1] = side * (c[before, x] + c[behind, x]) + centre * c[line, x]
    for x in range(width):
        steep[x + 1] = near * (c[behind, x] - c[before, x]) + far * (c[below, x] - c[above, x])


@compiled
def _mirror_ends(values: Floats) -> None:
    values[0], values[len(values) - 1] = values[2], values[len(values) - 3]


@compiled
def _weighed(values: Floats, kernel: Kernel, found: Floats) -> None:
    """The spline (m,) across a line from its ``values`` (m + 2,), which begin one place earlier."""
    side, middle = kernel.side, kernel.middle
    for x in range(len(found)):
        found[x] = side * (values[x] + values[x + 2]) + middle * values[x + 1]


@compiled
def _sloped(values: Floats, kernel: Kernel, found: Floats) -> None:
    """Derivative of `_weighed` at all places but the first and the last."""
    near, far = kernel.near, kernel.far
    for x in range(1, len(found) - 1):
        found[x] = near * (values[x + 2] - values[x]) + far * (values[x + 3] - values[x - 1])


@compiled
def _at(index: int) -> np.uint64:
    """Unsigned index: a signed index would be checked for counting from the end."""
    return np.uint64(index)


@compiled
def _within(node: int, size: int) -> int:
    """The node, or the nearest that has neighbours on both sides."""
    node = node if node > 1 else 1
    return node if node < size - 2 else size - 2


@compiled
def _mirrored(node: int, size: int) -> int:
    """`spline.mirrored` without its loop: for nodes outside by less than the axis is long."""
    node = node if node >= 0 else -node
    return node if node < size else 2 * size - 2 - node
