"""The frame loop of the baselines: predict the motion, measure a frame, go on from the last frame with a result."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from torchsphere.benchmark.baselines.baseline import Baseline, Progress
from torchsphere.correlation import frame_status
from torchsphere.geometry.circle import Circle
from torchsphere.imaging import crop, template_matching
from torchsphere.recording.frame_source import Source
from torchsphere.runtime.arrays import Array
from torchsphere.settings.arrays import check_circle

Image = NDArray[np.float32]

#: Smallest share of the disc in the image; `torchsphere.track` uses the same (docs/constants.toml).
MIN_IN_FRAME = 0.5

#: Largest distance of a measured centre from the expected centre, as a share of the radius (docs/constants.toml).
MAX_JUMP = 0.5

#: Smallest standard deviation of a disc's grey levels, as a share of that in the first frame (docs/constants.toml).
MIN_POWER = 0.2


@dataclass(frozen=True)
class Pair:
    """Crops around the ball in the last frame with a result, ``f``, and in the frame to be measured, ``g``."""

    f: Image  # grey levels (s, s); border values outside the image
    g: Image  # grey levels (s, s)
    centre_f: Array  # centre (2,) of the ball in f, px of the crop
    centre_g: Array  # expected centre (2,) in g, px of the crop
    rotation: Array  # expected rotation (3,), rad
    radius: float  # of the ball, px


#: A method: pair -> the ball's centre (2,) in ``g``, px of the crop; its rotation (3,), rad, with NaN for components
#: that are not measured; a status.
Measure = Callable[[Pair], tuple[Array, Array, str]]

#: Position, increment and status, as in `Baseline`.
Motion = tuple[Array, Array, NDArray[np.str_]]

NO_ROTATION: Array = np.full(3, np.nan)
NO_MOTION: Array = np.full(5, np.nan)


@dataclass(frozen=True)
class _Task:
    """The values that are the same for all frames of a recording."""

    measure: Measure
    radius: float  # of the ball, px
    half: int  # half the side of the crops, px
    power: float  # standard deviation of the ball's grey levels in the first frame


def failure(status: str) -> tuple[Array, Array, str]:
    """The result of a method that found nothing."""
    return np.full(2, np.nan), NO_ROTATION, status


def opened(images: Any, circle: Any) -> tuple[Source, Circle]:
    """Images, float32 on the CPU, and the outline in the first image; ValueError if they do not fit."""
    source, circle = Source.open(images, "cpu"), Circle.of(circle)
    if circle.frame != 0:
        raise ValueError(f"circle: it was found in frame {circle.frame}; give the outline in the first frame, 0")
    shape = source.images(0, 1)[0].shape
    check_circle(torch.tensor([[circle.x, circle.y, circle.radius]], dtype=torch.float64), shape)
    return source, circle


def follow(
    source: Source,
    circle: Circle,
    measure: Measure,
    *,
    half: int,
    finds_first: bool = False,
    progress: Progress | None = None,
) -> Motion:
    """Measure each frame against the last frame with a result, on crops of ``2 half + 1`` px.

    ``finds_first`` says that the method works on a single image, so that frame 0 is measured instead of taken from
    ``circle``.
    """
    n = source.count
    position, increment = np.full((n, 2), np.nan), np.full((n - 1, 5), np.nan)
    status = frame_status.of_unmeasured(n)
    centre, f = np.array([circle.x, circle.y]), source.images(0, 1)[0]
    task = _Task(measure, circle.radius, half, _power(f, centre, circle.radius))
    found, status[0] = _measured(task, f, f, centre, np.zeros(5)) if finds_first else (np.zeros(5), "ok")
    if status[0] == "ok":
        centre = position[0] = centre + found[:2]
    last, rate = 0, None
    for frame in range(1, n):
        g, gap = source.images(frame, frame + 1)[0], frame - last
        q, word = _advance(task, f, g, centre, None if rate is None else rate * gap)
        if word == "ok":
            centre = position[frame] = centre + q[:2]
            consecutive = gap == 1 and np.isfinite(position[last, 0])
            if consecutive:
                increment[frame - 1] = q
            last, f, rate = frame, g, np.nan_to_num(q) / gap
            word = "ok" if consecutive else "lost"
        status[frame] = word
        if progress is not None:
            progress(frame + 1, n)
    return position, increment, status


def result(began: float, measured: Motion, method: str, circle: Circle, **settings: Any) -> Baseline:
    """The motion with its settings and the time since ``began`` (`time.perf_counter`)."""
    given = {"method": method, "circle": (circle.x, circle.y, circle.radius)}
    return Baseline(*measured, seconds=time.perf_counter() - began, settings=given | settings)


def _advance(task: _Task, f: Tensor, g: Tensor, centre: Array, expected: Array | None) -> tuple[Array, str]:
    """Motion (5,) from ``f`` to ``g``: first from the ``expected`` motion, then from a search over the image."""
    if expected is not None:
        q, status = _measured(task, f, g, centre, expected)
        if status == "ok":
            return q, status
    match = template_matching.best_match(f, g, torch.from_numpy(centre), task.radius).numpy()
    q, searched = _measured(task, f, g, centre, np.concatenate((match - centre, np.zeros(3))))
    # A search has a result in any image, so the status of the expected motion is the better reason.
    return q, searched if searched == "ok" or expected is None else status


def _measured(task: _Task, f: Tensor, g: Tensor, centre: Array, guess: Array) -> tuple[Array, str]:
    """Motion (5,) from ``f`` to ``g`` and its status, measured around the ``guess`` (5,)."""
    expected = centre + guess[:2]
    if _disc(expected, task.radius, g.shape)[2].mean() < MIN_IN_FRAME:
        return NO_MOTION, "out_of_frame"
    if _power(g, expected, task.radius) < MIN_POWER * task.power:
        return NO_MOTION, "lost"
    crop_f, crop_g = (
        crop.cut(image[None], torch.from_numpy(c)[None], task.half) for image, c in ((f, centre), (g, expected))
    )
    origin_f, origin_g = crop_f.origin[0].numpy(), crop_g.origin[0].numpy()
    images = crop_f.images[0].numpy(), crop_g.images[0].numpy()
    pair = Pair(*images, centre - origin_f, expected - origin_g, guess[2:], task.radius)
    found, rotation, status = task.measure(pair)
    if status == "ok" and not float(np.hypot(*(found - pair.centre_g))) < MAX_JUMP * task.radius:
        status = "lost"
    return np.concatenate((found + origin_g - centre, rotation)), status


def _disc(centre: Array, radius: float, shape: torch.Size) -> tuple[Array, Array, NDArray[np.bool_]]:
    """Columns and rows (m,) of a grid over 0.9 of the disc, whole px, and which of them lie in the image."""
    steps = np.linspace(-0.9, 0.9, 31) * radius
    x, y = np.meshgrid(steps, steps)
    inside = np.hypot(x, y) <= 0.9 * radius
    column, row = np.rint(x[inside] + centre[0]), np.rint(y[inside] + centre[1])
    height, width = shape
    return column, row, (column >= 0) & (column < width) & (row >= 0) & (row < height)


def _power(image: Tensor, centre: Array, radius: float) -> float:
    """Standard deviation of the grey levels of the disc's part in the image."""
    column, row, inside = _disc(centre, radius, image.shape)
    return float(image[row[inside].astype(int), column[inside].astype(int)].std()) if inside.sum() > 1 else 0.0
