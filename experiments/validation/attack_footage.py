"""Footage of balls with exact truth, clean or disturbed, for `experiments.validation.attack`.

A `Flight` has the exact poses; a `Recorded` has the images of a camera that filmed the flight, and the options that
its user would give to `ts.track`.
"""

from __future__ import annotations

import io
import math
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
import torch
from scipy.spatial.transform import Rotation
from torch import Tensor

import torchsphere as ts
from experiments.experiment import Array
from torchsphere.imaging.interpolation import blur
from torchsphere.synthetic import ray_caster

#: Pixels between the path of the outline and the border of the image.
MARGIN_PX = 14

#: Noise of the camera, grey levels, and poses within an exposure.
NOISE, EXPOSURES = 2.0, 7


@dataclass(frozen=True)
class Flight:
    """A ball and its exact poses."""

    pattern: ray_caster.Pattern
    radius: float  # px, in the first frame
    centres: Array  # (n, 2), px
    turns: Rotation  # n orientations, camera frame
    background: Tensor  # (h, w)
    seed: int
    growth: float = 0.0  # of the radius per frame, relative
    axes: tuple[float, float, float] = (1.0, 1.0, 1.0)  # half axes in radii, in the body's frame
    camera: ts.Camera | None = None

    def at(self, moments: Array) -> tuple[Tensor, Tensor]:
        """Centres (m, 2) and orientations (m, 3, 3) at moments between the frames, frames."""
        base = np.clip(np.floor(moments).astype(int), 0, len(self.centres) - 2)
        share = moments - base
        step, turn = self.centres[base + 1] - self.centres[base], self.turns[base + 1] * self.turns[base].inv()
        centres = self.centres[base] + share[:, None] * step
        turned = Rotation.from_rotvec(share[:, None] * turn.as_rotvec()) * self.turns[base]
        return torch.from_numpy(centres).float(), torch.from_numpy(turned.as_matrix()).float()


@dataclass(frozen=True)
class Recorded:
    """Images (n, h, w) of a flight, its true positions (n, 2) px and orientations, and options of `ts.track`.

    ``rival`` has the positions (n, 2) of a second ball with the same orientations: a program that names both may take
    either.
    """

    images: Tensor
    position: Array
    turns: Rotation
    options: dict[str, Any] = field(default_factory=dict)
    rival: Array | None = None


#: Makes a recording from a seed.
Case = Callable[[int], Recorded]


def flight(
    seed: int,
    *,
    frames: int = 40,
    radius: float | None = None,
    speed: float | None = None,
    turn_deg: float | None = None,
    contrast: tuple[float, float] = (30.0, 220.0),
    pattern: Callable[[int, float], ray_caster.Pattern] | None = None,
) -> Flight:
    """A steady flight with a direction, an axis, a size and a texture of its own for each seed.

    By default the radius is 26 to 40 px, the speed 0.5 to 5 px and the turn 0.3 to 4 deg per frame.
    """
    rng = np.random.default_rng(seed)
    drawn = rng.uniform(26, 40), rng.uniform(0.5, 5), rng.uniform(0.3, 4)
    radius, speed, turn = (b if a is None else a for a, b in zip((radius, speed, turn_deg), drawn, strict=True))
    heading = rng.uniform(-0.35, 0.35) + (math.pi if rng.random() < 0.5 else 0)
    axis = rng.normal(size=3)
    path = np.arange(frames)[:, None] * speed * np.array([math.cos(heading), math.sin(heading)])
    path = path - path.min(0) + radius + MARGIN_PX + rng.random(2)
    turned = np.radians(turn) * axis / np.linalg.norm(axis)
    width, height = (math.ceil(v) for v in path.max(0) + radius + MARGIN_PX)
    if pattern is None:
        speckle_px = rng.uniform(3, 5)
        made = ray_caster.speckle(seed, radius_px=radius, speckle_px=speckle_px, low=contrast[0], high=contrast[1])
    else:
        made = pattern(seed, radius)
    still = torch.full((height, width), float(rng.uniform(50, 150)))
    return Flight(made, radius, path, Rotation.from_rotvec(np.arange(frames)[:, None] * turned), still, seed)


def blotches(shape: tuple[int, int], seed: int, size_px: float = 2.0, spread: float = 40.0) -> Tensor:
    """A still texture (h, w) of random blotches, grey levels."""
    noise = torch.randn(1, *shape, generator=torch.Generator().manual_seed(seed))
    smooth = blur(noise, size_px)[0]
    return (120 + spread * smooth / smooth.std()).clamp(0, 255)


