"""Footage of `projection`: a rendered ball of varied rotation, radius, distance and place."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from render.ball import Ball
from render.camera import Camera
from render.frames import render_frames
from render.pattern import Pattern
from render.pose import Motion, Poses
from render.scene import Quality, Setup
from render.sensor import Sensor

Array = NDArray[np.float64]

NOISE_GREY, SPECKLE_PX, JITTER_PX = 2.0, 4.0, 0.3
BALL_RADIUS_M = 0.015

#: Direction of the rotation; direction from the middle to the corner of an image of 512 x 256, for a ball of 50 px.
AXIS, TO_CORNER = (0.2, 0.5, 0.2), np.array([200.0, 72.0]) / math.hypot(200.0, 72.0)


@dataclass(frozen=True)
class Case:
    """Footage of a ball: px, degrees per frame, radii."""

    radius: float = 50.0
    turn: float = math.sqrt(0.33)
    axis: tuple[float, float, float] = AXIS
    distance: float = math.inf  # from the camera along its axis, radii; infinite for the orthographic camera
    offset: tuple[float, float] = (0.0, 0.0)  # projected centre in the first frame, px from the optical axis
    step: tuple[float, float] = (1.4, 0.2)
    frames: int = 30
    samples: int = 256


#: Light paths per pixel, except in the base cases.
SAMPLES = 64

BASE = Case()
CROSSING = Case(turn=0.5, distance=10.0, offset=(-174.0, -20.0), step=(6.0, 1.0))
PLACE = replace(CROSSING, frames=15)

#: Name, label and scale of each property that is varied, and its values.
SERIES: tuple[tuple[str, str, str, tuple[float, ...]], ...] = (
    ("rotation", "rotation (deg per frame)", "log", (0.1, 0.3, BASE.turn, 1, 2, 5, 10, 20)),
    ("radius", "radius (px)", "log", (10, 20, 35, 50, 75, 100)),
    ("distance", "distance (radii)", "log", (4, 6, 10, 20, 50, 100, 200)),
    ("place", "place (deg off the axis)", "linear", (0, 6, 12, 18, 24)),
)


def case_of(name: str, value: float) -> Case:
    """The case of a series at one of its values; only base cases have all samples."""
    if name == "place":
        middle = CROSSING.distance * CROSSING.radius * math.tan(math.radians(value)) * TO_CORNER
        first = middle - (PLACE.frames - 1) / 2 * np.array(PLACE.step)
        return replace(PLACE, offset=(float(first[0]), float(first[1])), samples=SAMPLES)
    base = CROSSING if name == "distance" else BASE
    changed: dict[str, Any] = {"turn" if name == "rotation" else name: float(value)}
    case = replace(base, **changed)
    return case if case == base else replace(case, samples=SAMPLES)


@dataclass(frozen=True)
class Footage:
    """Rendered frames and their truth."""

    images: torch.Tensor  # (n, h, w), float32
    centres: Array  # (n, 3), px: the projected centre and the radius at its depth
    outlines: Array  # (n, 3), px: the circle that fits the outline best
    increment: Array  # (n - 1, 5) as (dx, dy, wx, wy, wz), px and rad
    camera: Camera  # of the renderer


@dataclass(frozen=True)
class Scene:
    """Input of `render.frames`, the ball's positions (n, 3), m, and the true increment (n - 1, 5), px and rad."""

    setup: Setup
    motion: Motion
    places_m: Array
    increment: Array

    @property
    def times_s(self) -> Array:
        """Times of the frames, one per second."""
        return np.arange(len(self.places_m), dtype=float)

    @property
    def centres(self) -> Array:
        """Projected centre and radius (n, 3) at its depth, px."""
        camera, radius_m = self.setup.camera, self.setup.ball.radius_m
        radii = [radius_m * camera.px_per_m(float(depth)) for depth in self.places_m[:, 2]]
        return np.column_stack((camera.project(self.places_m), radii))


