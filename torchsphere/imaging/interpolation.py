"""Cubic interpolation of image crops: prefilter, sampling, gradient, optional Gaussian pre-blur.

The kernel is ``b + SHARPNESS b''``, b being the cubic B-spline: as wide, of the same order, continuous (T. Blu,
P. Thevenaz, M. Unser, IEEE Trans. Image Process. 10 (2001) 1069, doi:10.1109/83.931101, take 1/42). Interpolation turns
a part of a texture of frequency k, cycles/px, into one of 1 - k, so that a shift by d px is measured as
``d + A sin(2 pi d)``. Aliasing in the images has the opposite sign, and SHARPNESS balances both.
"""

from __future__ import annotations

import functools
import math
from collections.abc import Sequence

import torch
from torch import Tensor

from torchsphere.kernels import jit, spline

#: Share of the B-spline's second derivative in the kernel (docs/constants.toml).
SHARPNESS = 1 / 24

#: Values of the kernel at the nodes -1, 0, 1.
NODE_WEIGHTS = (1 / 6 + SHARPNESS, 4 / 6 - 2 * SHARPNESS, 1 / 6 + SHARPNESS)

#: Derivative of the kernel at the nodes 1 and 2 before a point (behind it with the other sign): middle of a small jump.
SLOPE_WEIGHTS = (1 / 2 - SHARPNESS, SHARPNESS / 2)

#: Distance from which a pixel changes a spline coefficient by less than 1e-9: a factor of 0.42 per px.
SPLINE_REACH = 24

#: Rows of a filter's matrix that are applied together.
BLOCK = 24

#: Standard deviation of the Gaussian pre-blur, px (docs/constants.toml).
PRE_BLUR_PX = 1.0

#: Weights of the four nodes around each point, along one axis.
Weights = tuple[Tensor, Tensor, Tensor, Tensor]


@functools.lru_cache(maxsize=64)
def gaussian_kernel(sigma: float) -> Tensor:
    """Sampled Gaussian of standard deviation ``sigma`` px, float64, sum 1; a single 1 where ``sigma`` is 0."""
    if sigma == 0:
        return torch.ones(1, dtype=torch.float64)
    reach = math.ceil(4 * sigma)
    steps = torch.arange(-reach, reach + 1, dtype=torch.float64)
    kernel = torch.exp(-0.5 * (steps / sigma) ** 2)
    return kernel / kernel.sum()


def _mirrored(kernel: Tensor, size: int) -> Tensor:
    """Matrix (size, size) that convolves with the odd, symmetric ``kernel``, mirrored at the first and last node."""
    reach = len(kernel) // 2
    matrix = torch.zeros(size, size, dtype=torch.float64)
    period = max(2 * (size - 1), 1)
    rows = torch.arange(size)
    for step, weight in zip(range(-reach, reach + 1), kernel, strict=True):
        columns = (rows + step) % period
        columns = torch.minimum(columns, period - columns)
        matrix[rows, columns] += weight
    return matrix


@functools.lru_cache(maxsize=64)
def blur_matrix(size: int, pre_blur: float) -> Tensor:
    """Gaussian blur along one axis as a matrix (size, size), float64."""
    return _mirrored(gaussian_kernel(pre_blur), size)


@functools.lru_cache(maxsize=64)
def prefilter_matrix(size: int, pre_blur: float) -> Tensor:
    """Pre-blur, then the change from values to B-spline coefficients, along one axis: (size, size), float64."""
    spline = _mirrored(torch.tensor(NODE_WEIGHTS, dtype=torch.float64), size)
    return torch.linalg.solve(spline, blur_matrix(size, pre_blur))


def _separable(images: Tensor, rows: Tensor, columns: Tensor, reach: int) -> Tensor:
    """``rows @ images @ columns^T`` for banded matrices, which are 0 further than ``reach`` from their diagonal.

    Block by block, in two thirds of the time of the whole products at 121 px.
    """
    rows, columns = rows.to(images), columns.to(images)
    images = torch.cat([columns[a:b, c:d] @ images.mT[:, c:d] for a, b, c, d in _blocks(len(columns), reach)], 1)
    return torch.cat([rows[a:b, c:d] @ images.mT[:, c:d] for a, b, c, d in _blocks(len(rows), reach)], 1)


def _blocks(size: int, reach: int) -> list[tuple[int, int, int, int]]:
    """First and last row, first and last column of the blocks along the diagonal of a banded matrix (size, size)."""
    limits = [(first, min(first + BLOCK, size)) for first in range(0, size, BLOCK)]
    return [(a, b, max(0, a - reach), min(size, b + reach)) for a, b in limits]


@jit.in_loops(
    lambda images, pre_blur=PRE_BLUR_PX: spline.coefficients(images, gaussian_kernel(pre_blur), *NODE_WEIGHTS[:2])
)
def coefficients(images: Tensor, pre_blur: float = PRE_BLUR_PX) -> Tensor:
    """B-spline coefficients (n, h, w) of the pre-blurred ``images`` (n, h, w), mirrored at the border."""
    height, width = images.shape[-2:]
    reach = SPLINE_REACH + math.ceil(4 * pre_blur)
    return _separable(images, prefilter_matrix(height, pre_blur), prefilter_matrix(width, pre_blur), reach)


