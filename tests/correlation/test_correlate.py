"""Correlation of pairs: exactness, laws, statuses, invalid arguments."""

from typing import Any

import numpy as np
import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st
from shots import noisy, pair

from torchsphere import correlate
from torchsphere.correlation import gauss_newton, znssd
from torchsphere.correlation.frame_status import STATUSES
from torchsphere.geometry.circle import Circle
from torchsphere.synthetic import ray_caster

MOTION = (0.63, -0.41, 0.2, 0.5, -0.3)
STILL = (0.0, 0.0, 0.0, 0.0, 0.0)


def to_degrees(q: torch.Tensor) -> np.ndarray:
    values = q.double().numpy().copy()
    values[..., 2:] = np.rad2deg(values[..., 2:])
    return values


@pytest.mark.parametrize("dtype", [torch.float32, torch.float64])
@pytest.mark.parametrize("jacobian", ["constant", "autograd"])
@pytest.mark.parametrize("model", ["rigid", "finite", "published", "translation"])
def test_no_motion_gives_exactly_zero(model: str, jacobian: str, dtype: torch.dtype) -> None:
    f, _, circle = pair(STILL)
    image = noisy(f, 2.0, 1).to(dtype)
    found = correlate(image, image, circle, model=model, jacobian=jacobian)
    assert found.status.tolist() == ["ok"]
    # Sampling scales places to the crop's width, which rounds them by 1e-7 of 130 px: 1e-5 px in single precision.
    assert found.q.abs().max() < (1e-5 if dtype == torch.float32 else 1e-12)
    assert float(found.zncc[0]) == pytest.approx(1.0, abs=1e-6)


# Known truth, one at a time and together, px and degrees.
@pytest.mark.parametrize("shift", [(0.1, 0.0), (0.25, -0.75), (0.5, 0.5), (-0.9, 0.33), (1.4, 0.2)])
def test_sub_pixel_shifts_are_found(shift: tuple[float, float]) -> None:
    f, g, circle = pair((*shift, 0, 0, 0))
    found = correlate(f, g, circle)
    # Noise-free: the spline's error on the foreshortened speckle at the limb remains. The tolerance is the standard
    # deviation under noise of two grey levels, 0.005 px and 0.007 deg.
    np.testing.assert_allclose(to_degrees(found.q)[0, :2], shift, atol=0.005)
    np.testing.assert_allclose(to_degrees(found.q)[0, 2:], 0, atol=0.007)


def test_all_five_components_are_found() -> None:
    f, g, circle = pair(MOTION)
    found = correlate(f, g, circle)
    # As above, and the second order of 0.6 deg: w^2 R / 2 = 0.003 px before it averages out.
    np.testing.assert_allclose(to_degrees(found.q)[0], MOTION, atol=0.01)


@pytest.mark.parametrize("degrees", [3.0, 6.0])
def test_finite_follows_large_rotations_from_a_near_guess(degrees: float) -> None:
    f, g, circle = pair((0.6, 0.3, 0, degrees, 0))
    start = [0.6, 0.3, 0, np.deg2rad(0.9 * degrees), 0]
    found = correlate(f, g, circle, start=start, model="finite", jacobian="autograd")
    # Measured: a bias along the front's motion of 0.002 px per degree, and an error of each pair of that size.
    np.testing.assert_allclose(to_degrees(found.q)[0], (0.6, 0.3, 0, degrees, 0), atol=0.005 * degrees)


def jacobian_difference(images: tuple[torch.Tensor, torch.Tensor, tuple[float, float, float]], **options: Any) -> float:
    """Largest difference between the results of the two Jacobians, px."""
    f, g, circle = images
    constant, autograd = (
        correlate(f, g, circle, jacobian=name, tolerance_px=1e-8, **options) for name in ("constant", "autograd")
    )
    assert constant.status.tolist() == autograd.status.tolist() == ["ok"]
    return float(((constant.q[0] - autograd.q[0]) * torch.tensor([1, 1, 50.0, 50.0, 50.0])).abs().max())


# The two gradients weigh the residual differently, so they agree where the model can explain the images: `published`
# and `translation` cannot explain a rotation.
@pytest.mark.parametrize(
    ("model", "motion"),
    [(model, (0.63, -0.41, 0, 0, 0)) for model in ("rigid", "finite", "published", "translation")]
    + [("rigid", MOTION), ("finite", MOTION)],
)
def test_constant_and_autograd_jacobians_agree_at_convergence(model: str, motion: tuple[float, ...]) -> None:
    coarse = ray_caster.speckle(0, radius_px=50.0, speckle_px=8.0)
    # Noise-free, and with a speckle that the spline interpolates without error.
    assert jacobian_difference(pair(motion, pattern=coarse), model=model, roi=0.9) < 1e-4


