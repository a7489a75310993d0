"""Frames: scene, shutter and sensor joined.

Noise of the light paths. The sample positions in a pixel are jittered on a grid and stratified along rows and columns;
each frame has its own positions. The table gives the standard deviation between frames that differ in these positions
alone, rms in grey levels, for a ball of radius 50 px with the default pattern (speckles of 4 px, grey levels 20 to 217
of 255):

========================  ============  ==================  ================
light                     within 0.9 R  from there to rim   pixels at the rim
========================  ============  ==================  ================
flat, 64 samples          0.33          0.69                1.38
flat, 256 samples         0.11          0.24                0.46
area light, 64 samples    0.23          0.37                0.64
========================  ============  ==================  ================

Rounding to whole grey levels adds 0.29 grey levels, so 64 samples give about the noise of a perfect 8-bit camera;
sensor noise of 2 grey levels is far larger. The edge position in one row of pixels has a standard deviation of 0.015 px
at 64 samples and of 0.002 px at 1024, without bias. For tracker errors below 0.001 px, use 256 samples or more.
"""

from __future__ import annotations

import logging
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from . import backend
from .camera import Camera
from .light import disc_points
from .pattern import Pattern, chart
from .pose import Motion, Poses
from .scene import Pass, Quality, Setup, passes, place_ball
from .view import look, window

_log = logging.getLogger(__name__)


def render_frames(
    setup: Setup, motion: Motion, times_s: NDArray[np.float64], *, numbers: Sequence[int] | None = None
) -> Iterator[NDArray[np.uint8] | NDArray[np.uint16]]:
    """Render a recording lazily, one frame at a time.

    Parameters
    ----------
    setup : Setup
        The scene, shutter and sensor.
    motion : callable
        times_s (n,) -> Poses.
    times_s : (n,) ndarray
        Middle of each frame's exposure, s.
    numbers : sequence of int, optional
        Numbers of the frames, which fix their noise; 0, 1, ... by default. A frame depends on its number, time and
        setup alone, not on the other frames.

    Yields
    ------
    (h, w) ndarray
        Grey levels; uint8 for 8 bits, else uint16.
    """
    names = range(len(times_s)) if numbers is None else numbers
    for number, grey in zip(names, render_radiance(setup, motion, times_s, numbers=numbers), strict=True):
        yield setup.sensor.record(grey, number)


def render_radiance(
    setup: Setup, motion: Motion, times_s: NDArray[np.float64], *, numbers: Sequence[int] | None = None
) -> Iterator[NDArray[np.float64]]:
    """Render the grey levels that a sensor without noise, saturation and rounding gives.

    Parameters
    ----------
    setup, motion, times_s, numbers
        As for `render_frames`.

    Yields
    ------
    (h, w) ndarray
        Grey levels, float64.

    Raises
    ------
    ImportError
        If mitsuba is not installed.
    ValueError
        If the variant cannot render the setup, or the count of numbers differs from that of the times.
    """
    names = list(range(len(times_s)) if numbers is None else numbers)
    if len(names) != len(times_s):
        raise ValueError(f"numbers has {len(names)} entries: expected one for each of the {len(times_s)} times")
    if not names:
        return
    _log.info(backend.choose(setup.quality.variant).reason)
    parts = passes(setup, chart(setup.pattern, setup.ball.diameter_mm / 2, _radius_px(setup, motion)))
    backdrop = setup.background.image(setup.camera.height, setup.camera.width)
    for number, time_s in zip(names, times_s, strict=True):
        backend.choose(setup.quality.variant)  # another recording may have changed Mitsuba's variant in between
        poses = motion(setup.shutter.times_s(float(time_s)))
        yield setup.sensor.grey(_exposure(setup, parts, backdrop, poses, number))


def _radius_px(setup: Setup, motion: Motion) -> float:
    """Radius of the ball's image, px, at time 0: a frame must not depend on the other frames rendered with it."""
    centre_m = motion(np.zeros(1)).position_m[0]
    _refuse_too_near(setup, centre_m)
    return setup.ball.radius_m * setup.camera.px_per_m(float(centre_m[2]))


