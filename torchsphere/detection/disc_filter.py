"""Disc filter: the disc that a silhouette separates best from a ring around it."""

from __future__ import annotations

import math

import torch
import torch.nn.functional as F  # noqa: N812  (torch's own custom)
from torch import Tensor

#: Longest side of the filtered images, px.
COARSE_PX = 192

#: Ratio of successive radii, and outer radius of the ring in radii of the disc.
RADIUS_STEP, RING = 1.1, 1.35

#: Least share of a silhouette's variance that the disc of a ball explains.
MIN_EXPLAINED = 0.35


def best_discs(silhouettes: Tensor, radii: tuple[float, float] = (0.0, math.inf)) -> list[Tensor | None]:
    """The disc (1, 3), float64, that explains most of each silhouette (k, h, w); None without a good one.

    ``radii``, px, are the least and the largest that are looked for.
    """
    factor = max(1, math.ceil(max(silhouettes.shape[1:]) / COARSE_PX))
    small = F.avg_pool2d(silhouettes[:, None], factor)[:, 0]
    best = [MIN_EXPLAINED] * len(small)
    guesses: list[Tensor | None] = [None] * len(small)
    radius, largest = max(8.0 / factor, 2.5, radii[0] / factor), min(0.5 * min(small.shape[1:]), radii[1] / factor)
    while radius < largest:
        shares, places = (values.tolist() for values in _explained(small, radius).flatten(1).max(-1))
        for i, (share, place) in enumerate(zip(shares, places, strict=True)):
            # Of two discs that explain equally well, the larger is the ball and the smaller a speckle.
            if share * radius**0.25 > best[i]:
                best[i] = share * radius**0.25
                y, x = divmod(place, small.shape[2])
                guess = [(v + 0.5) * factor - 0.5 for v in (x, y)] + [radius * factor]
                guesses[i] = torch.tensor([guess], dtype=torch.float64)
        radius *= RADIUS_STEP
    return guesses


def _explained(small: Tensor, radius: float) -> Tensor:
    """Share (k, h, w) of each silhouette's variance that the means of a disc and its ring around each pixel explain."""
    count, height, width = small.shape
    reach = math.ceil(RING * radius)
    steps = torch.arange(-reach, reach + 1, dtype=small.dtype, device=small.device)
    distance = (steps[:, None] ** 2 + steps[None] ** 2).sqrt()
    disc, both = ((outer - distance + 0.5).clamp(0, 1) for outer in (radius, RING * radius))
    # Values that wrap around the periodic plane lie in the margin, which is cut off.
    size = (_fast_length(height + reach), _fast_length(width + reach))
    of_disc, of_both = torch.fft.rfft2(torch.stack((disc, both)), s=size)
    spectrum = torch.fft.rfft2(torch.cat((small, torch.ones_like(small[:1]), small.square())), s=size)
    products = torch.cat((spectrum[: count + 1] * of_disc, spectrum * of_both))
    sums = torch.fft.irfft2(products, s=size)[:, reach : reach + height, reach : reach + width]
    inner, n, total, every, squared = sums.split((count, 1, count, 1, count))
    outer, m = total - inner, (every - n).clamp_min(1e-3)
    n = n.clamp_min(1e-3)
    difference = inner / n - outer / m
    rest = (squared - total.square() / (n + m)).clamp_min(1e-3)
    explained = n * m / (n + m) * difference.clamp_min(0) ** 2 / rest
    # The disc must lie in the image.
    r = math.ceil(radius * 0.97)
    allowed = torch.zeros_like(small[0], dtype=torch.bool)
    allowed[r : height - r, r : width - r] = True
    return torch.where(allowed, explained, 0.0)


def _fast_length(least: int) -> int:
    """The next length without prime factors above 5, of which Fourier transforms are five times faster."""
    left = least
    for factor in (2, 3, 5):
        while left % factor == 0:
            left //= factor
    return least if left == 1 else _fast_length(least + 1)


def explained_by(silhouette: Tensor, circle: Tensor) -> float:
    """Share of the silhouette's variance that the means of the circle and of a ring around it explain."""
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