@pytest.mark.parametrize("model", ["rigid", "finite"])
def test_on_the_finest_speckle_the_jacobians_differ_by_less_than_the_noise(model: str) -> None:
    # At the limb a speckle of 4 px is interpolated with an error of half a per cent of its contrast. The two gradients
    # weigh this residual differently: a fifth of the standard deviation under noise, 0.005 px.
    assert jacobian_difference(pair(MOTION), model=model) < 1e-3


def test_a_batch_row_equals_the_single_row() -> None:
    made = [pair((0.3 * i, -0.2 * i, 0.1 * i, 0.2, 0.0), seed=i) for i in range(3)]
    f, g = (torch.stack([one[k] for one in made]) for k in (0, 1))
    batch = correlate(f, g, made[0][2])
    for i in range(3):
        single = correlate(f[i], g[i], made[0][2])
        # The same sums in another order, float64.
        torch.testing.assert_close(batch.q[i], single.q[0], atol=1e-9, rtol=0)
        torch.testing.assert_close(batch.covariance[i], single.covariance[0], atol=1e-12, rtol=1e-6)
        assert int(batch.iterations[i]) == int(single.iterations[0])
        assert batch.status[i] == single.status[0]


@pytest.mark.parametrize("model", ["rigid", "finite", "published"])
def test_rarer_tests_for_convergence_change_nothing(model: str, monkeypatch: pytest.MonkeyPatch) -> None:
    # As on a GPU, which has to finish all work for each test.
    shots = [pair((dx, 0.3, 0.2, 0.5, 0.1)) for dx in (0.1, 1.2, 2.3)]
    f, g = (noisy(torch.stack([shot[i] for shot in shots]), 2.0, i) for i in (0, 1))
    often = correlate(f, g, shots[0][2], model=model)
    monkeypatch.setattr(gauss_newton, "CHECK_STEP", 4)
    seldom = correlate(f, g, shots[0][2], model=model)
    assert often.status.tolist() == seldom.status.tolist() == ["ok"] * 3
    assert often.iterations.tolist() == seldom.iterations.tolist()
    # New modes at each step, or kept while steps are small: MODES_HOLD_PX of 50 px changes them by 4e-4 of a step.
    torch.testing.assert_close(often.q, seldom.q, atol=1e-5, rtol=0)
    torch.testing.assert_close(often.covariance, seldom.covariance, atol=0, rtol=1e-2)


def test_every_pair_may_have_its_own_centre() -> None:
    made = [pair(MOTION, centre=centre) for centre in ((62.3, 64.1), (65.8, 63.2))]
    f, g = (torch.stack([one[k] for one in made]) for k in (0, 1))
    found = correlate(f, g, np.array([one[2] for one in made]))
    np.testing.assert_allclose(to_degrees(found.q), (MOTION, MOTION), atol=0.01)  # as for one pair


def test_a_circle_is_read_as_its_three_numbers() -> None:
    f, g, numbers = pair(MOTION)
    plain = correlate(f, g, numbers).q
    # The frame of the circle has no meaning for a pair.
    assert correlate(f, g, Circle(*numbers, sd_x=0.1, frame=7)).q.equal(plain)
    both = correlate(torch.stack((f, f)), torch.stack((g, g)), [Circle(*numbers), Circle(*numbers)])
    torch.testing.assert_close(both.q, plain.expand(2, 5), atol=1e-9, rtol=0)  # float64, sums in another order


def test_a_bad_row_does_not_touch_the_others() -> None:
    f, g, circle = pair(MOTION)
    alone = correlate(f, g, circle)
    flat, missing = torch.full_like(f, 100), torch.full_like(f, torch.nan)
    noise = 100 + 20 * torch.randn(f.shape, generator=torch.Generator().manual_seed(0)).double()
    found = correlate(torch.stack((f, flat, f, missing, f)), torch.stack((g, g, noise, g, missing)), circle)
    assert found.status[0] == "ok"
    assert "ok" not in found.status[1:]
    torch.testing.assert_close(found.q[0], alone.q[0], atol=1e-9, rtol=0)  # float64, sums in another order
    assert found.q[1:].isnan().all()
    assert found.covariance[1:].isnan().all()


