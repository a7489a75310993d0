"""How much of a correlated pair's residual is noise, over the region and in windows of it."""

from __future__ import annotations

import functools
import math
from typing import NamedTuple

import torch
import torch.nn.functional as F  # noqa: N812  (torch's own custom)
from torch import Tensor

from torchsphere.correlation.reference import Reference, scale
from torchsphere.kernels import jit, region, znssd

#: Sides of the windows of energy and of shape, shares of the radius: half a dozen and a dozen speckles.
ENERGY_WINDOW, SHAPE_WINDOW = 0.13, 0.22

#: Least side of a window, px.
MIN_WINDOW_PX = 5

#: Side of the blocks whose scores count as independent, share of the radius, and its least value, px.
BLOCK, MIN_BLOCK_PX = 0.2, 4

#: Ratio of variances that about 80 blocks reach by chance: one standard deviation above 1.
MAX_CHANCE_SCATTER = 1.2

#: Share of the noise's variance that the blocks show after the fit (docs/constants.toml).
BLOCK_NOISE_SHARE = 0.75

#: Radius of the part that faces the camera and shows the noise, share of the ball's (docs/constants.toml).
FACING = 0.5

#: Standard deviations below the mean from which and at which that part counts as quieter (docs/constants.toml).
MIN_QUIET_SDS, FULL_QUIET_SDS = 1.0, 3.0


def local_mean(reference: Reference, values: Tensor, weights: Tensor) -> Tensor:
    """Weighted mean (n, p) of ``values`` (n, p) in a window around each point."""
    window = _window_side(ENERGY_WINDOW, reference)
    if jit.suits(values, weights):
        return region.local_mean(values, weights, reference.places, reference.side, window)
    total, count = _window_sums(reference, torch.stack((weights * values, weights), 1), window).unbind(1)
    return total / count.clamp_min(1e-6)


def local_zncc(reference: Reference, warped: Tensor, weights: Tensor) -> Tensor:
    """Correlation coefficient (n, p) of both images in a window around each point."""
    count = weights.sum(-1, keepdim=True).clamp_min(1)
    f, g = (v - (weights * v).sum(-1, keepdim=True) / count for v in (reference.values, warped))
    gain = (weights * g * g).sum(-1, keepdim=True) / (weights * f * f).sum(-1, keepdim=True).clamp_min(1e-12)
    products = torch.stack((torch.ones_like(f), f, g, f * f, g * g, f * g), 1) * weights[:, None]
    n, f, g, ff, gg, fg = _window_sums(reference, products, _window_side(SHAPE_WINDOW, reference)).unbind(1)
    n = n.clamp_min(1e-6)
    f, g = f / n, g / n
    # Half the noise's variance as a floor, for windows without texture.
    floor = 0.5 * reference.noise.square()[:, None]
    power = ((ff / n - f * f).clamp_min(0) + floor) * ((gg / n - g * g).clamp_min(0) + gain * floor)
    return (fg / n - f * g) / power.clamp_min(1e-12).sqrt()


