"""Lucas-Kanade points: OpenCV's pyramidal optical flow, then a robust fit of the rigid motion to the points.

Bouguet 2001, "Pyramidal implementation of the affine Lucas Kanade feature tracker", for the flow.
"""

from __future__ import annotations

import math
import time
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from torchsphere.benchmark.baselines import extras
from torchsphere.benchmark.baselines.baseline import Baseline, Progress
from torchsphere.benchmark.baselines.stepwise import NO_ROTATION, NOWHERE, Array, Image, Pair, follow, opened, result

#: Tukey's constant for 95 % efficiency under Gaussian errors; rounds of reweighting.
TUKEY, ROUNDS = 4.685, 16

#: Fewest points that a motion is believed from: with less, five unknowns fit anything.
MIN_POINTS = 12

#: Scatter of the points about the fit, px, above which they do not move as one body: it is 0.02 on a ball.
MAX_SCATTER_PX = 0.5

#: Farthest that a point may end from its start after the way there and back, px.
MAX_RETURN_PX = 0.5

#: Steps per point and level, and the step at which they end, px.
STEPS, LAST_STEP_PX = 50, 1e-3


def lucas_kanade(
    images: Any,
    circle: Any,
    *,
    roi: float = 0.95,
    spacing_px: float = 4.0,
    enlarged: int = 2,
    blur_px: float = 0.7,
    window_px: int = 15,
    levels: int = 2,
    progress: Progress | None = None,
) -> Baseline:
    """Follow the ball by the flow of a grid of points and the rigid motion through them; measures all five.

    The settings are the best of those measured (25 pairs each of the example shot, R = 50 px, and of a ball without
    rotation; standard deviation of dx and dy):

    - ``enlarged`` 2, ``blur_px`` 0.7: 0.006 and 0.006 px (0.006 and 0.005 without rotation). On the images as they are
      it is 0.041 and 0.024: OpenCV's bilinear samples of 8 bit images draw the points to whole px. Blur alone 0.030,
      enlargement alone 0.007 with twice the bias, three times 0.007.
    - ``roi`` 0.95: bias 0.010 px without blur, 0.012 at 0.9, 0.04 at 0.8. Corners instead of a grid have a bias of
      0.027 px, because they prefer some parts of the ball.
    - ``window_px`` 15 in the enlarged image; ``spacing_px`` from 2 to 6, ``levels`` from 0 to 3 and the mean of both
      directions change nothing that can be seen.

    Parameters
    ----------
    images, circle, progress
        As in `Tracker`.
    roi : float
        Radius of the disc of points as a fraction of the ball's.
    spacing_px : float
        Of the points, px.
    enlarged : int
        How many times the crops are enlarged, by cubic interpolation.
    blur_px : float
        Standard deviation of the Gaussian that blurs the crops first, px; 0 for none.
    window_px : int
        Side of the points' windows, px of the enlarged crop.
    levels : int
        Levels of the pyramid above the crop.
    """
    cv2, (source, first) = extras.load("cv2"), opened(images, circle)
    began = time.perf_counter()
    flow = _Flow(
        cv2=cv2,
        gain=extras.eight_bit_gain(source.images(0, 1)[0].numpy()),
        offsets=_grid(roi * first.radius, spacing_px),
        enlarged=enlarged,
        blur_px=blur_px,
        options={
            "winSize": (window_px, window_px),
            "maxLevel": levels,
            "criteria": (cv2.TERM_CRITERIA_EPS | cv2.TERM_CRITERIA_COUNT, STEPS, LAST_STEP_PX * enlarged),
            "flags": cv2.OPTFLOW_USE_INITIAL_FLOW,
        },
    )
    half = math.ceil(1.05 * first.radius) + window_px
    measured = follow(source, first, flow.measured, half=half, progress=progress)
    settings = {"roi": roi, "spacing_px": spacing_px, "enlarged": enlarged, "blur_px": blur_px}
    settings |= {"window_px": window_px, "levels": levels}
    return result(began, measured, "OpenCV calcOpticalFlowPyrLK and a rigid fit", first, **settings)


