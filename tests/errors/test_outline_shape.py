"""Outlines of fixed axes are said; what a motion, a lens, a near camera or a codec does to outlines is not."""

import math

import numpy as np
import pytest
import torch
from shots import SHAPE, Shot, clean, compressed, noisy, rotation_matrix, speckle, textured, turned
from torch import Tensor

import torchsphere as ts
from torchsphere.errors.outline_shape import NEAREST, Allowed, axis_ratio
from torchsphere.geometry.camera import Camera
from torchsphere.imaging.interpolation import blur
from torchsphere.recording.frame_source import Source
from torchsphere.recording.square_pixels import with_square_pixels
from torchsphere.synthetic import ray_caster

#: A camera of which nothing is known, and an exposure that may last from image to image.
UNKNOWN = Allowed(NEAREST, 1.0, math.inf)


def stretched(made: Shot, aspect: float) -> Shot:
    """The shot as its images look where their pixels, which have those sides, are taken for square."""
    # Images are enlarged to square pixels; the inverse of a ratio draws them as if they had it.
    images = torch.from_numpy(with_square_pixels(made.images.numpy(), 1 / aspect))
    wide, high = max(1 / aspect, 1.0), max(aspect, 1.0)
    centres = (made.centres + 0.5) * torch.tensor([wide, high]) - 0.5
    return Shot(images, centres, made.orientations, made.increments, 0.5 * (wide + high) * made.radius)


def ratio_of(made: Shot, allowed: Allowed = UNKNOWN, images: Tensor | None = None) -> float | None:
    source = Source.open(made.images if images is None else images)
    return axis_ratio(source, made.centres.numpy(), made.radius, None, allowed)


def slow(**options: float) -> Shot:
    """A ball in the middle of the image, where a near camera sees it from the front."""
    return clean(**{"n": 6, "step": (2.0, 0.4), "start": (245.0, 125.0), "radius": 40.0, **options})


@pytest.mark.parametrize("seed", [1, 2, 3])
@pytest.mark.parametrize("aspect", [16 / 15, 1.1, 0.8])
def test_the_ratio_of_the_sides_is_found(aspect: float, seed: int) -> None:
    found = ratio_of(stretched(slow(seed=seed), aspect))
    assert found == pytest.approx(1 / aspect, rel=0.025)


DISTURBED = {
    "nothing": lambda made: made.images,
    "noise": lambda made: noisy(made.images, 15.0, 1),
    "a lens out of focus": lambda made: blur(made.images, 2.5),
    "a codec": lambda made: compressed(made.images, 24.0),
}


@pytest.mark.parametrize("name", DISTURBED)
def test_a_disturbed_circle_is_none(name: str) -> None:
    made = slow(seed=2)
    assert ratio_of(made, images=DISTURBED[name](made)) is None


def test_a_strong_background_is_none() -> None:
    assert ratio_of(slow(seed=4, background=textured(5, 3.0, 40.0))) is None


@pytest.mark.parametrize("step", [(10.0, 0.4), (0.3, 10.0)])
def test_a_smear_is_none(step: tuple[float, float]) -> None:
    made = clean(seed=2, n=6, step=step, exposure=1.0, start=(220.0, 90.0))
    assert ratio_of(made) is None
    # What nobody allows for would be taken for long pixels.
    assert ratio_of(made, Allowed(0.0, 0.0, math.inf)) is not None


def filmed_near(radii: float, start: tuple[float, float]) -> Shot:
    """Images by a camera that many radii away."""
    radius, n = 40.0, 6
    camera = Camera(focal_px=radii * radius, principal_px=(255.5, 127.5))
    centres = torch.tensor(start, dtype=torch.float64) + torch.arange(n)[:, None] * torch.tensor([4.0, 0.3])
    turn = torch.deg2rad(torch.tensor(turned(0.57), dtype=torch.float64))
    orientations = torch.stack([rotation_matrix(turn * i) for i in range(n)])
    pattern, poses = speckle(1, radius), (centres.float(), orientations.float())
    images = ray_caster.render(pattern, poses[0], radius, poses[1], 90.0, shape=SHAPE, camera=camera)
    return Shot(noisy(images, 1.0, 1), centres, orientations, torch.empty(0), radius)


@pytest.mark.parametrize(("radii", "start"), [(8.0, (70.0, 120.0)), (8.0, (250.0, 60.0)), (15.0, (70.0, 120.0))])
def test_a_near_camera_is_none(radii: float, start: tuple[float, float]) -> None:
    made = filmed_near(radii, start)
    assert ratio_of(made) is None
    assert ratio_of(made, Allowed(1 / radii, 0.0, math.inf)) is None


def test_axes_that_turn_are_none() -> None:
    shapes = [stretched(slow(seed=3), aspect) for aspect in (1.1, 1.0, 1 / 1.1, 1.0, 1.1, 1 / 1.1)]
    height, width = (min(made.images.shape[k] for made in shapes) for k in (1, 2))
    images = torch.stack([made.images[i, :height, :width] for i, made in enumerate(shapes)])
    centres = torch.stack([made.centres[i] for i, made in enumerate(shapes)])
    # The ball lies in the middle of none of them, but the camera is known to be far.
    source = Source.open(images)
    assert axis_ratio(source, centres.numpy(), 41.0, None, Allowed(0.0, 0.0, math.inf)) is None


def test_a_track_says_by_how_much_and_what_to_give() -> None:
    made = stretched(slow(seed=1, n=6), 1.1)
    wrong = ts.track(made.images, circle=made.circle, sphere_map=False, log=False)
    sentence = next(text for text in wrong.warnings if "no circle" in text)
    assert "higher than wide" in sentence
    assert "`pixel_aspect`" in sentence
    assert "1.1" in sentence
    # The other side is enlarged as well: the ball is round, and larger.
    x, y, radius = (1.1 * value for value in slow(seed=1).circle)
    circle = (x + 0.05, y + 0.05, radius)
    right = ts.track(made.images, circle=circle, sphere_map=False, pixel_aspect=1.1, log=False)
    assert right.findings.axis_ratio is None
    assert np.isfinite(right.increment).all()
