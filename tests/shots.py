"""Synthetic shots with known truth: a ball with a pattern, poses, noise and the rounding of a camera."""

from __future__ import annotations

import functools
import math
from dataclasses import dataclass

import numpy as np
import torch
from torch import Tensor

from torchsphere.imaging.interpolation import blur
from torchsphere.synthetic import ray_caster
from torchsphere.synthetic.ray_caster import CUBE_HALF_WIDTH, Pattern
from torchsphere.tracking.track import Track, track

SHAPE = (256, 512)


@dataclass(frozen=True)
class Shot:
    """Images of a ball (n, h, w) and its true motion: px and rad, camera frame, float64."""

    images: Tensor
    centres: Tensor  # (n, 2)
    orientations: Tensor  # (n, 3, 3)
    increments: Tensor  # (n - 1, 5)
    radius: float

    @property
    def circle(self) -> tuple[float, float, float]:
        x, y = self.centres[0].tolist()
        return x, y, self.radius


def rotation_matrix(vector: Tensor) -> Tensor:
    """Rodrigues' formula, (3,) in rad -> (3, 3); independent of the package, so that a wrong sign there shows."""
    angle = float(vector.norm())
    x, y, z = vector.tolist()
    cross = torch.tensor([[0, -z, y], [z, 0, -x], [-y, x, 0]], dtype=torch.float64)
    if angle == 0:
        return torch.eye(3, dtype=torch.float64)
    sine, versine = math.sin(angle) / angle, (1 - math.cos(angle)) / angle**2
    return torch.eye(3, dtype=torch.float64) + sine * cross + versine * cross @ cross


@functools.lru_cache(maxsize=16)
def speckle(seed: int, radius: float, low: float = 30.0, high: float = 220.0) -> Pattern:
    return ray_caster.speckle(seed, radius_px=radius, low=low, high=high)


@functools.lru_cache(maxsize=1)
def spot(x: float, y: float, level: float = 60.0, height: float = 150.0) -> Pattern:
    """A grey ball with one bright spot, at first at (x, y) radii from the centre in the image."""
    steps = torch.linspace(-CUBE_HALF_WIDTH, CUBE_HALF_WIDTH, 96)
    z, v, u = torch.meshgrid(steps, steps, steps, indexing="ij")
    squared = (u - x) ** 2 + (v - y) ** 2 + (z + math.sqrt(1 - x**2 - y**2)) ** 2
    return Pattern(level + height * torch.exp(-squared / (2 * 0.1**2)))


def textured(seed: int, blur_px: float, amplitude: float, mean: float = 120.0) -> Tensor:
    """A still background (h, w) of random blotches."""
    generator = torch.Generator().manual_seed(seed)
    field = blur(torch.randn(1, *SHAPE, generator=generator), blur_px)[0]
    return (mean + amplitude * field / field.std()).clamp(0, 255)


def noisy(images: Tensor, noise: float, seed: int) -> Tensor:
    """Add white noise and round to the 256 grey levels of an 8 bit camera."""
    generator = torch.Generator().manual_seed(seed)
    return (images + noise * torch.randn(images.shape, generator=generator)).round().clamp(0, 255)


def shot(
    seed: int = 0,
    *,
    n: int = 60,
    step: tuple[float, float] = (1.4, 0.2),
    jitter: float = 0.3,
    rotation_deg: tuple[float, float, float] = (0.2, 0.5, 0.2),
    radius: float = 50.0,
    start: tuple[float, float] = (80.0, 120.0),
    background: Tensor | float = 90.0,
    low: float = 30.0,
    high: float = 220.0,
    noise: float = 2.0,
    subsamples: int = 3,
) -> Shot:
    """By default the example shot: a speckled ball over a uniform background, 8 bit.

    Nine rays per pixel leave an error of 3 grey levels at the outline; a study of the outline needs more.
    """
    generator = torch.Generator().manual_seed(seed + 100)
    phase = torch.rand(n, 2, generator=generator, dtype=torch.float64)
    steps = torch.tensor(step, dtype=torch.float64) + jitter * (2 * phase[1:] - 1)
    turn = torch.deg2rad(torch.tensor(rotation_deg, dtype=torch.float64))
    centres = torch.tensor(start, dtype=torch.float64) + phase[0] + torch.cat((torch.zeros(1, 2), steps.cumsum(0)))
    orientations = torch.stack([rotation_matrix(turn * i) for i in range(n)])
    pattern, poses = speckle(seed, radius, low, high), (centres.float(), orientations.float())
    images = ray_caster.render(pattern, poses[0], radius, poses[1], background, shape=SHAPE, subsamples=subsamples)
    increments = torch.cat((steps, turn.expand(n - 1, 3)), 1)
    return Shot(noisy(images, noise, seed + 200), centres, orientations, increments, radius)


