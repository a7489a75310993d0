"""Images missing between two frames: there the ball moves and turns a whole number of times as far as elsewhere."""

from __future__ import annotations

import numpy as np

from torchsphere.tracking.result import Track

#: Largest relative difference of steps that count as equal (docs/constants.toml).
MAX_DIFFERENCE = 0.1

#: Least length of the neighbouring steps, in standard deviations (docs/constants.toml).
MIN_LENGTH_SD = 20.0


def missing_frames(track: Track) -> tuple[tuple[int, int], ...]:
    """Frames before which images seem to be missing, and how many: ((frame, images), ...)."""
    to_px = np.array([1.0, 1.0, *3 * [track.circle.radius]])
    # A gap that the images' own times state is not missing.
    steps = track.increment * to_px / track.durations[:, None]
    sd = np.sqrt(np.diagonal(track.covariance, axis1=1, axis2=2)) * to_px
    gaps = []
    for i in range(1, len(steps) - 1):
        before, step, after = steps[i - 1 : i + 2]
        expected = 0.5 * (before + after)
        length = float(np.linalg.norm(expected))
        # Steps that were not measured are NaN, and comparisons with NaN are false.
        is_measurable = length > MIN_LENGTH_SD * np.linalg.norm(sd[i])
        if not (is_measurable and np.linalg.norm(after - before) < MAX_DIFFERENCE * length):
            continue
        ratio = round(float(step @ expected) / length**2)
        if ratio >= 2 and np.linalg.norm(step / ratio - expected) < MAX_DIFFERENCE * length:
            gaps.append((i + 1, ratio - 1))
    return tuple(gaps)
