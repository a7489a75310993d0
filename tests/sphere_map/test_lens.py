"""Lens and pixels as unknowns of the adjustment: their signs, and how the state changes with them."""

import math
from dataclasses import replace

import pytest
import torch
from ball_models import RADIUS, poses, rough_ball, windows

from torchsphere.sphere_map import lens, settling
from torchsphere.sphere_map.perspective import Optics, orthographic
from torchsphere.sphere_map.pixel_weights import uniform_profile
from torchsphere.sphere_map.state import State

CPU = torch.device("cpu")
FAR = orthographic((101, 201), CPU)  # the middle is at (100, 50)


def lens_of(distortion: float = 0.0, stretch: float = 0.0) -> Optics:
    corner = float(FAR.principal.square().sum())
    return replace(
        FAR,
        distortion=torch.tensor([distortion / corner, 0.0, 0.0], dtype=torch.float64),
        stretch=torch.tensor(stretch, dtype=torch.float64),
    )


def state() -> State:
    at, ball = poses(), rough_ball()
    return State(windows(at), at, ball, uniform_profile(ball.radius, 4.0))


@pytest.mark.parametrize("optics", [lens_of(-0.08), lens_of(0.05, 0.03)], ids=["barrel", "cushion, wide pixels"])
def test_straight_and_bent_places_belong_together(optics: Optics) -> None:
    points = torch.tensor([[3.0, 90.0], [100.0, 50.0], [180.0, 10.0]], dtype=torch.float64)
    torch.testing.assert_close(optics.bent(optics.straightened(points)), points, atol=1e-7, rtol=0)
    # The middle stays.
    torch.testing.assert_close(optics.straightened(points)[1], points[1])


def test_a_positive_distortion_moves_the_corner_outwards_by_its_share() -> None:
    corner = torch.tensor([200.0, 100.0], dtype=torch.float64)
    moved = lens_of(0.05).bent(corner) - FAR.principal
    torch.testing.assert_close(moved, 1.05 * (corner - FAR.principal))


def test_on_wide_pixels_a_ball_is_seen_narrow() -> None:
    beside, below = torch.tensor([[150.0, 50.0], [100.0, 90.0]], dtype=torch.float64)
    wide = lens_of(stretch=math.log(1.03))
    assert float(wide.bent(beside)[0] - 100) == pytest.approx(50 / math.sqrt(1.03))
    assert float(wide.bent(below)[1] - 50) == pytest.approx(40 * math.sqrt(1.03))


@pytest.mark.parametrize("number", [0, 1], ids=["distortion", "stretch"])
def test_a_change_of_the_lens_keeps_the_ball_where_it_is_seen_and_about_as_large(number: int) -> None:
    unknown, before = lens.unknowns(FAR)[number], state()
    after = unknown.changed(before, torch.tensor(0.02, dtype=torch.float64))
    assert float(unknown.value(before)) == 0
    assert float(unknown.value(after)) == pytest.approx(0.02)
    assert after.windows.optics is not None
    assert after.windows.bend is not None
    torch.testing.assert_close(after.windows.optics.bent(after.poses.centre), before.poses.centre, atol=1e-8, rtol=0)
    # A px of the image is 0.02 (r / corner)^2 smaller, twice or so, on both sides of the middle.
    assert float(after.ball.radius) == pytest.approx(RADIUS, rel=0.03)
    back = unknown.changed(after, torch.tensor(-0.02, dtype=torch.float64))
    torch.testing.assert_close(back.poses.centre, before.poses.centre, atol=1e-7, rtol=0)
    assert float(back.ball.radius) == pytest.approx(RADIUS, rel=1e-6)


def test_the_lens_that_was_found_has_the_standard_deviations_of_its_own_unknowns() -> None:
    unknowns = lens.unknowns(FAR)
    seen = unknowns[0].changed(state(), torch.tensor(-0.05, dtype=torch.float64))
    n = len(seen.poses)
    covariance = torch.zeros(8 * n + 3, 8 * n + 3, dtype=torch.float64)
    covariance[8 * n, 8 * n] = 0.001**2
    found = lens.found(unknowns, seen, unknowns[:1], covariance)
    assert found.distortion == pytest.approx(-0.05)
    assert found.sd_distortion == pytest.approx(0.001)
    assert (found.stretch, found.sd_stretch) == (0, 0)
    assert found.middle == (100.0, 50.0)
    assert lens.found(unknowns, state(), (), covariance) == lens.Lens()


def test_a_value_is_seen_beyond_its_standard_deviation_and_beyond_what_coarse_cells_show_of_any_ball() -> None:
    assert lens.is_seen(-0.01, 0.001)
    assert not lens.is_seen(0.01, 0.01)
    assert not lens.is_seen(0.9 * lens.LEAST_SEEN, 1e-6)


def test_a_lens_is_looked_for_along_a_path_that_is_longer_than_the_radius() -> None:
    path = torch.tensor([[10.0, 20.0], [11.0, 41.0]], dtype=torch.float64)
    assert settling._crosses(path, 20.0)
    assert not settling._crosses(path, 22.0)
