"""Closed forms against automatic differentiation of the models, which is slow and independent."""

import pytest
import torch

from torchsphere.correlation import reference_lookup
from torchsphere.geometry import motion_models, rotation
from torchsphere.geometry.motion_models import Geometry
from torchsphere.imaging import interpolation

RADIUS = torch.tensor([50.0, 50.0, 50.0], dtype=torch.float64)
GENERATOR = torch.Generator().manual_seed(0)
POINTS = 30 * (2 * torch.rand(3, 2, 40, generator=GENERATOR, dtype=torch.float64) - 1)
GRADIENT = torch.randn(3, 2, 40, generator=GENERATOR, dtype=torch.float64)
#: Turns of 0, about 0.6 and about 20 deg.
Q = torch.tensor([[0.0, 0, 0, 0, 0], [1.4, 0.2, 0.0035, 0.0087, 0.0035], [-3, 2, 0.2, -0.3, 0.1]], dtype=torch.float64)
SURFACE = rotation.surface(POINTS, RADIUS)
MODELS = pytest.mark.parametrize("model", [motion_models.rigid, motion_models.finite])


@MODELS
def test_points_move_as_in_the_model(model: motion_models.Displacement) -> None:
    expected = POINTS.mT + motion_models.displacement(model, Q, POINTS.mT, Geometry(RADIUS))
    moved = rotation.moved(Q, SURFACE, exact=model is motion_models.finite)[:, :2] + Q[:, :2, None]
    # The matrix exponential of the models is right to 1e-10 rad, at 50 px.
    torch.testing.assert_close(moved.mT, expected, atol=2e-8, rtol=0)


@MODELS
def test_slopes_are_the_modes_times_the_gradient(model: motion_models.Displacement) -> None:
    modes = motion_models.modes(model, Q, POINTS.mT, Geometry(RADIUS))
    expected = torch.einsum("npck,ncp->nkp", modes, GRADIENT)
    found = rotation.slopes(Q, SURFACE, GRADIENT, exact=model is motion_models.finite)
    # px per rad, of a surface 50 px away.
    torch.testing.assert_close(found, expected, atol=1e-6, rtol=0)


@MODELS
def test_the_gram_is_that_of_the_modes(model: motion_models.Displacement) -> None:
    weights = torch.rand(3, 40, generator=GENERATOR, dtype=torch.float64)
    modes = motion_models.modes(model, Q, POINTS.mT, Geometry(RADIUS))
    expected = torch.einsum("np,npck,npcl->nkl", weights, modes, modes)
    found = rotation.gram(Q, SURFACE, weights, exact=model is motion_models.finite)
    torch.testing.assert_close(found, expected, atol=0, rtol=1e-8)


def test_a_rotation_of_single_precision_keeps_the_points_on_the_ball() -> None:
    moved = rotation.moved(Q.float(), SURFACE.float(), exact=True)
    # Rounding of single precision at 50 px.
    torch.testing.assert_close(moved.norm(dim=1), RADIUS.float()[:, None].expand(-1, 40), atol=2e-5, rtol=0)


def test_the_gradient_with_the_value_is_that_of_the_spline() -> None:
    c = torch.randn(2, 20, 20, generator=GENERATOR, dtype=torch.float64)
    points = 1 + 17 * torch.rand(2, 50, 2, generator=GENERATOR, dtype=torch.float64)
    nudged = points.clone().requires_grad_()
    (expected,) = torch.autograd.grad(interpolation.sample(c, nudged).sum(), nudged)
    value, gradient = interpolation.sample_with_gradient(c, points)
    torch.testing.assert_close(value, interpolation.sample(c, points), atol=1e-12, rtol=0)
    torch.testing.assert_close(gradient.mT, expected, atol=1e-12, rtol=0)


def test_the_last_cell_contains_its_far_side() -> None:
    c = torch.randn(1, 9, 9, generator=GENERATOR, dtype=torch.float64)
    corner = torch.full((1, 1, 2), 7.0, dtype=torch.float64)
    expected = reference_lookup.nodes(c)[0, 0, -1, -1]
    assert float(interpolation.sample(c, corner)) == pytest.approx(float(expected), abs=1e-12)


def test_a_blur_away_from_the_border_is_the_blur() -> None:
    images = torch.randn(2, 40, 31, generator=GENERATOR, dtype=torch.float64)
    within = reference_lookup.blur_within(images, 1.0)
    torch.testing.assert_close(within, interpolation.blur(images, 1.0)[:, 4:-4, 4:-4], atol=1e-12, rtol=0)
    assert torch.equal(reference_lookup.blur_within(images, 0.0), images)
