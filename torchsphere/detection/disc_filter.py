"""Disc filter: the disc that a silhouette separates best from a ring around it."""

from __future__ import annotations

import functools
import math
from dataclasses import dataclass
from typing import NamedTuple

import torch
import torch.nn.functional as F  # noqa: N812  (torch's own custom)
from torch import Tensor

#: Longest side of the filtered images, px.
COARSE_PX = 192

#: Radius from which an image is halved, px (docs/constants.toml).
HALVED_FROM = 12.0

#: Ratio of successive radii, and outer radius of the ring in radii of the disc.
RADIUS_STEP, RING = 1.1, 1.35

#: Least share of a silhouette's variance that the disc of a ball explains.
MIN_EXPLAINED = 0.35


def best_discs(silhouettes: Tensor, radii: tuple[float, float] = (0.0, math.inf)) -> list[Tensor | None]:
    """The disc (1, 3), float64, that explains most of each silhouette (k, h, w); None without a good one.

    ``radii``, px, are the least and the largest that are looked for.
    """
    factor = max(1, math.ceil(max(silhouettes.shape[1:]) / COARSE_PX))
    level = _Level.of(F.avg_pool2d(silhouettes[:, None], factor)[:, 0])
    best = [MIN_EXPLAINED] * len(silhouettes)
    guesses: list[Tensor | None] = [None] * len(silhouettes)
    radius, halved = max(8.0 / factor, 2.5, radii[0] / factor), 1
    while radius < min(halved * level.largest, radii[1] / factor):
        if radius >= halved * HALVED_FROM:
            # A larger disc needs no finer image, and the smallest discs take most of the time.
            level, halved = level.halved(), 2 * halved
            continue
        shares, places = (values.tolist() for values in level.explained(radius / halved).flatten(1).max(-1))
        for i, (share, place) in enumerate(zip(shares, places, strict=True)):
            # Of two discs that explain equally well, the larger is the ball and the smaller a speckle.
            if share * radius**0.25 > best[i]:
                best[i] = share * radius**0.25
                y, x = divmod(place, level.small.shape[2])
                guess = [(v + 0.5) * halved * factor - 0.5 for v in (x, y)] + [radius * factor]
                guesses[i] = torch.tensor([guess], dtype=torch.float64)
        radius *= RADIUS_STEP
    return guesses


@dataclass(frozen=True)
class _Level:
    """Silhouettes (k, h, w) at one resolution, with the spectra of their values and squares on a larger plane."""

    small: Tensor
    values: Tensor
    squares: Tensor

    @classmethod
    def of(cls, small: Tensor) -> _Level:
        """The spectra are made once for all radii."""
        values, squares = torch.fft.rfft2(torch.stack((small, small.square())), s=_plane(*small.shape[1:]))
        return cls(small, values, squares)

    @property
    def largest(self) -> float:
        """Radius of the largest disc in the image, px."""
        return 0.5 * min(self.small.shape[1:])

    def halved(self) -> _Level:
        """The silhouettes at half the resolution."""
        return _Level.of(F.avg_pool2d(self.small[:, None], 2)[:, 0])

    def explained(self, radius: float) -> Tensor:
        """Share (k, h, w) of the variance that the means of a disc and its ring around each pixel explain."""
        height, width = self.small.shape[1:]
        kernels = _kernels(radius, height, width, self.small.device)
        products = torch.cat((self.values * kernels.disc, self.values * kernels.both, self.squares * kernels.both))
        inner, total, squared = _summed(products, _reach(radius), height, width).chunk(3)
        n, m = kernels.of_disc, kernels.of_ring
        difference = inner / n - (total - inner) / m
        rest = (squared - total.square() / (n + m)).clamp_min(1e-3)
        explained = n * m / (n + m) * difference.clamp_min(0) ** 2 / rest
        # The disc must lie in the image.
        r = math.ceil(radius * 0.97)
        allowed = torch.zeros_like(self.small[0], dtype=torch.bool)
        allowed[r : height - r, r : width - r] = True
        return torch.where(allowed, explained, 0.0)


class _Kernels(NamedTuple):
    """Spectra of a disc, and of the disc with its ring; numbers (h, w) of pixels in the disc and in the ring."""

    disc: Tensor
    both: Tensor
    of_disc: Tensor
    of_ring: Tensor


@functools.lru_cache(maxsize=32)
def _kernels(radius: float, height: int, width: int, device: torch.device) -> _Kernels:
    """Kernels for images (h, w) on a device; a search looks for the same radii in many images."""
    reach = _reach(radius)
    steps = torch.arange(-reach, reach + 1, dtype=torch.float32, device=device)
    distance = (steps[:, None] ** 2 + steps[None] ** 2).sqrt()
    shapes = torch.stack([(outer - distance + 0.5).clamp(0, 1) for outer in (radius, RING * radius)])
    spectra = torch.fft.rfft2(shapes, s=_plane(height, width))
    everywhere = torch.fft.rfft2(torch.ones(height, width, device=device), s=_plane(height, width))
    n, both = _summed(everywhere * spectra, reach, height, width)
    return _Kernels(spectra[0], spectra[1], n.clamp_min(1e-3), (both - n).clamp_min(1e-3))


def _reach(radius: float) -> int:
    """Reach of the ring around a disc, px."""
    return math.ceil(RING * radius)


def _plane(height: int, width: int) -> tuple[int, int]:
    """Size of the plane of the transforms of an image: what wraps around lies in a margin."""
    margin = _reach(HALVED_FROM)
    return _fast_length(height + margin), _fast_length(width + margin)


def _summed(products: Tensor, reach: int, height: int, width: int) -> Tensor:
    """Sums (k, h, w) around each pixel from the ``products`` of spectra."""
    sums = torch.fft.irfft2(products, s=_plane(height, width))
    return sums[..., reach : reach + height, reach : reach + width]


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
