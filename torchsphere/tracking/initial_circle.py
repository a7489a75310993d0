"""The circle that a recording is followed from: found, given, or fitted to its image, and improved by later frames.

The ball's path tells the still background from the ball, and so its limb better than one image does. Later frames
improve the radius alone: the path drifts from the centre. How the texture moves would tell the radius, too, but not
from pairs of images: sharp spots, a lamp and a near camera leave the residual of another radius. The map of the ball
has these in its model.
"""

from __future__ import annotations

import dataclasses
import math
from dataclasses import dataclass
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from torchsphere.correlation.options import Options
from torchsphere.detection import ball_search, blurred_limb, detect, limb_fit, outline_fit
from torchsphere.detection.blurred_limb import LimbBlur
from torchsphere.detection.detect import at_limb, unblurred
from torchsphere.geometry.camera import Camera, require_distance, sphere_of_outline
from torchsphere.geometry.circle import Circle
from torchsphere.imaging import background, crop, interlacing
from torchsphere.recording.frame_range import spread
from torchsphere.recording.frame_source import Source
from torchsphere.runtime import steps
from torchsphere.settings.arrays import check_circle
from torchsphere.settings.limits import is_whole
from torchsphere.tracking.follow import Follower
from torchsphere.tracking.record import Record

#: Largest number of followed frames, and of those chosen for radius and background (docs/constants.toml).
FRAMES, MAX_CHOSEN = 65, 16

#: Failed searches for the ball after which the remaining frames are left out (docs/constants.toml).
MAX_SEARCHES = 4

#: Distance beyond the outline up to which the limb is looked at, px, with the reach of the spline
#: (docs/constants.toml).
LIMB_REACH_PX = 16.0

#: Largest distance of a later frame's circle from the path, as a share of the radius (docs/constants.toml).
MAX_OFF_PATH = 0.015

#: Standard deviation of a frame's radius, over that of the first, from which it is left out (docs/constants.toml).
MAX_SD_RATIO = 1.2

#: Smallest number of frames that have a scatter (docs/constants.toml).
MIN_FRAMES = 3


def find_initial_circle(
    source: Source, given: Any, mask: Tensor | None, refine: bool, options: Options
) -> tuple[Circle, Options]:
    """The ball in the first tracked frame, and the options with a camera whose focal length is known."""
    if given is not None:
        return _check_given_circle(source, given, refine, options)
    steps.tell("looking for the ball in %d frames", source.count)
    outline = ball_search.find(source.images, source.count, mask)
    steps.tell("following the circle %s px of frame %d to measure its radius", outline.text(), outline.frame)
    circle, options = _sphere_from_outline(outline, source, options)
    if options.camera is not None and not outline.unproven:
        circle = _fit_in_perspective(source, outline, circle, options.camera)
    return calibrate_circle(source, circle, mask, options), options


def _check_given_circle(source: Source, given: Any, refine: bool, options: Options) -> tuple[Circle, Options]:
    """The circle that was given, checked and, if asked for, fitted to its image."""
    circle = Circle.of(given)
    if not is_whole(circle.frame) or not 0 <= circle.frame < source.count:
        raise ValueError(f"circle: its frame {circle.frame!r} is not one of the recording's 0 to {source.count - 1}")
    image = source.images(circle.frame, circle.frame + 1)[0]
    check_circle(torch.tensor([[circle.x, circle.y, circle.radius]]), image.shape)
    if not isinstance(given, Circle):
        circle, options = _sphere_from_outline(circle, source, options)
    elif options.camera is not None:
        settled = options.camera.settled(image.shape, circle.radius)
        require_distance(settled, circle.radius)
        options = dataclasses.replace(options, camera=settled)
    return detect.refine_circle(image, circle, camera=options.camera) if refine else circle, options


def is_interlaced(source: Source, circle: Circle) -> bool:
    """Whether the images from that of the ``circle`` on show the ball at two instants."""
    first = min(circle.frame, source.count - 2)
    centre = torch.tensor([[circle.x, circle.y]], dtype=torch.float64).expand(2, 2)
    crops = crop.cut(source.images(first, first + 2), centre, crop.half_size(circle.radius, 0.0))
    return interlacing.is_interlaced(crops)


def _fit_in_perspective(source: Source, outline: Circle, sphere: Circle, camera: Camera) -> Circle:
    """The ``sphere`` of a found ``outline``, fitted to its image with the camera's perspective."""
    try:
        return detect.refine_circle(source.images(outline.frame, outline.frame + 1)[0], sphere, camera=camera)
    except ValueError:
        # Edges of the background that are stronger than the ball's: the outline itself was found in spite of them.
        return sphere


def _sphere_from_outline(outline: Circle, source: Source, options: Options) -> tuple[Circle, Options]:
    """Projected centre and radius at its depth of a ball with that outline, and the options with a settled camera."""
    if options.camera is None:
        return outline, options
    camera = options.camera.settled(source.images(0, 1).shape, outline.radius)
    require_distance(camera, outline.radius)
    sphere = sphere_of_outline(torch.tensor([outline.x, outline.y, outline.radius], dtype=torch.float64), camera)
    x, y, radius = sphere.tolist()
    return dataclasses.replace(outline, x=x, y=y, radius=radius), dataclasses.replace(options, camera=camera)


