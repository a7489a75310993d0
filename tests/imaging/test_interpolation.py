"""Cubic interpolation: prefilter, samples, gradient, what it does to a texture and to noise."""

import math

import numpy as np
import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st

from torchsphere.correlation import reference_lookup
from torchsphere.imaging import interpolation

GENERATOR = torch.Generator().manual_seed(11)
IMAGES = 100 + 30 * torch.randn(2, 24, 24, generator=GENERATOR, dtype=torch.float64)
PLACES = 2 + 19 * torch.rand(2, 200, 2, generator=GENERATOR, dtype=torch.float64)


def slow_kernel(distance: np.ndarray) -> np.ndarray:
    """The centred cubic B-spline with a twenty-fourth of its second derivative."""
    t = np.abs(distance)
    inner = 2 / 3 - t**2 + t**3 / 2 + (3 * t - 2) / 24
    return np.where(t < 1, inner, np.where(t < 2, (2 - t) ** 3 / 6 + (2 - t) / 24, 0.0))


def slow_coefficients(line: np.ndarray) -> np.ndarray:
    """Coefficients of one line with mirrored ends by the recursive filter (M. Unser, 1999), one by one."""
    # The kernel at a node and beside it, 14/24 and 5/24: the pole solves 5 z^2 + 14 z + 5 = 0.
    pole, n = (math.sqrt(24) - 7) / 5, len(line)
    period = np.concatenate((line, line[-2:0:-1]))
    forward = np.zeros(n)
    forward[0] = sum(period[-k % len(period)] * pole**k for k in range(60))
    for i in range(1, n):
        forward[i] = line[i] + pole * forward[i - 1]
    c = np.zeros(n)
    c[-1] = pole / (pole**2 - 1) * (forward[-1] + pole * forward[-2])
    for i in range(n - 2, -1, -1):
        c[i] = pole * (c[i + 1] - forward[i])
    return 24 / 5 * c


def slow_spline(image: np.ndarray, x: float, y: float) -> float:
    """Sum of all coefficients times the kernel, one place."""
    c = np.apply_along_axis(slow_coefficients, 0, np.apply_along_axis(slow_coefficients, 1, image))
    return float(slow_kernel(np.arange(image.shape[0]) - y) @ c @ slow_kernel(np.arange(image.shape[1]) - x))


@pytest.mark.parametrize("pre_blur", [0.0, 0.7])
def test_the_spline_goes_through_the_nodes_exactly(pre_blur: float) -> None:
    c = interpolation.coefficients(IMAGES, pre_blur)
    blurred = interpolation.blur(IMAGES, pre_blur)
    # Rounding of float64 at 100 grey levels.
    torch.testing.assert_close(reference_lookup.nodes(c)[:, 0], blurred[:, 1:-1, 1:-1], atol=1e-9, rtol=0)
    y, x = torch.meshgrid(torch.arange(1, 22), torch.arange(1, 22), indexing="ij")
    nodes = torch.stack((x, y), -1).reshape(1, -1, 2).expand(2, -1, -1).double()
    at_nodes = interpolation.sample(c, nodes).reshape(2, 21, 21)
    torch.testing.assert_close(at_nodes, blurred[:, 1:22, 1:22], atol=1e-9, rtol=0)


def test_samples_equal_a_slow_spline() -> None:
    c = interpolation.coefficients(IMAGES, 0.0)
    found = interpolation.sample(c, PLACES[:, :25])
    slow = [
        [slow_spline(image.numpy(), *place) for place in places]
        for image, places in zip(IMAGES, PLACES[:, :25].tolist(), strict=True)
    ]
    # The same function by another way in float64; bilinear look-ups round their offsets.
    torch.testing.assert_close(found, torch.tensor(slow, dtype=torch.float64), atol=1e-9, rtol=0)


def found_shift(frequency: float, d: float) -> float:
    """What a texture of one frequency that moved by ``d`` px seems to have moved by, by least squares, px."""
    x = torch.arange(200, dtype=torch.float64)
    errors = []
    for phase in torch.linspace(0, 1, 9, dtype=torch.float64)[:-1]:
        f, g = (torch.cos(2 * torch.pi * (frequency * (x - moved) + phase)).expand(5, -1)[None] for moved in (0.0, d))
        c_f, c_g = interpolation.coefficients(f, 0.0), interpolation.coefficients(g, 0.0)
        value, slope, _ = reference_lookup.nodes(c_f)[0, :, 1, 50:150]
        # The nodes lack one pixel at the border.
        places = torch.stack((x[51:151] + d, torch.full((100,), 2.0, dtype=torch.float64)), -1)[None]
        left = value - interpolation.sample(c_g, places)[0]
        errors.append(float((slope * left).sum() / slope.square().sum()))
    return d + float(np.mean(errors))


