"""Residual and correlation coefficient of two images over a region."""

from __future__ import annotations

import numpy as np
import torch
from torch import Tensor

from torchsphere.kernels.jit import ONE, ZERO, Floats, arrays, compiled, require_one_size, require_same_points

#: Least power of a deformed image in the gain, and of both images in the coefficient.
_LEAST_POWER, _FLAT = np.float32(1e-12), np.float32(1e-9)


def residual(values: Tensor, warped: Tensor, weights: Tensor) -> Tensor:
    """`znssd.residual`."""
    require_same_points(values, warped, weights)
    found = torch.empty(weights.shape)
    _residual(*arrays(values, warped, weights, found))
    return found


def zncc(values: Tensor, warped: Tensor, weights: Tensor) -> Tensor:
    """`znssd.zncc`."""
    require_same_points(values, warped, weights)
    found = torch.empty(len(weights))
    _zncc(*arrays(values, warped, weights, found))
    return found


def powers(difference: Tensor, weights: Tensor, surface: Tensor, limit: Tensor) -> Tensor:
    """Sums (n, 4) of weights and weighted squares of ``difference`` (n, p), of a part and of the whole region.

    The part lies within ``limit`` (n,), px, of the middle of the ball's front: `residual_noise.ResidualPower`.
    """
    require_same_points(difference, weights, surface)
    require_one_size(0, weights, limit)
    found = torch.empty(len(weights), 4)
    _powers(*arrays(difference, weights, surface, limit, found))
    return found


@compiled
def _residual(values: Floats, warped: Floats, weights: Floats, found: Floats) -> None:
    for n in range(len(values)):
        mean_f, mean_g, gain = adjusted(values[n], warped[n], weights[n])
        f, g, difference = values[n], warped[n], found[n]
        for i in range(len(f)):
            difference[i] = f[i] - mean_f - gain * (g[i] - mean_g)


@compiled
def adjusted(values: Floats, warped: Floats, weights: Floats) -> tuple[np.float32, np.float32, np.float32]:
    """Weighted means of both images (p,), and the gain to a common standard deviation: equation (3)."""
    count, sum_f, sum_g = ZERO, ZERO, ZERO
    for i in range(len(values)):
        count += weights[i]
        sum_f += weights[i] * values[i]
        sum_g += weights[i] * warped[i]
    count = count if count > ONE else ONE
    mean_f, mean_g = sum_f / count, sum_g / count
    power_f, power_g = ZERO, ZERO
    for i in range(len(values)):
        f, g = values[i] - mean_f, warped[i] - mean_g
        power_f += weights[i] * f * f
        power_g += weights[i] * g * g
    # In this order NaN stays NaN.
    power_g = _LEAST_POWER if power_g < _LEAST_POWER else power_g
    return mean_f, mean_g, np.sqrt(power_f / power_g)


@compiled
def _zncc(values: Floats, warped: Floats, weights: Floats, found: Floats) -> None:
    for n in range(len(values)):
        mean_f, mean_g, _ = adjusted(values[n], warped[n], weights[n])
        f, g, weight = values[n], warped[n], weights[n]
        power_f, power_g, both = ZERO, ZERO, ZERO
        for i in range(len(f)):
            a, b = weight[i] * (f[i] - mean_f), weight[i] * (g[i] - mean_g)
            power_f += a * a
            power_g += b * b
            both += a * b
        power = np.sqrt(power_f * power_g)
        found[n] = both / power if power > _FLAT else ZERO


@compiled
def _powers(difference: Floats, weights: Floats, surface: Floats, limit: Floats, found: Floats) -> None:
    for n in range(len(weights)):
        r, weight, x, y, inside = difference[n], weights[n], surface[n, 0], surface[n, 1], limit[n] * limit[n]
        inner, inner_power, whole, power = ZERO, ZERO, ZERO, ZERO
        for i in range(len(r)):
            part = weight[i] if x[i] * x[i] + y[i] * y[i] < inside else ZERO
            inner += part
            inner_power += part * r[i] * r[i]
            whole += weight[i]
            power += weight[i] * r[i] * r[i]
        found[n, 0], found[n, 1], found[n, 2], found[n, 3] = inner, inner_power, whole, power
