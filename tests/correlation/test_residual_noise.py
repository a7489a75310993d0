"""The stated uncertainty under residuals that are more or less than noise."""

import numpy as np
import pytest
import torch
from shots import clean, noisy, pair
from torch import Tensor

from torchsphere import track
from torchsphere.correlation import residual_noise
from torchsphere.correlation.reference import Filtered, Reference, build_reference
from torchsphere.imaging.crop import cut, half_size


def reference(count: int = 1, blur: float = 1.0) -> Reference:
    """``count`` copies of the reference of the example ball."""
    f, _, circle = pair((0, 0, 0, 0, 0))
    circles = torch.tensor(circle, dtype=torch.float64).expand(count, -1)
    crops = cut(f.expand(count, -1, -1), circles[:, :2], half_size(circles[0, 2].item(), 8.0), None)
    return build_reference(Filtered.of(crops, blur), circles, 0.95, blur)


def small_reference(count: int) -> Reference:
    """``count`` references of noise on a ball of 10 px."""
    circles = torch.tensor([[20.0, 20.0, 10.0]], dtype=torch.float64).expand(count, -1)
    images = torch.randn(count, 41, 41, generator=torch.Generator().manual_seed(2))
    return build_reference(Filtered.of(cut(images, circles[:, :2], 18, None), 1.0), circles, 0.95, 1.0)


def test_fading_blocks_count_each_point_once_in_the_sum_of_squares() -> None:
    made = reference()
    n = made.values.shape[-1]
    for at in (0, n // 3, n // 2, n - 1):
        point = torch.zeros(1, 1, n, dtype=torch.float64)
        point[..., at] = 2.0
        sums = residual_noise.block_sums(made, point, torch.ones_like(point[:, 0]), fading=True)
        assert float(sums.square().sum()) == pytest.approx(4.0, rel=1e-9)


def noise_share(made: Reference, difference: Tensor, weights: Tensor) -> Tensor:
    return residual_noise.noise_share(made, residual_noise.ResidualPower.of(made, difference, weights))


def test_the_share_of_noise_is_that_of_the_part_that_faces_the_camera() -> None:
    made = reference()
    r = made.points.norm(dim=-1) / made.geometry.radius
    weights = made.weights
    even = torch.ones_like(weights)
    assert float(noise_share(made, even, weights)) == pytest.approx(1.0, rel=1e-6)
    # Three times as much outside: the inner quarter of the ball is 0.25 / 0.95^2 of the region.
    limb = 1.0 + 2.0 * (r >= 0.5).to(weights)
    inner = 0.25 / 0.95**2
    expected = 1 / (inner + 9 * (1 - inner))
    assert float(noise_share(made, limb, weights)) == pytest.approx(expected, rel=0.01)  # of whole pixels
    # The share is 1 where the middle has more residual than the rest, and where the middle is hidden.
    assert float(noise_share(made, 1 / limb, weights)) == 1.0
    assert float(noise_share(made, limb, weights * (r > 0.5))) == 1.0


def test_few_pixels_that_are_quiet_by_chance_count_as_noise() -> None:
    # The facing part of a ball of 10 px has 12 independent squares: their variance scatters by 0.4 of its value.
    made = small_reference(400)
    white = torch.randn(made.values.shape, generator=torch.Generator().manual_seed(3)).to(made.values)
    smooth = residual_noise.local_mean(made, white, made.weights)  # correlated over a few px, like blurred noise
    assert float(noise_share(made, smooth, made.weights).mean()) > 0.97


def factors(difference: Tensor, made: Reference) -> Tensor:
    """`inflation` (n, 2) of two translations, stated for a ``difference`` (n, p) of white noise."""
    weights = made.weights
    jacobian = made.gradient
    gram = ((jacobian * weights[:, None]) @ jacobian.mT).double()
    variance = (weights * difference.square()).sum(-1) / weights.sum(-1)
    stated = variance[:, None, None] * torch.linalg.inv(gram)
    power = residual_noise.ResidualPower.of(made, difference, weights)
    return residual_noise.inflation(made, jacobian, torch.linalg.cholesky(gram), weights * difference, power, stated)


def test_the_factor_of_white_noise_is_one() -> None:
    made = reference(40)
    generator = torch.Generator().manual_seed(1)
    white = torch.randn(made.values.shape, generator=generator).to(made.values)
    found = factors(white, made)
    # The scatter of the blocks narrows a little less than it widens.
    assert float(found.min()) > 0.9
    assert float(found.mean()) == pytest.approx(1.0, abs=0.04)


def test_a_residual_in_phase_with_the_gradient_widens_and_one_that_cancels_within_speckles_narrows() -> None:
    made = reference()
    r = made.points.norm(dim=-1) / made.geometry.radius
    # A part of the ball has moved: all of its residual acts on x.
    part = torch.where((r > 0.6) & (made.points[..., 0] > 0), made.gradient[:, 0], 0.0)
    assert float(factors(part, made)[0, 0]) > 2.0
    # The texture is blurred more towards the limb: products of its second derivatives with the gradient cancel.
    seen_flatter = r**2 * (reference(blur=1.3).values - made.values)
    assert float(factors(seen_flatter, made).max()) < 0.7


@pytest.mark.parametrize(("degrees", "noise"), [(5.0, 2.0), (10.0, 2.0), (10.0, 5.0)])
def test_the_scatter_of_fast_turns_is_the_stated_uncertainty(degrees: float, noise: float) -> None:
    ratios = []
    for seed in (41, 42, 43):
        made = clean(seed=seed, n=13, step=(1.4, 0.2), turn_deg=degrees, radius=40.0)
        measured = track(noisy(made.images, noise, seed), made.circle, sphere_map=False)
        assert (measured.status == "ok").all()
        error = measured.increment - made.increments.numpy()
        sd = np.sqrt(np.einsum("nii->ni", measured.covariance))
        # Errors that all steps share belong to `torchsphere.errors.steady_error`.
        ratios.append((error - error.mean(0)) / sd * np.sqrt(12 / 11))
    found = np.sqrt(np.mean(np.concatenate(ratios) ** 2, 0))
    # The ratio of 33 errors is known to 12 %. With the whole residual as noise it is 0.4 to 0.7.
    assert ((found > 0.6) & (found < 1.45)).all(), found
    assert np.sqrt(np.mean(found**2)) > 0.75
