"""Where, and how far, a correlated pair's residual is more than noise."""

from __future__ import annotations

import functools
import math
from typing import NamedTuple

import torch
import torch.nn.functional as F  # noqa: N812  (torch's own custom)
from torch import Tensor

from torchsphere import kernels
from torchsphere.correlation.reference import Reference, scale
from torchsphere.kernels import box_filter, znssd

#: Side of the window that energies are averaged over, and of the one in which the images are compared by
#: their shape alone, as shares of the radius, and the least, px: half a dozen and a dozen speckles of the example ball.
ENERGY_WINDOW, SHAPE_WINDOW, MIN_WINDOW_PX = 0.13, 0.22, 5

#: Side of the blocks whose scores count as independent, as a share of the radius, and the least, px.
BLOCK, MIN_BLOCK_PX = 0.2, 4

#: Ratio of variances up to which the scatter of about 80 blocks says nothing: one standard deviation above 1.
MAX_CHANCE_SCATTER = 1.2

#: Share of the variance that the blocks find where the residual is noise, some of which the fit has taken up. Measured
#: at R = 40 and 50 px under noise of 5 grey levels: 0.74 to 0.78 for each of the five modes.
BLOCK_NOISE_SHARE = 0.75

#: Part of the region, of the radius, whose residual stands for the noise: the view of the texture changes least there.
#: Measured at 5, 10 and 15 deg per frame without noise: its residual is 0.25, 0.3 and 0.4 of the whole region's.
FACING = 0.5

#: From how many and up to how many standard deviations of its own a quieter residual in that part is believed, bit by
#: bit: a small ball has few independent values there, and a variance that is low by chance made the standard deviations
#: of balls of 10 px 1.05 to 1.2 times too narrow.
MIN_QUIET_SDS, FULL_QUIET_SDS = 1.0, 3.0


def local_mean(reference: Reference, values: Tensor, weights: Tensor) -> Tensor:
    """Mean (n, p) of ``values`` (n, p) in a window around each point, over the points that count."""
    window = _odd(ENERGY_WINDOW, reference)
    if kernels.suits(values, weights):
        return box_filter.local_mean(values, weights, reference.places, reference.side, window)
    total, count = _smoothed(reference, torch.stack((weights * values, weights), 1), window).unbind(1)
    return total / count.clamp_min(1e-6)


def local_zncc(reference: Reference, warped: Tensor, weights: Tensor) -> Tensor:
    """Correlation coefficient (n, p) of both images in a window around each point: blind to local gain and offset."""
    count = weights.sum(-1, keepdim=True).clamp_min(1)
    f, g = (v - (weights * v).sum(-1, keepdim=True) / count for v in (reference.values, warped))
    gain = (weights * g * g).sum(-1, keepdim=True) / (weights * f * f).sum(-1, keepdim=True).clamp_min(1e-12)
    products = torch.stack((torch.ones_like(f), f, g, f * f, g * g, f * g), 1) * weights[:, None]
    n, f, g, ff, gg, fg = _smoothed(reference, products, _odd(SHAPE_WINDOW, reference)).unbind(1)
    n = n.clamp_min(1e-6)
    f, g = f / n, g / n
    # Half the image noise's variance as a floor: a window without texture has no shape to compare.
    floor = 0.5 * reference.noise.square()[:, None]
    power = ((ff / n - f * f).clamp_min(0) + floor) * ((gg / n - g * g).clamp_min(0) + gain * floor)
    return (fg / n - f * g) / power.clamp_min(1e-12).sqrt()


