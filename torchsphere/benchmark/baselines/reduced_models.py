"""torchsphere's own correlation with fewer modes: translation alone (standard DIC), and the paper's printed modes."""

from __future__ import annotations

import dataclasses
import time
from typing import Any

import numpy as np

from torchsphere.benchmark.baselines.baseline import Baseline, Progress
from torchsphere.benchmark.baselines.frame_loop import opened, result
from torchsphere.imaging.interpolation import PRE_BLUR_PX
from torchsphere.tracking.track import track

#: Radius of the region of interest as a share of the ball's (docs/constants.toml).
ROI = 1.0


def translation_only(images: Any, circle: Any, *, progress: Progress | None = None) -> Baseline:
    """Follow the ball with the model "translation", the standard DIC of the paper; measures dx and dy."""
    found = _correlated(images, circle, "translation", progress)
    # The method measures no rotation, so a frame with a translation is "ok".
    status = np.where(found.status == "weak_texture", "ok", found.status)
    return dataclasses.replace(found, status=status)


def published(images: Any, circle: Any, *, progress: Progress | None = None) -> Baseline:
    """Follow the ball with the model "published", the five modes as the paper prints them; measures all five."""
    return _correlated(images, circle, "published", progress)


def _correlated(images: Any, circle: Any, model: str, progress: Progress | None) -> Baseline:
    """Correlate pairs of successive images, without the map of the ball, whose rotations these models do not have.

    The default pre-blur for a region up to the outline is 0.7 px. The full blur more than halves the models' errors:
    with the printed modes, 0.05 px and 0.2 deg per step instead of 0.11 px and 0.3 deg, over the benchmark's 18 suites.
    """
    began = time.perf_counter()
    _, first = opened(images, circle)
    found = track(images, first, model=model, roi=ROI, pre_blur=PRE_BLUR_PX, sphere_map=False, progress=progress)
    measured = found.position, found.increment, found.status
    return result(began, measured, "torchsphere.track", first, **found.settings)
