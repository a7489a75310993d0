"""The footprint of a blurred pixel on the ball, and the fit of its blur."""

from dataclasses import replace

import numpy as np
import pytest
import torch
from ball_models import RADIUS, distances, one_share, poses, random, smooth_ball, windows
from numpy.typing import NDArray
from shots import rotation_matrix
from torch import Tensor

from torchsphere.sphere_map import cube_map, footprint, forward_model, rays
from torchsphere.sphere_map.ball import Poses, TexturedBall
from torchsphere.sphere_map.pixel_weights import uniform_profile
from torchsphere.sphere_map.state import State, fit_map
from torchsphere.sphere_map.window import Windows

Floats = NDArray[np.float64]

BLUR_PX = 0.5


def seen_through_optics(seen: Windows, at: Poses, ball: TexturedBall) -> Tensor:
    """Grey levels (s, s) of one image as means over the pixels' area and the optics' blur, inside the outline alone."""
    nodes, shares = np.polynomial.hermite_e.hermegauss(7)
    area, parts = np.polynomial.legendre.leggauss(3)
    optics, pixel = (list(zip(*rule, strict=True)) for rule in ((BLUR_PX * nodes, shares), (area / 2, parts)))
    steps = [(a + b, p * q) for a, p in optics for b, q in pixel]
    total = torch.zeros_like(seen.levels)
    x, y = seen.offsets(at.centre)
    for right, p in steps:
        for down, q in steps:
            u, v = torch.broadcast_tensors((x + right) / ball.radius, (y + down) / ball.radius)
            points = torch.stack((u, v, -(1 - u.square() - v.square()).clamp_min(1e-9).sqrt()))
            turned = torch.einsum("nij,inab->jnab", at.orientation, points)
            light = ball.light[0] + (ball.light[1:].reshape(3, 1, 1, 1) * points).sum(0)
            total += p * q * light * cube_map.places(turned, ball.cells).value(ball.coefficients)
    return (at.gain * total / sum(share for _, share in steps) ** 2 + at.offset)[0]


def test_a_blurred_pixel_sees_more_of_a_tilted_surface() -> None:
    """A map that is right in front is right where the surface is tilted by 40 to 60 deg, if its blur is known."""
    at, shown = poses(1), smooth_ball()
    seen = windows(at)
    truth = seen_through_optics(seen, at, shown)
    # The map holds the texture as a pixel in front sees it: minus the variance over two times the Laplacian.
    width = shown.cells / (cube_map.CELLS_PER_RADIUS * RADIUS)
    faces = shown.coefficients.reshape(6, shown.cells + 3, shown.cells + 3)
    curved = torch.zeros_like(faces)
    curved[:, 1:-1] += faces[:, 2:] + faces[:, :-2] - 2 * faces[:, 1:-1]
    curved[:, :, 1:-1] += faces[:, :, 2:] + faces[:, :, :-2] - 2 * faces[:, :, 1:-1]
    held = faces + (BLUR_PX**2 + 1 / 12) * width**2 / 2 * curved
    tilted = (distances(seen, at)[0] / RADIUS - 0.75).abs() < 0.1

    def error(blur: float) -> float:
        ball = replace(shown, coefficients=held.flatten(), footprint_blur=blur)
        return float((forward_model.linearise(seen, at, ball).levels[0] - truth)[tilted].square().mean().sqrt())

    assert error(BLUR_PX) < 0.6 * error(0.0)


def moments(place: Floats, weight: Floats) -> tuple[float, float, float]:
    """Mean, standard deviation and cube root of the third moment of the places."""
    share = weight / weight.sum()
    off = place - (share * place).sum()
    return (share * place).sum(), np.sqrt((share * off**2).sum()), np.cbrt((share * off**3).sum())


