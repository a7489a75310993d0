"""How well two images agree over a region: residual and coefficient."""

from __future__ import annotations

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from torchsphere.kernels.jit import arrays, compiled, require_one_size

Array = NDArray[np.float32]

_ZERO, _ONE = np.float32(0), np.float32(1)

#: Least power of a deformed image that the gain is divided by, and of both images that have a coefficient.
_LEAST_POWER, _FLAT = np.float32(1e-12), np.float32(1e-9)


def residual(values: Tensor, warped: Tensor, weights: Tensor) -> Tensor:
    """``f - a g - b`` (n, p) of both images (n, p) each: `znssd.residual`."""
    _require_alike(values, warped, weights)
    found = torch.empty(weights.shape)
    _residual(*arrays(values, warped, weights, found))
    return found


def zncc(values: Tensor, warped: Tensor, weights: Tensor) -> Tensor:
    """The coefficient (n,) of both images (n, p): `znssd.zncc`."""
    _require_alike(values, warped, weights)
    found = torch.empty(len(weights))
    _zncc(*arrays(values, warped, weights, found))
    return found


def beyond(values: Tensor, limits: Tensor, weights: Tensor) -> Tensor:
    """True (n,) where a value (n, p) that has a weight (n, p) is above its row's limit (n,)."""
    _require_alike(values, weights)
    require_one_size(0, values, limits)
    found = torch.zeros(len(values), dtype=torch.bool)
    _beyond(*arrays(values, limits, weights, found))
    return found


def powers(difference: Tensor, weights: Tensor, surface: Tensor, limit: Tensor) -> Tensor:
    """Weights and weighted squares of the ``difference`` (n, p), summed up: (n, 4), of a part and of the whole region.

    The part is what lies within ``limit`` (n,), px, of the middle of the ball's front ``surface`` (n, 3, p).
    """
    _require_alike(difference, weights, surface)
    require_one_size(0, weights, limit)
    found = torch.empty(len(weights), 4)
    _powers(*arrays(difference, weights, surface, limit, found))
    return found


def _require_alike(*tensors: Tensor) -> None:
    """Raise ValueError unless all tensors have as many pairs and as many points."""
    require_one_size(0, *tensors)
    require_one_size(-1, *tensors)


@compiled
def _residual(values: Array, warped: Array, weights: Array, found: Array) -> None:
    for n in range(len(values)):
        mean_f, mean_g, gain = adjusted(values[n], warped[n], weights[n])
        f, g, difference = values[n], warped[n], found[n]
        for i in range(len(f)):
            difference[i] = f[i] - mean_f - gain * (g[i] - mean_g)


@compiled
def adjusted(values: Array, warped: Array, weights: Array) -> tuple[np.float32, np.float32, np.float32]:
    """Weighted means of both images (p,), and the gain that gives them one standard deviation: equation (3)."""
    count, sum_f, sum_g = _ZERO, _ZERO, _ZERO
    for i in range(len(values)):
        count += weights[i]
        sum_f += weights[i] * values[i]
        sum_g += weights[i] * warped[i]
    count = count if count > _ONE else _ONE
    mean_f, mean_g = sum_f / count, sum_g / count
    power_f, power_g = _ZERO, _ZERO
    for i in range(len(values)):
        f, g = values[i] - mean_f, warped[i] - mean_g
        power_f += weights[i] * f * f
        power_g += weights[i] * g * g
    # This way round a power that is no number stays none.
    power_g = _LEAST_POWER if power_g < _LEAST_POWER else power_g
    return mean_f, mean_g, np.sqrt(power_f / power_g)


@compiled
def _zncc(values: Array, warped: Array, weights: Array, found: Array) -> None:
    for n in range(len(values)):
        mean_f, mean_g, _ = adjusted(values[n], warped[n], weights[n])
        f, g, weight = values[n], warped[n], weights[n]
        power_f, power_g, both = _ZERO, _ZERO, _ZERO
        for i in range(len(f)):
            a, b = weight[i] * (f[i] - mean_f), weight[i] * (g[i] - mean_g)
            power_f += a * a
            power_g += b * b
            both += a * b
        power = np.sqrt(power_f * power_g)
        found[n] = both / power if power > _FLAT else _ZERO


@compiled
def _beyond(values: Array, limits: Array, weights: Array, found: NDArray[np.bool_]) -> None:
    for n in range(len(values)):
        value, weight, count = values[n], weights[n], 0
        for i in range(len(value)):
            count += (value[i] > limits[n]) & (weight[i] > _ZERO)
        found[n] = count > 0


@compiled
def _powers(difference: Array, weights: Array, surface: Array, limit: Array, found: Array) -> None:
    for n in range(len(weights)):
        r, weight, x, y, inside = difference[n], weights[n], surface[n, 0], surface[n, 1], limit[n] * limit[n]
        inner, inner_power, whole, power = _ZERO, _ZERO, _ZERO, _ZERO
        for i in range(len(r)):
            part = weight[i] if x[i] * x[i] + y[i] * y[i] < inside else _ZERO
            inner += part
            inner_power += part * r[i] * r[i]
            whole += weight[i]
            power += weight[i] * r[i] * r[i]
        found[n, 0], found[n, 1], found[n, 2], found[n, 3] = inner, inner_power, whole, power
