"""Cubic B-spline: prefilter, samples, gradient, what it does to noise."""

import math

import numpy as np
import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st

from torchsphere import interpolate

GENERATOR = torch.Generator().manual_seed(11)
IMAGES = 100 + 30 * torch.randn(2, 24, 24, generator=GENERATOR, dtype=torch.float64)
PLACES = 2 + 19 * torch.rand(2, 200, 2, generator=GENERATOR, dtype=torch.float64)


def slow_coefficients(line: np.ndarray) -> np.ndarray:
    """B-spline coefficients of one line by the recursive filter with mirrored ends (M. Unser, 1999), one by one."""
    pole, n = math.sqrt(3) - 2, len(line)
    period = np.concatenate((line, line[-2:0:-1]))
    forward = np.zeros(n)
    forward[0] = sum(period[-k % len(period)] * pole**k for k in range(40))
    for i in range(1, n):
        forward[i] = line[i] + pole * forward[i - 1]
    c = np.zeros(n)
    c[-1] = pole / (pole**2 - 1) * (forward[-1] + pole * forward[-2])
    for i in range(n - 2, -1, -1):
        c[i] = pole * (c[i + 1] - forward[i])
    return 6 * c


def slow_spline(image: np.ndarray, x: float, y: float) -> float:
    """Sum of all coefficients times the centred cubic B-spline, one place."""
    c = np.apply_along_axis(slow_coefficients, 0, np.apply_along_axis(slow_coefficients, 1, image))

    def kernel(distance: np.ndarray) -> np.ndarray:
        t = np.abs(distance)
        return np.where(t < 1, 2 / 3 - t**2 + t**3 / 2, np.where(t < 2, (2 - t) ** 3 / 6, 0.0))

    return float(kernel(np.arange(image.shape[0]) - y) @ c @ kernel(np.arange(image.shape[1]) - x))


@pytest.mark.parametrize("pre_blur", [0.0, 0.7])
def test_the_spline_goes_through_the_nodes_exactly(pre_blur: float) -> None:
    c = interpolate.coefficients(IMAGES, pre_blur)
    blurred = interpolate.blur(IMAGES, pre_blur)
    # Rounding of float64 at 100 grey levels.
    torch.testing.assert_close(interpolate.nodes(c)[:, 0], blurred[:, 1:-1, 1:-1], atol=1e-9, rtol=0)
    y, x = torch.meshgrid(torch.arange(1, 22), torch.arange(1, 22), indexing="ij")
    nodes = torch.stack((x, y), -1).reshape(1, -1, 2).expand(2, -1, -1).double()
    at_nodes = interpolate.sample(c, nodes).reshape(2, 21, 21)
    torch.testing.assert_close(at_nodes, blurred[:, 1:22, 1:22], atol=1e-9, rtol=0)


def test_samples_equal_a_slow_spline() -> None:
    c = interpolate.coefficients(IMAGES, 0.0)
    found = interpolate.sample(c, PLACES[:, :25])
    slow = [
        [slow_spline(image.numpy(), *place) for place in places]
        for image, places in zip(IMAGES, PLACES[:, :25].tolist(), strict=True)
    ]
    # The same function by another way in float64; bilinear look-ups round their offsets.
    torch.testing.assert_close(found, torch.tensor(slow, dtype=torch.float64), atol=1e-9, rtol=0)


def test_samples_equal_scipy() -> None:
    ndimage = pytest.importorskip(
        "scipy.ndimage", reason="SciPy, which is no dependency of torchsphere, is not installed"
    )
    found = interpolate.sample(interpolate.coefficients(IMAGES, 0.0), PLACES)
    for image, places, values in zip(IMAGES, PLACES, found, strict=True):
        expected = ndimage.map_coordinates(image.numpy(), places.flip(-1).T.numpy(), order=3, mode="mirror")
        np.testing.assert_allclose(values.numpy(), expected, atol=1e-9, rtol=0)  # rounding of float64


def test_single_precision_is_good_to_a_thousandth_of_a_grey_level() -> None:
    double = interpolate.sample(interpolate.coefficients(IMAGES), PLACES)
    single = interpolate.sample(interpolate.coefficients(IMAGES.float()), PLACES.float())
    # 1e-7 of 200 grey levels, a few dozen operations; places rounded to 1e-6 px on slopes of 50 levels per px.
    assert (double - single).abs().max() < 1e-3


