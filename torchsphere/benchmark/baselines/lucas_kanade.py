"""Lucas-Kanade points: OpenCV's pyramidal optical flow, then a robust fit of the rigid motion to the points.

Bouguet 2001, "Pyramidal implementation of the affine Lucas Kanade feature tracker", for the flow.
"""

from __future__ import annotations

import math
import time
from typing import Any

import numpy as np
from numpy.typing import NDArray

from torchsphere.benchmark.baselines.baseline import Baseline, Progress, eight_bit, eight_bit_gain, load
from torchsphere.benchmark.baselines.frame_loop import Image, Pair, failure, follow, opened, result
from torchsphere.runtime.arrays import Array

#: Radius of the disc of points as a share of the ball's, and the distance of the points, px (docs/constants.toml).
ROI, SPACING_PX = 0.95, 4.0

#: Enlargement of the crops by cubic interpolation, and the blur before the enlargement, px (docs/constants.toml).
ENLARGED, BLUR_PX = 2, 0.7

#: Side of a point's window, px of the enlarged crop, and pyramid levels above the crop (docs/constants.toml).
WINDOW_PX, LEVELS = 15, 2

#: Largest number of steps per point and level, and the length of the last step, px.
STEPS, LAST_STEP_PX = 50, 1e-3

#: Tukey's constant for 95 % efficiency under Gaussian errors, and the number of reweighted fits.
TUKEY, ROUNDS = 4.685, 16

#: Smallest number of points in a fit of five unknowns (docs/constants.toml).
MIN_POINTS = 12

#: Largest standard deviation of the points about a rigid motion, px (docs/constants.toml).
MAX_SCATTER_PX = 0.5

#: Largest distance of a point from its start after flow forward and back, px (docs/constants.toml).
MAX_RETURN_PX = 0.5


def lucas_kanade(images: Any, circle: Any, *, progress: Progress | None = None) -> Baseline:
    """Follow the ball by the flow of a grid of points and the rigid motion through them; measures all five."""
    cv2, (source, first) = load("cv2"), opened(images, circle)
    began = time.perf_counter()
    gain, grid = eight_bit_gain(source.images(0, 1)[0].numpy()), _grid(ROI * first.radius)

    def measure(pair: Pair) -> tuple[Array, Array, str]:
        after, valid = _flow(cv2, pair, grid, gain)
        if valid.sum() < MIN_POINTS:
            return failure("lost")
        q, scatter, used = rigid_fit(grid[valid], after[valid] - pair.centre_f, pair.radius)
        if used < MIN_POINTS or not scatter < MAX_SCATTER_PX:
            return failure("low_correlation")
        return pair.centre_f + q[:2], q[2:], "ok"

    half = math.ceil(1.05 * first.radius) + WINDOW_PX
    measured = follow(source, first, measure, half=half, progress=progress)
    settings = {"roi": ROI, "spacing_px": SPACING_PX, "enlarged": ENLARGED, "blur_px": BLUR_PX}
    settings |= {"window_px": WINDOW_PX, "levels": LEVELS}
    return result(began, measured, "OpenCV calcOpticalFlowPyrLK and a rigid fit", first, **settings)


def _flow(cv2: Any, pair: Pair, grid: Array, gain: float) -> tuple[Array, NDArray[np.bool_]]:
    """Places (m, 2) in ``g`` of the points ``grid`` (m, 2), px, and which of them return to their start."""
    options = {
        "winSize": (WINDOW_PX, WINDOW_PX),
        "maxLevel": LEVELS,
        "criteria": (cv2.TERM_CRITERIA_EPS | cv2.TERM_CRITERIA_COUNT, STEPS, LAST_STEP_PX * ENLARGED),
        "flags": cv2.OPTFLOW_USE_INITIAL_FLOW,
    }
    f, g = (_enlarged(cv2, image, gain) for image in (pair.f, pair.g))
    before = grid + pair.centre_f
    guess = pair.centre_g + grid + _rotation_shift(grid, pair.rotation, pair.radius)
    # Pixel i of the crop covers the pixels from i ENLARGED to (i + 1) ENLARGED - 1 of the enlarged crop.
    start, expected = ((((p + 0.5) * ENLARGED - 0.5)[:, None]).astype(np.float32) for p in (before, guess))
    after, found, _ = cv2.calcOpticalFlowPyrLK(f, g, start, expected.copy(), **options)
    back, found_back, _ = cv2.calcOpticalFlowPyrLK(g, f, after, start.copy(), **options)
    returned = np.abs(back - start)[:, 0].max(-1) < MAX_RETURN_PX * ENLARGED
    valid = (found[:, 0] == 1) & (found_back[:, 0] == 1) & returned
    return (after[:, 0].astype(np.float64) + 0.5) / ENLARGED - 0.5, valid