def blur(images: Tensor, sigma: float) -> Tensor:
    """Gaussian blur of ``images`` (n, h, w) by ``sigma`` px, mirrored at the border."""
    height, width = images.shape[-2:]
    return _separable(images, blur_matrix(height, sigma), blur_matrix(width, sigma), math.ceil(4 * sigma))


@jit.in_loops(functools.partial(spline.sample, sharpness=SHARPNESS))
def sample(c: Tensor, points: Tensor) -> Tensor:
    """The spline with coefficients ``c`` (n, h, w) at ``points`` (n, p, 2), as (x, y) in px of the crop: (n, p).

    Points must lie at least 1 px inside the crop; differentiable with respect to ``points``.
    """
    base = _cells(c, points)
    x, y = (points - base).unbind(-1)
    (value,) = _weighted(c, base, (spline_weights(x, SHARPNESS),), ((0, spline_weights(y, SHARPNESS)),))
    return value


@jit.in_loops(functools.partial(spline.sample_with_gradient, sharpness=SHARPNESS))
def sample_with_gradient(c: Tensor, points: Tensor) -> tuple[Tensor, Tensor]:
    """`sample`, and the exact gradient (n, 2, p) of the spline there, grey levels per px.

    The sixteen look-ups serve all three: 1.5 times the time of the value alone; differentiation took four times.
    """
    base = _cells(c, points)
    x, y = (points - base).unbind(-1)
    of_x, of_y = spline_weights(x, SHARPNESS), spline_weights(y, SHARPNESS)
    along, across = slope_weights(x, SHARPNESS), slope_weights(y, SHARPNESS)
    value, *gradient = _weighted(c, base, (of_x, along), ((0, of_y), (1, of_y), (0, across)))
    return value, torch.stack(gradient, 1)


def _cells(c: Tensor, points: Tensor) -> Tensor:
    """First node (n, p, 2), as (x, y), of the cell that each point lies in; the last cell includes its far side."""
    height, width = c.shape[-2:]
    x, y = points.detach().floor().unbind(-1)
    return torch.stack((x.clamp_max_(width - 3), y.clamp_max_(height - 3)), 1).mT


def _weighted(
    c: Tensor, base: Tensor, of_x: tuple[Weights, ...], outputs: tuple[tuple[int, Weights], ...]
) -> list[Tensor]:
    """Sums (n, p) over the sixteen nodes around each point, whose cell starts at ``base`` (n, p, 2).

    Each of the ``outputs`` has the number of its weights along x in ``of_x``, and its weights along y. Look-ups in flat
    images with one index for all nodes take half the time of four bilinear look-ups.
    """
    width = c.shape[-1]
    column, row = base.unbind(-1)
    index = ((row - 1) * width + (column - 1)).long()
    levels = c.flatten(1)
    sums: list[Tensor | None] = [None] * len(outputs)
    for j in range(4):
        nodes = [levels[:, j * width + i :].gather(1, index) for i in range(4)]
        lines = [sum_of_products(nodes, weights) for weights in of_x]
        for k, (line, of_y) in enumerate(outputs):
            part = sums[k]
            sums[k] = lines[line] * of_y[j] if part is None else part.addcmul_(lines[line], of_y[j])
    return [part for part in sums if part is not None]


def sum_of_products(values: Sequence[Tensor], weights: Weights) -> Tensor:
    """Sum of four values times their weights, element by element."""
    total = values[0] * weights[0]
    for value, weight in zip(values[1:], weights[1:], strict=True):
        # In place: differentiation does not need the partial sum.
        total.addcmul_(value, weight)
    return total


def spline_weights(t: Tensor, sharpness: float = 0.0) -> Weights:
    """Weights of the four nodes around a point at the share ``t`` of its cell; of the B-spline without sharpness."""
    squared = t * t
    last = (squared / 6 + sharpness) * t
    rest = 1 - t
    first = (rest * rest / 6 + sharpness) * rest
    second = (2 / 3 - 2 * sharpness) - squared + 3 * last
    return first, second, 1 - first - second - last, last


def slope_weights(t: Tensor, sharpness: float = 0.0) -> Weights:
    """Derivatives of `spline_weights`."""
    last = 0.5 * t * t + sharpness
    rest = 1 - t
    first = -0.5 * rest * rest - sharpness
    second = 3 * last - 2 * t
    return first, second, -first - second - last, last


@functools.lru_cache(maxsize=16)
def noise_gains(pre_blur: float) -> tuple[float, float]:
    """Variances of a value and of a gradient component after pre-blur and spline, of white noise of variance 1.

    Computed from the matrices in use, not from the continuous Gaussian.
    """
    size = 65
    middle = size // 2
    value = blur_matrix(size, pre_blur)[middle].square().sum()
    c = prefilter_matrix(size, pre_blur)
    lines = [weight * (c[middle + i] - c[middle - i]) for i, weight in enumerate(SLOPE_WEIGHTS, 1)]
    slope = torch.stack(lines).sum(0).square().sum()
    return float(value * value), float(slope * value)