@pytest.mark.parametrize("model", ["rigid", "finite", "published", "translation"])
@pytest.mark.parametrize("value", [np.nan, np.inf])
def test_values_that_are_not_finite_are_lost_and_not_weak_texture(value: float, model: str) -> None:
    f, g, circle = pair(MOTION)
    all_of_it, one, flat = torch.full_like(f, value), g.clone(), torch.full_like(f, 100)
    one[70, 60] = value
    found = correlate(torch.stack((f, all_of_it, f, flat)), torch.stack((all_of_it, g, one, g)), circle, model=model)
    # As `track` reports such frames.
    assert found.status.tolist() == ["lost", "lost", "lost", "weak_texture"]
    assert found.q.isnan().all()
    assert found.covariance.isnan().all()


@settings(max_examples=8, deadline=None, derandomize=True)
@given(gain=st.floats(0.1, 10), offset=st.floats(-100, 100))
def test_gain_and_offset_change_nothing(gain: float, offset: float) -> None:
    f, g, circle = pair(MOTION, radius=20.0, centre=(30.2, 30.7), shape=(62, 62))
    plain = correlate(f, g, circle).q
    # The law is exact; float64 keeps ten digits of it.
    torch.testing.assert_close(correlate(f, gain * g + offset, circle).q, plain, atol=1e-8, rtol=0)
    torch.testing.assert_close(correlate(gain * f + offset, g, circle).q, plain, atol=1e-8, rtol=0)


small_shift, small_turn = st.floats(-0.8, 0.8), st.floats(-0.5, 0.5)


@settings(max_examples=8, deadline=None, derandomize=True)
@given(dx=small_shift, dy=small_shift, wx=small_turn, wy=small_turn, wz=small_turn)
def test_swapping_the_images_negates_the_motion(dx: float, dy: float, wx: float, wy: float, wz: float) -> None:
    f, g, (x, y, radius) = pair((dx, dy, wx, wy, wz))
    there = to_degrees(correlate(f, g, (x, y, radius)).q)
    back = to_degrees(correlate(g, f, (x + dx, y + dy, radius)).q)
    # The inverse of a rotation vector is its negative. Each way has its own interpolation bias (0.0025 px) and a part
    # of the second order, w^2 R / 2 = 0.005 px.
    np.testing.assert_allclose(there, -back, atol=0.01)


def test_precision_follows_the_images() -> None:
    f, g, circle = pair(MOTION)
    double, single = correlate(f, g, circle), correlate(f.float(), g.float(), circle)
    assert double.q.dtype == torch.float64
    assert single.q.dtype == torch.float32
    assert correlate(f.numpy(), g.numpy(), circle).q.dtype == torch.float64
    # Convergence stops within 2e-4 px; float32 alone is good to 1e-5.
    np.testing.assert_allclose(to_degrees(double.q), to_degrees(single.q), atol=4e-4)


def test_a_start_reaches_large_motions() -> None:
    f, g, circle = pair((9.3, -4.2, 0, 0.5, 0))
    assert correlate(f, g, circle).status[0] != "ok"
    found = correlate(f, g, circle, start=(9, -4, 0, 0, 0))
    np.testing.assert_allclose(to_degrees(found.q)[0], (9.3, -4.2, 0, 0.5, 0), atol=0.01)


def test_ignored_pixels_have_no_influence() -> None:
    f, g, circle = pair((0.4, 0.3, 0.2, 0.3, 0.1))
    ignore = np.zeros(f.shape, bool)
    ignore[40:60, 70:100] = True
    clean = correlate(f, g, circle, ignore=ignore)
    spoiled_f, spoiled_g = f.clone(), g.clone()
    generator = torch.Generator().manual_seed(2)
    spoiled_f[40:60, 70:100] = 255 * torch.rand(20, 30, generator=generator).double()
    spoiled_g[40:60, 70:100] = 0
    spoiled = correlate(spoiled_f, spoiled_g, circle, ignore=ignore)
    assert spoiled.status.tolist() == ["ok"]
    # The spline's coefficients pass on 0.27 of a value per px. Three px away (crop.REACH) 1 % of the garbage is left: a
    # tenth of the effect of noise (0.005 px).
    np.testing.assert_allclose(to_degrees(spoiled.q), to_degrees(clean.q), atol=5e-4)
    # As for every pair (0.005 px, 0.007 deg), with a tenth of the region missing on one side.
    np.testing.assert_allclose(to_degrees(clean.q)[0], (0.4, 0.3, 0.2, 0.3, 0.1), atol=0.01)


@pytest.mark.parametrize("garbage", [np.nan, 1e9])
def test_absurd_values_do_not_leak_out_of_ignored_pixels(garbage: float) -> None:
    f, g, circle = pair(MOTION)
    ignore = np.zeros(f.shape, bool)
    ignore[40:60, 70:100] = True
    f[40:60, 70:100] = garbage
    found = correlate(f, g, circle, ignore=ignore)
    assert found.status.tolist() == ["ok"]
    np.testing.assert_allclose(to_degrees(found.q)[0], MOTION, atol=0.01)  # as in the test before


