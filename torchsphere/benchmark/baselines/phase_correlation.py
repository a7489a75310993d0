"""Phase correlation: scikit-image's ``phase_cross_correlation`` of two crops.

Guizar-Sicairos, Thurman and Fienup 2008, doi:10.1364/OL.33.000156.
"""

from __future__ import annotations

import math
import time
from typing import Any

import numpy as np

from torchsphere.benchmark.baselines.baseline import Baseline, Progress, load
from torchsphere.benchmark.baselines.frame_loop import NO_ROTATION, Image, Pair, failure, follow, opened, result
from torchsphere.runtime.arrays import Array

#: Normalization of the cross-correlation: None, a plain correlation, or "phase" (docs/constants.toml).
NORMALIZATION = None

#: Parts into which a pixel is divided (docs/constants.toml).
UPSAMPLE = 100

#: Radius of the window as a share of the ball's, and its outer part where the window falls to 0 (docs/constants.toml).
ROI, TAPER = 1.0, 0.2

#: Largest root of one minus the squared correlation coefficient of a valid pair (docs/constants.toml).
MAX_ERROR = 0.8

#: Largest number of rounds in which the second window is moved to the measured centre.
ROUNDS = 3


def phase_correlation(images: Any, circle: Any, *, progress: Progress | None = None) -> Baseline:
    """Follow the ball by the peak of the cross-correlation of two windowed discs; measures dx and dy."""
    registration, (source, first) = load("skimage.registration"), opened(images, circle)
    began = time.perf_counter()

    def measure(pair: Pair) -> tuple[Array, Array, str]:
        f, centre, error = _windowed(pair.f, pair.centre_f, ROI * pair.radius), pair.centre_g, 1.0
        for _ in range(ROUNDS):
            # The windows are whole px apart, so that they do not bias the fraction, which is measured.
            window_centre = pair.centre_f + np.rint(centre - pair.centre_f)
            g = _windowed(pair.g, window_centre, ROI * pair.radius)
            shift, error, _ = registration.phase_cross_correlation(
                f, g, upsample_factor=UPSAMPLE, normalization=NORMALIZATION
            )
            centre = pair.centre_f - shift[::-1]
            if np.abs(centre - window_centre).max() < 1:
                break
        return (centre, NO_ROTATION, "ok") if error < MAX_ERROR else failure("low_correlation")

    half = math.ceil(1.1 * first.radius) + 4
    measured = follow(source, first, measure, half=half, progress=progress)
    settings = {"normalization": NORMALIZATION, "upsample": UPSAMPLE, "roi": ROI, "taper": TAPER}
    return result(began, measured, "scikit-image phase_cross_correlation", first, **settings)


def _windowed(image: Image, centre: Array, radius: float) -> Array:
    """The disc without its mean, falling to 0 over the outer `TAPER` of its radius; 0 outside."""
    y, x = np.indices(image.shape)
    distance = np.hypot(x - centre[0], y - centre[1]) / radius
    weight = 0.5 + 0.5 * np.cos(np.pi * np.clip((distance - 1) / TAPER + 1, 0, 1))
    mean = (weight * image).sum() / weight.sum()
    return np.asarray(weight * (image - mean), dtype=np.float64)
