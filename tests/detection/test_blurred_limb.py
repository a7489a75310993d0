"""Circle and blur of a speckled ball whose image is blurred by the optics or by its motion during the exposure."""

import math

import pytest
import torch
import torch.nn.functional as F  # noqa: N812  (torch's convention)
from shots import noisy, speckle
from torch import Tensor

import torchsphere as ts
from torchsphere.detection import blurred_limb, limb_fit
from torchsphere.detection.detect import refine_circle
from torchsphere.geometry.circle import Circle
from torchsphere.imaging.interpolation import blur
from torchsphere.synthetic import ray_caster

TRUE = (63.2, 64.7, 45.0)

#: Motion from frame to frame, px.
MOTION = torch.tensor([6.0, 2.0], dtype=torch.float64)

#: Rays of the pixels along each axis.
FINE = 3


def image(seed: int, *, optics_px: float = 0.0, smear_px: float = 0.0, background: float = 40.0) -> Tensor:
    """Image (h, w) with Gaussian blur, or averaged over a motion of ``smear_px`` along `MOTION`."""
    moments = torch.linspace(-0.5, 0.5, 11)[:, None] if smear_px else torch.zeros(1, 1)
    centres = FINE * (torch.tensor(TRUE[:2]) + moments * smear_px * (MOTION / MOTION.norm()).float()) + (FINE - 1) / 2
    axes = torch.eye(3).expand(len(centres), 3, 3)
    shape = (130 * FINE, 130 * FINE)
    seen = ray_caster.render(speckle(seed, TRUE[2]), centres, FINE * TRUE[2], axes, background, shape=shape)
    seen = seen.mean(0, keepdim=True)
    return noisy(F.avg_pool2d(blur(seen, FINE * optics_px) if optics_px else seen, FINE), 2.0, seed)[0]


def guess(away: float) -> Tensor:
    return torch.tensor([TRUE[0] + 0.3, TRUE[1] - 0.3, TRUE[2] + away], dtype=torch.float64)


@pytest.mark.parametrize("optics_px", [1.0, 1.5, 2.0, 3.0])
@pytest.mark.parametrize("seed", [0, 1])
def test_the_radius_and_the_blur_of_a_defocused_ball_are_found(optics_px: float, seed: int) -> None:
    given = image(seed, optics_px=optics_px)
    found = blurred_limb.fit_as_needed(given[None], guess(0.8 * optics_px)[None], only_blurred=True)
    assert found is not None
    (circle,), (covariance,), seen = found
    off = abs(float(circle[2]) - TRUE[2])
    # A sharp limb is found 0.4 to 2.7 px outside.
    assert off < 0.3
    assert off < 3 * float(covariance[2, 2].sqrt())
    assert math.sqrt(seen.variance) == pytest.approx(math.hypot(optics_px, 0.3), rel=0.12)


@pytest.mark.parametrize("smear_px", [3.0, 5.0])
@pytest.mark.parametrize("seed", [0, 1])
def test_a_motion_during_the_exposure_is_found_along_the_motion(smear_px: float, seed: int) -> None:
    found = blurred_limb.fit_as_needed(
        image(seed, smear_px=smear_px)[None], guess(0.5)[None], motion=MOTION[None], only_blurred=True
    )
    assert found is not None
    (circle,), (covariance,), seen = found
    # The limb of an image without smear is found up to 0.9 px outside.
    assert abs(float(circle[2]) - TRUE[2]) < 0.25
    assert ((circle - torch.tensor(TRUE)).abs() < 3 * covariance.diagonal().sqrt()).all()
    assert seen.smear_px == pytest.approx(smear_px, rel=0.25)


@pytest.mark.parametrize("background", [20.0, 90.0])
@pytest.mark.parametrize("optics_px", [0.0, 0.5])
def test_a_sharp_ball_is_left_to_the_sharp_limb(background: float, optics_px: float) -> None:
    given = image(0, optics_px=optics_px, background=background)
    start, _ = limb_fit.fit(given[None], guess(0.3)[None])
    assert blurred_limb.fit_as_needed(given[None], start, motion=MOTION[None], only_blurred=True) is None


