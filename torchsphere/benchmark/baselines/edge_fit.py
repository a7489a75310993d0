"""Edge fit: the circle through the ball's outline in each frame, by `torchsphere.detection.outline_fit`."""

from __future__ import annotations

import math
import time
from typing import Any

import numpy as np
import torch
from torch import Tensor

from torchsphere.benchmark.baselines.baseline import Baseline, Progress
from torchsphere.benchmark.baselines.stepwise import (
    NO_ROTATION,
    NOWHERE,
    Array,
    Measure,
    Motion,
    Pair,
    follow,
    opened,
    result,
)
from torchsphere.detection import outline_fit
from torchsphere.detection.detect import MIN_SUPPORT
from torchsphere.detection.outline_fit import OutlineFit
from torchsphere.geometry.circle import Circle
from torchsphere.imaging import background as still
from torchsphere.recording.frame_source import Source

#: Spread of the background, against the noise around it, above which it is no uniform one.
MIN_TEXTURE = 2.0

#: Height of the outline's step, against that in the first frame, below which the ball is not there; a plain ball in a
#: blank image would be found in its noise. `torchsphere.track` uses the same.
MIN_CONTRAST = 0.4


def edge_fit(
    images: Any,
    circle: Any,
    *,
    window: float = 0.06,
    rounds: int = 4,
    fixed_radius: bool = True,
    progress: Progress | None = None,
) -> Baseline:
    """Follow the ball by its outline alone; measures dx and dy, each frame by itself.

    Over a background that is not uniform the fit is repeated on the difference from it. The settings are the best of
    those measured (60 frames of the example shot, 30 without rotation, 30 over a textured background; standard
    deviation of the increments):

    - ``window`` 0.06, 3 px at a radius of 50: 0.025 px, as with 2 px; 0.4 px gives 0.042. A window that is wider than
      the speckle needs the silhouette first, without which the fit goes astray (errors of 3 px).
    - ``rounds`` 4: 6 and 8 are no better.
    - ``fixed_radius``: 0.036 px where the radius is fitted, too.
    - without the background: 0.05 px over texture instead of 0.13.

    Parameters
    ----------
    images, circle, progress
        As in `Tracker`.
    window : float
        How far the edge may lie from where it is expected, as a share of the radius; 2 px at least.
    rounds : int
        How often the rays are taken again.
    fixed_radius : bool
        Fit the centre alone, with the radius of ``circle``.
    """
    source, first = opened(images, circle)
    began = time.perf_counter()
    half = math.ceil(1.1 * first.radius) + 24

    def measured(images: Source, report: Progress | None) -> Motion:
        measure = _by_outline(
            images, first, window=max(2.0, window * first.radius), rounds=rounds, fixed_radius=fixed_radius
        )
        return follow(images, first, measure, half=half, finds_first=True, progress=report)

    found = measured(source, progress)
    background = behind(source, found[0], first)
    uneven = spread(background) > MIN_TEXTURE * spread(source.images(0, 1)[0] - background)
    if uneven:
        found = measured(without(source, background), None)
    settings = {"window": window, "rounds": rounds, "fixed_radius": fixed_radius, "background": uneven}
    return result(began, found, "torchsphere.detection.outline_fit", first, **settings)


def behind(source: Source, position: Array, circle: Circle) -> Tensor:
    """Still background (h, w), from where the ball was (n, 2), px; ``circle`` is believed where the first is NaN."""
    places = position.copy()
    if not np.isfinite(places[0]).all():
        places[0] = circle.x, circle.y
    return still.background(source, places, circle.radius).float()


def without(source: Source, background: Tensor) -> Source:
    """The images less the ``background`` (h, w)."""
    return Source(lambda a, b: source.images(a, b) - background, source.count, source.device, source.dtype)


def spread(image: Tensor) -> float:
    """Standard deviation of the grey levels, from the median of their distance from the median."""
    return 1.4826 * float((image - image.median()).abs().median())


def _by_outline(source: Source, circle: Circle, *, window: float, rounds: int, fixed_radius: bool) -> Measure:
    first = source.images(0, 1)
    given = torch.tensor([[circle.x, circle.y, circle.radius]], dtype=torch.float64)
    plain = outline_fit.is_plain(first[0], given[0])

    def fitted(image: Tensor, guess: Tensor) -> OutlineFit:
        return outline_fit.refine(
            image,
            guess,
            window=window,
            rounds=rounds,
            fixed_radius=fixed_radius,
            plain=plain,
            patterned=not plain,
        )

    least = MIN_CONTRAST * float(fitted(first, given).contrast[0])

    def measure(pair: Pair) -> tuple[Array, Array, str]:
        guess = torch.tensor([[*pair.centre_g, pair.radius]], dtype=torch.float64)
        fit = fitted(torch.from_numpy(pair.g)[None], guess)
        if not (float(fit.support[0]) >= MIN_SUPPORT and float(fit.contrast[0]) >= least):
            return NOWHERE, NO_ROTATION, "lost"
        centre = fit.circle[0, :2].numpy()
        # Farther off than the fit can look it has found the pattern's edges.
        near = float(np.hypot(*(centre - pair.centre_g))) < window
        return (centre, NO_ROTATION, "ok") if near else (NOWHERE, NO_ROTATION, "lost")

    return measure
