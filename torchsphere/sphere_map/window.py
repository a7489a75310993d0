"""The pixels of one image around the ball, and the rays over which a pixel averages the ball.

A Gauss rule places the rays in a pixel: two points in both directions, three near the limb, where the texture is
foreshortened to less than a pixel, and five across the outline.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
import torch
from torch import Tensor

from torchsphere.kernels import sphere_projection

#: Points of the Gauss rules along a side of a pixel: inside the disc, and near the limb.
INNER_POINTS, LIMB_POINTS = 2, 3

#: Distance from the centre, in radii, from which a pixel counts as near the limb (docs/constants.md).
LIMB_FROM = 0.85

#: Distance from the outline, px, within which the outline may cross a pixel (docs/constants.md).
OUTLINE_PX = 1.0

#: Points across such an outline, and in both directions where the outline is oblique (docs/constants.md).
POINTS_ACROSS, OBLIQUE_POINTS = 5, 4

#: Slope of the outline's normal against rows or columns up to which the outline is not oblique.
OBLIQUE_FROM = math.tan(math.radians(30.0))

#: Width of the margin around the disc, px, for the blur of the edge and the error of the pose.
MARGIN_PX = 2.0


@dataclass(frozen=True)
class Window:
    """The pixels of one image around the ball.

    Pixel and ray coordinates have double precision. All else, offsets from the centre too, has that of the image:
    single precision is nearly twice as fast and moves a pose by 1e-6 px.
    """

    pixels: Tensor  # coordinates (p, 2) as (x, y), px
    levels: Tensor  # grey levels (p,) of the image
    background: Tensor  # grey levels (p,) of the still background
    # (p,), 1 where the pixel shows ball or background, 0 where the pixel is ignored, less than 1 where an object may
    # hide the ball.
    visibility: Tensor
    rays: Tensor  # image coordinates (2, q) of the rays, px
    ray_weights: Tensor  # weights (q,) of the rays in their pixels
    ray_pixels: Tensor  # number (q,) of the pixel of each ray, ascending

    def sum_rays(self, values: Tensor) -> Tensor:
        """Sum over the rays of each pixel: (q, ...) -> (p, ...)."""
        sums = torch.zeros(len(self.pixels), *values.shape[1:], dtype=values.dtype)
        return sums.index_add_(0, self.ray_pixels, values)

    def to_rays(self, values: Tensor, factors: Tensor) -> Tensor:
        """The pixels' ``values`` (p,) at their rays, times the rays' ``factors`` (q,): (q,)."""
        return sphere_projection.to_rays(values, self.ray_pixels, factors)

    def offsets_from(self, centre: Tensor) -> Tensor:
        """Offsets (p, 2) of the pixels from ``centre`` (2,), px."""
        return (self.pixels - centre).to(self.levels)


def cut_window(image: Tensor, background: Tensor, centre: Tensor, radius: float, usable: Tensor | None) -> Window:
    """Cut the pixels of ``image`` (h, w) up to `MARGIN_PX` outside the disc around ``centre`` (2,).

    ``background`` and ``usable``, where given, are (h, w), too; ``usable`` is False for pixels to ignore.
    """
    height, width = image.shape
    reach = math.ceil(radius + MARGIN_PX) + 1
    x, y = (round(float(v)) for v in centre)
    columns = torch.arange(max(x - reach, 0), min(x + reach, width - 1) + 1)
    rows = torch.arange(max(y - reach, 0), min(y + reach, height - 1) + 1)
    pixels = torch.stack(torch.meshgrid(columns, rows, indexing="xy"), -1).reshape(-1, 2)
    pixels = pixels[(pixels - centre).norm(dim=-1) < radius + MARGIN_PX]
    column, row = pixels.unbind(-1)
    levels = image[row, column]
    visibility = torch.ones_like(levels) if usable is None else usable[row, column].to(levels)
    rays, weights, owners = _cast_rays(pixels.double(), centre, radius)
    return Window(
        pixels.double(), levels, background[row, column].to(levels), visibility, rays, weights.to(levels), owners
    )


def _cast_rays(pixels: Tensor, centre: Tensor, radius: float) -> tuple[Tensor, Tensor, Tensor]:
    """`Window.rays`, `Window.ray_weights` and `Window.ray_pixels` of the ``pixels`` (p, 2)."""
    offsets = pixels - centre
    distance = offsets.norm(dim=-1)
    on_outline = (distance - radius).abs() < OUTLINE_PX
    x, y = offsets.abs().unbind(-1)
    normal_along_x, normal_along_y = on_outline & (y < OBLIQUE_FROM * x), on_outline & (x < OBLIQUE_FROM * y)
    near_limb = ~on_outline & (distance > LIMB_FROM * radius)
    rules = (
        (~on_outline & ~near_limb, INNER_POINTS, INNER_POINTS),
        (near_limb, LIMB_POINTS, LIMB_POINTS),
        (normal_along_x, POINTS_ACROSS, LIMB_POINTS),
        (normal_along_y, LIMB_POINTS, POINTS_ACROSS),
        (on_outline & ~normal_along_x & ~normal_along_y, OBLIQUE_POINTS, OBLIQUE_POINTS),
    )
    parts = []
    for chosen, columns, rows in rules:
        points, point_weights = _gauss_rule(columns, rows)
        number = torch.nonzero(chosen)[:, 0]
        rays = (pixels[number][:, None] + points).flatten(0, 1)
        parts.append((rays.T, point_weights.repeat(len(number)), number.repeat_interleave(len(points))))
    rays, weights, owners = (torch.cat(column, -1) for column in zip(*parts, strict=True))
    order = owners.argsort(stable=True)
    return rays[:, order].contiguous(), weights[order], owners[order]


def _gauss_rule(columns: int, rows: int) -> tuple[Tensor, Tensor]:
    """Points (k, 2), px from a pixel's centre, and weights (k,) of a Gauss rule over the pixel."""
    (x, x_weights), (y, y_weights) = (np.polynomial.legendre.leggauss(count) for count in (columns, rows))
    points = torch.cartesian_prod(torch.from_numpy(x) / 2, torch.from_numpy(y) / 2)
    return points, torch.outer(torch.from_numpy(x_weights) / 2, torch.from_numpy(y_weights) / 2).flatten()
