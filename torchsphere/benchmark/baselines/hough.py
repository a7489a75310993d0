"""Hough: OpenCV's ``HoughCircles`` on the silhouette of the ball in each frame."""

from __future__ import annotations

import math
import time
from typing import Any

import numpy as np
from numpy.typing import NDArray

from torchsphere.benchmark.baselines.baseline import Baseline, Progress, eight_bit, eight_bit_gain, load
from torchsphere.benchmark.baselines.edge_fit import still_background, subtract_background
from torchsphere.benchmark.baselines.frame_loop import NO_ROTATION, Pair, failure, follow, opened, result
from torchsphere.geometry.circle import Circle
from torchsphere.recording.frame_source import Source
from torchsphere.runtime.arrays import Array

#: Accumulator cells per radius, by enlargement of the crops (docs/constants.toml).
CELLS_PER_RADIUS = 300.0

#: Diameter of the closing of the silhouette as a share of the radius (docs/constants.toml).
CLOSING = 0.3

#: Blur of the silhouette, px (docs/constants.toml).
BLUR_PX = 0.7

#: Threshold of the silhouette in standard deviations of the noise (docs/constants.toml).
SIGMAS = 5.0

#: Largest deviation of the radius from the given circle's, px (docs/constants.toml).
PLAY_PX = 2.0

#: Smallest share of the circle that the silhouette of a ball fills (docs/constants.toml).
MIN_FILLED = 0.3

#: Smallest threshold of the silhouette as a share of the ball's contrast; for images without noise
#: (docs/constants.toml).
MIN_LEVEL = 0.05

#: Largest enlargement of the crops; the accumulator's cells are then an eighth of a px (docs/constants.toml).
MAX_ENLARGED = 8


def hough(
    images: Any,
    circle: Any,
    *,
    cells_per_radius: float = CELLS_PER_RADIUS,
    closing: float = CLOSING,
    blur_px: float = BLUR_PX,
    sigmas: float = SIGMAS,
    play_px: float = PLAY_PX,
    progress: Progress | None = None,
) -> Baseline:
    """Follow the ball by the best circle in each frame, as in the paper's table 2; measures dx and dy.

    A speckled ball has edges everywhere, so only the edges of its silhouette are used: the difference from the still
    background, after a threshold and a closing. A first pass over the plain images finds the ball roughly, which the
    background needs. The crops are enlarged so that an accumulator cell is a fraction of a px.
    """
    cv2, (source, first) = load("cv2"), opened(images, circle)
    began = time.perf_counter()
    enlarged = min(max(round(cells_per_radius / first.radius), 1), MAX_ENLARGED)
    half = math.ceil(1.1 * first.radius) + 9
    rough = _rough_positions(cv2, source, first, half, play_px)
    moving = subtract_background(source, still_background(source, rough, first))
    level = _threshold(moving.images(0, 1)[0].numpy(), first, sigmas)
    size = 2 * round(0.5 * closing * first.radius) + 1
    element = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (size, size))

    def measure(pair: Pair) -> tuple[Array, Array, str]:
        ball = (np.abs(pair.g) > level).astype(np.uint8)
        ball = cv2.morphologyEx(cv2.morphologyEx(ball, cv2.MORPH_CLOSE, element), cv2.MORPH_OPEN, element)
        large = cv2.resize(255 * ball, None, fx=enlarged, fy=enlarged, interpolation=cv2.INTER_CUBIC)
        large = cv2.GaussianBlur(large, (0, 0), blur_px * enlarged)
        centre = _best_circle(cv2, large, enlarged, pair.radius, play_px)
        if centre is None or _filled_share(ball, centre, pair.radius) < MIN_FILLED:
            return failure("lost")
        return centre, NO_ROTATION, "ok"

    measured = follow(moving, first, measure, half=half, finds_first=True, progress=progress)
    settings = {"enlarged": enlarged, "closing": closing, "blur_px": blur_px, "sigmas": sigmas, "play_px": play_px}
    return result(began, measured, "OpenCV HoughCircles", first, **settings)


def _rough_positions(cv2: Any, source: Source, first: Circle, half: int, play_px: float) -> Array:
    """Centres (n, 2) from the edges of the plain images, right to one or two px."""
    gain = eight_bit_gain(source.images(0, 1)[0].numpy())

    def measure(pair: Pair) -> tuple[Array, Array, str]:
        image = cv2.GaussianBlur(eight_bit(pair.g, gain), (0, 0), 1.5)
        centre = _best_circle(cv2, image, 1, pair.radius, play_px)
        return failure("lost") if centre is None else (centre, NO_ROTATION, "ok")

    return follow(source, first, measure, half=half, finds_first=True)[0]


def _best_circle(cv2: Any, image: NDArray[np.uint8], enlarged: int, radius: float, play_px: float) -> Array | None:
    """Centre (2,) of the best circle in the enlarged image, px of the image before its enlargement."""
    limits = {
        "minRadius": math.floor((radius - play_px) * enlarged),
        "maxRadius": math.ceil((radius + play_px) * enlarged),
    }
    # dp = 1: a cell per px of the enlarged image. A distance above the image's size leaves the best circle alone.
    found = cv2.HoughCircles(image, cv2.HOUGH_GRADIENT, 1, 2 * max(image.shape), param1=100, param2=8, **limits)
    if found is None or np.size(found) == 0:
        return None
    centre = np.asarray(found, dtype=np.float64).reshape(-1, 3)[0, :2]
    return np.asarray((centre + 0.5) / enlarged - 0.5)


def _filled_share(ball: NDArray[np.uint8], centre: Array, radius: float) -> float:
    """Share of the circle that the silhouette fills."""
    y, x = np.indices(ball.shape)
    return float(ball[np.hypot(x - centre[0], y - centre[1]) <= radius].mean())


def _threshold(difference: NDArray[np.float32], circle: Circle, sigmas: float) -> float:
    """Smallest difference of a ball's pixel from the background, grey levels."""
    y, x = np.indices(difference.shape)
    distance = np.hypot(x - circle.x, y - circle.y)
    ball, around = (np.abs(difference[part]) for part in (distance < circle.radius, distance > 1.1 * circle.radius))
    noise = 1.4826 * float(np.median(around)) if around.size else 0.0
    return max(sigmas * noise, MIN_LEVEL * float(np.quantile(ball, 0.95)))