@pytest.mark.parametrize(("frequency", "of_b_spline"), [(0.1, 1.3e-4), (0.2, 2.5e-3), (0.25, 7.0e-3)])
def test_a_shift_by_part_of_a_pixel_is_found_two_to_four_times_better_than_with_the_b_spline(
    frequency: float, of_b_spline: float
) -> None:
    assert abs(found_shift(frequency, 0.25) - 0.25) < 0.4 * of_b_spline
    # At whole and half pixels nothing is off, by symmetry; rounding.
    assert found_shift(frequency, 1.0) == pytest.approx(1.0, abs=1e-9)
    assert found_shift(frequency, 0.5) == pytest.approx(0.5, abs=1e-9)


def test_single_precision_is_good_to_a_thousandth_of_a_grey_level() -> None:
    double = interpolation.sample(interpolation.coefficients(IMAGES), PLACES)
    single = interpolation.sample(interpolation.coefficients(IMAGES.float()), PLACES.float())
    # 1e-7 of 200 grey levels, a few dozen operations; places rounded to 1e-6 px on slopes of 50 levels per px.
    assert (double - single).abs().max() < 1e-3


@pytest.mark.parametrize("pre_blur", [0.0, 0.7])
def test_the_gradient_at_the_nodes_is_the_slope_of_the_samples(pre_blur: float) -> None:
    c = interpolation.coefficients(IMAGES, pre_blur)
    y, x = torch.meshgrid(torch.arange(2, 21), torch.arange(2, 21), indexing="ij")
    nodes = torch.stack((x, y), -1).reshape(1, -1, 2).expand(2, -1, -1).double()
    h = 1e-4
    for axis, gradient in enumerate(reference_lookup.nodes(c)[:, 1:].unbind(1)):
        step = h * torch.eye(2, dtype=torch.float64)[axis]
        slope = (interpolation.sample(c, nodes + step) - interpolation.sample(c, nodes - step)) / (2 * h)
        # The third derivative jumps at a node, by up to 1000 levels per px^3: times h^2 / 6, and rounding: 1e-13 / h.
        torch.testing.assert_close(slope.reshape(2, 19, 19), gradient[:, 1:20, 1:20], atol=1e-4, rtol=0)


def test_automatic_differentiation_of_samples_equals_finite_differences() -> None:
    c = interpolation.coefficients(IMAGES, 0.0)
    places = PLACES.clone().requires_grad_()
    (slope,) = torch.autograd.grad(interpolation.sample(c, places).sum(), places)
    h = 1e-5
    for axis in range(2):
        step = h * torch.eye(2, dtype=torch.float64)[axis]
        expected = (interpolation.sample(c, PLACES + step) - interpolation.sample(c, PLACES - step)) / (2 * h)
        # Rounding: 200 levels x 1e-16 / h x a few look-ups; a node between the two places: h x 100 levels per px^2.
        torch.testing.assert_close(slope[..., axis], expected, atol=1e-3, rtol=0)


@settings(max_examples=20, deadline=None, derandomize=True)
@given(st.floats(-5, 5), st.floats(-5, 5), st.floats(2, 20), st.floats(2, 20))
def test_a_plane_is_reproduced_in_the_middle(a: float, b: float, x: float, y: float) -> None:
    steps = torch.arange(61, dtype=torch.float64)
    plane = (a * steps[None] + b * steps[:, None])[None]
    place = torch.tensor([[[x + 19, y + 19]]], dtype=torch.float64)
    value = interpolation.sample(interpolation.coefficients(plane), place)
    # The mirrored border bends the plane there; that decays by 0.42 per px, 21 px: 1e-8 of 300 levels.
    assert abs(float(value) - (a * (x + 19) + b * (y + 19))) < 1e-6


@pytest.mark.parametrize("pre_blur", [0.0, 0.7, 1.5])
def test_noise_gains_are_what_white_noise_keeps(pre_blur: float) -> None:
    noise = torch.randn(1, 400, 400, generator=torch.Generator().manual_seed(5), dtype=torch.float64)
    c = interpolation.coefficients(noise, pre_blur)
    of_value, of_slope = interpolation.noise_gains(pre_blur)
    values, *slopes = reference_lookup.nodes(c)[..., 20:-20, 20:-20].unbind(1)
    # 130 000 pixels, of which a blur of 1.5 px leaves 130 000 / (4 pi 1.5^2) = 4600 independent: sd 2 %, three of them.
    assert float(values.var()) == pytest.approx(of_value, rel=0.06)
    assert float(torch.stack(slopes).var()) == pytest.approx(of_slope, rel=0.06)


def test_without_blur_a_value_keeps_all_its_noise() -> None:
    assert interpolation.noise_gains(0.0)[0] == pytest.approx(1.0, abs=1e-12)  # rounding
    assert float(interpolation.gaussian_kernel(0.7).sum()) == pytest.approx(1.0, abs=1e-12)


def test_a_blurred_point_is_a_gaussian_of_the_stated_width() -> None:
    image = torch.zeros(1, 41, 41, dtype=torch.float64)
    image[0, 20, 20] = 1
    row = interpolation.blur(image, 1.5)[0].sum(0)
    steps = torch.arange(41, dtype=torch.float64) - 20
    # Sampled and cut at 4 sigma: the variance keeps 0.1 %.
    assert float((row * steps**2).sum()) == pytest.approx(1.5**2, rel=2e-3)
