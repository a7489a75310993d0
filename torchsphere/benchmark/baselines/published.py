"""The five modes as the paper prints them: torchsphere's own correlation with the model "published"."""

from __future__ import annotations

from typing import Any

from torchsphere.benchmark.baselines.baseline import Baseline, Progress
from torchsphere.benchmark.baselines.translation_only import correlated


def published(images: Any, circle: Any, *, roi: float = 1.0, progress: Progress | None = None) -> Baseline:
    """Follow the ball with `torchsphere.track` and the model "published"; measures all five.

    With ``roi`` 1.0 what the printed modes lack costs least, measured over 59 pairs of the example shot (0.5 deg about
    y per frame, R = 50 px): the mean error of x is 0.001 px and its standard deviation 0.007 (0.010 and 0.010 at 0.95,
    0.023 and 0.012 at 0.9), that of wy -0.062 deg (-0.074, -0.085). Without rotation it is 0.001 and 0.005 px, 0.004 at
    0.95. Everything else is torchsphere's own default.

    Parameters
    ----------
    images, circle, progress
        As in `Tracker`.
    roi : float
        Radius of the region of interest as a fraction of the ball's.
    """
    return correlated(images, circle, "published", roi, progress)
