"""Motion blur of an example image."""

import pytest
import torch

from torchsphere.planning.example_image import Example, blurred


def test_blurring_by_two_px_averages_the_moments_of_the_exposure() -> None:
    ramp = torch.arange(40.0).square()[None].expand(40, -1).contiguous()
    example = Example(ramp, torch.zeros_like(ramp), (20.0, 20.0, 10.0), "a parabola")
    # The mean of x^2 over four moments at -0.75, -0.25, 0.25, 0.75 px is x^2 + 0.3125.
    seen = blurred(example, (2.0, 0.0)).image
    assert (seen - ramp)[10:-10, 10:-10].numpy() == pytest.approx(0.3125, abs=2e-3)