@pytest.mark.parametrize("pre_blur", [0.0, 0.7])
def test_the_gradient_at_the_nodes_is_the_slope_of_the_samples(pre_blur: float) -> None:
    c = interpolate.coefficients(IMAGES, pre_blur)
    y, x = torch.meshgrid(torch.arange(2, 21), torch.arange(2, 21), indexing="ij")
    nodes = torch.stack((x, y), -1).reshape(1, -1, 2).expand(2, -1, -1).double()
    h = 1e-4
    for axis, gradient in enumerate(interpolate.nodes(c)[:, 1:].unbind(1)):
        step = h * torch.eye(2, dtype=torch.float64)[axis]
        slope = (interpolate.sample(c, nodes + step) - interpolate.sample(c, nodes - step)) / (2 * h)
        # The third derivative jumps at a node, by up to 1000 levels per px^3: times h^2 / 6, and rounding: 1e-13 / h.
        torch.testing.assert_close(slope.reshape(2, 19, 19), gradient[:, 1:20, 1:20], atol=1e-4, rtol=0)


def test_automatic_differentiation_of_samples_equals_finite_differences() -> None:
    c = interpolate.coefficients(IMAGES, 0.0)
    places = PLACES.clone().requires_grad_()
    (slope,) = torch.autograd.grad(interpolate.sample(c, places).sum(), places)
    h = 1e-5
    for axis in range(2):
        step = h * torch.eye(2, dtype=torch.float64)[axis]
        expected = (interpolate.sample(c, PLACES + step) - interpolate.sample(c, PLACES - step)) / (2 * h)
        # Rounding: 200 levels x 1e-16 / h x a few look-ups; a node between the two places: h x 100 levels per px^2.
        torch.testing.assert_close(slope[..., axis], expected, atol=1e-3, rtol=0)


@settings(max_examples=20, deadline=None, derandomize=True)
@given(st.floats(-5, 5), st.floats(-5, 5), st.floats(2, 20), st.floats(2, 20))
def test_a_plane_is_reproduced_in_the_middle(a: float, b: float, x: float, y: float) -> None:
    steps = torch.arange(61, dtype=torch.float64)
    plane = (a * steps[None] + b * steps[:, None])[None]
    place = torch.tensor([[[x + 19, y + 19]]], dtype=torch.float64)
    value = interpolate.sample(interpolate.coefficients(plane), place)
    # The mirrored border bends the plane there; that decays by 0.27 per px, 21 px: 1e-12 of 300 levels.
    assert abs(float(value) - (a * (x + 19) + b * (y + 19))) < 1e-6


@pytest.mark.parametrize("pre_blur", [0.0, 0.7, 1.5])
def test_noise_gains_are_what_white_noise_keeps(pre_blur: float) -> None:
    noise = torch.randn(1, 400, 400, generator=torch.Generator().manual_seed(5), dtype=torch.float64)
    c = interpolate.coefficients(noise, pre_blur)
    of_value, of_slope = interpolate.noise_gains(pre_blur)
    values, *slopes = interpolate.nodes(c)[..., 20:-20, 20:-20].unbind(1)
    # 130 000 pixels, of which a blur of 1.5 px leaves 130 000 / (4 pi 1.5^2) = 4600 independent: sd 2 %, three of them.
    assert float(values.var()) == pytest.approx(of_value, rel=0.06)
    assert float(torch.stack(slopes).var()) == pytest.approx(of_slope, rel=0.06)


def test_without_blur_a_value_keeps_all_its_noise() -> None:
    assert interpolate.noise_gains(0.0)[0] == pytest.approx(1.0, abs=1e-12)  # rounding
    assert float(interpolate.gaussian_kernel(0.7).sum()) == pytest.approx(1.0, abs=1e-12)


def test_a_blurred_point_is_a_gaussian_of_the_stated_width() -> None:
    image = torch.zeros(1, 41, 41, dtype=torch.float64)
    image[0, 20, 20] = 1
    row = interpolate.blur(image, 1.5)[0].sum(0)
    steps = torch.arange(41, dtype=torch.float64) - 20
    # Sampled and cut at 4 sigma: the variance keeps 0.1 %.
    assert float((row * steps**2).sum()) == pytest.approx(1.5**2, rel=2e-3)