def filmed(made: Flight, *, exposure: float = 0.0, rows_late: float = 0.0) -> Tensor:
    """Clean images (n, h, w) at every frame; the mean over an ``exposure`` (share of the interval) around it.

    Odd rows are seen ``rows_late`` frames later, as in interlaced video.
    """
    moments = np.arange(len(made.centres), dtype=float)
    late = np.linspace(-0.5, 0.5, EXPOSURES) * exposure if exposure else np.zeros(1)
    images = torch.stack([rendered(made, moments + shift) for shift in late]).mean(0)
    if rows_late:
        images[:, 1::2] = rendered(made, moments + rows_late)[:, 1::2]
    return images


def rendered(made: Flight, moments: Array) -> Tensor:
    """Images (m, h, w) at the moments, frames, without noise."""
    centres, turned = made.at(moments)
    if made.axes != (1.0, 1.0, 1.0):
        return torch.stack([_ellipsoid(made, centre, turn) for centre, turn in zip(centres, turned, strict=True)])
    images = []
    for moment, centre, turn in zip(moments, centres, turned, strict=True):
        radius = made.radius * (1 + made.growth) ** float(moment)
        images.append(
            ray_caster.render(
                made.pattern, centre[None], radius, turn[None], made.background, subsamples=4, camera=made.camera
            )[0]
        )
    return torch.stack(images)


def _ellipsoid(made: Flight, centre: Tensor, turn: Tensor) -> Tensor:
    """One image of a body with half axes of ``axes`` radii; parallel rays, 3 x 3 a pixel."""
    height, width = made.background.shape
    fine = [(torch.arange(size * 3) + 0.5) / 3 - 0.5 for size in (height, width)]
    y, x = torch.meshgrid(*fine, indexing="ij")
    start = torch.stack(((x - centre[0]) / made.radius, (y - centre[1]) / made.radius, torch.zeros_like(x)), -1)
    scale = torch.tensor(made.axes)
    from_body, along = start @ turn / scale, turn[2] / scale
    a, b, c = along @ along, from_body @ along, from_body.square().sum(-1) - 1
    root = b.square() - a * c
    hit = root > 0
    body = (from_body + ((-b - root.clamp_min(0).sqrt()) / a)[..., None] * along) * scale
    grid = body[None, None] / ray_caster.CUBE_HALF_WIDTH
    grey = torch.nn.functional.grid_sample(made.pattern.volume[None, None], grid, align_corners=True)[0, 0, 0]
    still = made.background.repeat_interleave(3, 0).repeat_interleave(3, 1)
    return torch.nn.functional.avg_pool2d(torch.where(hit, grey, still)[None], 3)[0]


def digitised(images: Tensor, seed: int, noise: float = NOISE) -> Tensor:
    """Images with white noise, rounded to 256 grey levels."""
    generator = torch.Generator().manual_seed(seed + 1000)
    return (images + noise * torch.randn(images.shape, generator=generator)).round().clamp(0, 255)


def recorded(made: Flight, images: Tensor, **options: Any) -> Recorded:
    """The ``images`` with noise and the truth of the flight."""
    return Recorded(digitised(images, made.seed), made.centres, made.turns, options)


def seen_as(made: Recorded, images: Tensor) -> Recorded:
    """The same recording with other images, as after a video codec."""
    return replace(made, images=images)


def offsets(made: Flight, images: Tensor) -> tuple[Tensor, Tensor]:
    """Distances (n, h, w) of all pixels from the centre in each frame along x and y, radii."""
    height, width = images.shape[1:]
    centres = torch.from_numpy(made.centres).float()
    x = (torch.arange(width)[None, None] - centres[:, 0, None, None]) / made.radius
    y = (torch.arange(height)[None, :, None] - centres[:, 1, None, None]) / made.radius
    return x.expand_as(images), y.expand_as(images)


def h264(images: Tensor, crf: int) -> Tensor:
    """The images after H.264 with that rate factor; sides are cut to even numbers by repeating the border."""
    import av

    pixels = images.to(torch.uint8).numpy()
    pixels = np.pad(pixels, ((0, 0), (0, pixels.shape[1] % 2), (0, pixels.shape[2] % 2)), mode="edge")
    stream = io.BytesIO()
    with av.open(stream, "w", format="mp4") as container:
        video = container.add_stream("libx264", rate=30, options={"crf": str(crf)})
        video.height, video.width, video.pix_fmt = *pixels.shape[1:], "yuv420p"
        for image in pixels:
            frame = av.VideoFrame.from_ndarray(np.repeat(image[..., None], 3, -1), format="rgb24")
            container.mux(video.encode(frame))
        container.mux(video.encode(None))
    stream.seek(0)
    with av.open(stream) as container:
        decoded = [frame.to_ndarray(format="gray") for frame in container.decode(video=0)]
    return torch.from_numpy(np.stack(decoded)).float()[:, : images.shape[1], : images.shape[2]]
