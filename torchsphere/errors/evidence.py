"""What the sources of error are found by, beside the track itself."""

from __future__ import annotations

import functools
from collections.abc import Container
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from torch import Tensor

from torchsphere.correlation.options import Options
from torchsphere.errors.background_blocks import background_blocks
from torchsphere.geometry.circle import Circle
from torchsphere.recording.frame_source import Source


@dataclass(frozen=True)
class Evidence:
    """The images, and how the motion of their n frames was measured."""

    source: Source
    ignore: Tensor | None  # (h, w), True for pixels to ignore
    image: Tensor  # grey levels (h, w) of the first circle's frame
    contrast: float  # of the background against the ball: `edge_leakage.background_contrast`
    options: Options  # adapted to the ball
    given: Container[str]  # names of the options that were given, not chosen
    exposure: float | None  # over the time between frames, as it was stated
    position: NDArray[np.float64]  # (n, 2), px, NaN where unknown
    circle: Circle  # with the radius of the map
    on_map: NDArray[np.bool_]  # (n,), True for a frame whose pose is on a map
    uneven_light: float  # share of the steps to a frame into which an object took light from one side of the ball
    residual_factors: NDArray[np.float64]  # (n - 1, 5), in the standard deviations of the steps: `residual_scatter`
    unseen_step_px: tuple[float, float] = (0.0, 0.0)  # sd of a steady step that the limbs of a ball in place hide

    @functools.cached_property
    def blocks(self) -> list[Tensor]:
        """Blocks of the still background: `background_blocks`."""
        return background_blocks(self.source, self.position, self.circle.radius, self.ignore)
