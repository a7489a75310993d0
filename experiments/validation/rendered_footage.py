"""Flights filmed by the renderer, which shares no line of code with the program under test.

The pattern is the renderer's own, of sharp spots, and so are light, shadow, gloss and exposure.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
import torch
from torch import Tensor

from experiments.experiment import Array
from experiments.validation.attack_footage import Flight
from render.background import Background, StillObject
from render.ball import Ball
from render.camera import Camera
from render.exposure import Shutter
from render.frames import render_radiance
from render.light import Light, Lighting
from render.pattern import Pattern
from render.pose import Poses
from render.scene import Quality, Setup

#: Radius of all balls, m, and grey level of full scale.
RADIUS_M, WHITE = 0.015, 255.0

#: Light paths per pixel.
SAMPLES = 256

#: Uniform light beside a lamp, the lamp's level, and its place from the middle of the flight, m.
DIM, LAMP, LAMP_FROM_BALL_M = 0.5, 0.5, np.array([-0.3, -0.3, -0.3])

#: Poses within an exposure.
SUBFRAMES = 16


@dataclass(frozen=True)
class Painted(Background):
    """A backdrop with grey levels of its own."""

    levels: Array = field(default_factory=lambda: np.zeros((1, 1)))  # (h, w)

    def image(self, height: int, width: int) -> Array:
        """The levels, for the renderer."""
        if self.levels.shape != (height, width):
            raise ValueError(f"levels has the shape {self.levels.shape}: expected {(height, width)}")
        return self.levels / WHITE


@dataclass(frozen=True)
class Look:
    """What the renderer adds to a flight."""

    speckle_px: float = 4.0
    has_lamp: bool = False
    gloss: float = 0.0  # of `render.ball.Ball`
    plate: tuple[float, float] | None = None  # first and last column that a plate in front of the ball hides
    exposure: float = 0.0  # share of the frame interval


def by_renderer(made: Flight, look: Look) -> Tensor:
    """Clean images (n, h, w) of the flight, float; its pattern is replaced by one of the renderer."""
    m_per_px = RADIUS_M / made.radius
    height, width = made.background.shape
    depth, camera = 0.0, Camera("orthographic", width, height, scale_px_per_mm=1e-3 / m_per_px)
    if made.camera is not None and made.camera.focal_px is not None:
        camera = Camera("pinhole", width, height, focal_px=made.camera.focal_px)
        depth = made.camera.focal_px * m_per_px

    def place(pixels: Array) -> Array:
        """Points (m, 3) that are seen at the ``pixels`` (m, 2), at the depth of the ball."""
        return np.column_stack(((pixels - camera.centre_px) * m_per_px, np.full(len(pixels), depth)))

    def pose(times: Array) -> Poses:
        centres, turned = made.at(times)
        return Poses(place(centres.double().numpy()), turned.double().numpy())

    middle = place(made.centres.mean(0, keepdims=True))[0]
    setup = Setup(
        Ball(2000 * RADIUS_M, gloss=look.gloss),
        Pattern(speckle_mm=1000 * m_per_px * look.speckle_px, seed=made.seed),
        camera,
        _with_lamp(middle) if look.has_lamp else Lighting(),
        Painted(levels=made.background.double().numpy(), objects=_plates(look, middle, m_per_px, camera)),
        Shutter(look.exposure, SUBFRAMES),
        quality=Quality(SAMPLES, seed=made.seed),
    )
    frames = np.arange(len(made.centres), dtype=np.float64)
    return torch.from_numpy(np.stack(list(render_radiance(setup, pose, frames)))).float()


def _with_lamp(middle: Array) -> Lighting:
    """Uniform light, and a lamp in front of the ball, above it on the left."""
    x, y, z = (middle + LAMP_FROM_BALL_M).tolist()
    return Lighting(DIM, (Light(position_m=(x, y, z), towards_m=tuple(middle.tolist()), level=LAMP),))


def _plates(look: Look, middle: Array, m_per_px: float, camera: Camera) -> tuple[StillObject, ...]:
    """The plate of a `Look`, two radii in front of the ball; a camera at a distance sees it larger."""
    if look.plate is None:
        return ()
    first, last = look.plate
    x = ((first + last) / 2 - camera.centre_px[0]) * m_per_px
    size = (last - first) * m_per_px, 40 * RADIUS_M, 0.1 * RADIUS_M
    return (StillObject(centre_m=(x, float(middle[1]), float(middle[2]) - 2 * RADIUS_M), size_m=size),)
