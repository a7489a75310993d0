"""The reference image at whole pixels around the ball's centre, without interpolation."""

from __future__ import annotations

import functools
import math
from collections.abc import Sequence

import numpy as np
import torch
from torch import Tensor

from torchsphere.geometry import rotation
from torchsphere.imaging import interpolation
from torchsphere.kernels import jit, region
from torchsphere.kernels import lookup as looked

#: From the mean absolute difference of two Laplacians to the standard deviation of white noise.
_TO_DEVIATION = math.sqrt(math.pi / 2) / 6

_KERNEL = looked.Kernel(*map(np.float32, (*interpolation.NODE_WEIGHTS[:2], *interpolation.SLOPE_WEIGHTS)))


@jit.in_loops(region.front)
def front(grid: Tensor, nearest: Tensor, radius: Tensor, limit: Tensor) -> tuple[Tensor, Tensor]:
    """The ball's front (n, 3, p) at the pixels ``grid`` (p, 2), and weights (n, p): 1 within ``limit`` (n,), else 0.

    The grid's origin is ``nearest`` (n, 2) from the centre of a ball of ``radius`` (n,), all px.
    """
    points = grid.T.to(nearest).contiguous() + nearest[..., None]
    weights = points.square().sum(1) < limit[:, None].square()
    return rotation.surface(points, radius), weights.to(nearest)


@jit.in_loops(functools.partial(looked.levels, kernel=_KERNEL))
def levels(c: Tensor, grid: Tensor, middle: Tensor) -> tuple[Tensor, Tensor]:
    """Values (n, p) and gradients (n, 2, p), per px, of the splines ``c`` (n, h, w) at the pixels ``grid`` (p, 2).

    The grid's origin is the pixel ``middle`` (n, 2) of the crop, as (x, y).
    """
    value, *gradient = gather_pixels(nodes(c).unbind(1), grid, middle - 1)
    return value, torch.stack(gradient, 1)


@jit.in_loops(
    lambda c, grid, middle, sigma: looked.blurred_gradient(
        c, grid, middle, _KERNEL, interpolation.gaussian_kernel(sigma)
    )
)
def blurred_gradient(c: Tensor, grid: Tensor, middle: Tensor, sigma: float) -> Tensor:
    """The gradients (n, 2, p) of `levels` after a Gaussian blur by ``sigma`` px."""
    blurred = blur_within(c, sigma)
    border = (c.shape[-1] - blurred.shape[-1]) // 2 + 1
    return torch.stack(gather_pixels(nodes(blurred).unbind(1)[1:], grid, middle - border), 1)


def noise(images: Tensor, grid: Tensor, middle: Tensor, weights: Tensor) -> Tensor:
    """Standard deviation (n,) of the noise of ``images`` (n, h, w) at the pixels of `levels` with ``weights`` (n, p).

    J. Immerkaer, Computer Vision and Image Understanding 64 (1996) 300, doi:10.1006/cviu.1996.0060.
    """
    return _TO_DEVIATION * roughness(images, grid, middle, weights)


@jit.in_loops(looked.roughness)
def roughness(images: Tensor, grid: Tensor, middle: Tensor, weights: Tensor) -> Tensor:
    """Weighted mean (n,) of the absolute difference of two Laplacians, which does not see the image itself."""
    rows = images[:, :-2] - 2 * images[:, 1:-1] + images[:, 2:]
    both = rows[:, :, :-2] - 2 * rows[:, :, 1:-1] + rows[:, :, 2:]
    (response,) = gather_pixels([both.abs()], grid, middle - 1)
    return torch.linalg.vecdot(response, weights) / weights.sum(-1).clamp_min(1)


def gather_pixels(maps: Sequence[Tensor], grid: Tensor, middle: Tensor) -> list[Tensor]:
    """Values (n, p) of each of the maps (n, h, w) at the pixels ``grid`` (p, 2) around ``middle`` (n, 2), as (x, y)."""
    step = torch.tensor([1, maps[0].shape[-1]])
    index = (grid @ step) + (middle @ step)[:, None]
    index = index.clamp_(0, maps[0][0].numel() - 1).to(maps[0].device)
    return [values.flatten(1).gather(1, index) for values in maps]


def nodes(c: Tensor) -> Tensor:
    """Image without its border and its derivatives along x and y, per px: (n, h, w) -> (n, 3, h - 2, w - 2).

    Exact values of the spline at its nodes, in the middle of the derivatives' small jumps; ``c`` is mirrored.
    """
    side, middle, _ = interpolation.NODE_WEIGHTS
    ratio = middle / side

    def weighed(values: Tensor, factor: float, out: Tensor | None = None) -> Tensor:
        return torch.add(values[..., :-2] + values[..., 2:], values[..., 1:-1], alpha=ratio, out=out).mul_(factor)

    found = c.new_empty(len(c), 3, c.shape[-2] - 2, c.shape[-1] - 2)
    rows = weighed(c.mT, side).mT
    weighed(rows, side, found[:, 0])
    _slopes_along(rows, found[:, 1])
    weighed(_slopes_along(c.mT, c.new_empty(len(c), c.shape[-1], c.shape[-2] - 2)).mT, side, found[:, 2])
    return found


def _slopes_along(values: Tensor, out: Tensor) -> Tensor:
    """Derivative of the spline ``values`` (..., m) along the last axis: ``out`` (..., m - 2)."""
    near, far = interpolation.SLOPE_WEIGHTS
    torch.sub(values[..., 2:], values[..., :-2], out=out).mul_(near)
    out[..., 1:-1].add_(values[..., 4:], alpha=far).sub_(values[..., :-4], alpha=far)
    out[..., 0].add_(values[..., 3] - values[..., 1], alpha=far)
    out[..., -1].add_(values[..., -2] - values[..., -4], alpha=far)
    return out


def blur_within(images: Tensor, sigma: float) -> Tensor:
    """`interpolation.blur` without the border: (n, h, w) -> smaller by the kernel's reach on every side.

    Shifts and sums take a third of the time of two matrix products.
    """
    kernel = interpolation.gaussian_kernel(sigma).tolist()
    reach = len(kernel) // 2
    for axis in (1, 2):
        left = images.shape[axis] - 2 * reach
        total = images.narrow(axis, reach, left) * kernel[reach]
        for step in range(1, reach + 1):
            pair = images.narrow(axis, reach - step, left) + images.narrow(axis, reach + step, left)
            total.add_(pair, alpha=kernel[reach + step])
        images = total
    return images
