"""The flights of `experiments.validation.flights`: drawn from a seed, with exact poses and rates, and filmed.

Every second flight is filmed by the renderer, which shares no line with the program under test, and every second of
those has a lamp beside the uniform light.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
import torch
from scipy.spatial.transform import Rotation
from torch import Tensor

import torchsphere as ts
from experiments.experiment import Array
from experiments.validation.attack_footage import MARGIN_PX, Flight, blotches, digitised
from experiments.validation.rendered_footage import Look, by_renderer
from torchsphere.synthetic import ray_caster

#: Steps of the integration of the true motion in a frame's interval.
SUBSTEPS = 40

#: Rays along a side of a pixel within the outline.
SUBSAMPLES = 3

#: Standard deviation of the ball's radius over the camera's distance, and its largest value.
SD_NEARNESS, MAX_NEARNESS = 0.03, 0.1

#: Grey level of the bar that the ball hits.
BAR = 170.0


@dataclass(frozen=True)
class Drawn:
    """A flight as its seed draws it: per frame, px and rad."""

    radius: float
    noise: float
    speed: float
    turn_deg: float
    frames: int
    contact: tuple[float, float] | None  # start and end, frames
    speckle_px: float
    is_blotched: bool
    nearness: float  # radius over the camera's distance
    film: str  # "ray caster", or light of the renderer: "uniform" or "lamp"


def drawn(seed: int) -> Drawn:
    """The flight of a seed."""
    rng = np.random.default_rng(seed)
    radius = 80.0 if rng.random() < 0.05 else rng.uniform(20, 60)
    noise = float(np.exp(rng.uniform(math.log(0.5), math.log(8))))
    speed, turn, frames = rng.uniform(0, 6), rng.uniform(0, 8), int(rng.integers(40, 61))
    has_impact = rng.random() < 1 / 3 and speed > 0.5
    start = rng.uniform(0.35, 0.5) * frames
    contact = (start, start + rng.uniform(6, 12)) if has_impact else None
    speckle_px, is_blotched = rng.uniform(3, 5), bool(rng.random() < 0.5)
    nearness = min(abs(rng.normal(0, SD_NEARNESS)), MAX_NEARNESS)
    film = ("ray caster", "uniform", "ray caster", "lamp")[seed % 4]
    return Drawn(radius, noise, speed, turn, frames, contact, speckle_px, is_blotched, nearness, film)


@dataclass(frozen=True)
class Truth:
    """A flight with its exact rates at the frames."""

    made: Flight
    rate: Array  # (n, 5), px and rad per frame
    acceleration: Array  # (n, 2), px per frame^2


def flown(seed: int, flight: Drawn) -> Truth:
    """Poses and rates by fine integration; half a sine of force turns the flight round and changes the spin."""
    rng = np.random.default_rng(seed + 10_000)
    heading = rng.uniform(-0.35, 0.35) + (math.pi if rng.random() < 0.5 else 0)
    axis = rng.normal(size=3)
    before = np.array([*flight.speed * np.array([math.cos(heading), math.sin(heading)]), 0, 0, 0])
    before[2:] = np.radians(flight.turn_deg) * axis / np.linalg.norm(axis)
    change = np.array([-rng.uniform(1.2, 1.8), rng.uniform(-0.2, 0.2), 0, 0, 0]) * before[[0, 0, 0, 0, 0]]
    change[2:] = np.radians(rng.uniform(-0.3, 0.3, 3))
    times = np.arange((flight.frames - 1) * SUBSTEPS + 1) / SUBSTEPS
    middle = times[:-1] + 0.5 / SUBSTEPS
    fine = before + _share(middle, flight.contact)[:, None] * change
    path = np.concatenate((np.zeros((1, 2)), fine[:, :2].cumsum(0) / SUBSTEPS))
    turned = [Rotation.identity()]
    for step in fine[:, 2:] / SUBSTEPS:
        turned.append(Rotation.from_rotvec(step) * turned[-1])
    path += flight.radius + MARGIN_PX + rng.random(2) - path.min(0)
    width, height = (math.ceil(v) for v in path.max(0) + flight.radius + MARGIN_PX)
    still = torch.full((height, width), float(rng.uniform(50, 150)))
    if flight.is_blotched:
        still = blotches((height, width), seed, 3.0, 20.0)
    if flight.contact is not None:
        _put_bar(still, path[:, 0], flight.radius, is_right=bool(before[0] > 0))
    pattern = ray_caster.speckle(seed, radius_px=flight.radius, speckle_px=flight.speckle_px)
    frames = np.arange(flight.frames)
    turns = Rotation.concatenate([turned[k * SUBSTEPS] for k in frames])
    camera = ts.Camera(focal_px=flight.radius / flight.nearness).settled(tuple(still.shape))
    made = Flight(pattern, flight.radius, path[::SUBSTEPS], turns, still, seed, camera=camera)
    rate = before + _share(frames, flight.contact)[:, None] * change
    return Truth(made, rate, _share_slope(frames, flight.contact)[:, None] * change[:2])


def _put_bar(still: torch.Tensor, x: Array, radius: float, *, is_right: bool) -> None:
    """Draw the bar where the ball turns round."""
    if is_right:
        still[:, math.ceil(x.max() + radius) + 1 :] = BAR
    else:
        still[:, : max(math.floor(x.min() - radius), 0)] = BAR


def _share(times: Array, contact: tuple[float, float] | None) -> Array:
    """Share of the change of velocity that is done at the times."""
    if contact is None:
        return np.zeros(len(times))
    passed = np.clip((times - contact[0]) / (contact[1] - contact[0]), 0, 1)
    return np.asarray(0.5 * (1 - np.cos(math.pi * passed)))


def _share_slope(times: Array, contact: tuple[float, float] | None) -> Array:
    """Derivative of `_share`."""
    if contact is None:
        return np.zeros(len(times))
    length = contact[1] - contact[0]
    passed = (times - contact[0]) / length
    return np.where((passed > 0) & (passed < 1), 0.5 * math.pi / length * np.sin(math.pi * passed), 0.0)


def filmed(flight: Drawn, made: Flight) -> Tensor:
    """Images (n, h, w) of the flight by a camera with noise."""
    if flight.film == "ray caster":
        centres, turned = torch.from_numpy(made.centres).float(), torch.from_numpy(made.turns.as_matrix()).float()
        clean = ray_caster.render(
            made.pattern, centres, made.radius, turned, made.background, subsamples=SUBSAMPLES, camera=made.camera
        )
    else:
        clean = by_renderer(made, Look(flight.speckle_px, has_lamp=flight.film == "lamp"))
    return digitised(clean, made.seed, flight.noise)
