"""Hough: OpenCV's ``HoughCircles`` on the silhouette of the ball in each frame."""

from __future__ import annotations

import math
import time
from typing import Any

import numpy as np
from numpy.typing import NDArray

from torchsphere.benchmark.baselines import extras
from torchsphere.benchmark.baselines.baseline import Baseline, Progress
from torchsphere.benchmark.baselines.edge_fit import behind, without
from torchsphere.benchmark.baselines.stepwise import NO_ROTATION, NOWHERE, Array, Pair, follow, opened, result
from torchsphere.geometry.circle import Circle
from torchsphere.recording.frame_source import Source

#: Share of the circle that the silhouette must fill: less is an edge that happens to be round.
MIN_FILLED = 0.3

#: Least height of the silhouette's threshold, as a share of the ball's contrast; for images without noise.
MIN_LEVEL = 0.05

#: Enlargement of the crops, at most: the accumulator's cells are then an eighth of a px.
MAX_ENLARGED = 8


def hough(
    images: Any,
    circle: Any,
    *,
    cells_per_radius: float = 300.0,
    closing: float = 0.3,
    blur_px: float = 0.7,
    sigmas: float = 5.0,
    play_px: float = 2.0,
    progress: Progress | None = None,
) -> Baseline:
    """Follow the ball by the best circle in each frame; measures dx and dy.

    The paper's own rival (its table 2), tuned so that nobody can say it was not. A speckled ball has edges everywhere,
    so the edges of its silhouette are taken: the background (what each pixel shows while the ball is elsewhere, for
    which a rough pass over the plain images tells where the ball is) is subtracted, the difference thresholded and
    closed, and the crop enlarged so that the accumulator has cells of a fraction of a px. Standard deviation of one
    coordinate of the position, measured on 30 to 60 frames of the example shot (R = 50 px):

    - on the plain image 0.8 to 1.2 px, on the difference's absolute value 0.5 to 0.9, on the silhouette 0.15 to 0.30
      where it is enlarged and 0.7 to 0.9 where it is not;
    - ``cells_per_radius`` 300, an enlargement of 6: 0.13; of 4 0.16, of 8 0.12 for twice the time; an accumulator
      coarser than the pixels (dp = 2) 0.4. "HOUGH_GRADIENT_ALT", OpenCV's sub-pixel variant, 0.7 to 1.2 on whatever;
    - ``closing`` 0.3 of the radius: 0.13 against 0.16 at 0.2; ``blur_px`` 0.7: 1.5 makes it 0.2; a blur before the
      threshold 0.26 and more; ``sigmas`` from 3 to 10 and ``play_px`` from 1 to 5 change nothing.

    Parameters
    ----------
    images, circle, progress
        As in `Tracker`.
    cells_per_radius : float
        Fineness of the accumulator.
    closing : float
        Diameter of the closing of the silhouette as a share of the radius: speckles as bright as the background.
    blur_px : float
        Blur of the silhouette, px.
    sigmas : float
        Threshold of the silhouette in standard deviations of the noise.
    play_px : float
        How far the radius may differ from that of ``circle``, px.
    """
    cv2, (source, first) = extras.load("cv2"), opened(images, circle)
    began = time.perf_counter()
    up = min(max(round(cells_per_radius / first.radius), 1), MAX_ENLARGED)
    half = math.ceil(1.1 * first.radius) + 9
    moving = without(source, behind(source, _roughly(cv2, source, first, half, play_px), first))
    level = _threshold(moving.images(0, 1)[0].numpy(), first, sigmas)
    size = 2 * round(0.5 * closing * first.radius) + 1
    element = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (size, size))

    def measure(pair: Pair) -> tuple[Array, Array, str]:
        ball = (np.abs(pair.g) > level).astype(np.uint8)
        ball = cv2.morphologyEx(cv2.morphologyEx(ball, cv2.MORPH_CLOSE, element), cv2.MORPH_OPEN, element)
        large = cv2.resize(255 * ball, None, fx=up, fy=up, interpolation=cv2.INTER_CUBIC)
        found = _circle(cv2, cv2.GaussianBlur(large, (0, 0), blur_px * up), up, pair.radius, play_px)
        if found is None or _filled(ball, found, pair.radius) < MIN_FILLED:
            return NOWHERE, NO_ROTATION, "lost"
        return found, NO_ROTATION, "ok"

    measured = follow(moving, first, measure, half=half, finds_first=True, progress=progress)
    settings = {"enlarged": up, "closing": closing, "blur_px": blur_px, "sigmas": sigmas, "play_px": play_px}
    return result(began, measured, "OpenCV HoughCircles", first, **settings)


def _roughly(cv2: Any, source: Source, first: Circle, half: int, play_px: float) -> Array:
    """Centres (n, 2) from the edges of the images as they are, good to a px or two: where the background is not."""
    gain = extras.eight_bit_gain(source.images(0, 1)[0].numpy())

    def measure(pair: Pair) -> tuple[Array, Array, str]:
        image = cv2.GaussianBlur(extras.eight_bit(pair.g, gain), (0, 0), 1.5)
        found = _circle(cv2, image, 1, pair.radius, play_px)
        return (NOWHERE, NO_ROTATION, "lost") if found is None else (found, NO_ROTATION, "ok")

    return follow(source, first, measure, half=half, finds_first=True)[0]


def _circle(cv2: Any, image: NDArray[np.uint8], up: int, radius: float, play: float) -> Array | None:
    """Centre (2,) of the best circle in the image, which is enlarged ``up`` times; px of the image before that."""
    limits = {"minRadius": math.floor((radius - play) * up), "maxRadius": math.ceil((radius + play) * up)}
    # One circle per image, dp = 1 (a cell per px of the enlarged image); a vote of 8 is little, the best one counts.
    found = cv2.HoughCircles(image, cv2.HOUGH_GRADIENT, 1, 2 * max(image.shape), param1=100, param2=8, **limits)
    if found is None or np.size(found) == 0:
        return None
    centre = np.asarray(found, dtype=np.float64).reshape(-1, 3)[0, :2]
    return np.asarray((centre + 0.5) / up - 0.5)


def _filled(ball: NDArray[np.uint8], centre: Array, radius: float) -> float:
    """Share of the circle that the silhouette fills."""
    y, x = np.indices(ball.shape)
    return float(ball[np.hypot(x - centre[0], y - centre[1]) <= radius].mean())


def _threshold(difference: NDArray[np.float32], circle: Circle, sigmas: float) -> float:
    """Difference from the background, grey levels, from which a pixel belongs to the ball."""
    y, x = np.indices(difference.shape)
    distance = np.hypot(x - circle.x, y - circle.y)
    ball, around = (np.abs(difference[part]) for part in (distance < circle.radius, distance > 1.1 * circle.radius))
    noise = 1.4826 * float(np.median(around)) if around.size else 0.0
    return max(sigmas * noise, MIN_LEVEL * float(np.quantile(ball, 0.95)))
