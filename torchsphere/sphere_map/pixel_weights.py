"""Weights of the pixels: residual variance by distance from the outline, and parts that an object hides.

Near the outline the texture is foreshortened to less than the map's cells, and the edge crosses pixels. The residual
there is more than camera noise; its variance is measured from the residuals themselves.
"""

from __future__ import annotations

from dataclasses import dataclass

import torch
import torch.nn.functional as F  # noqa: N812  (torch's own custom)
from torch import Tensor

from torchsphere.kernels import region, rings
from torchsphere.kernels.jit import in_loops, suits
from torchsphere.sphere_map.ball import Poses
from torchsphere.sphere_map.window import Windows

#: Limits of the rings in which the residual variance is measured, px from the outline (docs/constants.toml).
RING_LIMITS_PX = (-6.0, -4.0, -3.0, -2.0, -1.5, -1.0, -0.5, 0.0, 0.5, 1.0)

#: Width over which the variance goes over from a ring to the next, px (docs/constants.toml).
RAMP_PX = 0.5

#: Side of the square over which squared residuals are averaged to find hidden parts, px (docs/constants.toml).
NEIGHBOURHOOD_PX = 5

#: Mean squared residual of the square, in variances of the ring, from which visibility falls (docs/constants.toml).
HIDDEN_FROM = 3.0

#: Number of neighbouring pixels over which an error of the model near the outline is alike (docs/constants.toml).
ALIKE_PIXELS = 2.0

#: Variance that rounding to whole grey levels leaves, grey levels squared.
ROUNDING_VARIANCE = 1 / 12


@dataclass(frozen=True)
class ResidualProfile:
    """Variance of the residual by the distance from the outline."""

    limits: Tensor  # limits (m - 1,) of the rings, px from the ball's centre, in images of its own radius
    variance: Tensor  # variance (m,) in each ring, grey levels squared
    least: float = ROUNDING_VARIANCE  # that the steps of the levels leave in each ring

    @property
    def radius(self) -> Tensor:
        """Radius () of the ball, px."""
        return self.limits[-1] - RING_LIMITS_PX[-1]

    def at(self, windows: Windows, poses: Poses) -> Tensor:
        """Variance (n, s, s) at the windows' pixels, with the ball at its ``poses``.

        It goes over from one ring to the next along `RAMP_PX`: a pixel that rounding puts on the one or the other side
        of a limit has the same weight on both.
        """
        squares = _square_distances(windows, poses, self.radius)
        return _along_ramps(squares, *(part.to(squares) for part in (*self.ramps(), self.variance)))

    def ramps(self) -> tuple[Tensor, Tensor]:
        """Squares (m - 1,) of the rings' limits, px^2, and share of the next ring's variance per square, 1/px^2."""
        limits = self.limits.clamp_min(0)
        return limits.square(), 1 / (2 * RAMP_PX * limits.clamp_min(RAMP_PX))

    def weights(self, windows: Windows, poses: Poses) -> Tensor:
        """Weight (n, s, s) of each pixel: visibility over the variance of its ring."""
        return windows.visibility / self.at(windows, poses)


@in_loops(rings.along_ramps)
def _along_ramps(squares: Tensor, limits: Tensor, slopes: Tensor, variances: Tensor) -> Tensor:
    """Variance (n, s, s) at distances with these ``squares``, by `ResidualProfile.ramps` and ``variances`` (m,)."""
    found = variances[0].expand_as(squares)
    for limit, slope, step in zip(limits, slopes, variances.diff(), strict=True):
        found = found + step * ((squares - limit) * slope + 0.5).clamp(0, 1)
    return found


def _square_distances(windows: Windows, poses: Poses, radius: Tensor) -> Tensor:
    """Squares (n, s, s) of the pixels' distances from the centre, px^2, were the outline's radius that ``radius``."""
    x, y = windows.offsets(poses.centre)
    scale = (radius / poses.radii(radius)).square()
    return (x.square() + y.square()) * scale.to(x).reshape(-1, 1, 1)


def _ring_limits(radius: Tensor) -> Tensor:
    """`ResidualProfile.limits` around a ball of that ``radius``."""
    return radius + torch.tensor(RING_LIMITS_PX, dtype=radius.dtype, device=radius.device)


def uniform_profile(radius: Tensor, variance: float, least: float = ROUNDING_VARIANCE) -> ResidualProfile:
    """Profile with the same ``variance`` in all rings, before any residual is known."""
    limits = _ring_limits(radius)
    same = torch.full((len(limits) + 1,), variance, dtype=radius.dtype, device=radius.device)
    return ResidualProfile(limits, same, least)


def ring_sums(windows: Windows, poses: Poses, residual: Tensor, radius: Tensor, leverage: Tensor) -> Tensor:
    """Sums (2, m) per ring over the visible pixels: squares of the ``residual`` (n, s, s), and shares of noise in them.

    A map that was fitted to the same pixels takes up a part of their noise, the ``leverage`` (n, s, s).
    """
    # Squares need no root.
    squares = _square_distances(windows, poses, radius)
    limits = _ring_limits(radius).to(squares).clamp_min(0).square()
    return _sums(squares, limits, windows.visibility, residual, leverage)


@in_loops(rings.sums)
def _sums(squares: Tensor, limits: Tensor, visibility: Tensor, residual: Tensor, leverage: Tensor) -> Tensor:
    """`ring_sums` of pixels at distances with these ``squares``, in rings with ``limits`` (m - 1,), squared."""
    ring, none = torch.bucketize(squares, limits).flatten(), limits.new_zeros(len(limits) + 1, dtype=torch.float64)
    parts = visibility * residual.square(), visibility * (1 - leverage)
    return torch.stack([none.index_add(0, ring, part.flatten().double()) for part in parts])


def profile_of(sums: Tensor, radius: Tensor, least: float = ROUNDING_VARIANCE) -> ResidualProfile:
    """Variance per ring from the `ring_sums` (2, m) of all images."""
    limits, (total, count) = _ring_limits(radius), sums
    variance = (total / count.clamp_min(1)).clamp_min(least)
    # What exceeds the noise is an error of the model, which is alike over a speckle: neighbours repeat each other.
    beyond = (variance - variance[0]).clamp_min(0)
    return ResidualProfile(limits, variance + (ALIKE_PIXELS - 1) * beyond, least)


def estimate_visibility(windows: Windows, variance: Tensor, residual: Tensor) -> Windows:
    """The windows with lower visibility where a pixel's neighbourhood does not fit the model.

    ``residual`` and its expected ``variance`` (n, s, s).
    """
    usable = (windows.visibility > 0).to(residual)
    local = _local_mean(residual.square() / variance, usable)
    return windows.with_visibility(usable * (HIDDEN_FROM / local.clamp_min(HIDDEN_FROM)).square())


def _local_mean(values: Tensor, usable: Tensor) -> Tensor:
    """Mean (n, s, s) of the ``usable`` ``values`` over the square around each pixel."""
    if suits(values, usable):
        side = values.shape[-1]
        given = values.flatten(1), usable.flatten(1), torch.arange(side * side), side, NEIGHBOURHOOD_PX
        return region.local_mean(*given).reshape(values.shape)
    pooled = torch.stack((usable * values, usable), 1)
    pooled = F.avg_pool2d(pooled, NEIGHBOURHOOD_PX, stride=1, padding=NEIGHBOURHOOD_PX // 2)
    return pooled[:, 0] / pooled[:, 1].clamp_min(1e-6)