def test_the_coefficient_is_one_for_a_linear_copy_and_zero_for_noise() -> None:
    generator = torch.Generator().manual_seed(1)
    f, g = torch.randn(2, 1, 5000, generator=generator, dtype=torch.float64)
    weights = torch.ones_like(f)
    assert float(znssd.zncc(f, 3 * f + 7, weights)) == pytest.approx(1, abs=1e-12)
    assert float(znssd.zncc(f, 7 - 0.1 * f, weights)) == pytest.approx(-1, abs=1e-12)
    assert abs(float(znssd.zncc(f, g, weights))) < 4 / 5000**0.5  # four standard deviations
    assert float(znssd.zncc(f, torch.ones_like(f), weights)) == 0


def test_the_coefficient_falls_with_the_noise() -> None:
    f, g, circle = pair(STILL)
    found = correlate(noisy(f, 40.0, 1), noisy(g, 40.0, 2), circle, pre_blur=0.0, min_zncc=0.0)
    y, x = np.mgrid[: f.shape[0], : f.shape[1]]
    inside = (x - circle[0]) ** 2 + (y - circle[1]) ** 2 < (0.95 * circle[2]) ** 2
    texture, noise = float(f[inside].var()), float((noisy(f, 40.0, 1) - f)[inside].var())
    # Signal over signal and noise, known from 7000 pixels to 1 / sqrt(7000) = 1.2 %; q absorbs a little.
    assert float(found.zncc[0]) == pytest.approx(texture / (texture + noise), abs=0.05)


def noise_image(seed: int) -> torch.Tensor:
    return 100 + 20 * torch.randn(130, 130, generator=torch.Generator().manual_seed(seed))


@pytest.mark.parametrize("level", [77.3, 100.0, 255.0])
def test_a_flat_image_has_no_texture(level: float) -> None:
    flat = torch.full((130, 130), level)
    found = correlate(flat, flat, (64, 64, 50))
    assert found.status.tolist() == ["weak_texture"]
    assert found.q.isnan().all()


def test_a_plain_ball_has_no_texture() -> None:
    circle = (63.2, 64.7, 50.0)
    y, x = torch.meshgrid(torch.arange(130), torch.arange(130), indexing="ij")
    ball = torch.where((x - circle[0]) ** 2 + (y - circle[1]) ** 2 < circle[2] ** 2, 200.0, 90.0)
    found = correlate(noisy(ball, 2.0, 1), noisy(ball, 2.0, 2), circle)
    assert found.status.tolist() == ["weak_texture"]


def test_noise_is_no_motion() -> None:
    found = correlate(noise_image(0), noise_image(1), (64, 64, 50))
    assert found.status[0] in ("low_correlation", "not_converged", "weak_texture")
    assert found.q.isnan().all()


def test_unrelated_patterns_are_no_motion() -> None:
    images = [pair(STILL, seed=seed)[0] for seed in range(4)]
    found = correlate(torch.stack(images[:3]), torch.stack(images[1:]), (63.2, 64.7, 50))
    assert set(found.status) <= {"low_correlation", "not_converged"}
    assert found.q.isnan().all()


def test_a_region_mostly_out_of_the_frame_is_out_of_frame() -> None:
    f, g, (x, y, radius) = pair(STILL)
    found = correlate(f[:, 55:], g[:, 55:], (x - 55 - 4, y, radius))
    assert found.status.tolist() == ["ok"]  # more than half of the ball is in sight
    found = correlate(f[:, 85:], g[:, 85:], (0, y, radius), min_visible=0.8)
    assert found.status.tolist() == ["out_of_frame"]
    assert found.q.isnan().all()


def test_statuses_come_from_the_published_list() -> None:
    assert STATUSES == ("ok", "weak_texture", "low_correlation", "not_converged", "out_of_frame", "lost")


def test_too_few_iterations_have_not_converged() -> None:
    f, g, circle = pair(MOTION)
    found = correlate(f, g, circle, max_iterations=1)
    assert found.status.tolist() == ["not_converged"]
    assert int(found.iterations[0]) == 1


def test_results_have_a_row_per_pair() -> None:
    f, g, circle = pair(MOTION)
    found = correlate(f.expand(2, -1, -1), g.expand(2, -1, -1), circle)
    assert found.q.shape == (2, 5)
    assert found.covariance.shape == (2, 5, 5)
    assert found.zncc.shape == found.iterations.shape == found.status.shape == (2,)


