"""The compiled loops over rings around the ball against torch in double precision."""

import torch
from ball_models import random
from torch import Tensor

from torchsphere.sphere_map import pixel_weights

LIMITS = torch.tensor([300.0, 500.0, 700.0], dtype=torch.float64)


def squares() -> Tensor:
    """Squared distances (2, 9, 9) in all rings, px^2."""
    return 500 + 250 * random(2, 9, 9)


def test_variances_along_ramps_are_those_of_torch() -> None:
    given = squares(), LIMITS, torch.tensor([0.02, 0.03, 0.01]).double(), torch.tensor([4.0, 5.0, 3.0, 9.0]).double()
    expected = pixel_weights._along_ramps(*given)
    found = pixel_weights._along_ramps(*(part.float() for part in given))
    torch.testing.assert_close(found.double(), expected, atol=1e-4, rtol=0)


def test_sums_of_rings_are_those_of_torch() -> None:
    shown, residual, leverage = random(2, 9, 9, seed=3).abs(), random(2, 9, 9, seed=4), random(2, 9, 9, seed=5).abs()
    given = squares(), LIMITS, shown, residual, leverage
    expected = pixel_weights._sums(*given)
    found = pixel_weights._sums(*(part.float() for part in given))
    assert found.dtype == torch.float64
    torch.testing.assert_close(found, expected, atol=1e-4, rtol=0)
