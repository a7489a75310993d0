"""The disc that separates its inside from a ring around it best: where a ball may be in a silhouette."""

from __future__ import annotations

import math

import torch
import torch.nn.functional as F  # noqa: N812  (torch's own custom)
from torch import Tensor

#: Longest side of the images that the disc filter works on, px.
COARSE_PX = 192

#: Steps of the disc filter's radius, and the outer radius of the ring that a disc is compared with.
RADIUS_STEP, RING = 1.1, 1.35

#: A silhouette that a disc explains to a smaller share is none.
MIN_EXPLAINED = 0.35


def best(silhouette: Tensor) -> Tensor | None:
    """The disc (1, 3), float64, that tells inside from outside best; None where none does."""
    factor = max(1, math.ceil(max(silhouette.shape) / COARSE_PX))
    small = F.avg_pool2d(silhouette[None, None], factor)[0, 0]
    best, guess = MIN_EXPLAINED, None
    radius, largest = max(8.0 / factor, 2.5), 0.5 * min(small.shape)
    while radius < largest:
        explained = _explained(small, radius)
        # Of two discs that explain equally well the larger is the ball and the smaller one of its speckles.
        value = float(explained.max()) * radius**0.25
        if value > best:
            y, x = divmod(int(explained.argmax()), small.shape[1])
            best = value
            guess = torch.tensor([[(v + 0.5) * factor - 0.5 for v in (x, y)] + [radius * factor]], dtype=torch.float64)
        radius *= RADIUS_STEP
    return guess


def _explained(small: Tensor, radius: float) -> Tensor:
    """Share (h, w) of the silhouette's variance, in disc and ring around each place, that the two means explain."""
    height, width = small.shape
    reach = math.ceil(RING * radius)
    steps = torch.arange(-reach, reach + 1, dtype=small.dtype, device=small.device)
    distance = (steps[:, None] ** 2 + steps[None] ** 2).sqrt()
    disc = (radius - distance + 0.5).clamp(0, 1)
    ring = (RING * radius - distance + 0.5).clamp(0, 1) - disc
    stack = torch.stack((small, small.square(), torch.ones_like(small)))
    size = (height + 2 * reach, width + 2 * reach)
    spectrum = torch.fft.rfft2(stack, s=size)
    sums = [
        torch.fft.irfft2(spectrum * torch.fft.rfft2(kernel, s=size), s=size)[
            :, reach : reach + height, reach : reach + width
        ]
        for kernel in (disc, ring)
    ]
    (inner, inner_squared, n), (outer, outer_squared, m) = sums
    n, m = n.clamp_min(1e-3), m.clamp_min(1e-3)
    mean = (inner + outer) / (n + m)
    total = (inner_squared + outer_squared - (n + m) * mean**2).clamp_min(1e-3)
    difference = inner / n - outer / m
    explained = n * m / (n + m) * difference.clamp_min(0) ** 2 / total
    # The disc must lie in the image.
    r = math.ceil(radius * 0.97)
    allowed = torch.zeros_like(small, dtype=torch.bool)
    allowed[r : height - r, r : width - r] = True
    return torch.where(allowed, explained, 0.0)


def explained_by(silhouette: Tensor, circle: Tensor) -> float:
    """Share of the silhouette's variance, in the circle and a ring around it, that the two means explain."""
    x, y, radius = circle.tolist()
    height, width = silhouette.shape
    columns = torch.arange(width, device=silhouette.device) - x
    rows = torch.arange(height, device=silhouette.device) - y
    distance = (rows[:, None] ** 2 + columns[None] ** 2).sqrt()
    near = silhouette[distance < RING * radius]
    inner = silhouette[distance < radius]
    n, m = len(inner), len(near) - len(inner)
    if n < 10 or m < 10:
        return 0.0
    outer_mean = (near.sum() - inner.sum()) / m
    difference = float(inner.mean() - outer_mean)
    return n * m / (n + m) * max(difference, 0.0) ** 2 / max(float(near.var()) * len(near), 1e-6)
