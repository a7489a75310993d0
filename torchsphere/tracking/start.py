"""The start of a measurement: the circle of one frame, with options that suit its ball."""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass
from typing import Any

from torch import Tensor

from torchsphere.correlation.options import Options
from torchsphere.errors.edge_leakage import adapt_options, background_contrast
from torchsphere.geometry.camera import Camera
from torchsphere.geometry.circle import Circle
from torchsphere.tracking.initial_circle import find_initial_circle
from torchsphere.tracking.task import Task


@dataclass(frozen=True)
class Start:
    """The circle that is followed, and how."""

    circle: Circle
    image: Tensor  # grey levels (h, w) of the circle's frame
    contrast: float  # of the background against the ball, see `background_contrast`
    options: Options  # adapted to the ball
    given: frozenset[str] = frozenset()  # names of the options that were given, not adapted
    grows: bool = False  # whether the ball comes nearer or goes away, which nobody said

    @property
    def is_camera_assumed(self) -> bool:
        """Whether the camera was not given: a ball that grows is followed with one that is far away."""
        return self.grows and "camera" not in self.given

    @property
    def known_camera(self) -> Camera | None:
        """The camera, unless it is assumed."""
        return None if self.is_camera_assumed else self.options.camera

    def at(self, circle: Circle) -> Start:
        """The start with another circle of the same frame."""
        return dataclasses.replace(self, circle=dataclasses.replace(circle, frame=self.circle.frame))


def first_start(task: Task, settings: Options, given: dict[str, Any]) -> Start:
    """Find or check the circle, and adapt the ``settings`` to the ball; options that were ``given`` stay."""
    circle, settings = find_initial_circle(task.source, task.circle, task.ignore, task.refine, settings)
    image = task.source.images(circle.frame, circle.frame + 1)[0]
    contrast = background_contrast(image, circle, task.ignore)
    options = adapt_options(settings, given, circle.radius, contrast)
    return Start(circle, image, contrast, options, frozenset(given))
