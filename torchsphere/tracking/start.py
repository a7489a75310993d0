"""The start of a measurement: images as the ball is measured in, and the circle of one frame with options that suit it.

`track`, ``info`` and ``pick`` begin here alike.
"""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass
from typing import Any

from torch import Tensor

from torchsphere.correlation.options import Options
from torchsphere.errors.edge_leakage import adapt_options, background_contrast
from torchsphere.geometry.camera import Camera
from torchsphere.geometry.circle import Circle
from torchsphere.imaging import interlacing
from torchsphere.imaging.colour_mosaic import without_mosaic
from torchsphere.recording.frame_source import Source
from torchsphere.tracking.initial_circle import find_initial_circle, is_interlaced
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


@dataclass(frozen=True)
class Prepared:
    """A task with images without a mosaic of colours and without interlaced rows, and its start."""

    task: Task
    start: Start
    mosaic: tuple[str, ...]  # patterns that the mosaic may have; none for grey images
    interlaced: bool


def prepared(task: Task, settings: Options, given: dict[str, Any]) -> Prepared:
    """Find out what the images are, and the `first_start` in them."""
    source, mosaic = without_mosaic(task.source)
    task = dataclasses.replace(task, source=source)
    start = first_start(task, settings, given)
    interlaced = source.count > 1 and is_interlaced(source, start.circle)
    if interlaced:
        task = dataclasses.replace(task, source=source.changed(interlacing.of_even_rows))
        start = first_start(task, settings, given)
    return Prepared(task, start, mosaic, interlaced)


def found_in(source: Source, ignore: Tensor | None = None) -> Prepared:
    """`prepared` for images of which nothing else is known, as a measurement with all defaults begins."""
    return prepared(Task(source, None, ignore, False, False, False, None, None, None), Options(), {})


def first_start(task: Task, settings: Options, given: dict[str, Any]) -> Start:
    """Find or check the circle, and adapt the ``settings`` to the ball; options that were ``given`` stay."""
    circle, settings = find_initial_circle(task.source, task.circle, task.ignore, task.refine, settings)
    image = task.source.images(circle.frame, circle.frame + 1)[0]
    contrast = background_contrast(image, circle, task.ignore)
    options = adapt_options(settings, given, circle.radius, contrast)
    # None is what was left out, as a request hands it on.
    return Start(
        circle, image, contrast, options, frozenset(name for name, value in given.items() if value is not None)
    )
