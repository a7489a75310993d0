"""The limb as the circle between background and pattern."""

import pytest
import torch
from shots import noisy, pair, speckle, textured

from torchsphere.detection import limb_fit
from torchsphere.synthetic import ray_caster
from torchsphere.synthetic.ray_caster import Pattern

EYE = torch.eye(3, dtype=torch.float64)[None]

#: Tolerance, px: twice the measured error of an eighth of the outline.
WITHIN = 0.3


def circle(x: float, y: float, radius: float) -> torch.Tensor:
    return torch.tensor([[x, y, radius]], dtype=torch.float64)


def half_as_dark(seed: int, *, rest: float = 1.0) -> tuple[torch.Tensor, torch.Tensor]:
    """Image (1, h, w) of a ball over 64 grey levels whose lower limb fades to 64, and its circle.

    ``rest`` is the share of the pattern that is left at the lowest point: 1 is an evenly lit ball.
    """
    true = circle(63.2, 64.7, 50.0)
    ball = speckle(seed, 50.0, 15.0, 210.0)
    image = ray_caster.render(ball, true[:, :2], 50.0, EYE, 64.0, shape=(130, 130), subsamples=7)
    low = ((torch.arange(130, dtype=torch.float64) - true[0, 1]) / 50.0 - 0.2).div(0.4).clamp(0, 1)[:, None]
    image = 64 + (image.double() - 64) * (1 - (1 - rest) * low)
    return noisy(image.float(), 2.0, seed), true


@pytest.mark.parametrize("background", [10.0, 60.0, 90.0, 125.0, 240.0])
@pytest.mark.parametrize("seed", [0, 1])
# Where noise is low, the interpolation's ringing is the largest error of a grey level outside of the ball.
@pytest.mark.parametrize("noise", [0.5, 2.0])
def test_a_speckled_ball_is_found_over_any_of_its_grey_levels(background: float, seed: int, noise: float) -> None:
    f, _, at = pair((0, 0, 0, 0, 0), seed=seed, background=background)
    image = noisy(f, noise, seed)[None].float()
    found, covariance = limb_fit.fit(image, circle(*at) + torch.tensor([0.5, -0.5, -0.6]))
    # Fits of edges have larger errors over 125 grey levels.
    assert (found - circle(*at)).abs().max() < WITHIN
    sd = covariance[0].diagonal().sqrt()
    assert ((sd > 0.05) & (sd < 0.2)).all()


@pytest.mark.parametrize("seed", [0, 1, 2])
def test_a_limb_as_dark_as_the_background_leaves_the_centre_unknown_along_it(seed: int) -> None:
    image, true = half_as_dark(seed, rest=0.0)
    _, lit = limb_fit.fit(half_as_dark(seed)[0], true)
    found, covariance = limb_fit.fit(image, true + torch.tensor([0.4, 0.4, -0.4]))
    sd = covariance[0].diagonal().sqrt()
    # An arc of two thirds of the circle determines x, but does not separate y and the radius.
    assert sd[1] > 1.5 * lit[0].diagonal().sqrt()[1]
    assert sd[1] > 1.3 * sd[0]
    # Three standard deviations: with correct bands none of these nine numbers exceeds them.
    assert ((found - true)[0].abs() < 3 * sd).all()


def test_a_circle_beside_the_image_is_nan() -> None:
    found, _ = limb_fit.fit(torch.full((1, 60, 60), 100.0), circle(30, 30, 200.0))
    assert found.isnan().all()


def test_a_batch_of_limbs_equals_its_rows() -> None:
    images, circles = zip(*(half_as_dark(seed) for seed in (0, 1)), strict=True)
    batch = limb_fit.fit(torch.cat(images), torch.cat(circles))
    for i in range(2):
        one = limb_fit.fit(images[i], circles[i])
        for whole, row in zip(batch, one, strict=True):
            # Crops have the size for the batch's largest ball, and their border changes a spline a little.
            torch.testing.assert_close(whole[i], row[0], atol=2e-3, rtol=0)


def test_an_uncertain_background_widens_the_circles_covariance() -> None:
    f, _, at = pair((0, 0, 0, 0, 0))
    _, calm = limb_fit.fit(noisy(f, 2.0, 0)[None].float(), circle(*at))
    _, noise = limb_fit.fit(noisy(f, 12.0, 0)[None].float(), circle(*at))
    assert (noise[0].diagonal() > 1.5 * calm[0].diagonal()).all()


def test_a_plain_ball_that_equals_its_background_has_no_limb() -> None:
    pattern = Pattern(torch.full((4, 4, 4), 64.0))
    image = ray_caster.render(pattern, circle(63, 64, 40)[:, :2], 40.0, EYE, 64.0, shape=(130, 130))
    _, covariance = limb_fit.fit(noisy(image, 2.0, 0), circle(63, 64, 40))
    assert not (covariance[0].diagonal().sqrt() < 0.5).any()


@pytest.mark.parametrize(("blur_px", "levels"), [(2.0, 10.0), (2.0, 40.0), (6.0, 40.0)])
def test_a_texture_behind_the_ball_does_not_make_it_larger(blur_px: float, levels: float) -> None:
    for seed in range(3):
        f, _, at = pair((0, 0, 0, 0, 0), seed=seed, background=textured(seed + 2, blur_px, levels))
        found, covariance = limb_fit.fit(noisy(f, 2.0, seed)[None].float(), circle(*at))
        off = (found - circle(*at))[0].abs()
        # With the background's level and variance from the same places the radius was 0.2 to 6 px too large.
        assert off[2] < WITHIN
        assert (off < 3 * covariance[0].diagonal().sqrt()).all()


def test_neighbours_are_averaged_around_the_whole_outline() -> None:
    values = torch.rand(2, 37, generator=torch.Generator().manual_seed(5), dtype=torch.float64)
    # A fifth of 37 rays: a ray and four neighbours on either side.
    expected = torch.stack([values.roll(shift, 1) for shift in range(-4, 5)]).mean(0)
    assert torch.allclose(limb_fit.averaged(values, 0.2), expected, rtol=0, atol=1e-12)
    assert torch.allclose(limb_fit.averaged(values[..., None], 0.2)[..., 0], expected, rtol=0, atol=1e-12)
