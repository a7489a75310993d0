"""How certain the steps between frames on a map of the ball are."""

from __future__ import annotations

import itertools
import math

import numpy as np
from numpy.typing import NDArray

from torchsphere.bundle import Bundle
from torchsphere.register import Registration

Array = NDArray[np.float64]


def step_covariances(n: int, found: dict[int, Registration], keys: list[int], adjusted: Bundle) -> Array:
    """Covariance (n - 1, 5, 5) of the steps between frames that are both on the map.

    Between keyframes it is that of the adjustment. Elsewhere it is the two images' own noise and what the map's errors
    add. Those are the same for both frames as far as they see the ball from the same side: the variance that they add
    between keyframes counts by the square of how far the ball turns, against how far it turns between these. Measured
    on eleven rendered suites of balls of 20 and 50 px, errors of steps are then 0.75 to 1.07 times what is stated, but
    for dim light (1.19) and motion blur (0.59). With the whole of it they were 0.69 to 1.07, and 0.46 to 0.57 on three
    of them with 18 keyframes instead of 36, though the errors were the same. What it does not know is that pixels fall
    on other places of the map as the ball moves: on 100 frames of balls of 30 px, at 0.5 to 5 deg per frame, errors
    beside the keyframes were 1.0 to 1.37 times what is stated, and at 0.5 deg 1.0 to 1.2 times with the whole.
    """
    unit = np.array([1.0, 1.0, *3 * [1 / adjusted.ball.radius]])
    to_units = np.outer(unit, unit)
    between = np.full((n - 1, 5, 5), np.nan)
    place = {i: k for k, i in enumerate(keys)}
    added, turns = [], []
    for a, b in itertools.pairwise(keys):
        alone = (found[a].covariance + found[b].covariance).numpy()
        added.append(np.diag(_difference(adjusted, place[a], place[b])) / np.diag(alone) - 1)
        turns.append(_turn(found[a], found[b]))
    most, turn = np.maximum(np.median(added, axis=0), 0.0), float(np.median(turns))
    for i in range(n - 1):
        if i in place and i + 1 in place:
            between[i] = _difference(adjusted, place[i], place[i + 1]) * to_units
        elif i in found and i + 1 in found:
            own = (found[i].covariance + found[i + 1].covariance).numpy()
            share = min(_turn(found[i], found[i + 1]) / max(turn, 1e-9), 1.0) ** 2
            wider = np.sqrt(1 + most * share)
            between[i] = wider[:, None] * own * wider * to_units
    return between


def _turn(a: Registration, b: Registration) -> float:
    """Angle between the orientations of two frames, rad."""
    turned = (b.pose.orientation @ a.pose.orientation.T).trace()
    return math.acos(min(max((float(turned) - 1) / 2, -1.0), 1.0))


def _difference(adjusted: Bundle, a: int, b: int) -> Array:
    """Covariance (5, 5) of the step from the adjusted pose number ``a`` to number ``b``."""
    spread, first, second = adjusted.covariance, slice(5 * a, 5 * a + 5), slice(5 * b, 5 * b + 5)
    shared = spread[first, second]
    return spread[first, first] + spread[second, second] - shared - shared.T
