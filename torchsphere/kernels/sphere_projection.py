"""What rays meet of the ball's surface, how a step of the ball changes what they see, and which pixels the disc covers.

The loops serve single and double precision alike: see `torchsphere.kernels.cube_map`.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from torchsphere.kernels.jit import compiled

Array = NDArray[Any]
Double = NDArray[np.float64]
Owners = NDArray[np.int64]

_ZERO, _ONE = np.float32(0), np.float32(1)

#: Distance, in standard deviations, from which a ray meets the ball or passes it, as far as double precision tells.
_CERTAIN = 8.5


def met(
    rays: Tensor, centre: Tensor, part: Tensor, owner: Tensor, pixels: int, radius: float, limb: float, turn_px: float
) -> tuple[Tensor, Tensor]:
    """Points (3, q) of the unit sphere, and the rays' weights (q,) in their pixels: see `projection.surface_points`."""
    points, weight = part.new_empty(3, len(part)), torch.empty_like(part)
    numbers = part.new_tensor([limb, limb * radius]).numpy()
    given: Any = *rays.contiguous().numpy(), *centre.tolist(), *numbers, *points.numpy(), weight.numpy()
    _meet(*given)
    _share_out(part.numpy(), owner.numpy(), radius, turn_px, np.zeros(pixels), weight.numpy())
    return points, weight


@compiled
def _meet(
    across: Double, down: Double, x: float, y: float, limb: Any, least: Any, px: Array, py: Array, pz: Array, far: Array
) -> None:
    """Points of the unit sphere, and the rays' distances ``far`` from the centre."""
    for i in range(len(px)):
        # In double precision until they are taken from the centre.
        px[i], py[i] = across[i] - x, down[i] - y
    for i in range(len(px)):
        distance = np.sqrt(px[i] * px[i] + py[i] * py[i])
        far[i] = distance
        scale = limb / (distance if distance > least else least)
        px[i] *= scale
        py[i] *= scale
        pz[i] = -np.sqrt(_ONE - (px[i] * px[i] + py[i] * py[i]))


@compiled
def _share_out(part: Array, owner: Owners, radius: float, turn_px: float, whole: Double, weight: Array) -> None:
    """Weights in their pixels, in place of the rays' distances; the pixels' sums come to be in ``whole``."""
    for i in range(len(part)):
        inside = (radius - weight[i]) / turn_px
        share = 1.0 if inside > 0 else 0.0
        if abs(inside) < _CERTAIN:
            share = 0.5 * math.erfc(-inside / math.sqrt(2.0))
        weight[i] = part[i] * (share + 1e-9)
        whole[np.uint64(owner[i])] += weight[i]
    for i in range(len(part)):
        weight[i] /= whole[np.uint64(owner[i])]


def coverage(
    pixels: Tensor, centre: Tensor, radius: float, blur: float, reach: float, like: Tensor
) -> tuple[Tensor, Tensor]:
    """Share (p,) of each of the ``pixels`` (p, 2) that the disc covers, and its slope: see `projection.coverage`.

    ``reach``, px, is how far from the outline a pixel may lie and see it.
    """
    share, slope = torch.empty_like(like), torch.empty_like(like)
    x, y = centre.tolist()
    _coverage(pixels.contiguous().numpy(), x, y, radius, blur, reach, share.numpy(), slope.numpy())
    return share, slope


@compiled
def _coverage(
    pixels: Double, x: float, y: float, radius: float, blur: float, reach: float, share: Array, slope: Array
) -> None:
    # A straight edge in place of the circle would make the disc larger by pi times the variance of blur and pixel.
    edge = radius - (blur * blur + 1 / 12) / (2 * radius)
    for i in range(len(pixels)):
        across, down = pixels[i, 0] - x, pixels[i, 1] - y
        distance = max(math.sqrt(across * across + down * down), 1e-9)
        inwards = edge - distance
        share[i], slope[i] = 1.0 if inwards > 0 else 0.0, 0.0
        if abs(inwards) < reach:
            # An edge along a row or column of pixels is the limit of a slightly tilted one.
            a, b = max(abs(across) / distance, 0.03) / 2, max(abs(down) / distance, 0.03) / 2
            covered, steep = _corners(inwards, a, b, blur)
            share[i], slope[i] = covered / (4 * a * b), steep / (4 * a * b)


@compiled
def _corners(inwards: float, a: float, b: float, blur: float) -> tuple[float, float]:
    """Sums over a pixel's corners, with their signs, of `_integrals`."""
    first, of_first = _integrals(inwards + a + b, blur)
    second, of_second = _integrals(inwards + a - b, blur)
    third, of_third = _integrals(inwards + b - a, blur)
    fourth, of_fourth = _integrals(inwards - a - b, blur)
    return first - second - third + fourth, of_first - of_second - of_third + of_fourth