def _refuse_too_near(setup: Setup, centre_m: NDArray[np.float64]) -> None:
    if setup.camera.model == "pinhole" and centre_m[2] <= setup.ball.radius_m:
        raise ValueError(
            f"position_m has z = {centre_m[2]:g} m: expected more than the ball's radius of {setup.ball.radius_m:g} m, "
            "for the pinhole camera is at the origin and looks along +z"
        )


def _exposure(
    setup: Setup, parts: list[Pass], backdrop: NDArray[np.float64], poses: Poses, number: int
) -> NDArray[np.float64]:
    """Mean light of a frame, (h, w), over the poses within its exposure."""
    count = len(poses.position_m)
    samples = max(1, round(setup.quality.samples / count))
    seeds = np.random.SeedSequence([setup.quality.seed, number]).generate_state(count * len(parts)).reshape(count, -1)
    total = np.zeros_like(backdrop)
    for centre_m, orientation, row in zip(poses.position_m, poses.orientation, seeds.tolist(), strict=True):
        total += _moment(setup, parts, backdrop, Moment(centre_m, orientation, samples, row))
    return total / count


@dataclass(frozen=True)
class Moment:
    """A pose within an exposure, its light paths per pixel, and a seed for each part of the light."""

    centre_m: NDArray[np.float64]
    orientation: NDArray[np.float64]
    samples: int
    seeds: list[int]


def _moment(setup: Setup, parts: list[Pass], backdrop: NDArray[np.float64], moment: Moment) -> NDArray[np.float64]:
    """Light of all pixels, (h, w), at one pose."""
    _refuse_too_near(setup, moment.centre_m)
    unit_m = setup.ball.radius_m
    things = setup.background.objects
    spheres = [(np.asarray(thing.centre_m), thing.reach_m) for thing in things]
    spheres.append((moment.centre_m, unit_m))
    region = window(setup.camera, spheres)
    start = min(float(centre[2]) - 1.5 * reach for centre, reach in spheres) / unit_m - 1.0
    refuse_lamps_in_sight(setup, start * unit_m)
    light = cover = np.zeros((region.height, region.width))
    for part, seed in zip(parts, moment.seeds, strict=True):
        place_ball(part, moment.centre_m / unit_m, moment.orientation)
        own, seen = look(part, setup.camera, region, unit_m=unit_m, start=start, samples=moment.samples, seed=seed)
        light, cover = light + own, cover + seen / len(parts)
    whole = backdrop.copy()
    behind = whole[region.top : region.top + region.height, region.left : region.left + region.width]
    behind *= 1.0 - cover
    behind += light
    return whole


def refuse_lamps_in_sight(setup: Setup, start_m: float) -> None:
    """Refuse an area light in the camera's sight: an invisible lamp that would hide the objects behind it.

    Parameters
    ----------
    setup : Setup
        The scene.
    start_m : float
        z at which the orthographic camera's lines of sight begin, m; objects before it do not block them.

    Raises
    ------
    ValueError
        If a part of a lamp lies within the image.
    """
    camera = setup.camera
    for light in setup.lighting.lights:
        if light.kind != "area" or light.level == 0:
            continue
        points = disc_points(light)
        if camera.model == "orthographic":
            points = points[points[:, 2] >= start_m]
        x, y = camera.project(points).T
        if ((x > -0.5) & (x < camera.width - 0.5) & (y > -0.5) & (y < camera.height - 0.5)).any():
            raise ValueError(
                f"position_m = {light.position_m}: this area light of {light.diameter_m:g} m is within the camera's "
                "sight; expected it aside of what the camera sees, or a spot light, which has no extent"
            )


def trial() -> bool:
    """Render a small frame with Mitsuba's current variant.

    Returns
    -------
    bool
        True if the frame shows the ball over the backdrop.
    """
    setup = Setup(pattern=Pattern(kind="plain"), camera=Camera(width=128, height=128), quality=Quality(samples=4))
    parts = passes(setup, chart(setup.pattern, setup.ball.diameter_mm / 2, 50.0))
    backdrop = setup.background.image(128, 128)
    level = _moment(setup, parts, backdrop, Moment(np.zeros(3), np.eye(3), 4, [0]))
    return bool(np.allclose([level[0, 0], level[64, 64]], [setup.background.level, setup.pattern.brightest], atol=0.01))
