"""Translation only: torchsphere's own correlation with two modes, the standard DIC that the paper compares with."""

from __future__ import annotations

import dataclasses
import time
from typing import Any

import numpy as np

from torchsphere.benchmark.baselines.baseline import Baseline, Progress
from torchsphere.benchmark.baselines.stepwise import opened, result
from torchsphere.imaging.interpolation import PRE_BLUR_PX
from torchsphere.tracking.track import track


def translation_only(images: Any, circle: Any, *, roi: float = 1.0, progress: Progress | None = None) -> Baseline:
    """Follow the ball with `torchsphere.track` and the model "translation"; measures dx and dy.

    With ``roi`` 1.0 the bias of a rotation is least (0.303 px at 0.5 deg per frame and a radius of 50 px; 0.316 at
    0.95, 0.33 at 0.9, 0.381 at 0.7); without rotation the standard deviation is 0.0016 px, over a textured background
    0.0023. Everything else is torchsphere's own default.

    Parameters
    ----------
    images, circle, progress
        As in `Tracker`.
    roi : float
        Radius of the region of interest as a fraction of the ball's.
    """
    found = correlated(images, circle, "translation", roi, progress)
    # A rival is asked for no more than its method measures: a frame with its translation is all right.
    status = np.where(found.status == "weak_texture", "ok", found.status)
    return dataclasses.replace(found, status=status)


def correlated(images: Any, circle: Any, model: str, roi: float, progress: Progress | None) -> Baseline:
    """Pairs of successive images correlated by torchsphere with another motion model, and nothing else of it.

    No map of the ball: it holds rotations that these models do not have. A region up to the outline would by itself be
    blurred by 0.7 px only. With the full px these models are better: on the benchmark's 18 suites the printed modes'
    mean errors of a step are 0.05 px and 0.2 deg instead of 0.11 and 0.3, most of it where the ball turns fast.
    """
    began = time.perf_counter()
    _, first = opened(images, circle)
    found = track(images, first, model=model, roi=roi, pre_blur=PRE_BLUR_PX, sphere_map=False, progress=progress)
    measured = found.position, found.increment, found.status
    return result(began, measured, "torchsphere.track", first, **found.settings)
