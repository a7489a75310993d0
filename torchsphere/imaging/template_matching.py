"""Position of the ball in the next image, to a pixel or two, by template matching on reduced images."""

from __future__ import annotations

import math

import torch
import torch.nn.functional as F  # noqa: N812  (torch's own custom)
from torch import Tensor

#: Radius of the ball in the reduced images, px.
SMALL_RADIUS_PX = 10.0

#: Radius of the template in ball radii: the outline is part of the template.
TEMPLATE_RADIUS = 1.12


def best_match(f: Tensor, g: Tensor, centre: Tensor, radius: float, ignore: Tensor | None = None) -> Tensor:
    """Centre (2,) of the ball in ``g`` (h, w): best match of the disc around ``centre`` (2,) in ``f`` (h, w), px.

    Right to a tenth of the ``radius``, px; float64 on the CPU. ``ignore`` (h, w) is True where pixels are unusable.
    """
    factor = max(1, int(radius / SMALL_RADIUS_PX))
    small_radius = radius / factor
    reach = math.ceil(TEMPLATE_RADIUS * small_radius)
    small_f, small_g = (_reduce(image, factor, reach) for image in (f, g))
    # Pixel i of the reduced image is the mean of ``factor`` pixels from i factor on.
    place = (centre.to("cpu", torch.float64) + 0.5) / factor - 0.5
    middle = place.round().long()
    x, y = (
        min(max(int(v), 0), size - 1)
        for v, size in zip(middle, (f.shape[1] // factor, f.shape[0] // factor), strict=True)
    )
    template = small_f[y : y + 2 * reach + 1, x : x + 2 * reach + 1]
    steps = torch.arange(-reach, reach + 1).to(template)
    weights = ((steps[:, None] ** 2 + steps[None] ** 2) <= (TEMPLATE_RADIUS * small_radius) ** 2).to(template)
    if ignore is not None:
        ignored = _reduce(ignore.to(template), factor, reach)[y : y + 2 * reach + 1, x : x + 2 * reach + 1]
        weights = weights * (ignored < 0.5)
    score = _zncc_map(small_g, template, weights)
    row, column = divmod(int(score.argmax()), score.shape[1])
    found = torch.tensor([column + _subpixel_offset(score[row], column), row + _subpixel_offset(score[:, column], row)])
    step = found.double() - torch.tensor([x, y])
    return centre.to("cpu", torch.float64) + step * factor


def _reduce(image: Tensor, factor: int, border: int) -> Tensor:
    small = F.avg_pool2d(image[None, None], factor)
    return F.pad(small, (border,) * 4, mode="replicate")[0, 0]


def _zncc_map(image: Tensor, template: Tensor, weights: Tensor) -> Tensor:
    """Correlation coefficient of the weighted template at every place of the image."""
    count = weights.sum().clamp_min(1)
    centred = (template - (weights * template).sum() / count) * weights
    mean_level = image.mean()
    stack = torch.stack((image - mean_level, (image - mean_level).square()))[:, None]
    kernels = torch.stack((centred, weights))[:, None]
    products, sums = F.conv2d(stack[:1], kernels)[0]
    squares = F.conv2d(stack[1:], kernels[1:])[0, 0]
    power = (squares - sums.square() / count).clamp_min(1e-3 * float(count))
    return products / (power * centred.square().sum().clamp_min(1e-6)).sqrt()


def _subpixel_offset(line: Tensor, at: int) -> float:
    """Offset of the vertex of the parabola through the maximum and its neighbours, -0.5 to 0.5."""
    if not 0 < at < len(line) - 1:
        return 0.0
    left, middle, right = line[at - 1 : at + 2].tolist()
    curvature = left - 2 * middle + right
    return max(-0.5, min(0.5, 0.5 * (left - right) / curvature)) if curvature < 0 else 0.0
