"""A background that moves with a shaken camera, and one that stands still beside noise, lamps and a moving target."""

import dataclasses
from pathlib import Path

import numpy as np
import pytest
import scipy
from numpy.typing import NDArray

import torchsphere as ts
from torchsphere.errors.camera_shake import camera_shake
from torchsphere.recording.frame_source import Source

FRAMES, SHAPE, RADIUS = 20, (160, 256), 20.0

Array = NDArray[np.float64]


def background(seed: int = 0) -> Array:
    texture = scipy.ndimage.gaussian_filter(np.random.default_rng(seed).normal(size=SHAPE), 2.0)
    return 100 + 20 * texture / texture.std()


def moved(image: Array, x: float, y: float) -> Array:
    return np.asarray(scipy.ndimage.shift(image, (y, x), order=3, mode="nearest"))


def filmed(images: list[Array], folder: Path, noise: float = 1.5) -> Source:
    rng = np.random.default_rng(1)
    noisy = [(image + noise * rng.normal(size=SHAPE)).round().clip(0, 255).astype(np.uint8) for image in images]
    np.save(folder / "film.npy", np.stack(noisy))
    return Source.open(ts.open_recording(folder / "film.npy"))


@pytest.fixture(scope="module")
def tracked() -> ts.Track:
    """A ball that flies from left to right."""
    images = np.random.default_rng(2).integers(0, 255, (2, 64, 64), dtype=np.uint8)
    track = ts.track(images, (32.0, 32.0, RADIUS))
    position = np.stack((np.linspace(50, 200, FRAMES), np.full(FRAMES, 80.0)), 1)
    return dataclasses.replace(track, position=position)


@pytest.mark.parametrize("x", [0.3, -0.6])
def test_a_shaken_camera_is_reported_with_its_displacement(tracked: ts.Track, tmp_path: Path, x: float) -> None:
    still = background()
    images = [still if i < 12 else moved(still, x, 0.2) for i in range(FRAMES)]
    found = camera_shake(filmed(images, tmp_path), tracked)
    assert found is not None
    assert found.px == pytest.approx(np.hypot(x, 0.2), rel=0.15)
    assert found.frame >= 12


def test_only_the_tracked_frames_are_compared(tracked: ts.Track, tmp_path: Path) -> None:
    still = background()
    images = [moved(still, 0.5, 0.0)] * 3 + [still] * FRAMES
    assert camera_shake(filmed(images[3:], tmp_path), tracked) is None
    assert camera_shake(filmed(images, tmp_path), tracked) is not None


def test_noise_and_flickering_lamps_are_no_shake(tracked: ts.Track, tmp_path: Path) -> None:
    still = background()
    lamps = [(1 + 0.2 * np.sin(i)) * still + 10 * np.cos(i) for i in range(FRAMES)]
    for noise in (0.5, 6.0):
        assert camera_shake(filmed(lamps, tmp_path, noise), tracked) is None


def test_a_target_that_moves_in_a_part_of_the_image_is_no_shake(tracked: ts.Track, tmp_path: Path) -> None:
    still = background()
    images = []
    for i in range(FRAMES):
        image = still.copy()
        image[:, 200:] = moved(still, 0.1 * i, 0.0)[:, 200:]
        images.append(image)
    assert camera_shake(filmed(images, tmp_path), tracked) is None


@pytest.mark.parametrize("noise", [0.5, 4.0])
def test_a_background_without_texture_shows_no_shake(tracked: ts.Track, tmp_path: Path, noise: float) -> None:
    assert camera_shake(filmed([np.full(SHAPE, 90.0)] * FRAMES, tmp_path, noise), tracked) is None