def pair(
    q: tuple[float, float, float, float, float],
    *,
    seed: int = 0,
    pattern: Pattern | None = None,
    radius: float = 50.0,
    centre: tuple[float, float] = (63.2, 64.7),
    shape: tuple[int, int] = (130, 130),
    background: float = 90.0,
) -> tuple[Tensor, Tensor, tuple[float, float, float]]:
    """Images f and g (h, w), float64, without noise, of a ball that moves by q, and the circle of the ball.

    q = (dx, dy, wx, wy, wz), px and degrees.
    """
    motion = torch.tensor(q, dtype=torch.float64)
    centres = torch.tensor(centre, dtype=torch.float64) + torch.stack((torch.zeros(2), motion[:2]))
    turned = torch.stack((torch.eye(3, dtype=torch.float64), rotation_matrix(torch.deg2rad(motion[2:]))))
    images = ray_caster.render(pattern or speckle(seed, radius), centres, radius, turned, background, shape=shape)
    return images[0], images[1], (*centre, radius)


@dataclass(frozen=True)
class ExampleTrack:
    """A shot, its track, and the reports of progress."""

    shot: Shot
    track: Track
    progress: list[tuple[int, int]]

    @property
    def errors(self) -> np.ndarray:
        """Measured minus true increments (n - 1, 5): px and degrees."""
        return increment_errors(self.track, self.shot)


def example_track() -> ExampleTrack:
    made = shot(0)
    calls: list[tuple[int, int]] = []
    return ExampleTrack(made, track(made.images, progress=lambda done, total: calls.append((done, total))), calls)


def increment_errors(measured: Track, made: Shot) -> np.ndarray:
    """Measured minus true increments (n - 1, 5): px and degrees."""
    errors = measured.increment - made.increments.numpy()
    errors[:, 2:] = np.rad2deg(errors[:, 2:])
    return errors