@dataclass(frozen=True)
class _Flight:
    """The first frames of a recording, and the path of the ball in them."""

    source: Source
    ignore: Tensor | None  # (h, w), True where the images are not to be used
    options: Options
    followed: Record

    @property
    def frames(self) -> NDArray[np.int64]:
        """Frames that were measured."""
        return np.flatnonzero(self.followed.is_ok)

    @property
    def evenly_lit_frames(self) -> NDArray[np.int64]:
        """Measured frames without an object that takes light from one side of the ball."""
        return self.frames[~self.followed.uneven_light[self.frames]]

    def relative_size(self, circle: Circle, frames: NDArray[np.int64]) -> Tensor:
        """Size (m,) of the ball in the given frames relative to its size in the frame of ``circle``."""
        return torch.from_numpy(self.followed.size[frames] / self.followed.size[circle.frame])

    def circles(self, circle: Circle, frames: NDArray[np.int64]) -> Tensor:
        """Circles (m, 3) on the path in the given frames, with the radius of ``circle`` in its frame."""
        radii = circle.radius * self.relative_size(circle, frames)
        return torch.cat((torch.from_numpy(self.followed.position[frames]), radii[:, None]), -1)

    def motion(self, frames: NDArray[np.int64]) -> Tensor:
        """Motion (m, 2) around the given frames, px per interval; 0 where no neighbour was followed."""
        return torch.from_numpy(self.source.steps_around(self.followed.position, frames))


def calibrate_circle(source: Source, found: Circle, ignore: Tensor | None, options: Options) -> Circle:
    """The ``found`` circle with radius and centre from the frames that follow it.

    A plain ball, or a ball that cannot be followed, keeps its circle.
    """
    if found.unproven:
        return found
    stop = min(found.frame + FRAMES, source.count)
    source = source.cached(found.frame, stop)

    followed = Follower(source, found, ignore, options, searches=MAX_SEARCHES).run(stop)
    flight = _Flight(source, ignore, options, followed)
    if len(flight.frames) < MIN_FRAMES:
        return found
    found, blur = _fit_limb(flight, found)
    return dataclasses.replace(found, radius=_radius_over_frames(flight, found, blur))


def _fit_limb(flight: _Flight, found: Circle) -> tuple[Circle, LimbBlur | None]:
    """The circle at the ball's limb, with and without the still background taken out, whichever is more certain.

    Also the blur across the limb; None where it is sharp.
    """
    image = flight.source.images(found.frame, found.frame + 1)[0].cpu()
    if outline_fit.is_plain(image, torch.tensor([found.x, found.y, found.radius], dtype=torch.float64)):
        return found, None
    difference = (image - _still_background(flight, found, image)).to(image)
    hidden, ignore, camera = _hidden_background(flight, found, image.shape), flight.ignore, flight.options.camera
    if ignore is not None:
        # Image and background are on the CPU, wherever the pairs are measured.
        ignore = ignore.cpu()
        hidden = hidden | ignore
    views = (image, ignore), (difference, hidden)
    fits = [at_limb(view[None], found, mask, camera) for view, mask in views]
    best = min(range(len(fits)), key=lambda k: math.hypot(fits[k].sd_x, fits[k].sd_y, fits[k].sd_radius))
    view, mask = views[best]
    motion = flight.motion(np.array([found.frame]))[0]
    return unblurred(view, fits[best], motion=motion, ignore=mask, camera=camera)


def _still_background(flight: _Flight, found: Circle, image: Tensor) -> Tensor:
    """The still background (h, w) around the ball in its frame; the ``image`` itself elsewhere."""
    reach = found.radius + LIMB_REACH_PX
    left, top = (max(0, math.floor(v - reach)) for v in (found.x, found.y))
    part = slice(top, math.ceil(found.y + reach) + 1), slice(left, math.ceil(found.x + reach) + 1)

    def read(start: int, stop: int) -> Tensor:
        return flight.source.images(start, stop)[:, part[0], part[1]]

    around = dataclasses.replace(flight.source, read=read, is_file=False)
    still = image.double().clone()
    still[part] = background.background(around, flight.followed.position - [left, top], found.radius)
    return still


def _radius_over_frames(flight: _Flight, found: Circle, blur: LimbBlur | None) -> float:
    """Median radius over several frames; that of ``found`` where later frames are less certain than its own."""
    if len(flight.evenly_lit_frames) < MIN_FRAMES:
        return found.radius
    chosen = spread(flight.evenly_lit_frames, MAX_CHOSEN)
    circles = flight.circles(found, chosen)
    images = flight.source.images_of(chosen)
    ignore, camera = flight.ignore, flight.options.camera
    if blur is None:
        fitted, covariance = limb_fit.fit(images, circles, ignore=ignore, camera=camera)
    else:
        motion = flight.motion(chosen) if blur.exposure else None
        fitted, covariance, _ = blurred_limb.fit(images, circles, motion=motion, ignore=ignore, camera=camera)
    good = ((fitted - circles).abs() < MAX_OFF_PATH * found.radius).all(-1)
    good &= covariance[:, 2, 2] < (MAX_SD_RATIO * found.sd_radius) ** 2
    if int(good.sum()) < MIN_FRAMES:
        return found.radius
    return float((fitted[:, 2] / flight.relative_size(found, chosen))[good].median())


def _hidden_background(flight: _Flight, found: Circle, shape: torch.Size) -> Tensor:
    """True (h, w) where the ball hides the background in all chosen frames except that of ``found``.

    A pixel that is visible in that frame alone is taken for the background there, whatever it shows.
    """
    known = np.flatnonzero(np.isfinite(flight.followed.position[:, 0]))
    chosen = spread(known[known != found.frame], MAX_CHOSEN)
    rows, columns = (torch.arange(size, dtype=torch.float64) for size in shape)
    hidden, limit = torch.ones(shape, dtype=torch.bool), (found.radius + background.CLEARANCE_PX) ** 2
    for x, y in flight.followed.position[chosen].tolist():
        hidden &= (columns - x).square() < (limit - (rows - y).square())[:, None]
    return hidden
