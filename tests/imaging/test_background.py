"""The still background behind a moving ball."""

import numpy as np
import torch
from shots import noisy, shot, textured

from torchsphere.imaging import background as still
from torchsphere.recording.frame_source import Source


def test_a_textured_background_is_recovered_behind_the_balls_path() -> None:
    background = textured(1, 3.0, 20.0)
    made = shot(1, n=24, step=(12.0, 0.5), radius=20.0, background=background)
    found = still.background(Source.open(made.images), made.centres.numpy(), 20.0)
    # A median over 15 or more images of noise 2 and rounding.
    assert float((found - background).abs().max()) < 4.0
    assert float((found - background).square().mean().sqrt()) < 0.8


def test_what_the_ball_always_hides_is_filled_from_around() -> None:
    images = noisy(torch.full((6, 60, 60), 90.0), 1.0, 2)
    images[:, 20:40, 20:40] = 200.0
    positions = np.full((6, 2), 29.5)
    found = still.background(Source.open(images), positions, 16.0)
    assert bool(found.isfinite().all())
    # Nothing of the bright square, which the ball hides in every image.
    assert float(found.max()) < 95.0


def test_images_in_which_the_ball_is_not_known_are_not_used() -> None:
    images = noisy(torch.full((8, 60, 60), 90.0), 1.0, 3)
    images[4:] = 250.0
    positions = np.full((8, 2), 29.5)
    positions[4:] = np.nan
    found = still.background(Source.open(images), positions, 10.0)
    assert float(found.max()) < 95.0
