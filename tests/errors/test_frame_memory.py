"""Images that hold a part of the images beside them are recognised by their noise, and widen the steps."""

import numpy as np
import pytest
import torch

from torchsphere.errors import frame_memory
from torchsphere.errors.background_blocks import background_blocks
from torchsphere.geometry.circle import Circle
from torchsphere.recording.frame_source import Source

POSITION = np.column_stack((20.0 + np.arange(24), np.full(24, 30.0)))


def memory_of(images: torch.Tensor) -> float:
    return frame_memory.noise_memory(background_blocks(Source.open(images), POSITION, 12.0, None))


def noise() -> torch.Tensor:
    return 80 + 3 * torch.randn(24, 96, 120, generator=torch.Generator().manual_seed(0))


def test_the_memory_of_averaged_blended_and_plain_video_is_that_of_its_filter() -> None:
    plain = noise()
    averaged, blended = plain.clone(), plain.clone()
    for i in range(1, 24):
        averaged[i] = 0.6 * plain[i] + 0.4 * averaged[i - 1]
    blended[:-1] = (plain[:-1] + plain[1:]) / 2
    assert memory_of(plain) == 0
    assert memory_of(averaged) == pytest.approx(0.4, abs=0.05)
    assert memory_of(blended) == pytest.approx(0.5, abs=0.05)


def test_flicker_and_images_without_noise_have_no_memory() -> None:
    gain = 1 + 0.2 * torch.sin(torch.arange(24.0))[:, None, None]
    assert memory_of(noise() * gain) == 0
    assert memory_of(torch.full((24, 96, 120), 80.0)) == 0


def test_flicker_before_a_background_with_texture_has_no_memory_and_hides_none() -> None:
    """Successive images of a slow flicker are alike, and those far apart are not."""
    texture = 40 * torch.rand(96, 120, generator=torch.Generator().manual_seed(1)) - 20
    gain = 1 + 0.2 * torch.sin(0.4 * torch.arange(24.0))[:, None, None]
    seen = (noise() + texture) * gain
    assert memory_of(seen) == 0
    blended = seen.clone()
    blended[:-1] = (seen[:-1] + seen[1:]) / 2
    assert memory_of(blended) == pytest.approx(0.5, abs=0.08)


def test_a_lag_widens_steps_where_the_motion_changes() -> None:
    # 2 px per frame, and -2 px after an impact. The camera's first and last images hold no motion before and after.
    increment = np.zeros((10, 5))
    increment[:5, 0], increment[5:, 0] = 2, -2
    sd = np.sqrt(np.diagonal(frame_memory.widened(increment, np.zeros((10, 5, 5)), 0.5), axis1=1, axis2=2))
    assert sd[:, 0].tolist() == [2, 0, 0, 0, 4, 4, 0, 0, 0, 2]
    assert (sd[:, 1:] == 0).all()


def test_two_outlines_a_step_apart_make_the_radius_uncertain_by_a_quarter_of_the_step() -> None:
    increment = np.full((10, 5), np.nan)
    increment[:8] = [3.0, 4.0, 0.1, 0.0, 0.0]
    circle = frame_memory.less_certain(Circle(50.0, 40.0, 20.0, sd_x=0.1, sd_y=0.1, sd_radius=0.1), increment, 0.5)
    assert circle.sd_radius == pytest.approx(np.hypot(0.1, 5 / 4))
    assert (circle.sd_x, circle.sd_y, circle.radius) == (0.1, 0.1, 20.0)
