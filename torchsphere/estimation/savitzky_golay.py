"""Rates by local polynomials: Savitzky and Golay's filter, whose shortest form are central differences.

Source: Savitzky and Golay, Analytical Chemistry 36 (1964) 1627, DOI 10.1021/ac60214a047; here for uneven times, too.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
import torch
from kornia.geometry.liegroup import So3
from numpy.typing import NDArray

from torchsphere.geometry.orientation import chain
from torchsphere.runtime.arrays import Array
from torchsphere.settings.limits import require_window

#: Frames whose windows are fitted at once (docs/constants.toml).
FRAMES_AT_ONCE = 2000


@dataclass(frozen=True)
class Rates:
    """First and second derivative of the pose at each frame, and their variances; NaN where not known."""

    first: Array  # (n, 5)
    second: Array  # (n, 5)
    variance_first: Array  # (n, 5)
    variance_second: Array  # (n, 5)
    weights: Array  # weights (2, w) of the poses around a frame for even times
    offsets: Array  # times (w,) of these poses


def rates(
    times: Array,
    increment: Array,
    is_measured: NDArray[np.bool_],
    variance: Array,
    *,
    window: int,
    order: int,
    shifted: bool,
) -> Rates:
    """Fit polynomials of an ``order`` to the poses of a ``window``, an odd number of frames, around each frame.

    ``times`` are (n,), ``increment`` (n - 1, 5) the steps of the pose, ``variance`` (n, 5) that of the poses. The mask
    ``is_measured`` (n - 1, 2) is for translation and rotation; no window reaches over a gap. With ``shifted``, frames
    near the ends of a run take the nearest window that fits. Raises if the window or the order is invalid.
    """
    require_window(window, order)
    n = len(times)
    first, second, variance_first, variance_second = (np.full((n, 5), np.nan) for _ in range(4))
    for group, columns in enumerate((slice(0, 2), slice(2, 5))):
        for start, stop in runs(is_measured[:, group]):
            if stop - start < window:
                continue
            frames = np.arange(start, stop)
            low = np.clip(frames - window // 2, start, stop - window)
            if not shifted:
                frames, low = frames[window // 2 : len(frames) - window // 2], np.unique(low)
            chained = _chained(increment[start : stop - 1, columns])
            for block in range(0, len(frames), FRAMES_AT_ONCE):
                part = slice(block, block + FRAMES_AT_ONCE)
                at, around = frames[part], low[part, None] + np.arange(window)
                weights = _weights(times[around] - times[at, None], order)
                poses = _relative(chained, around - start, at - start)
                derivatives, variances = weights @ poses, weights**2 @ variance[around][..., columns]
                first[at, columns], second[at, columns] = derivatives[:, 0], derivatives[:, 1]
                variance_first[at, columns], variance_second[at, columns] = variances[:, 0], variances[:, 1]
    offsets: Array = (np.arange(float(window)) - window // 2) * float(np.median(np.diff(times)))
    return Rates(first, second, variance_first, variance_second, _weights(offsets[None], order)[0], offsets)


def runs(is_measured: NDArray[np.bool_]) -> list[tuple[int, int]]:
    """First frame, and last frame plus 1, of each run of frames without a gap."""
    edges = np.flatnonzero(np.diff(np.concatenate(([False], is_measured, [False])).astype(int)))
    return [(int(a), int(b) + 1) for a, b in zip(edges[::2], edges[1::2], strict=True)]


def _weights(times: Array, order: int) -> Array:
    """Weights (m, 2, w) of values at ``times`` (m, w) for the first and second derivative of their polynomial at 0."""
    size = np.abs(times).max(1)[:, None, None]
    inverse = np.linalg.pinv((times[..., None] / size) ** np.arange(order + 1))
    return np.concatenate([inverse[:, k : k + 1] * math.factorial(k) / size**k for k in (1, 2)], 1)


def _chained(steps: Array) -> Array:
    """Poses of a run from its steps (r - 1, d): positions (r, 2) in px, or rotation matrices (r, 3, 3)."""
    steps = np.concatenate((np.zeros((1, steps.shape[1])), steps))
    return steps.cumsum(0) if steps.shape[1] == 2 else chain(steps, np.ones(len(steps), dtype=bool))


def _relative(chained: Array, around: NDArray[np.int64], at: NDArray[np.int64]) -> Array:
    """Poses (m, w, d) of the frames ``around`` (m, w) relative to the frames ``at`` (m,) of a run of `_chained` poses.

    Rotations are vectors in the tangent space of the latter.
    """
    if chained.ndim == 2:
        return chained[around] - chained[at, None]
    relative = chained[around] @ np.swapaxes(chained[at], 1, 2)[:, None]
    rotations = So3.from_matrix(torch.from_numpy(relative.reshape(-1, 3, 3))).log().numpy()
    return rotations.reshape(*around.shape, 3)
