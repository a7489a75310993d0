"""The circle that a recording is followed from: found, given, or given and fitted to the image."""

from __future__ import annotations

import dataclasses
from typing import Any

import torch
from torch import Tensor

from torchsphere.correlation.options import Options
from torchsphere.detection import detect
from torchsphere.geometry.camera import Camera, sphere_of_outline
from torchsphere.geometry.circle import Circle
from torchsphere.recording.frame_source import Source
from torchsphere.settings.arrays import check_circle
from torchsphere.settings.limits import SettingError, is_whole
from torchsphere.tracking.circle_calibration import calibrate_circle


def find_initial_circle(
    source: Source, given: Any, mask: Tensor | None, refine: bool, options: Options
) -> tuple[Circle, Options]:
    """The ball in the first tracked frame, and the options with a camera whose focal length is known."""
    if given is not None:
        return _given_circle(source, given, refine, options)
    outline = detect.find(source.images, source.count, mask)
    circle, options = _sphere_of(outline, source, options)
    if options.camera is not None:
        circle = _fitted_in_perspective(source, outline, circle, options.camera)
    return calibrate_circle(source, circle, mask, options), options


def _given_circle(source: Source, given: Any, refine: bool, options: Options) -> tuple[Circle, Options]:
    """The circle that was given, checked and, if asked for, fitted to its image."""
    x, y, radius = _three_numbers((given.x, given.y, given.radius) if isinstance(given, Circle) else given)
    circle = dataclasses.replace(given, x=x, y=y, radius=radius) if isinstance(given, Circle) else Circle(x, y, radius)
    if not is_whole(circle.frame) or not 0 <= circle.frame < source.count:
        raise ValueError(f"circle: its frame {circle.frame!r} is not one of the recording's 0 to {source.count - 1}")
    image = source.images(circle.frame, circle.frame + 1)[0]
    check_circle(torch.tensor([[circle.x, circle.y, circle.radius]]), image.shape)
    if not isinstance(given, Circle):
        circle, options = _sphere_of(circle, source, options)
    elif options.camera is not None:
        options = dataclasses.replace(options, camera=options.camera.settled(image.shape, circle.radius))
    return detect.refine_circle(image, circle, camera=options.camera) if refine else circle, options


def shows_outline(source: Source, circle: Circle, options: Options) -> bool:
    """Whether the image that a circle was given for shows an outline near it."""
    image = source.images(circle.frame, circle.frame + 1)[0]
    try:
        detect.refine_circle(image, circle, camera=options.camera)
    except ValueError:
        return False
    return True


def _fitted_in_perspective(source: Source, outline: Circle, sphere: Circle, camera: Camera) -> Circle:
    """The ``sphere`` of a found ``outline``, fitted to its image with the camera's perspective."""
    try:
        return detect.refine_circle(source.images(outline.frame, outline.frame + 1)[0], sphere, camera=camera)
    except ValueError as error:
        # The original sentence advises on a circle that was given.
        raise SettingError(
            f"the circle found, at ({outline.x:.1f}, {outline.y:.1f}) with a radius of {outline.radius:.1f} px, could "
            "not be fitted to the image with the camera's perspective, so it may not be the ball's outline: give that "
            "with `circle` as x, y, radius in px of the first frame to track"
        ) from error


def _sphere_of(outline: Circle, source: Source, options: Options) -> tuple[Circle, Options]:
    """Projected centre and radius at its depth of a ball with that outline, and the options with a settled camera."""
    if options.camera is None:
        return outline, options
    camera = options.camera.settled(source.images(0, 1).shape, outline.radius)
    sphere = sphere_of_outline(torch.tensor([outline.x, outline.y, outline.radius], dtype=torch.float64), camera)
    x, y, radius = sphere.tolist()
    return dataclasses.replace(outline, x=x, y=y, radius=radius), dataclasses.replace(options, camera=camera)


def _three_numbers(given: Any) -> tuple[float, float, float]:
    try:
        x, y, radius = (float(v) for v in given)
    except (TypeError, ValueError) as error:
        raise ValueError(f"circle: expected three numbers (x, y, radius) in px, got {given!r}") from error
    return x, y, radius