def angles_between(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Angle (n,) in degrees of the rotation from one matrix to the other."""
    trace = np.einsum("nij,nij->n", a, b)
    return np.rad2deg(np.arccos(np.clip((trace - 1) / 2, -1, 1)))


#: An oblique axis: all modes of the rotation are used.
OBLIQUE = (0.35, 0.85, 0.4)


def turned(degrees: float, axis: tuple[float, float, float] = OBLIQUE) -> tuple[float, float, float]:
    """Rotation vector in degrees of a turn by ``degrees`` about ``axis``."""
    direction = np.array(axis) / np.linalg.norm(axis)
    x, y, z = (degrees * direction).tolist()
    return x, y, z


def clean(
    *,
    seed: int = 0,
    n: int = 20,
    step: tuple[float, float] = (6.0, 0.4),
    turn_deg: float = 0.57,
    radius: float = 50.0,
    start: tuple[float, float] = (80.0, 120.0),
    background: Tensor | float = 90.0,
    low: float = 30.0,
    high: float = 220.0,
    exposure: float = 0.0,
) -> Shot:
    """A shot without noise and rounding, to which a disturbance is added: steady motion about the oblique axis.

    The image is the mean over the share ``exposure`` of the frame interval, around the pose of the frame.
    """
    turn = torch.deg2rad(torch.tensor(turned(turn_deg), dtype=torch.float64))
    step_px, first = (torch.tensor(v, dtype=torch.float64) for v in (step, start))
    share = torch.linspace(-0.5, 0.5, 9, dtype=torch.float64) * exposure if exposure else torch.zeros(1)
    times = torch.arange(n, dtype=torch.float64)
    moments = (times[:, None] + share).flatten()
    images = ray_caster.render(
        speckle(seed, radius, low, high),
        (first + moments[:, None] * step_px).float(),
        radius,
        torch.stack([rotation_matrix(turn * float(t)) for t in moments]).float(),
        background,
        shape=SHAPE,
    )
    orientations = torch.stack([rotation_matrix(turn * float(t)) for t in times])
    increments = torch.cat((step_px, turn)).expand(n - 1, 5)
    images = images.unflatten(0, (n, len(share))).mean(1)
    return Shot(images, first + times[:, None] * step_px, orientations, increments, radius)


def flickered(images: Tensor, amount: float, seed: int = 0) -> Tensor:
    """Each frame times a random brightness, uniform within 1 +- ``amount``."""
    generator = torch.Generator().manual_seed(seed + 300)
    return images * (1 + amount * (2 * torch.rand(len(images), 1, 1, generator=generator) - 1))


def pixel_grid(images: Tensor) -> tuple[Tensor, Tensor]:
    """Columns x (1, w) and rows y (h, 1) of the pixels."""
    return torch.arange(images.shape[-1])[None, :].float(), torch.arange(images.shape[-2])[:, None].float()


def covered(images: Tensor, cover: Tensor, level: float) -> Tensor:
    """The images behind an object of one grey level; ``cover`` (n or 1, h, w) from 0 to 1."""
    return images * (1 - cover) + level * cover


def bar(images: Tensor, middle: float, width: float, slope: float = 0.0) -> Tensor:
    """Cover (1, h, w) of a still bar across the image, with edges as wide as a pixel."""
    x, y = pixel_grid(images)
    across = (x - middle + slope * (y - 120)).abs()
    return (0.5 * width - across + 0.5).clamp(0, 1)[None]


def edge(images: Tensor, places: Tensor, slope: float = 0.0) -> Tensor:
    """Cover (n, h, w) of the half-plane to the right of a straight edge at the columns ``places`` (n,)."""
    x, y = pixel_grid(images)
    return (x + slope * (y - 120) - places.float()[:, None, None] + 0.5).clamp(0, 1)


def highlight(made: Shot, place: tuple[float, float] = (-0.35, -0.4), size: float = 0.12) -> Tensor:
    """Saturated reflection of a lamp, which moves with the ball and does not rotate."""
    x, y = pixel_grid(made.images)
    cx, cy = (made.centres + made.radius * torch.tensor(place)).float().unbind(-1)
    squared = (x - cx[:, None, None]) ** 2 + (y - cy[:, None, None]) ** 2
    return (made.images + 400 * torch.exp(-squared / (2 * (size * made.radius) ** 2))).clamp(max=255)


def shaded(made: Shot, amount: float = 0.5) -> Tensor:
    """Light from the left, which decreases across the ball and does not rotate with the ball."""
    x, _ = pixel_grid(made.images)
    across = ((x - made.centres[:, 0, None, None].float()) / made.radius).clamp(-1, 1)
    return made.images * (1 - amount * 0.5 * (1 + across))


def lamp_lit(made: Shot, direction: tuple[float, float, float], around: float = 0.3) -> Tensor:
    """The images as albedo of a matt ball under a distant lamp in that direction and some uniform light."""
    x, y = pixel_grid(made.images)
    towards = torch.tensor(direction) / torch.tensor(direction).norm()
    cx, cy = made.centres.float().T[..., None, None]
    nx, ny = (x - cx) / made.radius, (y - cy) / made.radius
    nz = -(1 - nx**2 - ny**2).clamp_min(0).sqrt()
    facing = (towards[0] * nx + towards[1] * ny + towards[2] * nz).clamp_min(0)
    return made.images * torch.where(nx**2 + ny**2 < 1, around + (1 - around) * facing, 1.0)


def compressed(images: Tensor, step: float = 12.0) -> Tensor:
    """The images in blocks of 8 x 8 px with a rounded cosine transform, as by JPEG."""
    k = torch.arange(8, dtype=torch.float32)
    basis = torch.cos((2 * k[None, :] + 1) * k[:, None] * math.pi / 16) * 0.5
    basis[0] /= math.sqrt(2)
    table = step * (1 + 0.5 * (k[:, None] + k[None, :]))
    blocks = images.unflatten(1, (-1, 8)).unflatten(3, (-1, 8)).movedim(2, 3)
    coefficients = (basis @ blocks @ basis.T / table).round() * table
    return (basis.T @ coefficients @ basis).movedim(3, 2).flatten(3, 4).flatten(1, 2).clamp(0, 255)
