"""The loop that all rivals share: predict, measure one frame, go on from it; what fails is flagged and passed over."""

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
from torchsphere.correlation.result import STATUSES
from torchsphere.geometry.circle import Circle
from torchsphere.imaging import crop, template_matching
from torchsphere.recording.frame_source import Source
from torchsphere.settings.arrays import check_circle

Array = NDArray[np.float64]
Image = NDArray[np.float32]

#: Share of the disc in the image below which the ball counts as out of it; `torchsphere.track` uses the same.
MIN_IN_FRAME = 0.5

#: Farthest that a measurement may lie from where it was looked for, as a share of the radius. The guess is the last
#: motion, or a template match that is right to a tenth of the radius: what lies farther away is another thing.
MAX_JUMP = 0.5

#: Standard deviation of the grey levels of a disc, as a share of that in the first frame, below which the ball is not
#: there: a blank frame correlates with nothing, but several of the methods do not say so.
MIN_POWER = 0.2


@dataclass(frozen=True)
class Pair:
    """Crops around the ball in the frame it was last seen in and in the one to be measured.

    Attributes
    ----------
    f, g : ndarray
        Grey levels (s, s), float32; beyond the image's border the border's own values.
    centre_f : ndarray
        Centre of the ball (2,) in ``f``, px of the crop.
    centre_g : ndarray
        Where it is looked for in ``g`` (2,), px of the crop.
    turn : ndarray
        Rotation (3,) to be expected, rad.
    radius : float
        Of the ball, px.
    """

    f: Image
    g: Image
    centre_f: Array
    centre_g: Array
    turn: Array
    radius: float


#: A method: the pair -> the ball's centre in ``g`` (2,), px of the crop, its rotation (3,) in rad with NaN for what the
#: method does not measure, and a status.
Measure = Callable[[Pair], tuple[Array, Array, str]]

#: Position, increment and status, as in `Baseline`.
Motion = tuple[Array, Array, NDArray[np.str_]]

NO_ROTATION: Array = np.full(3, np.nan)
NOWHERE: Array = np.full(2, np.nan)
NOT_MEASURED: Array = np.full(5, np.nan)


@dataclass(frozen=True)
class _Task:
    """What stays the same over a recording."""

    measure: Measure
    radius: float
    half: int
    power: float


def opened(images: Any, circle: Any) -> tuple[Source, Circle]:
    """Images and circle in the forms that the methods use; ValueError where they do not fit.

    Returns
    -------
    source : Source
        The images, float32 on the CPU.
    circle : Circle
        The outline in the first image.
    """
    source = Source.open(images, "cpu")
    if not isinstance(circle, Circle):
        try:
            x, y, radius = (float(v) for v in circle)
        except (TypeError, ValueError) as error:
            raise ValueError(f"circle: expected three numbers (x, y, radius) in px, got {circle!r}") from error
        circle = Circle(x, y, radius)
    first = source.images(0, 1)[0]
    if circle.frame != 0:
        raise ValueError(f"circle: it was found in frame {circle.frame}; give the outline in the first frame, 0")
    check_circle(torch.tensor([[circle.x, circle.y, circle.radius]], dtype=torch.float64), first.shape)
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
    """Measure frame after frame, each against the last one in which the ball was seen.

    Parameters
    ----------
    source : Source
        The images.
    circle : Circle
        Outline of the ball in the first image.
    measure : callable
        The method.
    half : int
        Half the side of the crops, px.
    finds_first : bool
        The method finds the ball in a single image, and so in the first one, too; otherwise it is where ``circle`` is.
    progress : callable, optional
        Called as ``progress(done, total)`` with numbers of frames.

    Returns
    -------
    position, increment, status
        As in `Baseline`.
    """
    n = source.count
    position, increment = np.full((n, 2), np.nan), np.full((n - 1, 5), np.nan)
    status = np.full(n, "lost", dtype=f"<U{max(map(len, STATUSES))}")
    here, f = np.array([circle.x, circle.y]), source.images(0, 1)[0]
    task = _Task(measure, circle.radius, half, _power(f, here, circle.radius))
    found, status[0] = _measured(task, f, f, here, np.zeros(5)) if finds_first else (np.zeros(5), "ok")
    if status[0] == "ok":
        here = position[0] = here + found[:2]
    last, rate = 0, None
    for at in range(1, n):
        g, gap = source.images(at, at + 1)[0], at - last
        q, word = _advance(task, f, g, here, None if rate is None else rate * gap)
        if word == "ok":
            here = position[at] = here + q[:2]
            consecutive = gap == 1 and np.isfinite(position[last, 0])
            if consecutive:
                increment[at - 1] = q
            last, f, rate = at, g, np.nan_to_num(q) / gap
            word = "ok" if consecutive else "lost"
        status[at] = word
        if progress is not None:
            progress(at + 1, n)
    return position, increment, status