def test_an_outline_that_is_longer_than_wide_is_not_smeared() -> None:
    # A near camera whose axis passes the ball at a distance: 2.6 px longer along the motion.
    camera, axes = ts.Camera(12 * TRUE[2], (TRUE[0] + 177.0, TRUE[1] + 59.0)), torch.eye(3)[None]
    given = speckle(0, TRUE[2]), torch.tensor(TRUE[:2])[None], TRUE[2], axes, 20.0
    seen = noisy(ray_caster.render(*given, shape=(130, 130), subsamples=4, camera=camera), 2.0, 0)
    _, _, blur = blurred_limb.fit(seen, guess(0.5)[None], motion=MOTION[None], is_elliptic=True)
    assert blur.smear_px < 0.5


def test_images_of_one_blur_share_it_and_keep_their_circles() -> None:
    images = torch.stack([image(seed, optics_px=2.0) for seed in range(3)])
    together, covariance, shared = blurred_limb.fit(images, guess(0.5).expand(3, 3))
    alone = [blurred_limb.fit(images[i : i + 1], guess(0.5)[None]) for i in range(3)]
    variances = [one[2].variance for one in alone]
    assert min(variances) < shared.variance < max(variances)
    assert ((together[:, 2] - TRUE[2]).abs() < 3 * covariance[:, 2, 2].sqrt()).all()


def test_a_circle_beside_the_image_is_nan_and_no_blur_is_found_there() -> None:
    empty = torch.full((60, 60), 100.0)
    beside = torch.tensor([30.0, 30.0, 200.0], dtype=torch.float64)
    assert blurred_limb.fit(empty[None], beside[None])[0].isnan().all()
    assert blurred_limb.fit_as_needed(empty[None], beside[None], only_blurred=True) is None


def test_a_circle_beside_the_image_leaves_the_blur_to_the_others() -> None:
    images = torch.stack([image(0, optics_px=2.0), image(1, optics_px=2.0), torch.full((130, 130), 40.0)])
    guesses = torch.stack([guess(0.5), guess(0.5), torch.tensor([65.0, 65.0, 200.0], dtype=torch.float64)])
    found = blurred_limb.fit_as_needed(images, guesses, only_blurred=True)
    assert found is not None
    assert found[0].isfinite().all(1).tolist() == [True, True, False]
    assert ((found[0][:2, 2] - TRUE[2]).abs() < 0.3).all()


def test_a_given_circle_is_refined_to_the_outline_of_a_defocused_ball() -> None:
    found = refine_circle(image(2, optics_px=2.0), Circle(TRUE[0] + 0.5, TRUE[1], TRUE[2] + 1.0))
    assert abs(found.radius - TRUE[2]) < min(0.3, 3 * found.sd_radius)


def test_curved_outlines_and_smears_are_described_by_the_profile() -> None:
    # The blurred disc's level across its outline, on a fine grid.
    radius, variance, smear = 20.0, 4.0, 4.0
    steps = torch.arange(-8, 8.5, 0.5, dtype=torch.float64)
    limb = blurred_limb._Limb(steps, radius, torch.tensor([[smear]], dtype=torch.float64))
    fine = torch.arange(-40, 40.125, 0.25, dtype=torch.float64)
    disc = ((fine[:, None] ** 2 + fine**2) < radius**2).double()
    moments = torch.linspace(-0.5, 0.5, 41, dtype=torch.float64) * smear
    across = torch.exp(-0.5 * fine.square() / variance) / math.sqrt(2 * math.pi * variance) * 0.25
    column = disc @ across
    expected = (
        torch.stack(
            [
                torch.stack(
                    [
                        (column * torch.exp(-0.5 * (fine - radius - step - move) ** 2 / variance)).sum()
                        for move in moments
                    ]
                ).mean()
                for step in steps
            ]
        )
        * 0.25
        / math.sqrt(2 * math.pi * variance)
    )
    assert (limb.profile(variance, 1.0).mean[0, 0] - expected).abs().max() < 0.012
