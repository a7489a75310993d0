"""Weights of the pixels by the residuals."""

import itertools
from dataclasses import replace

import pytest
import torch
from ball_models import RADIUS, distances, poses, random, windows

from torchsphere.kernels.jit import suits
from torchsphere.sphere_map import pixel_weights
from torchsphere.sphere_map.pixel_weights import ALIKE_PIXELS, RAMP_PX, RING_LIMITS_PX, ROUNDING_VARIANCE

SIZE = torch.tensor(RADIUS, dtype=torch.float64)


def test_a_uniform_profile_weighs_visible_pixels_alike() -> None:
    at = poses()
    seen = windows(at)
    weights = pixel_weights.uniform_profile(SIZE, 4.0).weights(seen, at)
    torch.testing.assert_close(weights, seen.visibility / 4)


def test_the_variance_of_a_ring_is_the_mean_square_of_its_pixels_and_excess_over_the_disc_counts_several_times() -> (
    None
):
    at = poses()
    seen = windows(at)
    distance = distances(seen, at) - RADIUS
    residual = 2 * random(*seen.levels.shape) * torch.where(distance > -3, 1.5, 1.0)
    leverage = 0.3 * torch.sigmoid(random(*seen.levels.shape, seed=6))
    profile = pixel_weights.profile_of(pixel_weights.ring_sums(seen, at, residual, SIZE, leverage), SIZE)
    assert len(profile.variance) == len(RING_LIMITS_PX) + 1
    inner = None
    for variance, (lower, upper) in zip(
        profile.variance, itertools.pairwise((-RADIUS, *RING_LIMITS_PX, 100.0)), strict=True
    ):
        ring = (distance > lower) & (distance < upper) & (seen.visibility > 0)
        own = float(residual[ring].square().sum() / (1 - leverage[ring]).sum())
        inner = own if inner is None else inner
        expected = own + (ALIKE_PIXELS - 1) * max(own - inner, 0)
        assert float(variance) == pytest.approx(expected)


def test_between_rings_the_variance_goes_over_without_a_jump() -> None:
    at = poses()
    seen, inner, rings = windows(at), 5, len(RING_LIMITS_PX) + 1
    variance = torch.tensor([1.0] * inner + [9.0] * (rings - inner), dtype=torch.float64)
    profile = replace(pixel_weights.uniform_profile(SIZE, 1.0), variance=variance)
    from_limit = distances(seen, at) - RADIUS - RING_LIMITS_PX[inner - 1]
    expected = 1 + 8 * (from_limit / RAMP_PX + 0.5).clamp(0, 1)
    # The ramp is a line in the square of the distance, which bends by this much.
    bent = RAMP_PX / (RADIUS + RING_LIMITS_PX[0])
    torch.testing.assert_close(profile.at(seen, at).to(expected), expected, atol=bent, rtol=0)


def test_rounding_limits_the_variance_from_below() -> None:
    at = poses()
    seen = windows(at)
    none = torch.zeros_like(seen.levels)
    profile = pixel_weights.profile_of(pixel_weights.ring_sums(seen, at, none, SIZE, none), SIZE)
    assert float(profile.variance.min()) == pytest.approx(ROUNDING_VARIANCE)


@pytest.mark.parametrize("dtype", [torch.float32, torch.float64])
def test_a_patch_that_does_not_fit_loses_its_visibility_and_noise_does_not(dtype: torch.dtype) -> None:
    at = poses()
    seen = windows(at, dtype)
    residual = 2 * random(*seen.levels.shape).to(dtype)
    residual[1, 14:26, 12:24] += 40
    variance = torch.full_like(residual, 4.0)
    assert suits(residual) == (dtype == torch.float32)
    found = pixel_weights.estimate_visibility(seen, variance, residual).visibility
    assert float(found[1, 14:26, 12:24].max()) < 0.01
    # By noise alone the mean of 25 squares exceeds its limit once in a million.
    assert torch.equal(found[0], seen.visibility[0])
    assert float((found[1] - seen.visibility[1])[:, 30:].abs().max()) == 0


def test_loops_and_torch_give_the_same_visibility() -> None:
    at = poses()
    residual = 5 * random(*windows(at).levels.shape)
    found = [
        pixel_weights.estimate_visibility(
            windows(at, dtype), torch.full_like(residual.to(dtype), 4.0), residual.to(dtype)
        )
        for dtype in (torch.float32, torch.float64)
    ]
    torch.testing.assert_close(found[0].visibility.double(), found[1].visibility, atol=1e-5, rtol=0)
