"""Enhanced correlation coefficient (ECC): OpenCV's ``findTransformECC`` on the disc of the ball.

Evangelidis and Psarakis 2008, doi:10.1109/TPAMI.2008.113.
"""

from __future__ import annotations

import math
import time
from typing import Any

import numpy as np

from torchsphere.benchmark.baselines.baseline import Baseline, Progress, load
from torchsphere.benchmark.baselines.frame_loop import Pair, failure, follow, opened, result
from torchsphere.runtime.arrays import Array

#: Radius of the region of interest as a share of the ball's (docs/constants.toml).
ROI = 1.0

#: Side of the Gaussian filter, px, odd (docs/constants.toml).
FILTER_PX = 3

#: Largest number of Gauss-Newton steps, and the change of the correlation coefficient at which they end.
ITERATIONS, TOLERANCE = 100, 1e-6

#: Smallest correlation coefficient of a valid pair; `torchsphere.track` uses the same (docs/constants.toml).
MIN_CORRELATION = 0.6


def ecc(images: Any, circle: Any, *, progress: Progress | None = None) -> Baseline:
    """Follow the ball by the shift and rotation in the image plane that correlate best; measures dx, dy and wz.

    A rotation out of the image plane is measured as a shift, because the motion model has no such rotation.
    """
    cv2, (source, first) = load("cv2"), opened(images, circle)
    began = time.perf_counter()
    criteria = (cv2.TERM_CRITERIA_EPS | cv2.TERM_CRITERIA_COUNT, ITERATIONS, TOLERANCE)

    def measure(pair: Pair) -> tuple[Array, Array, str]:
        y, x = np.indices(pair.f.shape)
        disc = np.hypot(x - pair.centre_f[0], y - pair.centre_f[1]) <= ROI * pair.radius
        # OpenCV applies the mask to its "input", so f, whose circle is known, is the input and g is the "template".
        start, mask = _initial_warp(pair), disc.astype(np.uint8)
        try:
            correlation, warp = cv2.findTransformECC(
                pair.g, pair.f, start, cv2.MOTION_EUCLIDEAN, criteria, mask, FILTER_PX
            )
        except cv2.error:
            return failure("not_converged")
        if not correlation >= MIN_CORRELATION:
            return failure("low_correlation")
        forward = np.linalg.inv(np.vstack((warp.astype(np.float64), (0.0, 0.0, 1.0))))
        centre = forward[:2, :2] @ pair.centre_f + forward[:2, 2]
        return centre, np.array([np.nan, np.nan, rotation_angle(forward)]), "ok"

    measured = follow(source, first, measure, half=math.ceil(1.1 * first.radius) + 4, progress=progress)
    settings = {"roi": ROI, "filter_px": FILTER_PX, "iterations": ITERATIONS, "tolerance": TOLERANCE}
    return result(began, measured, "OpenCV findTransformECC", first, motion="euclidean", **settings)


def rotation_angle(matrix: Array) -> float:
    """Angle of the rotation nearest to the linear part of ``matrix`` (2 or 3, 3), rad, from x towards y."""
    return math.atan2(matrix[1, 0] - matrix[0, 1], matrix[0, 0] + matrix[1, 1])


def _initial_warp(pair: Pair) -> Any:
    """Warp (2, 3) from ``g`` to ``f`` for the expected motion."""
    c, s = math.cos(pair.rotation[2]), math.sin(pair.rotation[2])
    linear = np.array([[c, s], [-s, c]])
    shift = pair.centre_f - linear @ pair.centre_g
    return np.hstack((linear, shift[:, None])).astype(np.float32)
