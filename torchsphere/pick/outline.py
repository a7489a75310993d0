"""The ball's circle on the page: found as a measurement finds it, fitted near a drawn one, and its edge unrolled."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import torch
from numpy.typing import NDArray

from torchsphere.detection import detect
from torchsphere.geometry.circle import Circle
from torchsphere.imaging import polar
from torchsphere.pick.footage import Footage
from torchsphere.runtime import threads
from torchsphere.settings.arrays import as_mask, check_circle
from torchsphere.tracking.start import found_in

#: Reach of the unrolled edge to both sides of the circle, px and share of the radius, and its sampling, px.
REACH_PX, REACH, SPACING_PX = 12.0, 0.5, 0.5

#: Reach of the fit from a drawn circle, share of the radius (docs/constants.toml).
FIT_REACH = 0.15


@dataclass(frozen=True)
class Found:
    """The circle that was found, in its frame of the recording, and sentences on what is in doubt."""

    circle: Circle
    sentences: tuple[str, ...] = ()


@dataclass(frozen=True)
class Edge:
    """Grey levels along the rays of a circle, from inside to outside."""

    levels: NDArray[np.float64]  # (a, m), NaN where the image shows no such place
    steps: NDArray[np.float64]  # (m,) distances from the circle, px outwards

    @property
    def mean(self) -> NDArray[np.float64]:
        """Mean level (m,) at each distance; NaN where no ray has one."""
        known = np.isfinite(self.levels)
        total = np.where(known, self.levels, 0.0).sum(0)
        return np.divide(total, known.sum(0), out=np.full(len(self.steps), np.nan), where=known.any(0))


@threads.single_threaded_torch()
def find_ball(
    footage: Footage,
    start: int,
    stop: int,
    ignore: NDArray[np.bool_] | None = None,
    check: Callable[[], None] = lambda: None,
) -> Found:
    """The circle that a measurement of the frames ``start`` to ``stop - 1`` finds; raises ValueError without one.

    ``check`` is called again and again, and may raise to give the search up.
    """
    source = footage.source(start, stop, check).standardised()
    mask = None if ignore is None else as_mask(ignore, source.images(0, 1))
    circle = found_in(source, mask).start.circle
    circle = dataclasses.replace(circle, frame=start + circle.frame)
    where = "here"
    doubts = (circle.choice(where), circle.warning(where) if circle.doubt else "")
    return Found(circle, tuple(sentence for sentence in doubts if sentence))


@threads.single_threaded_torch()
def fit_circle(footage: Footage, circle: Circle) -> Found:
    """The ``circle`` fitted to the edge near it in its frame; raises ValueError where the image shows none."""
    image = torch.from_numpy(footage.image(circle.frame))
    _check(circle, image)
    fitted = detect.refine_circle(image, circle, window=max(2.0, FIT_REACH * circle.radius))
    return Found(fitted, (f"The fitted circle is in doubt: {fitted.doubt}.",) if fitted.doubt else ())


@threads.single_threaded_torch()
def unrolled_edge(footage: Footage, circle: Circle) -> Edge:
    """Grey levels around the edge of the ``circle`` in its frame; raises ValueError for a circle out of the image."""
    image = torch.from_numpy(footage.image(circle.frame))
    _check(circle, image)
    reach = min(REACH_PX, REACH * circle.radius)
    steps = torch.arange(-reach, reach + SPACING_PX / 2, SPACING_PX, dtype=torch.float64)
    row = torch.tensor([[circle.x, circle.y, circle.radius]], dtype=torch.float64)
    radii = (row[:, 2:, None] + steps).clamp_min(0.5)
    levels, inside = polar.levels(polar.Splines(image[None]), row, radii, polar.angles(circle.radius))
    known = torch.where(inside, levels.double(), torch.nan)
    return Edge(known[0].numpy(), steps.numpy())


def _check(circle: Circle, image: torch.Tensor) -> None:
    check_circle(torch.tensor([[circle.x, circle.y, circle.radius]], dtype=torch.float64), image.shape)
