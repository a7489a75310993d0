"""Images that are missing between two frames: the ball moves and turns a whole number of times as far as around."""

from __future__ import annotations

import numpy as np

from torchsphere.tracking.track import Track

#: Share of the steps around that they, and the step in question over their number, may differ by.
ALIKE = 0.1

#: Standard deviations that the steps around have to measure, so that a whole number is told from any other.
CLEAR = 20.0


def skipped(track: Track) -> tuple[tuple[int, int], ...]:
    """Frames before which images seem to be missing, and how many: ((frame, images), ...)."""
    to_px = np.array([1.0, 1.0, *3 * [track.circle.radius]])
    step = track.increment * to_px
    sd = np.sqrt(np.diagonal(track.covariance, axis1=1, axis2=2)) * to_px
    found = []
    for i in range(1, len(step) - 1):
        before, here, after = step[i - 1], step[i], step[i + 1]
        usual = 0.5 * (before + after)
        length = float(np.linalg.norm(usual))
        # Comparisons with NaN are false: a step that was not measured tells nothing.
        if not (length > CLEAR * np.linalg.norm(sd[i])) or not (np.linalg.norm(after - before) < ALIKE * length):
            continue
        times = round(float(here @ usual) / length**2)
        if times >= 2 and np.linalg.norm(here / times - usual) < ALIKE * length:
            found.append((i + 1, times - 1))
    return tuple(found)