@compiled
def _integrals(x: float, blur: float) -> tuple[float, float]:
    """Twofold and single integral of a Gaussian's distribution function at ``x``."""
    z = x / blur
    below = 0.5 * math.erfc(-z / math.sqrt(2.0))
    density = math.exp(-0.5 * z * z) / math.sqrt(2 * math.pi)
    return 0.5 * (x * x + blur * blur) * below + 0.5 * x * blur * density, x * below + blur * density


def changes(
    points: Tensor, value: Tensor, gradient: Tensor, light: Tensor, turn: Tensor, deepest: float, radius: float
) -> Tensor:
    """What each ray sees (7, q): the lit value, and its changes by dx, dy, wx, wy, wz and the radius, px.

    Parameters
    ----------
    points : Tensor
        Of the unit sphere (3, q), camera axes.
    value, gradient : Tensor
        Of the map (q,), and its derivative (3, q) by the direction, in the ball's axes.
    light : Tensor
        On the ball there (q,).
    turn : Tensor
        The ball's orientation (3, 3).
    deepest : float
        Depth of the surface, in radii, below which a ray counts as one on the limb.
    radius : float
        px.
    """
    found = points.new_empty(7, points.shape[1])
    numbers = points.new_tensor([deepest, 1 / radius]).numpy()
    given: Any = *points.numpy(), value.numpy(), *gradient.numpy(), light.contiguous().numpy()
    given = *given, turn.contiguous().numpy(), *numbers, *found.numpy()
    _changes(*given)
    return found


@compiled
def _changes(
    px: Array,
    py: Array,
    pz: Array,
    value: Array,
    gx: Array,
    gy: Array,
    gz: Array,
    light: Array,
    turn: Array,
    deepest: Any,
    per_px: Any,
    lit: Array,
    dx: Array,
    dy: Array,
    wx: Array,
    wy: Array,
    wz: Array,
    wider: Array,
) -> None:
    """What a pixel sees of the surface moves against the ball: by -(1, 0, -x / z) for dx, by -w x P for a rotation.

    For a larger radius the surface comes nearer by R / s and shrinks with respect to the ball.
    """
    for i in range(len(px)):
        x, y, z = px[i], py[i], pz[i]
        lit[i] = light[i] * value[i]
        # Rays that were drawn back to the limb follow the ball, and so near to it depth is no linear function any more.
        scale = light[i] * per_px if -z > deepest else _ZERO
        sx = scale * (turn[0, 0] * gx[i] + turn[0, 1] * gy[i] + turn[0, 2] * gz[i])
        sy = scale * (turn[1, 0] * gx[i] + turn[1, 1] * gy[i] + turn[1, 2] * gz[i])
        sz = scale * (turn[2, 0] * gx[i] + turn[2, 1] * gy[i] + turn[2, 2] * gz[i])
        deep = sz / z
        dx[i], dy[i] = deep * x - sx, deep * y - sy
        wx[i], wy[i], wz[i] = sy * z - sz * y, sz * x - sx * z, sx * y - sy * x
        wider[i] = deep - (sx * x + sy * y + sz * z)


def pixel_sums(values: Tensor, owner: Tensor, pixels: int) -> Tensor:
    """Sums (p, k) over the rays of each pixel, of ``values`` (k, q)."""
    found = values.new_zeros(pixels, len(values))
    _pixel_sums(values.numpy(), owner.numpy(), found.numpy())
    return found


@compiled
def _pixel_sums(values: Array, owner: Owners, found: Array) -> None:
    rays, unknowns = len(owner), len(values)
    for i in range(rays):
        pixel = np.uint64(owner[i])
        for k in range(unknowns):
            found[pixel, np.uint64(k)] += values[np.uint64(k), np.uint64(i)]


def spread(values: Tensor, owner: Tensor, light: Tensor) -> Tensor:
    """``light`` (q,) times the ``values`` (p,) of each ray's pixel: `pixel_sums` backwards."""
    found = torch.empty_like(light)
    _spread(values.contiguous().numpy(), owner.numpy(), light.contiguous().numpy(), found.numpy())
    return found


@compiled
def _spread(values: Array, owner: Owners, light: Array, found: Array) -> None:
    for i in range(len(owner)):
        found[i] = light[i] * values[np.uint64(owner[i])]


def lit(points: Tensor, part: Tensor, shading: Tensor) -> Tensor:
    """Weights (q,) times the light at ``points`` (3, q), which is ``shading`` (4,) of `projection.shading_basis`."""
    found = torch.empty_like(part)
    given: Any = *points.numpy(), part.numpy(), *shading.to(part).numpy(), found.numpy()
    _lit(*given)
    return found


@compiled
def _lit(x: Array, y: Array, z: Array, part: Array, same: Any, of_x: Any, of_y: Any, of_z: Any, found: Array) -> None:
    for i in range(len(part)):
        found[i] = part[i] * (same + of_x * x[i] + of_y * y[i] + of_z * z[i])