@pytest.mark.parametrize("blur", [0.0, 1.0, 2.0])
@pytest.mark.parametrize("in_widths", [-0.5, 0.0, 1.0, 2.0, 4.0, 6.0])
def test_rays_and_map_together_lie_as_the_footprint_does(blur: float, in_widths: float) -> None:
    """Along the arc, px, for pixels in so many widths of the footprint from the outline, at R = 35 px.

    In truth a point of the footprint (x, y) is seen at the angle asin(x / sqrt(R^2 - y^2)) from the line of sight, if
    the disc covers it. The map's own footprint adds its variance to that of the rays.
    """
    radius, width = 35.0, np.sqrt(blur**2 + 1 / 12)
    at = radius - in_widths * width
    side = np.linspace(-4.5 * width, 4.5 * width, 721) if blur else (np.arange(721) + 0.5) / 721 - 0.5
    x, y = np.meshgrid(at + side, side)
    density = np.exp(-((x - at) ** 2 + y**2) / (2 * width**2)) if blur else np.ones_like(x)
    chord = np.sqrt(radius**2 - y**2)
    mean, spread, third = moments(radius * np.arcsin(np.clip(x / chord, -1, 1)), density * (x < chord))
    size = torch.tensor(radius, dtype=torch.float64)
    ball = replace(smooth_ball(), radius=size, footprint_blur=blur, rim_points=rays.rim_points(radius))
    pixel = torch.tensor([[[at]]], dtype=torch.float64)
    drawn = rays.rays_of(pixel, torch.zeros_like(pixel), size, ball)
    seen = np.clip((drawn.scale * at / radius).numpy().ravel(), -1, 1)
    of_rays = moments(radius * np.arcsin(seen), drawn.weight.numpy().ravel())
    assert of_rays[0] == pytest.approx(mean, abs=0.02)
    assert np.hypot(of_rays[1], width) == pytest.approx(spread, rel=0.01)
    assert of_rays[2] == pytest.approx(third, abs=0.12 * spread)


def test_loops_and_torch_give_the_same_blurred_model() -> None:
    at, ball = poses(), replace(smooth_ball(), footprint_blur=BLUR_PX)
    seen = windows(at)
    single = Windows(seen.levels.float(), seen.background.float(), seen.visibility.float(), seen.origin)
    exact = forward_model.linearise(seen, at, ball)
    fast = forward_model.linearise(single, at, replace(ball, coefficients=ball.coefficients.float()))
    drawn = forward_model.design(single, at, ball).levels(ball.coefficients.float())
    visible = seen.visibility > 0
    # Single precision has 7 digits of grey levels of some hundred, and of places of some ten cells.
    assert float((fast.levels - exact.levels)[visible].abs().max()) < 0.02
    assert float((drawn - exact.levels)[visible].abs().max()) < 0.02
    size = exact.jacobian[visible.flatten(1)].square().mean(0).sqrt()
    difference = (fast.jacobian - exact.jacobian)[visible.flatten(1)] / size
    assert float(difference.square().mean(0).sqrt().max()) < 3e-4


def images(blur: float, edge_blur: float) -> State:
    """Ten images of a ball that turns, and a map fitted to them as if they were sharp."""
    count, ball = 10, smooth_ball(dtype=torch.float32)
    axis = torch.tensor([0.2, 0.95, 0.25], dtype=torch.float64)
    turns = torch.stack([rotation_matrix(3.0 * i / count * axis) for i in range(count)])
    at = Poses.at(torch.tensor([[30.34, 29.61]], dtype=torch.float64).expand(count, 2), turns)
    seen = windows(at, torch.float32)
    start = replace(ball, edge_blur=torch.tensor(edge_blur, dtype=torch.float64))
    levels = forward_model.linearise(seen, at, replace(start, footprint_blur=blur)).levels
    noisy = replace(seen, levels=levels + 0.5 * random(*levels.shape).float())
    return fit_map(State(noisy, at, start, uniform_profile(ball.radius, 0.25)), one_share, 40)[0]


@pytest.mark.parametrize("blur", [0.0, 0.3, BLUR_PX])
def test_the_blur_of_the_footprint_is_found_whatever_the_outline_has(blur: float) -> None:
    found = footprint.fit_footprint(images(blur, edge_blur=0.4), one_share).ball.footprint_blur
    assert found**2 == pytest.approx(blur**2, abs=0.03)


def test_a_sharp_outline_has_no_blur_in_the_footprint() -> None:
    state = images(0.0, edge_blur=0.1)
    found = footprint.fit_footprint(state, one_share)
    assert found.ball.footprint_blur == 0
    assert torch.equal(found.ball.coefficients, state.ball.coefficients)
