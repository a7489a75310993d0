"""The keyframes that make the map: as few frames as show every side of the ball that the recording shows."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

#: Angle between the directions of two keyframes, deg, that is small enough to show every side (docs/constants.toml).
APART_DEG = 20.0

#: Smallest number of keyframes, of large balls and of others, and largest: they share the noise of the map
#: (docs/constants.toml).
MIN_OF_LARGE, MIN_KEYFRAMES, MAX_KEYFRAMES = 8, 12, 48

#: Pixels on the ball, in all keyframes, that are enough where there are `MIN_OF_LARGE` (docs/constants.toml).
ENOUGH_PIXELS = 150_000

#: Smallest number of views of each side, an oblique view counted by its cosine (docs/constants.toml).
MIN_VIEWS = 4.0

#: Number of the first known frames over which keyframes are spread that are not needed for a direction
#: (docs/constants.toml).
SPREAD_OVER = 300


def choose_keyframes(known: NDArray[np.int64], orientation: NDArray[np.float64], radius: float) -> list[int]:
    """Numbers of the keyframes among the ``known`` frames (k,), in order; ``orientation`` (n, 3, 3) of all frames.

    ``radius`` is that of the ball, px.

    A frame becomes a keyframe where no earlier one shows the ball from within `APART_DEG`. So a long recording of a
    spinning ball has keyframes in its first turns, within which the sum of the increments has hardly drifted. More
    keyframes fill the gaps in time, until every side is seen often enough.
    """
    directions = orientation[known][:, 2]
    needed = _by_direction(directions)
    end = max(needed[-1], min(len(known), SPREAD_OVER) - 1)
    least = min(max(math.ceil(ENOUGH_PIXELS / (math.pi * radius**2)), MIN_OF_LARGE), MIN_KEYFRAMES)
    for count in range(max(len(needed), least), MAX_KEYFRAMES + 1, 2):
        chosen = _with_gaps_filled(needed, end, count)
        views = (directions[: end + 1] @ directions[chosen].T).clip(0).sum(1)
        if views.min() >= MIN_VIEWS or len(chosen) > end:
            break
    return [int(known[i]) for i in chosen]


def _by_direction(directions: NDArray[np.float64]) -> list[int]:
    """Numbers of the frames that show a new side."""
    chosen = [0]
    while len(chosen) < MAX_KEYFRAMES:
        later = directions[chosen[-1] + 1 :]
        far = np.flatnonzero((later @ directions[chosen].T).max(1, initial=-1.0) < np.cos(np.radians(APART_DEG)))
        if len(far) == 0:
            break
        chosen.append(chosen[-1] + 1 + int(far[0]))
    return chosen


def _with_gaps_filled(chosen: list[int], end: int, count: int) -> list[int]:
    """The ``chosen`` frames and others up to ``end``, in order: ``count`` if there are so many."""
    filled = set(chosen)
    candidates = set(np.linspace(0, end, count).round().astype(int).tolist()) - filled
    while candidates and len(filled) < count:
        farthest = max(sorted(candidates), key=lambda i: min(abs(i - c) for c in filled))
        filled.add(farthest)
        candidates.remove(farthest)
    return sorted(filled)


def choose_map_frames(known: NDArray[np.int64], keys: list[int], count: int) -> NDArray[np.int64]:
    """Up to ``count`` numbers, keyframes included, of frames that make the map.

    They lie evenly in the time of the keyframes.
    """
    inside = known[: int(np.searchsorted(known, keys[-1])) + 1]
    others = np.setdiff1d(inside, keys)
    more = max(0, min(count - len(keys), len(others)))
    chosen = others[np.unique(np.linspace(0, len(others) - 1, more).round().astype(int))] if more else others[:0]
    return np.union1d(keys, chosen)
