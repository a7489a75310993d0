"""Edge fit: the circle through the ball's outline in each frame, by `torchsphere.detection.outline_fit`."""

from __future__ import annotations

import math
import time
from typing import Any

import numpy as np
import torch
from torch import Tensor

from torchsphere.benchmark.baselines.baseline import Baseline, Progress
from torchsphere.benchmark.baselines.frame_loop import (
    NO_ROTATION,
    Measure,
    Motion,
    Pair,
    failure,
    follow,
    opened,
    result,
)
from torchsphere.detection import outline_fit
from torchsphere.detection.candidates import MIN_SUPPORT
from torchsphere.detection.outline_fit import OutlineFit
from torchsphere.geometry.circle import Circle
from torchsphere.imaging import background as still
from torchsphere.recording.frame_source import Source
from torchsphere.runtime.arrays import Array

#: Largest distance of the edge from its expected place, as a share of the radius, and its least value, px
#: (docs/constants.toml).
WINDOW, MIN_WINDOW_PX = 0.06, 2.0

#: Number of fits, each along new rays (docs/constants.toml).
ROUNDS = 4

#: Smallest standard deviation of a textured background, as a multiple of the image noise (docs/constants.toml).
MIN_TEXTURE = 2.0

#: Smallest height of the outline's step as a share of that in the first frame (docs/constants.toml).
MIN_CONTRAST = 0.4


def edge_fit(images: Any, circle: Any, *, progress: Progress | None = None) -> Baseline:
    """Follow the ball by its outline of known radius, each frame separately; measures dx and dy.

    Over a textured background the fit is repeated on the difference from the background.
    """
    source, first = opened(images, circle)
    began = time.perf_counter()
    half = math.ceil(1.1 * first.radius) + 24

    def measured(images: Source, report: Progress | None) -> Motion:
        return follow(images, first, _by_outline(images, first), half=half, finds_first=True, progress=report)

    found = measured(source, progress)
    background = still_background(source, found[0], first)
    textured = _robust_sd(background) > MIN_TEXTURE * _robust_sd(source.images(0, 1)[0] - background)
    if textured:
        found = measured(subtract_background(source, background), None)
    settings = {"window": WINDOW, "rounds": ROUNDS, "fixed_radius": True, "background": textured}
    return result(began, found, "torchsphere.detection.outline_fit", first, **settings)


def still_background(source: Source, position: Array, circle: Circle) -> Tensor:
    """Still background (h, w) behind a ball at ``position`` (n, 2), px; a NaN in frame 0 is replaced by ``circle``."""
    places = position.copy()
    if not np.isfinite(places[0]).all():
        places[0] = circle.x, circle.y
    return still.background(source, places, circle.radius).float()


def subtract_background(source: Source, background: Tensor) -> Source:
    """The images minus the ``background`` (h, w)."""
    return Source(lambda a, b: source.images(a, b) - background, source.count, source.device, source.dtype)


def _robust_sd(image: Tensor) -> float:
    """Standard deviation of the grey levels, from their median distance from the median."""
    return 1.4826 * float((image - image.median()).abs().median())


def _by_outline(source: Source, circle: Circle) -> Measure:
    """The measurement of a frame: the circle through the outline, close to the expected centre."""
    window = max(MIN_WINDOW_PX, WINDOW * circle.radius)
    first = source.images(0, 1)
    given = torch.tensor([[circle.x, circle.y, circle.radius]], dtype=torch.float64)
    plain = outline_fit.is_plain(first[0], given[0])

    def fitted(image: Tensor, guess: Tensor) -> OutlineFit:
        return outline_fit.refine(
            image, guess, window=window, rounds=ROUNDS, fixed_radius=True, plain=plain, patterned=not plain
        )

    min_contrast = MIN_CONTRAST * float(fitted(first, given).contrast[0])

    def measure(pair: Pair) -> tuple[Array, Array, str]:
        guess = torch.tensor([[*pair.centre_g, pair.radius]], dtype=torch.float64)
        fit = fitted(torch.from_numpy(pair.g)[None], guess)
        if not (float(fit.support[0]) >= MIN_SUPPORT and float(fit.contrast[0]) >= min_contrast):
            return failure("lost")
        centre = fit.circle[0, :2].numpy()
        # A result beyond the window of the fit lies on edges of the pattern.
        in_window = float(np.hypot(*(centre - pair.centre_g))) < window
        return (centre, NO_ROTATION, "ok") if in_window else failure("lost")

    return measure
