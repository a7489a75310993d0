"""The circle that a recording is followed from: found, or as given, or as given and fitted to the image."""

from __future__ import annotations

import dataclasses
from typing import Any

import torch
from torch import Tensor

from torchsphere.correlation.options import Options
from torchsphere.detection import detect as circles
from torchsphere.geometry.camera import Camera, sphere_of_outline
from torchsphere.geometry.circle import Circle
from torchsphere.recording.frame_source import Source
from torchsphere.settings.arrays import check_circle
from torchsphere.settings.limits import SettingError, is_whole
from torchsphere.tracking.circle_calibration import calibrate


def first_circle(
    source: Source, given: Any, mask: Tensor | None, refine: bool, options: Options
) -> tuple[Circle, Options]:
    """The ball in the first tracked frame, and the options with a camera that knows its focal length."""
    if given is None:
        seen = circles.find(source.images, source.count, mask)
        found, options = _as_sphere(seen, source, options)
        if options.camera is not None:
            found = _as_camera_sees(source, seen, found, options.camera)
        return calibrate(source, found, mask, options), options
    three = (given.x, given.y, given.radius) if isinstance(given, Circle) else given
    x, y, radius = _three_numbers(three)
    circle = dataclasses.replace(given, x=x, y=y, radius=radius) if isinstance(given, Circle) else Circle(x, y, radius)
    if not is_whole(circle.frame) or not 0 <= circle.frame < source.count:
        raise ValueError(f"circle: its frame {circle.frame!r} is not one of the recording's 0 to {source.count - 1}")
    first = source.images(circle.frame, circle.frame + 1)[0]
    check_circle(torch.tensor([[circle.x, circle.y, circle.radius]]), first.shape)
    if not isinstance(given, Circle):
        circle, options = _as_sphere(circle, source, options)
    elif options.camera is not None:
        options = dataclasses.replace(options, camera=options.camera.settled(first.shape, circle.radius))
    return circles.refine_circle(first, circle, camera=options.camera) if refine else circle, options


def shows_ball(source: Source, circle: Circle, options: Options) -> bool:
    """Whether the image that a circle was given for shows an outline near it."""
    image = source.images(circle.frame, circle.frame + 1)[0]
    try:
        circles.refine_circle(image, circle, camera=options.camera)
    except ValueError:
        return False
    return True


def _as_camera_sees(source: Source, seen: Circle, sphere: Circle, camera: Camera) -> Circle:
    """The ``sphere`` of a circle that was ``seen``, fitted to its image with the camera's perspective."""
    try:
        return circles.refine_circle(source.images(seen.frame, seen.frame + 1)[0], sphere, camera=camera)
    except ValueError as error:
        # The advice there is for a circle that was given.
        raise SettingError(
            f"the circle found, at ({seen.x:.1f}, {seen.y:.1f}) with a radius of {seen.radius:.1f} px, could not be "
            "fitted to the image with the camera's perspective, so it may not be the ball's outline: give that with "
            "`circle` as x, y, radius in px of the first frame to track"
        ) from error


def _as_sphere(seen: Circle, source: Source, options: Options) -> tuple[Circle, Options]:
    """The projected centre and the radius at its depth of a ball with that outline, and the camera that tells them."""
    if options.camera is None:
        return seen, options
    camera = options.camera.settled(source.images(0, 1).shape, seen.radius)
    sphere = sphere_of_outline(torch.tensor([seen.x, seen.y, seen.radius], dtype=torch.float64), camera)
    x, y, radius = sphere.tolist()
    return dataclasses.replace(seen, x=x, y=y, radius=radius), dataclasses.replace(options, camera=camera)


def _three_numbers(given: Any) -> tuple[float, float, float]:
    try:
        x, y, radius = (float(v) for v in given)
    except (TypeError, ValueError) as error:
        raise ValueError(f"circle: expected three numbers (x, y, radius) in px, got {given!r}") from error
    return x, y, radius
