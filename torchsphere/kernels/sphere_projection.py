"""Rays on the surface of the ball, the change of their grey level with the pose, and the disc's share of each pixel.

The loops serve single and double precision, as in `torchsphere.kernels.cube_map`.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from torchsphere.kernels.jit import ONE, ZERO, Doubles, Integers, compiled

Array = NDArray[Any]

#: Distance, in standard deviations, from which a ray meets or misses the ball with certainty in double precision.
_CERTAIN = 8.5


def surface_points(
    rays: Tensor, centre: Tensor, part: Tensor, owner: Tensor, pixels: int, radius: float, limb: float, turn_px: float
) -> tuple[Tensor, Tensor]:
    """`forward_model.surface_points`: points (3, q) of the unit sphere, and the rays' weights (q,) in their pixels."""
    points, weight = part.new_empty(3, len(part)), torch.empty_like(part)
    numbers = part.new_tensor([limb, limb * radius]).numpy()
    given: Any = *rays.contiguous().numpy(), *centre.tolist(), *numbers, *points.numpy(), weight.numpy()
    _meet(*given)
    _share_out(part.numpy(), owner.numpy(), radius, turn_px, np.zeros(pixels), weight.numpy())
    return points, weight


@compiled
def _meet(
    across: Doubles,
    down: Doubles,
    x: float,
    y: float,
    limb: Any,
    least: Any,
    px: Array,
    py: Array,
    pz: Array,
    far: Array,
) -> None:
    """Points of the unit sphere, and the rays' distances ``far`` from the centre."""
    for i in range(len(px)):
        # In double precision up to the difference from the centre.
        px[i], py[i] = across[i] - x, down[i] - y
    for i in range(len(px)):
        distance = np.sqrt(px[i] * px[i] + py[i] * py[i])
        far[i] = distance
        scale = limb / (distance if distance > least else least)
        px[i] *= scale
        py[i] *= scale
        pz[i] = -np.sqrt(ONE - (px[i] * px[i] + py[i] * py[i]))


@compiled
def _share_out(part: Array, owner: Integers, radius: float, turn_px: float, whole: Doubles, weight: Array) -> None:
    """Weights in the pixels replace the rays' distances; ``whole`` receives the sums of the pixels."""
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
    """`forward_model.coverage`; pixels further than ``reach``, px, from the outline do not see it."""
    share, slope = torch.empty_like(like), torch.empty_like(like)
    x, y = centre.tolist()
    _coverage(pixels.contiguous().numpy(), x, y, radius, blur, reach, share.numpy(), slope.numpy())
    return share, slope


@compiled
def _coverage(
    pixels: Doubles, x: float, y: float, radius: float, blur: float, reach: float, share: Array, slope: Array
) -> None:
    # A straight edge in place of the circle enlarges the disc by pi times the variance of blur and pixel.
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
    """Signed sums of `_integrals` over the corners of a pixel."""
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


def pose_derivatives(
    points: Tensor, value: Tensor, gradient: Tensor, light: Tensor, turn: Tensor, deepest: float, radius: float
) -> Tensor:
    """Grey level of each ray, and its change by dx, dy, wx, wy, wz and the radius (7, q), px.

    ``points`` (3, q) of the unit sphere, camera axes; ``value`` (q,) and ``gradient`` (3, q) of the map, ball's axes;
    ``light`` (q,); ``turn`` (3, 3): orientation; ``deepest``: depth in radii below which a ray counts as at the limb.
    """
    found = points.new_empty(7, points.shape[1])
    numbers = points.new_tensor([deepest, 1 / radius]).numpy()
    given = *points.numpy(), value.numpy(), *gradient.numpy(), light.contiguous().numpy(), turn.contiguous().numpy()
    _pose_derivatives(given, *numbers, tuple(found.numpy()))
    return found


@compiled
def _pose_derivatives(given: tuple[Array, ...], deepest: Any, per_px: Any, found: tuple[Array, ...]) -> None:
    """The seen surface point moves on the ball by -(1, 0, -x / z) for dx, by -w x P for a rotation.

    A larger radius brings the surface nearer by R / s and shrinks the point's distance on the ball.
    """
    px, py, pz, value, gx, gy, gz, light, turn = given
    lit, dx, dy, wx, wy, wz, wider = found
    for i in range(len(px)):
        x, y, z = px[i], py[i], pz[i]
        lit[i] = light[i] * value[i]
        # Rays drawn back to the limb follow the ball, and depth is not linear that close to the limb.
        scale = light[i] * per_px if -z > deepest else ZERO
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
def _pixel_sums(values: Array, owner: Integers, found: Array) -> None:
    rays, unknowns = len(owner), len(values)
    for i in range(rays):
        pixel = np.uint64(owner[i])
        for k in range(unknowns):
            found[pixel, np.uint64(k)] += values[np.uint64(k), np.uint64(i)]


def to_rays(values: Tensor, owner: Tensor, light: Tensor) -> Tensor:
    """``light`` (q,) times the ``values`` (p,) of each ray's pixel: the adjoint of `pixel_sums`."""
    found = torch.empty_like(light)
    _to_rays(values.contiguous().numpy(), owner.numpy(), light.contiguous().numpy(), found.numpy())
    return found


@compiled
def _to_rays(values: Array, owner: Integers, light: Array, found: Array) -> None:
    for i in range(len(owner)):
        found[i] = light[i] * values[np.uint64(owner[i])]


def ray_light(points: Tensor, part: Tensor, shading: Tensor) -> Tensor:
    """Weights (q,) times the light at ``points`` (3, q) by ``shading`` (4,) of `forward_model.shading_basis`."""
    found = torch.empty_like(part)
    given: Any = *points.numpy(), part.numpy(), *shading.to(part).numpy(), found.numpy()
    _ray_light(*given)
    return found


@compiled
def _ray_light(
    x: Array, y: Array, z: Array, part: Array, same: Any, of_x: Any, of_y: Any, of_z: Any, found: Array
) -> None:
    for i in range(len(part)):
        found[i] = part[i] * (same + of_x * x[i] + of_y * y[i] + of_z * z[i])
