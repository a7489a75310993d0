"""Images of a result, against the track of the same frames; residual maps of pairs whose motion is known exactly."""

import dataclasses

import numpy as np
import pytest
import torch
from shots import pair

from torchsphere.correlation.options import Options
from torchsphere.report.frame_sampling import Pairs, residual_maps
from torchsphere.results.reader import ResultFolder

MOVED = (1.3, -0.4, 0.4, -0.5, 0.3)


def _pairs(scale: float = 1.0) -> tuple[torch.Tensor, torch.Tensor, Pairs]:
    radius = 50.0 * scale
    size = int(130 * scale)
    f, g, circle = pair(
        (MOVED[0] * scale, MOVED[1] * scale, *MOVED[2:]),
        radius=radius,
        centre=(63.2 * scale, 64.7 * scale),
        shape=(size, size),
    )
    motion = torch.tensor([[MOVED[0] * scale, MOVED[1] * scale, *np.radians(MOVED[2:]), 0.0]], dtype=torch.float64)
    return f, g, Pairs(f[None].float(), g[None].float(), torch.tensor([circle], dtype=torch.float64), motion)


@pytest.mark.parametrize("scale", [1.0, 2.0], ids=["each pixel", "means of pixels"])
def test_the_true_motion_leaves_a_small_residual_at_any_gain_and_offset(scale: float) -> None:
    f, g, pairs = _pairs(scale)
    brighter = dataclasses.replace(pairs, after=1.2 * pairs.after + 7)
    still = dataclasses.replace(pairs, motion=torch.zeros(1, 6, dtype=torch.float64))
    left, scaled, unmoved = (residual_maps(p, None, Options()) for p in (pairs, brighter, still))
    # Images without noise, with a pattern of 50 grey levels: the residual is the renderer's sampling.
    assert np.nanstd(left) < 1.0
    np.testing.assert_allclose(scaled, left, atol=2e-2)
    assert np.nanstd(unmoved) > 15 * np.nanstd(left)
    assert f.shape == g.shape


def test_a_new_bright_spot_is_positive_in_the_map_at_its_place_in_the_first_image() -> None:
    _, _, pairs = _pairs()
    after = pairs.after.clone()
    # A spot on the surface point 12 px left of and 9 px below the centre, moved with the ball.
    x, y = -12.0, 9.0
    s = (50.0**2 - x**2 - y**2) ** 0.5
    turn = np.radians(MOVED[2:])
    dx, dy = MOVED[0] - s * turn[1] - y * turn[2], MOVED[1] + s * turn[0] + x * turn[2]
    column, row = round(63.2 + x + dx), round(64.7 + y + dy)
    after[0, row - 1 : row + 2, column - 1 : column + 2] += 60
    found = residual_maps(dataclasses.replace(pairs, after=after), None, Options())[0]
    at = np.unravel_index(np.nanargmax(np.abs(found)), found.shape)
    middle = found.shape[0] // 2
    # Centre and spot are each rounded to a pixel.
    assert abs(at[1] - middle - x) <= 1.5
    assert abs(at[0] - middle - y) <= 1.5
    assert found[at] > 20


def test_an_ignored_region_has_no_residual() -> None:
    _, _, pairs = _pairs()
    ignore = torch.zeros(130, 130, dtype=torch.bool)
    ignore[:, 80:] = True
    found = residual_maps(pairs, ignore, Options())[0]
    middle = found.shape[0] // 2
    assert np.isnan(found[:, middle + 20 :]).all()
    assert np.isfinite(found[middle, middle - 30])


def test_a_kept_image_shows_the_ball_at_the_position_of_the_track(result: ResultFolder) -> None:
    assert result.sampled is not None
    left, top, width, _ = result.sampled.box
    image = np.asarray(result.sampled.image(0).convert("L")).astype(float)
    scale = image.shape[1] / width
    rows, columns = np.indices(image.shape)
    # Only the ball's pattern varies: the background is even, and the bar's edge is more than two radii away.
    x, y = (columns + 0.5) / scale + left, (rows + 0.5) / scale + top
    away = np.hypot(x - result.position[0, 0], y - result.position[0, 1])
    assert image[away < 38].std() > 50
    assert image[(away > 44) & (away < 60)].std() < 6