def result(began: float, measured: Motion, method: str, circle: Circle, **settings: Any) -> Baseline:
    """Join what was measured since ``began`` (`time.perf_counter`) with the settings it was measured with."""
    given = {"method": method, "circle": (circle.x, circle.y, circle.radius)}
    return Baseline(*measured, seconds=time.perf_counter() - began, settings=given | settings)


def _advance(task: _Task, f: Tensor, g: Tensor, here: Array, expected: Array | None) -> tuple[Array, str]:
    """Motion (5,) from ``f`` to ``g``: from the ``expected`` one, and if that fails from a search over the image."""
    if expected is not None:
        q, word = _measured(task, f, g, here, expected)
        if word == "ok":
            return q, word
    seen = template_matching.best_match(f, g, torch.from_numpy(here), task.radius).numpy()
    q, again = _measured(task, f, g, here, np.concatenate((seen - here, np.zeros(3))))
    # A search finds something in any image; that the ball was expected outside is the better reason.
    return q, again if again == "ok" or expected is None else word


def _measured(task: _Task, f: Tensor, g: Tensor, here: Array, guess: Array) -> tuple[Array, str]:
    there = here + guess[:2]
    if _in_frame(g, there, task.radius) < MIN_IN_FRAME:
        return NOT_MEASURED, "out_of_frame"
    if _power(g, there, task.radius) < MIN_POWER * task.power:
        return NOT_MEASURED, "lost"
    crop_f, crop_g = (crop.cut(i[None], torch.from_numpy(c)[None], task.half) for i, c in ((f, here), (g, there)))
    origin_f, origin_g = crop_f.origin[0].numpy(), crop_g.origin[0].numpy()
    pair = Pair(
        crop_f.images[0].numpy(), crop_g.images[0].numpy(), here - origin_f, there - origin_g, guess[2:], task.radius
    )
    centre, turn, word = task.measure(pair)
    if word == "ok" and not float(np.hypot(*(centre - pair.centre_g))) < MAX_JUMP * task.radius:
        word = "lost"
    return np.concatenate((centre + origin_g - here, turn)), word


def _disc(centre: Array, radius: float, shape: torch.Size) -> tuple[Array, Array, NDArray[np.bool_]]:
    """Columns and rows (m,) of a grid over 0.9 of the disc, whole px, and which of them lie in the image."""
    steps = np.linspace(-0.9, 0.9, 31) * radius
    x, y = np.meshgrid(steps, steps)
    inside = np.hypot(x, y) <= 0.9 * radius
    column, row = np.rint(x[inside] + centre[0]), np.rint(y[inside] + centre[1])
    height, width = shape
    return column, row, (column >= 0) & (column < width) & (row >= 0) & (row < height)


def _in_frame(image: Tensor, centre: Array, radius: float) -> float:
    """Share of the disc that lies in the image."""
    return float(_disc(centre, radius, image.shape)[2].mean())


def _power(image: Tensor, centre: Array, radius: float) -> float:
    """Standard deviation of the grey levels of the disc, of what of it lies in the image."""
    column, row, inside = _disc(centre, radius, image.shape)
    return float(image[row[inside].astype(int), column[inside].astype(int)].std()) if inside.sum() > 1 else 0.0