IMAGE = noise_image(3)
CIRCLE = (64.0, 64.0, 40.0)
BAD = {
    "images of two shapes": ({"g": IMAGE[:100]}, r"one shape.*130.*100"),
    "no images": ({"f": None}, "f: expected an array"),
    "four axes": ({"f": IMAGE[None, None]}, "f: expected real grey levels"),
    "words": ({"f": np.array([["a", "b"]])}, "f: expected an array"),
    "complex": ({"f": IMAGE + 1j}, "f: expected real grey levels"),
    "masked images": ({"g": np.ma.masked_less(IMAGE.numpy(), 60)}, r"g: got a masked array with \d+ of.*`ignore`"),
    "masked images in a list": ({"f": [np.ma.masked_less(IMAGE.numpy(), 60)]}, "f: got a masked array"),
    "a mask that is masked": (
        {"ignore": np.ma.masked_less(IMAGE.numpy(), 60)},
        r"ignore: got a masked array.*give its `mask`",
    ),
    "a circle outside": ({"circle": (300, 64, 40)}, r"outside the image of 130 x 130"),
    "a circle of not a number": ({"circle": (64, np.nan, 40)}, "finite"),
    "an infinite radius": ({"circle": (64, 64, np.inf)}, "finite"),
    "a circle too small": ({"circle": (64, 64, 2.5)}, "3 px or more"),
    "a negative radius": ({"circle": (64, 64, -40)}, "3 px or more"),
    "a circle larger than the image": ({"circle": (64, 64, 500)}, "larger than the image"),
    "two numbers for a circle": ({"circle": (64, 64)}, "circle"),
    "a circle in words": ({"circle": Circle("left", 64, 40)}, "circle: expected 3 numbers"),  # type: ignore[arg-type]
    "circles of two radii": (
        {"circle": [(64, 64, 40), (64, 64, 41)], "f": IMAGE.expand(2, -1, -1), "g": IMAGE.expand(2, -1, -1)},
        "same radius",
    ),
    "more circles than pairs": ({"circle": [CIRCLE] * 3}, "circle"),
    "a start of three numbers": ({"start": (0, 0, 0)}, "start"),
    "a start that is not finite": ({"start": (0, np.nan, 0, 0, 0)}, "start"),
    "a mask of another shape": ({"ignore": np.zeros((3, 3))}, r"ignore.*130"),
    "an unknown model": ({"model": "affine"}, r"unknown model 'affine'.*rigid"),
    "an unknown jacobian": ({"jacobian": "numeric"}, r"unknown jacobian 'numeric'.*constant"),
    "a region of nothing": ({"roi": 0.0}, "roi = 0.0: expected"),
    "a region beyond the ball": ({"roi": 1.5}, "roi = 1.5: expected"),
    "a region of not a number": ({"roi": float("nan")}, "roi = nan: expected"),
    "a region in words": ({"roi": "all"}, "roi = 'all': expected"),
    "no iterations": ({"max_iterations": 0}, "max_iterations = 0: expected"),
    "half an iteration": ({"max_iterations": 2.5}, "max_iterations"),
    "a negative blur": ({"pre_blur": -1.0}, "pre_blur = -1.0: expected"),
    "no tolerance": ({"tolerance_px": 0.0}, "tolerance_px = 0.0: expected"),
    "a coefficient above one": ({"min_zncc": 1.1}, "min_zncc = 1.1: expected"),
    "precisions that differ": ({"f": IMAGE.double()}, "precision|dtype|float64"),
}


def test_a_masked_array_without_masked_values_is_read_as_its_data() -> None:
    f, g, circle = pair(MOTION)
    ignore = np.zeros(f.shape, bool)
    ignore[:9] = True
    plain = correlate(f, g, circle, ignore=ignore).q
    masked = correlate(
        np.ma.array(f.numpy()), [np.ma.array(g.numpy())], circle, ignore=np.ma.array(ignore, mask=False)
    ).q
    assert masked.equal(plain)


@pytest.mark.parametrize(("change", "sentence"), BAD.values(), ids=BAD.keys())
def test_invalid_arguments_are_refused_with_a_sentence(change: dict[str, Any], sentence: str) -> None:
    arguments = {"f": IMAGE, "g": IMAGE, "circle": CIRCLE} | change
    f, g, circle = (arguments.pop(name) for name in ("f", "g", "circle"))
    with pytest.raises(ValueError, match=sentence) as caught:
        correlate(f, g, circle, **arguments)
    assert "\n" not in str(caught.value)
