"""The reference images of the plain engine: grey levels and gradients over the region of interest.

All images are cubic splines, as in the paper; `torchsphere.correlation.plain` is the method that uses them.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import torch
import torch.nn.functional as F  # noqa: N812  (torch's own custom)
from torch import Tensor

from torchsphere.correlation.options import Options
from torchsphere.geometry import motion_models
from torchsphere.geometry.camera import view_of
from torchsphere.geometry.motion_models import Geometry
from torchsphere.imaging import crop, interpolation

#: Difference of two Laplacians, blind to the image itself (J. Immerkaer, doi:10.1006/cviu.1996.0060).
_DIFFERENCES = torch.tensor([[1.0, -2.0, 1.0], [-2.0, 4.0, -2.0], [1.0, -2.0, 1.0]])


class Region(NamedTuple):
    """The reference images over the region of interest."""

    points: Tensor  # (n, p, 2), px from the ball's centre
    weights: Tensor  # (n, p), 1 in the region and usable, else 0
    values: Tensor  # (n, p), grey levels
    gradient: Tensor  # (n, p, 2), grey levels per px
    blurred_gradient: Tensor  # the gradient after one more pre-blur
    normals: Tensor  # (n, p, 3), unit normals of the ball
    noise: Tensor  # (n,), standard deviation of the raw image's noise
    geometry: Geometry

    def scale(self, k: int) -> Tensor:
        """What turns k unknowns into px (n, k): 1 for translations, the radius for rotations and for growth."""
        radius = self.geometry.radius[:, None]
        return torch.cat((torch.ones_like(radius).expand(-1, 2), radius.expand(-1, k - 2)), -1)


def spline_coefficients(images: Tensor, pre_blur: float) -> Tensor:
    """Spline coefficients (n, h, w) of the images (n, h, w), blurred by ``pre_blur`` px: one matrix per axis."""
    height, width = (interpolation.prefilter_matrix(size, pre_blur).to(images) for size in images.shape[-2:])
    return height @ images @ width.T


def region_of(crops: crop.Crops, circles: Tensor, options: Options) -> Region:
    """Values and gradients of the reference images at all pixels within the region of interest."""
    c = spline_coefficients(crops.images, options.pre_blur)
    side = torch.arange(c.shape[-1], device=c.device)
    pixels = torch.stack(torch.meshgrid(side, side, indexing="xy"), -1).reshape(-1, 2)
    points = pixels + (crops.origin - circles[:, :2]).to(c)[:, None]
    radius = circles[:, 2].to(c)
    inside = points.square().sum(-1) < (options.roi * radius[:, None]).square()
    weights = inside.to(c) if crops.usable is None else (inside & crops.usable.flatten(1)).to(c)
    maps = _at_nodes(c)
    blur = interpolation.blur_matrix(c.shape[-1], options.pre_blur).to(c)
    maps = torch.cat((maps, blur @ maps[:, 1:] @ blur.T), 1).flatten(2)
    rough = F.conv2d(crops.images[:, None], _DIFFERENCES.to(c)[None, None], padding=1).abs().flatten(1)
    noise = math.sqrt(math.pi / 2) / 6 * (weights * rough).sum(-1) / weights.sum(-1).clamp_min(1)
    kept = inside.any(0)
    points, weights, maps = points[:, kept], weights[:, kept], maps[:, :, kept]
    depth = motion_models.depth(points, radius[:, None])
    return Region(
        points=points,
        weights=weights,
        values=maps[:, 0],
        gradient=maps[:, 1:3].mT,
        blurred_gradient=maps[:, 3:].mT,
        normals=torch.cat((points, -depth[..., None]), -1) / radius[:, None, None],
        noise=noise,
        geometry=Geometry(radius, None if options.camera is None else view_of(options.camera, circles[:, :2], c)),
    )


def _at_nodes(c: Tensor) -> Tensor:
    """Value and derivatives along x and y of the splines (n, h, w) at their nodes: (n, 3, h, w)."""
    side, middle, _ = interpolation.NODE_WEIGHTS
    near, far = interpolation.SLOPE_WEIGHTS
    value, slope = c.new_tensor([0.0, side, middle, side, 0.0]), c.new_tensor([-far, -near, 0.0, near, far])
    kernels = torch.stack((torch.outer(value, value), torch.outer(value, slope), torch.outer(slope, value)))
    return F.conv2d(c[:, None], kernels[:, None], padding=2)
