"""A codec's copies of the background are recognised, and widen the steps of a ball that it draws likewise."""

import numpy as np
import pytest
import torch

from torchsphere.errors import coded_video
from torchsphere.errors.background_blocks import background_blocks
from torchsphere.recording.frame_source import Source

POSITION = np.column_stack((20.0 + np.arange(24), np.full(24, 30.0)))


def is_coded(images: torch.Tensor) -> bool:
    return coded_video.is_coded(background_blocks(Source.open(images), POSITION, 12.0, None))


def noise() -> torch.Tensor:
    return (80 + 3 * torch.randn(24, 96, 120, generator=torch.Generator().manual_seed(0))).round()


def test_textured_parts_that_stay_the_same_are_a_codecs() -> None:
    images = noise()
    assert not is_coded(images)
    images[:, :48, 56:] = images[0, :48, 56:]
    assert is_coded(images)


def test_clipped_parts_and_images_shown_twice_are_not_a_codecs() -> None:
    clipped = noise()
    clipped[:, :48, 56:] = 0
    assert not is_coded(clipped)
    twice = noise().repeat_interleave(2, 0)[:24]
    assert not is_coded(twice)


def test_no_background_tells_nothing() -> None:
    assert not coded_video.is_coded([])
    assert not is_coded(noise()[:, :20, :40])


def test_steps_between_two_images_keep_a_quarter_of_a_px_and_steps_on_a_map_do_not() -> None:
    covariance, on_map = np.tile(np.eye(5) * 1e-4, (2, 1, 1)), np.array([True, True, False])
    sd = np.sqrt(np.diagonal(coded_video.widened(covariance, on_map, 20.0), axis1=1, axis2=2))
    assert sd[0] == pytest.approx(0.02)
    of_vector = 0.25 / np.sqrt(12)
    assert sd[1, :2] == pytest.approx(np.hypot(0.02, of_vector))
    assert sd[1, 2:] == pytest.approx(np.hypot(0.02, of_vector / 20))
