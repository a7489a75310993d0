"""Where the ball is in the next image, to a pixel or two, without any guess: template matching on small images."""

from __future__ import annotations

import math

import torch
import torch.nn.functional as F  # noqa: N812  (torch's own custom)
from torch import Tensor

#: Radius of the ball in the small images, px, and of the template as a multiple of it (the outline helps).
SMALL_RADIUS_PX, TEMPLATE = 10.0, 1.12


def best_match(f: Tensor, g: Tensor, centre: Tensor, radius: float, ignore: Tensor | None = None) -> Tensor:
    """Centre of the ball in ``g`` by matching the disc around it in ``f`` over the whole image.

    Parameters
    ----------
    f, g : Tensor
        Grey levels (h, w).
    centre : Tensor
        Centre of the ball in ``f`` as (x, y), px.
    radius : float
        Radius of the ball, px.
    ignore : Tensor, optional
        (h, w), True where the images are not to be used.

    Returns
    -------
    Tensor
        (2,) as (x, y), px, float64 on the CPU; right to about a tenth of the radius.
    """
    factor = max(1, int(radius / SMALL_RADIUS_PX))
    small_radius = radius / factor
    reach = math.ceil(TEMPLATE * small_radius)
    small_f, small_g = (_shrink(image, factor, reach) for image in (f, g))
    # Pixel i of the small image is the mean of the pixels from i factor on.
    place = (centre.to("cpu", torch.float64) + 0.5) / factor - 0.5
    middle = place.round().long()
    x, y = (
        min(max(int(v), 0), size - 1)
        for v, size in zip(middle, (f.shape[1] // factor, f.shape[0] // factor), strict=True)
    )
    template = small_f[y : y + 2 * reach + 1, x : x + 2 * reach + 1]
    steps = torch.arange(-reach, reach + 1).to(template)
    weights = ((steps[:, None] ** 2 + steps[None] ** 2) <= (TEMPLATE * small_radius) ** 2).to(template)
    if ignore is not None:
        ignored = _shrink(ignore.to(template), factor, reach)[y : y + 2 * reach + 1, x : x + 2 * reach + 1]
        weights = weights * (ignored < 0.5)
    score = _zncc_map(small_g, template, weights)
    row, column = divmod(int(score.argmax()), score.shape[1])
    found = torch.tensor([column + _fraction(score[row], column), row + _fraction(score[:, column], row)])
    step = found.double() - torch.tensor([x, y])
    return centre.to("cpu", torch.float64) + step * factor


def _shrink(image: Tensor, factor: int, border: int) -> Tensor:
    small = F.avg_pool2d(image[None, None], factor)
    return F.pad(small, (border,) * 4, mode="replicate")[0, 0]


def _zncc_map(image: Tensor, template: Tensor, weights: Tensor) -> Tensor:
    """Correlation coefficient of the weighted template with every place of the image."""
    count = weights.sum().clamp_min(1)
    centred = (template - (weights * template).sum() / count) * weights
    mean_level = image.mean()
    stack = torch.stack((image - mean_level, (image - mean_level).square()))[:, None]
    kernels = torch.stack((centred, weights))[:, None]
    products, sums = F.conv2d(stack[:1], kernels)[0]
    squares = F.conv2d(stack[1:], kernels[1:])[0, 0]
    power = (squares - sums.square() / count).clamp_min(1e-3 * float(count))
    return products / (power * centred.square().sum().clamp_min(1e-6)).sqrt()


def _fraction(line: Tensor, at: int) -> float:
    """Offset of the top of the parabola through the maximum and its neighbours, -0.5 to 0.5."""
    if not 0 < at < len(line) - 1:
        return 0.0
    left, middle, right = line[at - 1 : at + 2].tolist()
    curvature = left - 2 * middle + right
    return max(-0.5, min(0.5, 0.5 * (left - right) / curvature)) if curvature < 0 else 0.0
