"""Spans of a recording in which forces act: changes of the path's slope that free flight does not explain.

The test costs a few operations per frame. It only says where the full model (`contact_search`) is to look.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

#: Steps on either side of a frame whose slopes are compared (docs/constants.toml).
SLOPE_STEPS = (4, 16)

#: Change of the slope that is a force, in standard deviations (docs/constants.toml).
MIN_SLOPE_CHANGE_SD = 8.0

#: Steps of flight that part two forces (docs/constants.toml).
PARTING_STEPS = 8

Array = NDArray[np.float64]


def force_spans(times: Array, value: Array, variance: Array, seen: NDArray[np.bool_]) -> list[tuple[int, int]]:
    """First and last frame of each span in which a force acts.

    Parameters
    ----------
    times : ndarray
        (n,), rising, frames.
    value, variance : ndarray
        Independent values (k, n) and the variances of their errors.
    seen : ndarray
        (k, n), bool; a frame counts where all values were seen.
    """
    frames = np.flatnonzero(seen.all(0))
    time, value, variance = times[frames], value[:, frames], variance[:, frames]
    near, wide = (_is_forced(time, value, variance, steps) for steps in SLOPE_STEPS)
    # The short slopes say where a force is; the long slopes find weak forces, too, but blur them.
    spans = _runs(near)
    blur = SLOPE_STEPS[1]
    spans += [span for span in _runs(wide) if not any(a - blur <= span[1] and span[0] <= b + blur for a, b in spans)]
    return [(int(frames[a]), int(frames[b])) for a, b in sorted(spans)]


def _is_forced(time: Array, value: Array, variance: Array, steps: int) -> NDArray[np.bool_]:
    """(n,), True where the slopes before and after a frame differ by more than noise and a steady acceleration do."""
    forced = np.zeros(len(time), dtype=bool)
    if len(time) < 4 * steps:
        return forced
    windows = np.lib.stride_tricks.sliding_window_view
    moment = windows(time, steps + 1)
    moment = moment - moment.mean(-1, keepdims=True)
    gain = moment / (moment**2).sum(-1, keepdims=True)
    slope = (windows(value, steps + 1, axis=1) * gain).sum(-1)
    slope_variance = (windows(variance, steps + 1, axis=1) * gain**2).sum(-1)
    change = slope[:, steps:] - slope[:, :-steps]
    change -= np.median(change, axis=1, keepdims=True)
    stated = slope_variance[:, steps:] + slope_variance[:, :-steps]
    # Errors of neighbouring frames may be alike, and larger than stated.
    seen_variance = (1.4826 * np.median(np.abs(change), axis=1, keepdims=True)) ** 2
    score = change**2 / np.maximum(stated, seen_variance)
    forced[steps : len(time) - steps] = (score > MIN_SLOPE_CHANGE_SD**2).any(0)
    return forced


def _runs(mask: NDArray[np.bool_]) -> list[tuple[int, int]]:
    """First and last index of the runs of True, joined across less than `PARTING_STEPS`."""
    indices = np.flatnonzero(mask)
    if not len(indices):
        return []
    parts = np.split(indices, np.flatnonzero(np.diff(indices) > PARTING_STEPS) + 1)
    return [(int(part[0]), int(part[-1])) for part in parts]
