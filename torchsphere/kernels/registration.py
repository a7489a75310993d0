"""Normal equations of a registration in one compiled loop: `torchsphere.sphere_map.registration` on the CPU.

The derivatives of one image at a time are kept, which fit into the processor's cache.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
import torch
from torch import Tensor

from torchsphere.kernels import layout
from torchsphere.kernels.forward_model import Model, linearise_row, memory_for_row
from torchsphere.kernels.jit import ONE, ZERO, Doubles, Floats, Integers, arrays, compiled
from torchsphere.kernels.layout import Images, contiguous
from torchsphere.kernels.region import window_sums
from torchsphere.kernels.rings import put_ramps

_HALF, _LEAST = np.float32(0.5), 1e-12


class Rings(NamedTuple):
    """Residual variance in rings around the ball's centre: `pixel_weights.ResidualProfile`."""

    limits: Any  # between the rings (m - 1,), with slopes: `ResidualProfile.ramps`
    slopes: Any
    variances: Any  # (m,)
    radius: Any  # of the outline (), px, that has these limits


class Hidden(NamedTuple):
    """When a pixel counts as hidden."""

    window: int  # side of its neighbourhood, px
    limit: Any  # mean square of the neighbourhood from which its visibility falls


class Equations(NamedTuple):
    """Normal equations of n images with k unknowns, float64."""

    normal: Any  # (n, k, k)
    gradient: Any  # (n, k)
    squares: Any  # sums of squares (n,)
    seen: Any  # numbers of visible pixels (n,)


def equations(
    model: Model, images: Images, levels: Tensor, rings: Rings, hidden: Hidden, columns: list[int]
) -> Equations:
    """Equations for the ``columns`` (k,) of the jacobian, from the ``levels`` (n, s, s) seen."""
    n, k = len(levels), len(columns)
    found = Equations(*(torch.zeros(n, *shape, dtype=torch.float64) for shape in ((k, k), (k,), (), ())))
    limits, slopes, variances = arrays(*(ring.float() for ring in rings[:-1]))
    rings = Rings(limits, slopes, variances, np.float32(float(rings.radius)))
    hidden = Hidden(hidden.window, np.float32(hidden.limit))
    given = model.of_arrays(), contiguous(images), *arrays(levels), rings, hidden, np.array(columns)
    _equations(*given, Equations(*arrays(*found)))
    return found


@compiled
def _equations(
    model: Model,
    images: Images,
    levels: Floats,
    rings: Rings,
    hidden: Hidden,
    columns: Integers,
    found: Equations,
) -> None:
    window, visibility = hidden.window, images.visibility
    normal, gradient, squares, seen = found
    n, side, _ = levels.shape
    memory = memory_for_row(side, model.rule)
    jacobian = np.empty((side, layout.COLUMNS, side), np.float32)
    expected, residual = np.empty((side, side), np.float32), np.empty((side, side), np.float32)
    weights, part = np.empty((side, side), np.float32), np.empty(side, np.float32)
    wide = side + window - 1
    misfits, usable = np.zeros((wide, wide), np.float32), np.zeros((wide, wide), np.float32)
    sums, counts = np.empty((side, side), np.float32), np.empty((side, side), np.float32)
    for i in range(n):
        scale = rings.radius / images.ball[i, layout.RADIUS]
        for row in range(side):
            linearise_row(model, images, i, row, memory, expected[row], jacobian[row])
            for column in range(side):
                x, y = scale * memory.across[column], scale * memory.down[column]
                part[column] = x * x + y * y
            put_ramps(part, rings.limits, rings.slopes, rings.variances, weights[row])
            for column in range(side):
                weights[row, column] = ONE / weights[row, column]
            for column in range(side):
                residual[row, column] = levels[i, row, column] - expected[row, column]
        _misfits(expected, residual, visibility[i], weights, misfits, usable)
        window_sums(misfits, window, sums)
        window_sums(usable, window, counts)
        for row in range(side):
            inside, weight = visibility[i, row], weights[row]
            _hide(inside, sums[row], counts[row], hidden.limit, weight, part)
            squares[i] += _sum_of_squares(weight, part, residual[row])
            seen[i] += _total(part)
            _add_row(jacobian[row], weight, residual[row], columns, part, normal[i], gradient[i])
        for a in range(len(columns)):
            for b in range(a):
                normal[i, a, b] = normal[i, b, a]


@compiled
def _misfits(
    model: Floats, residual: Floats, visibility: Floats, weights: Floats, misfits: Floats, usable: Floats
) -> None:
    """Weighted squares of the residual without a change of gain and offset, in the middle of an array with a margin.

    Also the pixels that are ``usable``, likewise: `registration._without_brightness`.
    """
    side = len(model)
    sums = np.zeros(5)
    for row in range(side):
        a, b, c = ZERO, ZERO, ZERO
        for column in range(side):
            weight = visibility[row, column] * weights[row, column]
            a += weight
            b += weight * model[row, column]
            c += weight * residual[row, column]
        sums[0], sums[1], sums[2] = sums[0] + a, sums[1] + b, sums[2] + c
    total = max(sums[0], _LEAST)
    middle, mean = np.float32(sums[1] / total), np.float32(sums[2] / total)
    for row in range(side):
        a, b = ZERO, ZERO
        for column in range(side):
            weight, away = visibility[row, column] * weights[row, column], model[row, column] - middle
            a += weight * away * (residual[row, column] - mean)
            b += weight * away * away
        sums[3], sums[4] = sums[3] + a, sums[4] + b
    slope, margin = np.float32((sums[3] / total) / max(sums[4] / total, _LEAST)), (len(misfits) - side) // 2
    for row in range(side):
        of_row, inside = misfits[margin + row], usable[margin + row]
        for column in range(side):
            shown = ONE if visibility[row, column] > ZERO else ZERO
            rest = residual[row, column] - mean - slope * (model[row, column] - middle)
            of_row[margin + column] = shown * rest * rest * weights[row, column]
            inside[margin + column] = shown


@compiled
def _hide(visibility: Floats, sums: Floats, counts: Floats, limit: Any, weights: Floats, visible: Floats) -> None:
    """Lower the ``weights`` of a row by `pixel_weights.estimate_visibility`; ``visible`` where most of it is left."""
    for column in range(len(weights)):
        shown = ONE if visibility[column] > ZERO else ZERO
        count = counts[column]
        local = sums[column] / (count if count > ONE else ONE)
        share = limit / (local if local > limit else limit)
        share = shown * share * share
        weights[column] *= share
        visible[column] = ONE if share > _HALF else ZERO


@compiled
def _sum_of_squares(weights: Floats, visible: Floats, residual: Floats) -> Any:
    total = ZERO
    for column in range(len(weights)):
        total += weights[column] * visible[column] * residual[column] * residual[column]
    return total


@compiled
def _total(values: Floats) -> Any:
    total = ZERO
    for column in range(len(values)):
        total += values[column]
    return total


@compiled
def _add_row(
    jacobian: Floats,
    weights: Floats,
    residual: Floats,
    columns: Integers,
    part: Floats,
    normal: Doubles,
    gradient: Doubles,
) -> None:
    """Add a row of pixels: sums of the row in single precision, of rows in double precision."""
    for a in range(len(columns)):
        line, total = jacobian[columns[a]], ZERO
        for column in range(len(weights)):
            part[column] = weights[column] * line[column]
        for column in range(len(weights)):
            total += part[column] * residual[column]
        gradient[a] += total
        for b in range(a, len(columns)):
            other, total = jacobian[columns[b]], ZERO
            for column in range(len(weights)):
                total += part[column] * other[column]
            normal[a, b] += total
