"""Cubic B-spline interpolation of image crops: prefilter, sampling, gradient, optional Gaussian pre-blur.

Prefilter and pre-blur are linear and act along rows and columns apart, so that both together are one small dense
matrix per crop size, applied from the left and from the right. Sampling evaluates the spline exactly with four
bilinear look-ups per point (C. Sigg and M. Hadwiger, GPU Gems 2, chapter 20), which Kornia's ``remap`` carries.
"""

from __future__ import annotations

import functools
import math

import torch
from kornia.geometry.transform import remap
from torch import Tensor

#: Values of the centred cubic B-spline at the nodes -1, 0, 1.
NODE_WEIGHTS = (1 / 6, 4 / 6, 1 / 6)

#: Gaussian pre-blur, px. Measured on the example shot with `finite` (four patterns, spots of 4 px, 0.57 deg per frame,
#: true circle), largest bias and mean standard deviation of x: 0.0034 px at 0.6; 0.0014 and 0.0043 at 0.9; 0.0006 and
#: 0.0045 at 1.05. What is finer than this blur aliases; what is coarser is lost for the noise.
PRE_BLUR_PX = 1.0


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


def _separable(images: Tensor, rows: Tensor, columns: Tensor) -> Tensor:
    return rows.to(images) @ images @ columns.to(images).T


def coefficients(images: Tensor, pre_blur: float = PRE_BLUR_PX) -> Tensor:
    """B-spline coefficients (n, h, w) of the pre-blurred ``images`` (n, h, w), mirrored at the border."""
    height, width = images.shape[-2:]
    return _separable(images, prefilter_matrix(height, pre_blur), prefilter_matrix(width, pre_blur))


def blur(images: Tensor, sigma: float) -> Tensor:
    """Gaussian blur of ``images`` (n, h, w) by ``sigma`` px, mirrored at the border."""
    height, width = images.shape[-2:]
    return _separable(images, blur_matrix(height, sigma), blur_matrix(width, sigma))


def node_values(c: Tensor) -> Tensor:
    """The spline at its own nodes, (n, h, w) -> (n, h - 2, w - 2): the (blurred) image without its border."""
    side, middle, _ = NODE_WEIGHTS
    rows = middle * c[:, 1:-1] + side * (c[:, :-2] + c[:, 2:])
    return middle * rows[:, :, 1:-1] + side * (rows[:, :, :-2] + rows[:, :, 2:])


def node_gradient(c: Tensor) -> tuple[Tensor, Tensor]:
    """Exact derivative of the spline along x and y at its nodes, each (n, h - 2, w - 2), grey levels per px."""
    side, middle, _ = NODE_WEIGHTS
    rows = middle * c[:, 1:-1] + side * (c[:, :-2] + c[:, 2:])
    columns = middle * c[:, :, 1:-1] + side * (c[:, :, :-2] + c[:, :, 2:])
    return 0.5 * (rows[:, :, 2:] - rows[:, :, :-2]), 0.5 * (columns[:, 2:] - columns[:, :-2])


def sample(c: Tensor, points: Tensor) -> Tensor:
    """The spline with coefficients ``c`` (n, h, w) at ``points`` (n, p, 2), as (x, y) in px of the crop: (n, p).

    Points must lie at least 1 px inside the crop; differentiable with respect to ``points``.
    """
    with torch.no_grad():
        base = points.floor()
    low, high, share = _look_ups(points - base)
    x = torch.stack((base[..., 0] + low[..., 0], base[..., 0] + high[..., 0]), 1)
    y = torch.stack((base[..., 1] + low[..., 1], base[..., 1] + high[..., 1]), 1)
    # Four look-ups as four rows of one map: (low, low), (high, low), (low, high), (high, high) in (x, y).
    looked_up = remap(c[:, None], x.repeat(1, 2, 1), y.repeat_interleave(2, 1), align_corners=True)[:, 0]
    first = looked_up[:, 0] * share[..., 0] + looked_up[:, 1] * (1 - share[..., 0])
    second = looked_up[:, 2] * share[..., 0] + looked_up[:, 3] * (1 - share[..., 0])
    return first * share[..., 1] + second * (1 - share[..., 1])


def _look_ups(t: Tensor) -> tuple[Tensor, Tensor, Tensor]:
    """Offsets of the two linear look-ups that replace four nodes, and the weight of the first; ``t`` in [0, 1)."""
    w0 = (1 - t) ** 3 / 6
    w1 = (4 + t**2 * (3 * t - 6)) / 6
    w3 = t**3 / 6
    share = w0 + w1
    return w1 / share - 1, w3 / (1 - share) + 1, share


@functools.lru_cache(maxsize=16)
def noise_gains(pre_blur: float) -> tuple[float, float]:
    """Variance of a pixel, and of one component of the gradient, that white noise of variance 1 leaves after both
    pre-blur and spline; from the very matrices that are used, not from the continuous Gaussian.
    """
    size = 65
    middle = size // 2
    value = blur_matrix(size, pre_blur)[middle].square().sum()
    c = prefilter_matrix(size, pre_blur)
    slope = (0.5 * (c[middle + 1] - c[middle - 1])).square().sum()
    return float(value * value), float(slope * value)
