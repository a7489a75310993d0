"""Example images of the ball, rendered or filmed, as the camera will see it: rescaled, and blurred by the motion."""

from __future__ import annotations

import dataclasses
import math
from dataclasses import dataclass
from pathlib import Path

import torch
import torch.nn.functional as F  # noqa: N812  (torch's own custom)
from torch import Tensor

from torchsphere.geometry import motion_models
from torchsphere.imaging import interpolation
from torchsphere.recording import open_recording
from torchsphere.recording.folder import IMAGE_SUFFIXES, read_image
from torchsphere.settings.arrays import check_circle
from torchsphere.settings.limits import SettingError
from torchsphere.synthetic import ray_caster

#: Background around a rendered ball, px: the reach of crop, spline and pre-blur.
MARGIN_PX = 14

#: Sub-frames per px of motion blur.
SUB_FRAMES_PER_PX = 2.0

#: Rays along a side of a pixel (docs/constants.toml).
RAYS = 6

#: Least motion blur that changes the image, px.
MIN_BLUR_PX = 0.05

#: Rotations that show six sides of a rendered ball, rad (docs/constants.toml).
SIDES = tuple((x * math.pi / 2, y * math.pi / 2, 0.0) for x, y in ((0, 0), (0, 1), (0, 2), (0, 3), (1, 0), (-1, 0)))

#: Grey level of a rendered background.
BACKGROUND = 90.0


@dataclass(frozen=True)
class Example:
    """One image of the ball, with a companion that separates its noise from its texture."""

    image: Tensor  # grey levels (h, w), float32
    noise: Tensor  # another draw (h, w) of the noise in the image, alone, processed as the image is
    circle: tuple[float, float, float]  # outline (x, y, radius), px
    origin: str  # source of the image, in words


def rendered_examples(
    radius_px: float, speckle_px: float, low: float, high: float, seed: int = 0
) -> tuple[Example, ...]:
    """Several sides of a rendered ball with random speckle: sharp, without noise.

    ``speckle_px`` is the full width at half maximum of a spot; grey levels are between ``low`` and ``high``. Raises
    ValueError if the ball is too small, the spots are not smaller than the radius, or the levels do not rise.
    """
    if not 0 <= low < high < math.inf:
        raise SettingError(f"`grey` = {low:g},{high:g}: expected two finite levels, the dark one first")
    if not 0 < speckle_px < radius_px:
        raise SettingError(
            f"`speckle_px` = {speckle_px:.3g} on a ball of radius {radius_px:.3g} px: expected spots above 0, smaller "
            "than the radius"
        )
    side = 2 * (math.ceil(radius_px) + MARGIN_PX) + 1
    # Off the pixel grid, so that the example is no special case.
    centre = (side // 2 + 0.3, side // 2 - 0.2)
    check_circle(torch.tensor([[*centre, radius_px]]), (side, side))
    images = ray_caster.render(
        ray_caster.speckle(seed, radius_px=radius_px, speckle_px=speckle_px, low=low, high=high),
        torch.tensor([centre]).expand(len(SIDES), -1),
        radius_px,
        torch.stack([motion_models.rotation_matrix(torch.tensor(turn)) for turn in SIDES]),
        BACKGROUND,
        shape=(side, side),
        subsamples=RAYS,
    )
    origin = f"rendered speckle of {speckle_px:.3g} px, grey levels {low:g} to {high:g}"
    return tuple(Example(image, torch.zeros_like(image), (*centre, radius_px), origin) for image in images)


def filmed_example(path: Path, circle: tuple[float, float, float], noise: float) -> Example:
    """The first image of a file or folder, with the ball's outline and the image noise in grey levels.

    Raises ValueError or OSError if the file is no image, or does not show the whole ball.
    """
    if path.suffix.lower() in IMAGE_SUFFIXES and path.suffix.lower() not in (".tif", ".tiff"):
        image = torch.from_numpy(read_image(path))
    else:
        with open_recording(path) as recording:
            image = torch.from_numpy(recording.images(0, 1)[0])
    height, width = image.shape
    check_circle(torch.tensor([circle], dtype=torch.float64), image.shape)
    x, y, radius = circle
    if min(x - radius, y - radius, width - 1 - x - radius, height - 1 - y - radius) < -0.5:
        raise SettingError(
            f"`circle` = {x:g},{y:g},{radius:g}: reaches beyond the image of {width} x {height} px; take an image that "
            "shows the whole ball"
        )
    return Example(image, white_noise(image, noise, seed=0), circle, f"example image {path.name}")


def white_noise(image: Tensor, noise: float, seed: int = 1) -> Tensor:
    """White noise (h, w) of the standard deviation ``noise``, grey levels, in the shape of ``image``."""
    return noise * torch.randn(image.shape, generator=torch.Generator().manual_seed(seed))


def rescaled(example: Example, radius_px: float) -> Example:
    """The example in a camera of another scale, in which the ball has the radius ``radius_px``.

    A smaller image is the mean over larger pixels; a larger image is not sharper than the example.
    """
    factor = radius_px / example.circle[2]
    if abs(factor - 1) < 1e-3:
        return example
    height, width = example.image.shape
    shape = (max(round(height * factor), 1), max(round(width * factor), 1))
    layers = torch.stack((example.image, example.noise))[None]
    image, noise = F.interpolate(layers, shape, mode="bicubic", antialias=True, align_corners=False)[0]
    x, y, _ = example.circle
    # Pixel centres are whole numbers, their edges halves; the rounded shape stretches x and y slightly.
    centre = ((x + 0.5) * shape[1] / width - 0.5, (y + 0.5) * shape[0] / height - 0.5)
    return dataclasses.replace(example, image=image, noise=noise, circle=(*centre, radius_px))


def blurred(example: Example, motion_px: tuple[float, float]) -> Example:
    """The example with the blur of a motion (x, y) during the exposure: the mean over the moments of the exposure.

    Section 3.3 of the paper. The ball's turn during the exposure is neglected, because it is a hundredth of the blur.
    """
    length = math.hypot(*motion_px)
    if length < MIN_BLUR_PX:
        return example
    count = max(math.ceil(SUB_FRAMES_PER_PX * length), 2)
    shares = (torch.arange(count) + 0.5) / count - 0.5
    height, width = example.image.shape
    rows, columns = torch.meshgrid(torch.arange(float(height)), torch.arange(float(width)), indexing="ij")
    grid = torch.stack((columns, rows), -1).reshape(-1, 2)
    layers = interpolation.coefficients(torch.stack((example.image, example.noise)), 0.0)
    total = torch.zeros_like(layers)
    limit = torch.tensor([width - 2.0, height - 2.0])
    for share in shares:
        points = torch.minimum((grid + share * torch.tensor(motion_px)).clamp_min(1.0), limit)
        total += interpolation.sample(layers, points.expand(2, -1, -1)).reshape(2, height, width)
    image, noise = total / count
    return dataclasses.replace(example, image=image, noise=noise)