def rigid_fit(before: Array, after: Array, radius: float) -> tuple[Array, float, int]:
    """Rigid motion (5,) of an orthographic sphere from points (m, 2), px relative to the centre before the motion.

    With the mean ``M`` of a surface point's places before and after (each from its own centre), the displacement of a
    finite rotation is exactly ``2 c x M``, ``c`` the axis times the tangent of half the angle (Cayley's form). ``M``
    depends on the centre after the motion, so the fit is repeated, with Tukey's biweight against outliers. The other
    values are the robust standard deviation of the points about the fit, px, and the number of points with a weight.
    """
    q, weights = np.zeros(5), np.ones(len(before))
    moved = after - before
    q[:2] = np.median(moved, axis=0)
    for _ in range(ROUNDS):
        centred = after - q[:2]
        x, y = (0.5 * (before + centred)).T
        s = 0.5 * (_depth(before, radius) + _depth(centred, radius))
        one, none = np.ones_like(x), np.zeros_like(x)
        along_x = np.stack((one, none, none, -2 * s, -2 * y), -1)
        along_y = np.stack((none, one, 2 * s, none, 2 * x), -1)
        root = np.sqrt(weights)
        design = np.concatenate((root[:, None] * along_x, root[:, None] * along_y))
        q = np.linalg.lstsq(design, np.concatenate((root * moved[:, 0], root * moved[:, 1])), rcond=None)[0]
        residual = np.hypot(moved[:, 0] - along_x @ q, moved[:, 1] - along_y @ q)
        # Median of the length of a two-dimensional Gaussian: 1.1774 standard deviations.
        scatter = float(np.median(residual)) / 1.1774
        weights = np.clip(1 - (residual / (TUKEY * max(scatter, 1e-3))) ** 2, 0, None) ** 2
    half_tangent = float(np.linalg.norm(q[2:]))
    q[2:] *= 2 * math.atan(half_tangent) / half_tangent if half_tangent > 0 else 2.0
    return q, scatter, int((weights > 0).sum())


def _enlarged(cv2: Any, image: Image, gain: float) -> Any:
    """The crop blurred, enlarged and then rounded to 8 bit, so that the finer levels of the blur are kept."""
    image = cv2.GaussianBlur(image, (0, 0), BLUR_PX)
    return eight_bit(cv2.resize(image, None, fx=ENLARGED, fy=ENLARGED, interpolation=cv2.INTER_CUBIC), gain)


def _grid(radius: float) -> Array:
    """Points (m, 2) of a square grid within ``radius`` of its centre, px."""
    count = math.floor(radius / SPACING_PX)
    x, y = np.meshgrid(*2 * [np.arange(-count, count + 1) * SPACING_PX])
    inside = np.hypot(x, y) <= radius
    return np.stack((x[inside], y[inside]), -1)


def _depth(points: Array, radius: float) -> Array:
    """Height (m,) of the surface above the plane of the outline at the points (m, 2), px."""
    return np.sqrt(np.clip(radius**2 - (points**2).sum(-1), 0, None))


def _rotation_shift(points: Array, rotation: Array, radius: float) -> Array:
    """Displacement (m, 2) of the points by a small rotation (3,), px."""
    s = _depth(points, radius)
    x_shift = -s * rotation[1] - points[:, 1] * rotation[2]
    return np.stack((x_shift, s * rotation[0] + points[:, 0] * rotation[2]), -1)
