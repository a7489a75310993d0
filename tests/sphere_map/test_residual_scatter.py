"""Poses on the map of images whose error neighbouring pixels share, as a video codec leaves it."""

import numpy as np
import pytest
import torch
from shots import noisy, rotation_matrix, speckle
from torch.nn.functional import interpolate
from tracks import made_map

from torchsphere import Track, track
from torchsphere.synthetic import ray_caster

RADIUS, N = 24.0, 40

#: Side of the squares that share an error, px, and its standard deviation, grey levels.
SQUARE, SPREAD = 6, 8.0


@pytest.fixture(scope="module")
def flight() -> tuple[np.ndarray, torch.Tensor]:
    """Centres (n, 2) and clean images (n, h, w) of a ball that flies and turns."""
    i = np.arange(N)
    centres = np.stack((36.2 + 0.73 * i, 37.4 + 0.21 * i), 1)
    axis = torch.tensor([0.4, 0.7, 0.5], dtype=torch.float64)
    turned = torch.stack([rotation_matrix(0.03 * k * axis) for k in range(N)])
    ball = speckle(4, RADIUS)
    centre = torch.from_numpy(centres).float()
    return centres, ray_caster.render(ball, centre, RADIUS, turned.float(), 90.0, shape=(84, 108))


def ratio(found: Track, centres: np.ndarray) -> float:
    """Root mean square of the errors of all steps over their standard deviations."""
    errors = found.increment[:, :2] - np.diff(centres, axis=0)
    sd = np.sqrt(np.einsum("nii->ni", found.covariance)[:, :2])
    return float(np.sqrt(np.mean((errors / sd) ** 2)))


def test_errors_that_neighbouring_pixels_share_are_in_the_standard_deviations(
    flight: tuple[np.ndarray, torch.Tensor],
) -> None:
    centres, clean = flight
    _, height, width = clean.shape
    blocks = torch.randn(N, 1, height // SQUARE, width // SQUARE, generator=torch.Generator().manual_seed(3))
    shared = SPREAD * interpolate(blocks, scale_factor=SQUARE)[:, 0]
    found = track(noisy(clean + shared, 2.0, 9), (*centres[0], RADIUS))
    assert found.findings.is_on_map
    # Taken for noise of pixels apart they make steps err by 2.1 to 2.5 times what is stated.
    assert 0.6 < ratio(found, centres) < 1.5


def test_noise_of_pixels_apart_is_not_widened(flight: tuple[np.ndarray, torch.Tensor]) -> None:
    centres, clean = flight
    found = track(noisy(clean, 2.0, 9), (*centres[0], RADIUS))
    assert made_map(found).widened == 1.0
    assert 0.75 < ratio(found, centres) < 1.25
