"""Enhanced correlation coefficient (ECC): OpenCV's ``findTransformECC`` on the disc of the ball.

Evangelidis and Psarakis 2008, doi:10.1109/TPAMI.2008.113.
"""

from __future__ import annotations

import math
import time
from typing import Any

import numpy as np

from torchsphere.benchmark.baselines import extras
from torchsphere.benchmark.baselines.baseline import Baseline, Progress
from torchsphere.benchmark.baselines.stepwise import NO_ROTATION, NOWHERE, Array, Pair, follow, opened, result

#: Correlation coefficient below which a pair is not believed; `torchsphere.track` uses the same.
MIN_CORRELATION = 0.6


def ecc(
    images: Any,
    circle: Any,
    *,
    motion: str = "euclidean",
    roi: float = 1.0,
    filter_px: int = 3,
    iterations: int = 100,
    tolerance: float = 1e-6,
    progress: Progress | None = None,
) -> Baseline:
    """Follow the ball by the image motion that correlates best; measures dx, dy and wz.

    An image motion has no rotation out of the image plane: a turning ball is taken for a shifted one. The settings are
    the best of those measured (12 to 15 pairs each on a ball of 50 px without rotation, over a uniform and over a
    textured background, and on the example shot):

    - ``roi`` 1.0: without rotation the bias is 0.003 px and the standard deviation 0.007; at 0.95 with the usual filter
      of 5 px 0.014 and 0.013, at 1.08 0.004 and 0.007 but 0.012 and 0.010 over texture, at 1.15 there 0.035.
    - ``filter_px`` 3: 1 scatters twice as much, 5 has a bias of 0.008 px, 7 and 9 are no better.
    - ``motion`` "affine" has the same bias in a rotation and takes twice the time.

    Parameters
    ----------
    images, circle, progress
        As in `Tracker`.
    motion : str
        "translation", "euclidean" (with wz) or "affine" (wz from the nearest rotation).
    roi : float
        Radius of the region of interest as a fraction of the ball's.
    filter_px : int
        Side of the Gaussian filter, px, odd.
    iterations : int
        Most Gauss-Newton steps.
    tolerance : float
        Change of the correlation coefficient at which they end.

    Raises
    ------
    ValueError
        As in `Tracker`, and if ``motion`` is none of these.
    """
    cv2, (source, first) = extras.load("cv2"), opened(images, circle)
    began = time.perf_counter()
    kinds = {"translation": cv2.MOTION_TRANSLATION, "euclidean": cv2.MOTION_EUCLIDEAN, "affine": cv2.MOTION_AFFINE}
    if motion not in kinds:
        raise ValueError(f"motion {motion!r}: expected one of {', '.join(kinds)}")
    criteria = (cv2.TERM_CRITERIA_EPS | cv2.TERM_CRITERIA_COUNT, iterations, tolerance)

    def measure(pair: Pair) -> tuple[Array, Array, str]:
        y, x = np.indices(pair.f.shape)
        disc = np.hypot(x - pair.centre_f[0], y - pair.centre_f[1]) <= roi * pair.radius
        # The mask belongs to OpenCV's "input", so f, whose circle is known, is that and g the "template".
        start, mask = _back(pair, motion), disc.astype(np.uint8)
        try:
            correlation, warp = cv2.findTransformECC(pair.g, pair.f, start, kinds[motion], criteria, mask, filter_px)
        except cv2.error:
            return NOWHERE, NO_ROTATION, "not_converged"
        if not correlation >= MIN_CORRELATION:
            return NOWHERE, NO_ROTATION, "low_correlation"
        forth = np.linalg.inv(np.vstack((warp.astype(np.float64), (0.0, 0.0, 1.0))))
        centre = forth[:2, :2] @ pair.centre_f + forth[:2, 2]
        wz = math.nan if motion == "translation" else rotation_angle(forth)
        return centre, np.array([np.nan, np.nan, wz]), "ok"

    measured = follow(source, first, measure, half=math.ceil(1.1 * first.radius) + 4, progress=progress)
    settings = {"motion": motion, "roi": roi, "filter_px": filter_px, "iterations": iterations, "tolerance": tolerance}
    return result(began, measured, "OpenCV findTransformECC", first, **settings)


def rotation_angle(matrix: Array) -> float:
    """Angle of the rotation nearest to the linear part of ``matrix`` (2 or 3, 3), rad, from x towards y."""
    return math.atan2(matrix[1, 0] - matrix[0, 1], matrix[0, 0] + matrix[1, 1])


def _back(pair: Pair, motion: str) -> Any:
    """Warp (2, 3) from ``g`` to ``f`` for the motion that is expected."""
    angle = 0.0 if motion == "translation" else pair.turn[2]
    c, s = math.cos(angle), math.sin(angle)
    linear = np.array([[c, s], [-s, c]])
    shift = pair.centre_f - linear @ pair.centre_g
    return np.hstack((linear, shift[:, None])).astype(np.float32)
