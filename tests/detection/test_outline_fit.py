"""Edges along rays, and the circle through them."""

import math

import pytest
import torch
from shots import noisy, pair, speckle

from torchsphere.detection import outline_fit
from torchsphere.synthetic import ray_caster
from torchsphere.synthetic.ray_caster import Pattern

EYE = torch.eye(3, dtype=torch.float64)[None]


def plain_ball(x: float, y: float, radius: float, *, ball: float = 200.0, background: float = 60.0) -> torch.Tensor:
    centre = torch.tensor([[x, y]], dtype=torch.float64)
    pattern = Pattern(torch.full((4, 4, 4), ball))
    return ray_caster.render(pattern, centre, radius, EYE, background, shape=(130, 130), subsamples=9)


def circle(x: float, y: float, radius: float) -> torch.Tensor:
    return torch.tensor([[x, y, radius]], dtype=torch.float64)


@pytest.mark.parametrize("fraction", [0.0, 0.25, 0.5, 0.75])
def test_a_plain_ball_is_found_at_any_sub_pixel_phase(fraction: float) -> None:
    true = circle(63 + fraction, 64.3 - fraction, 40 + fraction)
    images = plain_ball(*true[0].tolist())
    fit = outline_fit.refine(images, true + torch.tensor([0.8, -0.6, 0.7]), plain=True)
    # Noise-free: 9 x 9 rays per pixel place an edge to 0.03 px, and 250 edges a circle to a tenth of that. The pixels'
    # box turns the edge into a polygon, 1 / (24 R) = 0.001 px. The tolerance is a hundredth of a px.
    torch.testing.assert_close(fit.circle, true, atol=0.01, rtol=0)
    assert float(fit.support[0]) > 0.95
    assert float(fit.contrast[0]) == pytest.approx(140, rel=0.05)


@pytest.mark.parametrize("seed", [0, 1, 2])
def test_a_speckled_ball_is_found_within_half_a_px_and_its_stated_uncertainty(seed: int) -> None:
    f, _, true = pair((0, 0, 0, 0, 0), seed=seed)
    images = noisy(f, 2.0, seed)[None]
    expected = circle(*true)
    fit = outline_fit.refine(images, expected + torch.tensor([1.5, -1.0, 1.0]), patterned=True)
    # The pattern at the limb shifts the edge: half a px.
    assert (fit.circle - expected).abs().max() < 0.5
    sd = fit.covariance[0].diagonal().sqrt()
    assert ((sd > 0) & (sd < 0.2)).all()


def test_a_fixed_radius_stays_and_the_centre_is_fitted() -> None:
    images = plain_ball(63.4, 64.1, 40.0)
    fit = outline_fit.refine(images, circle(64, 64, 40.0), fixed_radius=True)
    assert float(fit.circle[0, 2]) == 40.0
    torch.testing.assert_close(fit.circle[0, :2], torch.tensor([63.4, 64.1]).double(), atol=0.02, rtol=0)  # as above
    assert fit.covariance[0, 2].isnan().all()


def test_part_of_an_outline_is_enough() -> None:
    images = plain_ball(63.4, 64.1, 40.0)[:, :, 45:]
    fit = outline_fit.refine(images, circle(63.4 - 45 + 0.5, 64.1, 40.5), plain=True)
    # Two thirds of the outline: three times worse than the whole one.
    torch.testing.assert_close(fit.circle, circle(63.4 - 45, 64.1, 40.0), atol=0.03, rtol=0)


def test_without_an_edge_in_the_image_the_fit_is_nan() -> None:
    images = torch.full((1, 60, 60), 100.0)
    fit = outline_fit.refine(images, circle(30, 30, 200.0))
    assert float(fit.support[0]) == 0
    assert fit.circle.isnan().all()


def test_a_batch_of_fits_equals_its_rows() -> None:
    images = torch.cat([plain_ball(63.4 + i, 64.1, 40.0) for i in range(3)])
    guesses = circle(64, 64, 40).repeat(3, 1) + torch.tensor([[i, 0, 0] for i in range(3)])
    batch = outline_fit.refine(images, guesses)
    for i in range(3):
        one = outline_fit.refine(images[i : i + 1], guesses[i : i + 1])
        torch.testing.assert_close(batch.circle[i], one.circle[0], atol=1e-6, rtol=0)  # float64 rays, sums reordered


def test_the_step_of_the_centre_is_more_certain_than_the_centre() -> None:
    first, second = plain_ball(60.2, 64.1, 40.0), plain_ball(63.55, 64.9, 40.0)
    images = noisy(torch.cat((first, second)), 2.0, 1)
    guesses = torch.cat((circle(60, 64, 40), circle(63.5, 65, 40)))
    fit = outline_fit.refine(images, guesses, fixed_radius=True, plain=True)
    step, covariance = outline_fit.centre_step(fit)
    sd = covariance.diagonal().sqrt()
    # 250 rays with noise of 1.4 % of the edge's height: 0.02 px per ray and side, about 0.005 px for the centre.
    torch.testing.assert_close(step, torch.tensor([3.35, 0.8]).double(), atol=0.03, rtol=0)
    assert ((sd > 0) & (sd < 0.02)).all()


def test_plain_and_speckled_balls_are_distinguished() -> None:
    f, _, at = pair((0, 0, 0, 0, 0))
    assert not outline_fit.is_plain(noisy(f, 2.0, 0).float(), circle(*at)[0])
    assert outline_fit.is_plain(noisy(plain_ball(63, 64, 50)[0], 2.0, 0).float(), circle(63, 64, 50)[0])
    assert speckle(0, 50.0).volume.std() > 10


def test_shifts_of_a_blurred_step_are_found() -> None:
    steps = torch.arange(-2, 8.2, 0.25, dtype=torch.float64)
    for shift in (-0.1, 0.0, 0.1):
        levels = 60 + 140 * 0.5 * torch.erfc((steps - shift) / (math.sqrt(2) * 1.0))
        found, height = outline_fit.step_shifts(levels[None, None], steps, 1.0)
        # The model is linear in the shift: the error is of order shift^2.
        assert float(found) == pytest.approx(shift, abs=0.01)
        assert float(height) == pytest.approx(140, rel=0.01)


def test_centroid_shifts_do_not_depend_on_the_blur_of_an_edge() -> None:
    steps = torch.arange(-8, 8.2, 0.25, dtype=torch.float64)
    for step_blur in (0.5, 1.5):
        levels = 60 + 140 * 0.5 * torch.erfc((steps - 0.3) / (math.sqrt(2) * step_blur))
        found, height = outline_fit.centroid_shifts(levels[None, None], steps)
        # The trapezium rule is exact for a step that ends inside the window.
        assert float(found) == pytest.approx(0.3, abs=1e-3)
        assert float(height) == pytest.approx(140, abs=1e-3)