def _odd(share: float, reference: Reference) -> int:
    side = max(MIN_WINDOW_PX, share * float(reference.geometry.radius.mean())) / reference.spacing
    return 2 * (math.ceil(side) // 2) + 1


def to_grid(reference: Reference, values: Tensor) -> Tensor:
    """Values (n, c, p) of the points -> maps (n, c, side, side), 0 where there is no point."""
    maps = values.new_zeros(*values.shape[:2], reference.side * reference.side)
    maps.scatter_(2, reference.places.expand_as(values), values)
    return maps.unflatten(-1, (reference.side, reference.side))


def from_grid(reference: Reference, maps: Tensor) -> Tensor:
    """Values (n, c, p) at the points of maps (n, c, side, side)."""
    return maps.flatten(-2).index_select(2, reference.places)


def _smoothed(reference: Reference, values: Tensor, window: int) -> Tensor:
    """Sum over a square window around each point, points that are not there counting as 0; (n, c, p)."""
    maps = F.pad(to_grid(reference, values), (window // 2,) * 4)
    return from_grid(reference, _runs(_runs(maps, 2, window), 3, window))


def _runs(values: Tensor, axis: int, length: int) -> Tensor:
    """Sums of ``length`` neighbours along an axis, which they shorten by ``length - 1``, from sums of 1, 2, 4 ...

    Measured ten times faster than torch's pooling, a quarter of a pair's time by then.
    """
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
    """What the residual of n pairs comes to: sums of weights, and of its weighted squares, (n,) each.

    Attributes
    ----------
    facing, of_facing : Tensor
        Weights and squares of the part that faces the camera, see `FACING`.
    whole, of_whole : Tensor
        Of the whole region.
    """

    facing: Tensor
    of_facing: Tensor
    whole: Tensor
    of_whole: Tensor

    @classmethod
    def of(cls, reference: Reference, difference: Tensor, weights: Tensor) -> ResidualPower:
        """From the residual (n, p) and the weights (n, p)."""
        limit = FACING * reference.geometry.radius
        if kernels.suits(difference, weights, limit):
            return cls(*znssd.powers(difference, weights, reference.surface, limit).unbind(-1))
        facing = weights * (reference.points.square().sum(-1) < limit[:, None].square())
        square = difference.square()
        return cls(*(total for w in (facing, weights) for total in (w.sum(-1), torch.linalg.vecdot(w, square))))


def inflation(
    reference: Reference,
    jacobian: Tensor,
    factor: Tensor,
    weighted: Tensor,
    power: ResidualPower,
    stated: Tensor,
) -> Tensor:
    """Factors (n, k), float64, from the standard deviations in ``stated`` to those that the residual's places tell.

    ``jacobian`` (n, k, p) is that of the criterion, in px per px, ``factor`` (n, k, k) the Cholesky factor of its
    operator; ``weighted`` (n, p) is the residual times the weights, ``power`` what that comes to; ``stated`` (n, k, k),
    in px and rad, takes the whole residual for noise.

    The scores ``J^T W r`` of blocks of the region count as independent; their scatter gives a covariance that needs no
    model of the residual (the sandwich of Huber and White). The blocks fade into one another: what cancels within the
    ball does not at a sharp edge, which stated fast turns 1.05 to 1.1 times too wide. Each mode has its own factor,
    since a misfit of a part of the ball weighs on some of them; what widens it less than the blocks' number leaves open
    (`MAX_CHANCE_SCATTER`) does not count.

    A covered part or a shadow weighs more on the motion than noise of the same power, and widens. The changing view of
    the texture weighs less, and narrows: it leaves second derivatives of the texture, whose products with the gradient
    cancel within a few px. As noise it made the standard deviations 1.5 times too wide at 5 deg per frame and twice at
    10 and 15. What is noise (`noise_share`) is stated in full.
    """
    scores = block_sums(reference, jacobian, weighted, fading=True)
    scatter = (scores @ scores.mT).double()
    inverse = torch.cholesky_inverse(factor)
    unit = scale(reference, stated.shape[-1]).double()
    found = (inverse @ scatter @ inverse).diagonal(dim1=-2, dim2=-1) / unit.square()
    ratio = (found / stated.diagonal(dim1=-2, dim2=-1)).nan_to_num(1.0, 1.0, 1.0)
    noise = noise_share(reference, power)[:, None]
    narrower = torch.maximum(ratio + (1 - BLOCK_NOISE_SHARE) * noise, noise).clamp(max=1.0)
    return torch.maximum(narrower, ratio / MAX_CHANCE_SCATTER).sqrt()


def noise_share(reference: Reference, power: ResidualPower) -> Tensor:
    """Share (n,), float64, 0 to 1, of the residual's variance that is noise at most: see `FACING`."""
    # Where nothing of that part is to be seen, all may be noise.
    share = (power.of_facing / power.facing / (power.of_whole / power.whole)).double()
    share = share.nan_to_num(1.0, 1.0, 1.0).clamp(max=1.0)
    scatter = (2 / _independent(reference, power.facing).clamp_min(1)).sqrt()
    believed = ((1 - share) / scatter - MIN_QUIET_SDS) / (FULL_QUIET_SDS - MIN_QUIET_SDS)
    return 1 - (1 - share) * believed.clamp(0, 1)


def _independent(reference: Reference, count: Tensor) -> Tensor:
    """Independent squares (n,), float64, among so many residuals (n,): the pre-blur makes neighbours alike."""
    # Sum of the squared correlations of white noise behind a Gaussian blur, px^2.
    alike = max(2 * math.pi * reference.pre_blur**2, reference.spacing**2)
    return count.double() * reference.spacing**2 / alike


def block_sums(reference: Reference, values: Tensor, weights: Tensor, *, fading: bool = False) -> Tensor:
    """Sums (n, c, b) over the blocks of the points' values (n, c, p) times their weights (n, p).

    ``fading``: times further weights that fall like a cosine from 1 in the middle of a block to 0 in those of its
    neighbours, so that their squares add up to 1 everywhere.
    """
    size = math.ceil(max(MIN_BLOCK_PX, BLOCK * float(reference.geometry.radius.mean())) / reference.spacing)
    belongs = _shares(reference.side, size, fading).to(values)
    if kernels.suits(values, weights):
        return box_filter.block_sums(values, weights, reference.places, reference.side, belongs)
    # Over their rows, then over their columns.
    return (belongs @ to_grid(reference, values * weights[:, None]) @ belongs.T).flatten(2)


@functools.lru_cache(maxsize=16)
def _shares(side: int, size: int, fading: bool) -> Tensor:
    """Share (b, side), float64, of each place on an axis of the grid in each of the blocks of so many places."""
    along = torch.arange(side)
    if not fading:
        return F.one_hot(along // size).double().T.contiguous()
    middles = size * torch.arange(math.ceil(side / size) + 1)
    apart = (along - middles[:, None]).abs().double() / size
    # None at all from the next middle on, where a cosine in finite precision is not quite 0.
    return torch.where(apart < 1, torch.cos(0.5 * math.pi * apart), 0.0)