@dataclass(frozen=True)
class _Flow:
    """How the flow of points, `offsets` (m, 2) px from the ball's centre, is measured; `options` are OpenCV's."""

    cv2: Any
    gain: float
    offsets: Array
    enlarged: int
    blur_px: float
    options: dict[str, Any]

    def measured(self, pair: Pair) -> tuple[Array, Array, str]:
        """Centre, rotation and status of the second image."""
        after, good = self._points(pair)
        if good.sum() < MIN_POINTS:
            return NOWHERE, NO_ROTATION, "lost"
        q, scatter, used = rigid_fit(self.offsets[good], after[good] - pair.centre_f, pair.radius)
        if used < MIN_POINTS or not scatter < MAX_SCATTER_PX:
            return NOWHERE, NO_ROTATION, "low_correlation"
        return pair.centre_f + q[:2], q[2:], "ok"

    def _points(self, pair: Pair) -> tuple[Array, NDArray[np.bool_]]:
        """Places (m, 2) of the points in the second image, px, and which came back to their start."""
        f, g = (_prepared(self.cv2, image, self.gain, self.enlarged, self.blur_px) for image in (pair.f, pair.g))
        before = self.offsets + pair.centre_f
        guess = pair.centre_g + self.offsets + _swept(self.offsets, pair.turn, pair.radius)
        # Pixel i of the crop is the mean of the pixels i enlarged to (i + 1) enlarged - 1 of the enlarged one.
        start, expected = ((((p + 0.5) * self.enlarged - 0.5)[:, None]).astype(np.float32) for p in (before, guess))
        after, there, _ = self.cv2.calcOpticalFlowPyrLK(f, g, start, expected.copy(), **self.options)
        back, again, _ = self.cv2.calcOpticalFlowPyrLK(g, f, after, start.copy(), **self.options)
        returned = np.abs(back - start)[:, 0].max(-1) < MAX_RETURN_PX * self.enlarged
        good = (there[:, 0] == 1) & (again[:, 0] == 1) & returned
        return (after[:, 0].astype(np.float64) + 0.5) / self.enlarged - 0.5, good


def rigid_fit(before: Array, after: Array, radius: float) -> tuple[Array, float, int]:
    """Rigid motion of an orthographic sphere from points (m, 2) relative to the centre before the motion, px.

    With the mean ``M`` of a surface point's places before and after (each from its own centre), the displacement of a
    finite rotation is exactly ``2 c x M``, ``c`` the axis times the tangent of half the angle (Cayley's form). The
    centre after the motion enters ``M``, so the fit is repeated; Tukey's biweight takes care of points gone astray.

    Returns
    -------
    q : ndarray
        (5,) as (dx, dy, wx, wy, wz), px and rad.
    scatter : float
        Robust standard deviation of the points about the fit, px.
    used : int
        Points with a weight.
    """
    q, weights = np.zeros(5), np.ones(len(before))
    moved = after - before
    q[:2] = np.median(moved, axis=0)
    for _ in range(ROUNDS):
        there = after - q[:2]
        x, y = (0.5 * (before + there)).T
        s = 0.5 * (_depth(before, radius) + _depth(there, radius))
        one, none = np.ones_like(x), np.zeros_like(x)
        along_x = np.stack((one, none, none, -2 * s, -2 * y), -1)
        along_y = np.stack((none, one, 2 * s, none, 2 * x), -1)
        root = np.sqrt(weights)
        design = np.concatenate((root[:, None] * along_x, root[:, None] * along_y))
        q = np.linalg.lstsq(design, np.concatenate((root * moved[:, 0], root * moved[:, 1])), rcond=None)[0]
        rest = np.hypot(moved[:, 0] - along_x @ q, moved[:, 1] - along_y @ q)
        # Median of the length of a two-dimensional Gaussian: 1.1774 standard deviations.
        scatter = float(np.median(rest)) / 1.1774
        weights = np.clip(1 - (rest / (TUKEY * max(scatter, 1e-3))) ** 2, 0, None) ** 2
    half_tangent = float(np.linalg.norm(q[2:]))
    q[2:] *= 2 * math.atan(half_tangent) / half_tangent if half_tangent > 0 else 2.0
    return q, scatter, int((weights > 0).sum())


def _prepared(cv2: Any, image: Image, gain: float, enlarged: int, blur: float) -> Any:
    """The crop blurred and enlarged, 8 bit; rounded last, so that the blur's finer levels are not lost twice."""
    image = cv2.GaussianBlur(image, (0, 0), blur) if blur > 0 else image
    if enlarged > 1:
        image = cv2.resize(image, None, fx=enlarged, fy=enlarged, interpolation=cv2.INTER_CUBIC)
    return extras.eight_bit(image, gain)


def _grid(radius: float, spacing: float) -> Array:
    """Points (m, 2) of a square grid within ``radius`` of its middle point, px."""
    steps = np.arange(-math.floor(radius / spacing), math.floor(radius / spacing) + 1) * spacing
    x, y = np.meshgrid(steps, steps)
    inside = np.hypot(x, y) <= radius
    return np.stack((x[inside], y[inside]), -1)


def _depth(points: Array, radius: float) -> Array:
    """Height (m,) of the surface above the plane of the outline at the points (m, 2), px."""
    return np.sqrt(np.clip(radius**2 - (points**2).sum(-1), 0, None))


def _swept(points: Array, turn: Array, radius: float) -> Array:
    """Displacement (m, 2) of the points by a small rotation, px."""
    s = _depth(points, radius)
    return np.stack((-s * turn[1] - points[:, 1] * turn[2], s * turn[0] + points[:, 0] * turn[2]), -1)
