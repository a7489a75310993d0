"""The disturbances of `experiments.validation.attack`: each makes a recording with exact truth from a seed."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace

import numpy as np
import torch
from scipy.spatial.transform import Rotation
from torch import Tensor

import torchsphere as ts
from experiments.validation.attack_footage import (
    Case,
    Flight,
    Recorded,
    blotches,
    digitised,
    filmed,
    flight,
    h264,
    offsets,
    recorded,
    seen_as,
)
from experiments.validation.attack_rendered import RENDERED
from torchsphere.imaging.interpolation import blur
from torchsphere.synthetic.ray_caster import CUBE_HALF_WIDTH, Pattern


def clean(seed: int) -> Recorded:
    """Nothing but noise."""
    made = flight(seed)
    return recorded(made, filmed(made))


def on_blotches(seed: int) -> Recorded:
    """A still textured background."""
    made = flight(seed)
    made = replace(made, background=blotches(tuple(made.background.shape), seed, 3.0, 25.0))
    return recorded(made, filmed(made))


def perspective(distance_radii: float, is_given: bool) -> Case:
    """A camera at that distance, which the user gives or not."""

    def make(seed: int) -> Recorded:
        made = flight(seed, turn_deg=1.8)
        height, width = made.background.shape
        principal = ((width - 1) / 2, (height - 1) / 2)
        camera = ts.Camera(focal_px=made.radius * distance_radii, principal_px=principal)
        made = replace(made, camera=camera)
        options = {"model": "pinhole", "camera": camera} if is_given else {}
        return recorded(made, filmed(made), **options)

    return make


def defocus(sigma_px: float) -> Case:
    """Blur of the lens, Gaussian."""

    def make(seed: int) -> Recorded:
        made = flight(seed)
        return recorded(made, blur(filmed(made), sigma_px))

    return make


def exposure(blur_px: float) -> Case:
    """Motion during the exposure, half of the frame interval."""

    def make(seed: int) -> Recorded:
        made = flight(seed, speed=2 * blur_px, frames=24)
        return recorded(made, filmed(made, exposure=0.5))

    return make


def turn(deg: float) -> Case:
    """A large turn per frame."""

    def make(seed: int) -> Recorded:
        made = flight(seed, turn_deg=deg, frames=30)
        return recorded(made, filmed(made))

    return make


def in_front(cover: Callable[[Flight, Tensor], Tensor], moves: bool = False) -> Case:
    """A speckled object in front of the ball, where ``cover`` (n, h, w) is True; still, or moving by 2 px per frame."""

    def make(seed: int) -> Recorded:
        made = flight(seed, speed=4.0)
        images = filmed(made)
        n, height, width = images.shape
        texture = blotches((height, width + 2 * n), seed + 50)
        look = torch.stack([texture[:, 2 * i * moves : 2 * i * moves + width] for i in range(n)])
        return recorded(made, torch.where(cover(made, images), look, images))

    return make


def plate(made: Flight, images: Tensor) -> Tensor:
    """A plate over the middle of the path."""
    x = torch.arange(images.shape[2])
    middle = images.shape[2] / 2
    return ((x - middle).abs() < 0.8 * made.radius).expand_as(images)


def bars(made: Flight, images: Tensor) -> Tensor:
    """A bar along the path over the lower half of the ball."""
    y = torch.arange(images.shape[1])[:, None]
    return (y > made.centres[:, 1].mean()).expand_as(images)


def mesh(made: Flight, images: Tensor) -> Tensor:
    """Wires of 3 px every 14 px, both ways."""
    x, y = torch.arange(images.shape[2])[None], torch.arange(images.shape[1])[:, None]
    return ((x % 14 < 3) | (y % 14 < 3)).expand_as(images)


def hand(made: Flight, images: Tensor) -> Tensor:
    """A round hand that comes in from the side and covers half of the ball."""
    n, height, width = images.shape
    x, y = torch.arange(width)[None, None], torch.arange(height)[None, :, None]
    centre = width - 2.0 * torch.arange(n)[:, None, None]
    return (x - centre).square() + (y - height).square() < (0.6 * height) ** 2


def second_ball(seed: int) -> Recorded:
    """Another ball of that size crosses in front."""
    made = flight(seed, speed=4.0)
    other = replace(made, pattern=flight(seed + 77, radius=made.radius).pattern, centres=made.centres[::-1].copy())
    images, crossing = filmed(made), filmed(other)
    x, y = offsets(other, images)
    seen = recorded(made, torch.where(x.square() + y.square() < 1, crossing, images))
    return replace(seen, rival=other.centres)


def in_place(seed: int) -> Recorded:
    """A ball that turns in its place."""
    made = flight(seed, speed=0.0)
    return recorded(made, filmed(made))


def with_light(light: Callable[[Flight, Tensor], Tensor]) -> Case:
    """Light on the ball alone: a factor and an addition for each pixel."""

    def make(seed: int) -> Recorded:
        made = flight(seed)
        images = filmed(made)
        x, y = offsets(made, images)
        return recorded(made, torch.where(x.square() + y.square() < 1, light(made, images), images))

    return make


def _normals(made: Flight, images: Tensor) -> tuple[Tensor, Tensor, Tensor]:
    x, y = offsets(made, images)
    return x, y, -(1 - x.square() - y.square()).clamp_min(0).sqrt()


def lamp(made: Flight, images: Tensor) -> Tensor:
    """A lamp at rest on one side of a matt ball."""
    x, y, z = _normals(made, images)
    return images * (0.35 + 0.65 * (0.5 * x + 0.4 * y - 0.77 * z).clamp_min(0))


def turning_light(made: Flight, images: Tensor) -> Tensor:
    """A lamp that goes round the ball, 3 deg per frame."""
    x, y, z = _normals(made, images)
    angle = torch.deg2rad(3.0 * torch.arange(len(images)))[:, None, None]
    return images * (0.35 + 0.65 * (0.65 * (x * angle.cos() + y * angle.sin()) - 0.76 * z).clamp_min(0))


def highlight(made: Flight, images: Tensor) -> Tensor:
    """A reflection of the lamp, at rest on the ball."""
    x, y = offsets(made, images)
    return images + 120 * torch.exp(-((x + 0.3).square() + (y + 0.35).square()) / (2 * 0.12**2))


def flicker(seed: int) -> Recorded:
    """The lamp flickers by 15 %."""
    made = flight(seed)
    images = filmed(made)
    gain = 1 + 0.15 * torch.sin(2.1 * torch.arange(len(images)))[:, None, None]
    return recorded(made, images * gain)


def levels(low: float, high: float, noise: float = 2.0) -> Case:
    """Texture between those grey levels: weak, or saturated."""

    def make(seed: int) -> Recorded:
        made = flight(seed, contrast=(low, high))
        return Recorded(digitised(filmed(made), seed, noise), made.centres, made.turns)

    return make


def growth(relative: float) -> Case:
    """A ball that comes nearer without perspective in its texture: its radius grows per frame."""

    def make(seed: int) -> Recorded:
        made = replace(flight(seed, frames=24), growth=relative)
        reach = math.ceil(made.radius * ((1 + relative) ** 24 - 1))
        still = torch.nn.functional.pad(made.background[None, None], (reach,) * 4, "replicate")[0, 0]
        made = replace(made, background=still, centres=made.centres + reach)
        return recorded(made, filmed(made))

    return make


def ellipsoid(seed: int) -> Recorded:
    """A body whose one axis is 3 % longer."""
    made = replace(flight(seed, turn_deg=3.0), axes=(1.03, 1.0, 1.0))
    return recorded(made, filmed(made))


def _logo(seed: int, radius: float) -> Pattern:
    steps = torch.linspace(-CUBE_HALF_WIDTH, CUBE_HALF_WIDTH, 128)
    z, y, x = torch.meshgrid(steps, steps, steps, indexing="ij")
    angle = torch.atan2((x - 0.2).hypot(y + 0.1), -z)
    rings = torch.where(angle < 0.55, torch.where((angle * 9).remainder(2) < 1, 60.0, 200.0), 170.0)
    return Pattern(blur(rings, 0.8))


def logo(seed: int) -> Recorded:
    """A plain ball with one large logo."""
    made = flight(seed, pattern=_logo, turn_deg=1.0)
    return recorded(made, filmed(made))


def _dots(seed: int, radius: float) -> Pattern:
    steps = torch.linspace(-CUBE_HALF_WIDTH, CUBE_HALF_WIDTH, 160)
    z, y, x = torch.meshgrid(steps, steps, steps, indexing="ij")
    wave = torch.cos(18 * x) * torch.cos(18 * y) * torch.cos(18 * z)
    return Pattern(125 + 90 * wave)


def repeating(seed: int) -> Recorded:
    """A texture that repeats, turning by up to a third of its period."""
    made = flight(seed, pattern=_dots)
    return recorded(made, filmed(made))


def denoised(seed: int) -> Recorded:
    """A camera that averages each image with those before (recursive, share of the new image 0.6)."""
    made = clean(seed)
    images = made.images.clone()
    for i in range(1, len(images)):
        images[i] = 0.6 * images[i] + 0.4 * images[i - 1]
    return seen_as(made, images.round())


def blended(seed: int) -> Recorded:
    """Half of each image is the next one, as after a change of the frame rate: the truth lies midway between both."""
    made = clean(seed)
    following = torch.cat((made.images[1:], made.images[-1:]))
    half = made.position.copy()
    half[:-1] = (made.position[:-1] + made.position[1:]) / 2
    by_half = Rotation.from_rotvec((made.turns[1:] * made.turns[:-1].inv()).as_rotvec() / 2)
    turns = Rotation.concatenate((by_half * made.turns[:-1], made.turns[-1]))
    return replace(seen_as(made, (0.5 * made.images + 0.5 * following).round()), position=half, turns=turns)


def compressed(crf: int) -> Case:
    """H.264."""

    def make(seed: int) -> Recorded:
        made = clean(seed)
        return seen_as(made, h264(made.images, crf))

    return make


def interlaced(seed: int) -> Recorded:
    """Odd rows half a frame later, 8 px per frame."""
    made = flight(seed, speed=8.0, frames=24)
    return recorded(made, filmed(made, rows_late=0.5))


def dropped(seed: int) -> Recorded:
    """Every seventh image is missing, without a word in the file."""
    made = clean(seed)
    kept = np.flatnonzero(np.arange(len(made.images)) % 7 != 5)
    return Recorded(made.images[kept], made.position[kept], made.turns[kept])


def doubled(seed: int) -> Recorded:
    """Every seventh image is shown twice, with the noise of a codec."""
    made = flight(seed)
    order = np.sort(np.concatenate((np.arange(len(made.centres)), np.arange(5, len(made.centres), 7))))
    images = digitised(filmed(made)[order], seed)
    return Recorded(images, made.centres[order], made.turns[order])


def wobbling(seed: int) -> Recorded:
    """A spin that changes from frame to frame."""
    made = flight(seed)
    steps = np.random.default_rng(seed).normal(0, 0.02, (len(made.centres), 3)).cumsum(0)
    made = replace(made, turns=made.turns * Rotation.from_rotvec(np.sin(steps)))
    return recorded(made, filmed(made))


#: Case by its name in the table.
CASES: dict[str, Case] = {
    "nothing": clean,
    "still blotches behind": on_blotches,
    "spin that changes": wobbling,
    "camera at 50 radii": perspective(50.0, is_given=False),
    "camera at 10 radii": perspective(10.0, is_given=False),
    "camera at 50 radii, given": perspective(50.0, is_given=True),
    "camera at 10 radii, given": perspective(10.0, is_given=True),
    "defocus of 1 px": defocus(1.0),
    "defocus of 2 px": defocus(2.0),
    "defocus of 3 px": defocus(3.0),
    "exposure blur of 1 px": exposure(1.0),
    "exposure blur of 3 px": exposure(3.0),
    "exposure blur of 5 px": exposure(5.0),
    "plate in front": in_front(plate),
    "bar over half of the ball": in_front(bars),
    "mesh in front": in_front(mesh),
    "hand in front": in_front(hand, moves=True),
    "second ball in front": second_ball,
    "turns in its place": in_place,
    "lamp from one side": with_light(lamp),
    "lamp that goes round": with_light(turning_light),
    "highlight": with_light(highlight),
    "flicker of 15 %": flicker,
    "weak texture, 12 levels": levels(110.0, 122.0),
    "weak texture, 4 levels": levels(114.0, 118.0),
    "saturated texture": levels(30.0, 330.0),
    "noise of 12 levels": levels(30.0, 220.0, noise=12.0),
    "grows by 0.1 % per frame": growth(0.001),
    "grows by 0.3 % per frame": growth(0.003),
    "grows by 1 % per frame": growth(0.01),
    "grows by 3 % per frame": growth(0.03),
    "ellipsoid, 3 %": ellipsoid,
    "plain ball with a logo": logo,
    "texture that repeats": repeating,
    "averaged over frames": denoised,
    "blended frames": blended,
    "H.264, crf 23": compressed(23),
    "H.264, crf 30": compressed(30),
    "H.264, crf 36": compressed(36),
    "interlaced, 8 px per frame": interlaced,
    "images missing": dropped,
    "images shown twice": doubled,
    "turn of 10 deg": turn(10.0),
    "turn of 20 deg": turn(20.0),
    "turn of 25 deg": turn(25.0),
    "turn of 40 deg": turn(40.0),
    **RENDERED,
}
