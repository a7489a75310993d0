"""The rays of the pixels around the ball."""

import torch
from ball_models import pose, window


def test_the_weights_of_a_pixels_rays_sum_to_one_and_their_mean_is_its_centre() -> None:
    pixels = window(pose())
    total = pixels.sum_rays(pixels.ray_weights)
    torch.testing.assert_close(total, torch.ones_like(total), atol=1e-12, rtol=0)
    mean = pixels.sum_rays((pixels.ray_weights * pixels.rays).T)
    torch.testing.assert_close(mean, pixels.pixels, atol=1e-12, rtol=0)
