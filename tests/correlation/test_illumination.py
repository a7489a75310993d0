"""Light on one side of the ball that an object shades more from image to image."""

import numpy as np
import pytest
import torch
from shots import noisy, pair

from torchsphere import correlate
from torchsphere.correlation import illumination, znssd

MOTION = (0.3, 0.2, 0.1, 0.25, 0.1)
PATTERNS = range(4)


def shaded(share: float, seed: int) -> tuple[torch.Tensor, torch.Tensor, tuple[float, float, float]]:
    """A pair whose deformed image is darker towards the right limb, there by ``share``: the cube of the normal's x."""
    f, g, (x, y, radius) = pair(MOTION, seed=seed)
    columns = torch.arange(g.shape[1], dtype=torch.float64) - (x + MOTION[0])
    dark = 1 - share * (columns / radius).clamp(0, 1) ** 3
    return noisy(f, 1.0, 1), noisy(g * dark, 1.0, 2), (x, y, radius)


def error(share: float, *, robust: bool = True) -> np.ndarray:
    """Mean error (5,) of the measured motion over the patterns, px and deg."""
    errors = []
    for seed in PATTERNS:
        found = correlate(*shaded(share, seed), robust=robust)
        assert found.status.tolist() == ["ok"]
        q = found.q[0].double().numpy().copy()
        q[2:] = np.rad2deg(q[2:])
        errors.append(q - MOTION)
    return np.asarray(np.mean(errors, 0))


@pytest.fixture
def no_light(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(
        illumination, "is_light_identifiable", lambda solution, model: torch.zeros_like(solution.converged)
    )


@pytest.mark.parametrize("robust", [True, False])
def test_a_shade_that_deepens_on_one_side_does_not_move_the_ball(robust: bool) -> None:
    moved = error(0.3, robust=robust) - error(0.0, robust=robust)
    # One grey level of noise scatters the pairs by 0.0025 px and 0.004 deg, halved by four patterns. Without the blur
    # of the shaded pattern in the model the ball moved by 0.007 px.
    assert np.abs(moved[:2]).max() < 0.005
    assert np.abs(moved[2:]).max() < 0.008
    assert np.abs(moved[0]) < 0.002


@pytest.mark.usefixtures("no_light")
def test_without_the_allowance_the_shade_moves_the_ball() -> None:
    assert np.abs(error(0.3, robust=False)[0] - error(0.0, robust=False)[0]) > 0.008


def test_in_even_light_the_allowance_changes_nothing(monkeypatch: pytest.MonkeyPatch) -> None:
    found = error(0.0)
    monkeypatch.setattr(
        illumination, "is_light_identifiable", lambda solution, model: torch.zeros_like(solution.converged)
    )
    np.testing.assert_array_equal(error(0.0), found)


def test_the_harmonics_are_orthogonal_over_the_sphere() -> None:
    generator = torch.Generator().manual_seed(0)
    normals = torch.randn(1, 3, 400_000, dtype=torch.float64, generator=generator)
    values = znssd.harmonics(normals / normals.norm(dim=1, keepdim=True))[0]
    gram = values @ values.T / values.shape[1]
    size = gram.diagonal().sqrt()
    # 400,000 directions leave 0.0016.
    torch.testing.assert_close(gram / size / size[:, None], torch.eye(15, dtype=torch.float64), atol=0.01, rtol=0)


def test_the_changes_of_the_harmonics_are_their_derivative() -> None:
    generator = torch.Generator().manual_seed(0)
    normals, change = torch.randn(2, 1, 3, 50, dtype=torch.float64, generator=generator)
    step = 1e-5
    ahead, back = (znssd.harmonics(normals + s * step * change) for s in (1, -1))
    expected = znssd.harmonic_changes(normals, change)
    torch.testing.assert_close((ahead - back) / (2 * step), expected, atol=1e-7, rtol=1e-7)