def make_scene(case: Case, seed: int) -> Scene:
    """The scene of one pattern."""
    rng = np.random.default_rng([seed, 7])
    steps = np.array(case.step) + rng.uniform(-JITTER_PX, JITTER_PX, (case.frames - 1, 2))
    seen = np.array(case.offset) + rng.uniform(0, 1, 2) + np.concatenate((np.zeros((1, 2)), steps.cumsum(0)))
    turn = np.radians(case.turn) * np.array(case.axis) / np.linalg.norm(case.axis)
    start = Rotation.random(random_state=int(rng.integers(1 << 31)))
    orientations = (Rotation.from_rotvec(np.arange(case.frames)[:, None] * turn) * start).as_matrix()
    camera, places_m = _camera(case, seen)

    def motion(times_s: Array) -> Poses:
        frames = np.round(times_s).astype(int)
        return Poses(places_m[frames], orientations[frames])

    setup = Setup(
        ball=Ball(diameter_mm=2000 * BALL_RADIUS_M),
        pattern=Pattern(seed=seed, speckle_mm=SPECKLE_PX * 1000 * BALL_RADIUS_M / case.radius),
        camera=camera,
        sensor=Sensor(read_noise_grey=NOISE_GREY, seed=seed),
        quality=Quality(samples=case.samples, seed=seed),
    )
    return Scene(setup, motion, places_m, np.concatenate((steps, np.tile(turn, (case.frames - 1, 1))), 1))


def render_footage(case: Case, seed: int) -> Footage:
    """Footage of one pattern."""
    scene = make_scene(case, seed)
    images = np.stack(list(render_frames(scene.setup, scene.motion, scene.times_s)))
    outlines = np.stack([outline_circle(scene.setup.camera, place) for place in scene.places_m])
    return Footage(torch.from_numpy(images).float(), scene.centres, outlines, scene.increment, scene.setup.camera)


def _camera(case: Case, seen: Array) -> tuple[Camera, Array]:
    """The camera with an image cut to the ball's path, and the ball's positions (n, 3), m."""
    perspective = math.isfinite(case.distance)
    # Under perspective the outline is longer than the radius: by half of it at the widest angle of the series.
    margin = 12 + case.radius * (1.6 if perspective else 1.0)
    low, high = np.floor(seen.min(0) - margin), np.ceil(seen.max(0) + margin)
    width, height = (int(v) for v in high - low + 1)
    principal = (-float(low[0]), -float(low[1]))
    if not perspective:
        scale = case.radius / (1000 * BALL_RADIUS_M)
        camera = Camera(width=width, height=height, scale_px_per_mm=scale, principal_px=principal)
        return camera, np.column_stack((seen / (1000 * scale), np.zeros(len(seen))))
    focal = case.distance * case.radius
    camera = Camera("pinhole", width, height, focal_px=focal, principal_px=principal)
    rays = np.column_stack((seen / focal, np.ones(len(seen))))
    return camera, case.distance * BALL_RADIUS_M * rays


def outline_circle(camera: Camera, centre_m: Array) -> Array:
    """Circle (3,) that fits the outline best, px."""
    angle = np.linspace(0, 2 * np.pi, 180, endpoint=False)[:, None]
    line, share = np.array([0.0, 0.0, 1.0]), 1.0
    if camera.model == "pinhole":
        distance = float(np.linalg.norm(centre_m))
        line, share = centre_m / distance, 1 - (BALL_RADIUS_M / distance) ** 2
    across = np.cross(line, [0.0, 1.0, 0.0])
    across /= np.linalg.norm(across)
    ring = math.sqrt(share) * (np.cos(angle) * across + np.sin(angle) * np.cross(line, across))
    points = camera.project(share * centre_m + BALL_RADIUS_M * ring)
    # |p|^2 = 2 c.p + (R^2 - |c|^2) is linear in the centre c.
    design = np.column_stack((2 * points, np.ones(len(points))))
    x, y, rest = np.linalg.lstsq(design, (points**2).sum(1), rcond=None)[0]
    return np.array([x, y, math.sqrt(rest + x**2 + y**2)])
