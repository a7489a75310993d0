"""Other methods to measure the motion between two images of a ball, with the speed of their libraries.

`plain_gauss_newton` is the paper's method in numpy and scipy: a crop, scipy's cubic spline, five rigid modes, the
constant operator, one pair after the other. `ecc` and `lucas_kanade` call OpenCV.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import scipy.ndimage
from numpy.typing import NDArray

Array = NDArray[Any]

#: Region of interest and pre-blur as torchsphere has them, steps at most, and the step that ends the iteration, px.
ROI, PRE_BLUR_PX, STEPS, TOLERANCE_PX = 0.95, 1.0, 40, 2e-4

#: OpenCV's ECC: steps at most, change of the coefficient that ends the iteration, Gaussian filter, px (odd).
ECC_STEPS, ECC_TOLERANCE, ECC_FILTER_PX = 50, 1e-5, 5

#: OpenCV's Lucas-Kanade: distance of the points and side of the window, px, and levels of the pyramid.
SPACING_PX, WINDOW_PX, LEVELS = 4, 15, 2


def plain_gauss_newton(f: Array, g: Array, circle: Array) -> Array:
    """Increment (dx, dy, wx, wy, wz), px and rad, of the ball in ``circle`` (3,) from ``f`` (h, w) to ``g``."""
    x0, y0, radius = circle
    half = math.ceil(radius) + 12
    column, row = round(x0), round(y0)
    box = (slice(row - half, row + half + 1), slice(column - half, column + half + 1))
    blurred = [scipy.ndimage.gaussian_filter(image[box].astype(np.float32), PRE_BLUR_PX) for image in (f, g)]
    spline = scipy.ndimage.spline_filter(blurred[1], 3, output=np.float32)
    slope_y, slope_x = np.gradient(blurred[0])
    y, x = np.mgrid[-half : half + 1, -half : half + 1].astype(np.float32)
    y, x = y + (row - y0), x + (column - x0)
    inside = x**2 + y**2 < (ROI * radius) ** 2
    y, x = y[inside], x[inside]
    height = np.sqrt(radius**2 - x**2 - y**2)
    gx, gy, values = slope_x[inside], slope_y[inside], blurred[0][inside]
    values = values - values.mean()
    jacobian = np.stack((gx, gy, gy * height / radius, -gx * height / radius, (gy * x - gx * y) / radius))
    jacobian -= jacobian.mean(1, keepdims=True)
    inverse = np.linalg.inv(jacobian @ jacobian.T)
    q = np.zeros(5)
    for _ in range(STEPS):
        dx, dy, wx, wy, wz = q / (1, 1, radius, radius, radius)
        places = np.stack((y + dy + height * wx + x * wz - (row - y0), x + dx - height * wy - y * wz - (column - x0)))
        warped = scipy.ndimage.map_coordinates(spline, places + half, order=3, prefilter=False)
        warped -= warped.mean()
        step = inverse @ (jacobian @ (values - np.sqrt((values @ values) / (warped @ warped)) * warped))
        q += step
        if np.abs(step).max() < TOLERANCE_PX:
            break
    return np.asarray(q / (1, 1, radius, radius, radius))


def _box(image: Array, circle: Array) -> tuple[Array, Array]:
    """The square around the ball, and its first pixel as (x, y)."""
    half = math.ceil(1.1 * circle[2]) + 4
    left, top = max(round(circle[0]) - half, 0), max(round(circle[1]) - half, 0)
    return np.ascontiguousarray(image[top : top + 2 * half + 1, left : left + 2 * half + 1]), np.array([left, top])


def ecc(f: Array, g: Array, circle: Array) -> Array:
    """Step (dx, dy), px, by OpenCV's ``findTransformECC`` with a Euclidean motion."""
    import cv2

    (small_f, first), (small_g, _) = _box(f, circle), _box(g, circle)
    y, x = np.indices(small_f.shape)
    centre = circle[:2] - first
    mask = (np.hypot(x - centre[0], y - centre[1]) <= ROI * circle[2]).astype(np.uint8)
    criteria = (cv2.TERM_CRITERIA_EPS | cv2.TERM_CRITERIA_COUNT, ECC_STEPS, ECC_TOLERANCE)
    start = np.eye(2, 3, dtype=np.float32)
    _, warp = cv2.findTransformECC(small_g, small_f, start, cv2.MOTION_EUCLIDEAN, criteria, mask, ECC_FILTER_PX)
    back = np.vstack((warp, (0, 0, 1))).astype(np.float64)
    return np.asarray((np.linalg.inv(back) @ (*centre, 1))[:2] - centre)


def lucas_kanade(f: Array, g: Array, circle: Array) -> Array:
    """Increment (dx, dy, wx, wy, wz) by OpenCV's flow of a grid of points and the rigid motion through it."""
    import cv2

    flow_of: Any = cv2.calcOpticalFlowPyrLK
    (small_f, first), (small_g, _) = _box(f, circle), _box(g, circle)
    radius = circle[2]
    steps = np.arange(-ROI * radius, ROI * radius, SPACING_PX)
    x, y = (part.ravel() for part in np.meshgrid(steps, steps))
    inside = np.hypot(x, y) < ROI * radius
    x, y = x[inside], y[inside]
    height = np.sqrt(radius**2 - x**2 - y**2)
    points = (np.stack((x, y), -1) + circle[:2] - first).astype(np.float32)
    moved, found, _ = flow_of(small_f, small_g, points, None, None, None, (WINDOW_PX,) * 2, LEVELS)
    none = np.zeros_like(x)
    design = np.concatenate(
        (
            np.stack((none + 1, none, none, -height, -y), -1),
            np.stack((none, none + 1, height, none, x), -1),
        )
    )
    kept = np.tile(found.ravel() == 1, 2)
    flow = (moved - points).T.ravel()
    return np.asarray(np.linalg.lstsq(design[kept], flow[kept], rcond=None)[0])


#: The methods by name.
RIVALS = {
    "plain five-mode Gauss-Newton, numpy and scipy": plain_gauss_newton,
    "OpenCV ECC (two translations)": ecc,
    "OpenCV Lucas-Kanade with a five-mode fit": lucas_kanade,
}