def _window_side(share: float, reference: Reference) -> int:
    """Odd number of grid points along a window of this share of the radius."""
    side = max(MIN_WINDOW_PX, share * float(reference.geometry.radius.mean())) / reference.spacing
    return 2 * (math.ceil(side) // 2) + 1


def to_grid(reference: Reference, values: Tensor) -> Tensor:
    """Values (n, c, p) of the points as maps (n, c, side, side), 0 without a point."""
    maps = values.new_zeros(*values.shape[:2], reference.side * reference.side)
    maps.scatter_(2, reference.places.expand_as(values), values)
    return maps.unflatten(-1, (reference.side, reference.side))


def from_grid(reference: Reference, maps: Tensor) -> Tensor:
    """Values (n, c, p) at the points of maps (n, c, side, side)."""
    return maps.flatten(-2).index_select(2, reference.places)


def _window_sums(reference: Reference, values: Tensor, window: int) -> Tensor:
    """Sums (n, c, p) over a square window around each point."""
    maps = F.pad(to_grid(reference, values), (window // 2,) * 4)
    return from_grid(reference, _moving_sums(_moving_sums(maps, 2, window), 3, window))


def _moving_sums(values: Tensor, axis: int, length: int) -> Tensor:
    """Sums of ``length`` neighbours along an axis, from sums of 1, 2, 4 ...: ten times faster than torch's pooling."""
    left = values.shape[axis] - length + 1
    total, at, size = None, 0, 1
    while True:
        if length & size:
            part = values.narrow(axis, at, left)
            total, at = part if total is None else total + part, at + size
        if total is not None and at == length:
            return total
        shorter = values.shape[axis] - size
        values = values.narrow(axis, 0, shorter) + values.narrow(axis, size, shorter)
        size *= 2


class ResidualPower(NamedTuple):
    """Sums (n,) of the weights and of the weighted squares of the residual of n pairs."""

    facing_weight: Tensor  # of the part that faces the camera, see `FACING`
    facing_square: Tensor
    weight: Tensor  # of the whole region
    square: Tensor

    @classmethod
    def of(cls, reference: Reference, difference: Tensor, weights: Tensor) -> ResidualPower:
        """From the residual (n, p) and the weights (n, p)."""
        limit = FACING * reference.geometry.radius
        if jit.suits(difference, weights, limit):
            return cls(*znssd.powers(difference, weights, reference.surface, limit).unbind(-1))
        facing = weights * (reference.points.square().sum(-1) < limit[:, None].square())
        square = difference.square()
        return cls(*(total for w in (facing, weights) for total in (w.sum(-1), torch.linalg.vecdot(w, square))))


def inflation(
    reference: Reference, jacobian: Tensor, factor: Tensor, weighted: Tensor, power: ResidualPower, stated: Tensor
) -> Tensor:
    """Factors (n, k), float64, that correct the standard deviations for a residual that is not white noise.

    ``jacobian`` (n, k, p), px per px, and ``factor`` (n, k, k) are those of the criterion, ``weighted`` (n, p) is the
    residual times the weights; the covariance ``stated`` (n, k, k), px and rad, takes the whole residual for noise.

    The scatter of the scores ``J^T W r`` of independent blocks gives a covariance without a model of the residual (the
    sandwich of Huber and White). Overlapping blocks keep sums that cancel within the ball. A covered part or a shadow
    widens a mode; the changing view of the texture narrows it, since its products with the gradient cancel within a few
    px. The share of noise (`noise_share`) counts in full.
    """
    scores = block_sums(reference, jacobian, weighted, fading=True)
    scatter = (scores @ scores.mT).double()
    inverse = torch.cholesky_inverse(factor)
    unit = scale(reference, stated.shape[-1]).double()
    found = (inverse @ scatter @ inverse).diagonal(dim1=-2, dim2=-1) / unit.square()
    ratio = (found / stated.diagonal(dim1=-2, dim2=-1)).nan_to_num(1.0, 1.0, 1.0)
    noise = noise_share(reference, power)[:, None]
    narrowed = torch.maximum(ratio + (1 - BLOCK_NOISE_SHARE) * noise, noise).clamp(max=1.0)
    return torch.maximum(narrowed, ratio / MAX_CHANCE_SCATTER).sqrt()


def noise_share(reference: Reference, power: ResidualPower) -> Tensor:
    """Largest share (n,), float64, 0 to 1, of the residual's variance that may be noise: see `FACING`."""
    # All may be noise where that part is hidden.
    share = (power.facing_square / power.facing_weight / (power.square / power.weight)).double()
    share = share.nan_to_num(1.0, 1.0, 1.0).clamp(max=1.0)
    scatter = (2 / _independent(reference, power.facing_weight).clamp_min(1)).sqrt()
    credibility = ((1 - share) / scatter - MIN_QUIET_SDS) / (FULL_QUIET_SDS - MIN_QUIET_SDS)
    return 1 - (1 - share) * credibility.clamp(0, 1)


def _independent(reference: Reference, count: Tensor) -> Tensor:
    """Number (n,), float64, of independent residuals among ``count`` (n,): the pre-blur correlates neighbours."""
    # Sum of the squared correlations of white noise behind a Gaussian blur, px^2.
    correlated = max(2 * math.pi * reference.pre_blur**2, reference.spacing**2)
    return count.double() * reference.spacing**2 / correlated


def block_sums(reference: Reference, values: Tensor, weights: Tensor, *, fading: bool = False) -> Tensor:
    """Sums (n, c, b) over blocks of the values (n, c, p) times the weights (n, p).

    Blocks that are ``fading`` overlap: their weights fall like a cosine to 0 in the middle of the next block.
    """
    size = math.ceil(max(MIN_BLOCK_PX, BLOCK * float(reference.geometry.radius.mean())) / reference.spacing)
    shares = _shares(reference.side, size, fading).to(values)
    if jit.suits(values, weights):
        return region.block_sums(values, weights, reference.places, reference.side, shares)
    return (shares @ to_grid(reference, values * weights[:, None]) @ shares.T).flatten(2)


@functools.lru_cache(maxsize=16)
def _shares(side: int, size: int, fading: bool) -> Tensor:
    """Share (b, side), float64, of each place on an axis of the grid in each block of ``size`` places."""
    along = torch.arange(side)
    if not fading:
        return F.one_hot(along // size).double().T.contiguous()
    middles = size * torch.arange(math.ceil(side / size) + 1)
    distance = (along - middles[:, None]).abs().double() / size
    # Exactly 0 from the next middle on, where a rounded cosine is not.
    return torch.where(distance < 1, torch.cos(0.5 * math.pi * distance), 0.0)
