"""The ray caster of the synthetic shots: outline, pattern, background and derivative."""

import math

import pytest
import torch
from shots import rotation_matrix

from torchsphere.geometry.camera import Camera
from torchsphere.synthetic import ray_caster
from torchsphere.synthetic.ray_caster import CUBE_HALF_WIDTH, Pattern

EYE = torch.eye(3, dtype=torch.float64)


def plain(level: float) -> Pattern:
    return Pattern(torch.full((8, 8, 8), level))


def ramp(axis: int) -> Pattern:
    """100 grey levels times one body coordinate: trilinear sampling reproduces it exactly."""
    steps = 100 * torch.linspace(-CUBE_HALF_WIDTH, CUBE_HALF_WIDTH, 9, dtype=torch.float64)
    z, y, x = torch.meshgrid(steps, steps, steps, indexing="ij")
    return Pattern((x, y, z)[axis])


def centre(x: float, y: float) -> torch.Tensor:
    return torch.tensor([[x, y]], dtype=torch.float64)


def test_a_plain_ball_has_the_area_and_the_centroid_of_its_disc() -> None:
    image = ray_caster.render(plain(1.0), centre(30.3, 25.8), 20.0, EYE[None], 0.0, shape=(60, 70))[0]
    y, x = torch.meshgrid(torch.arange(60), torch.arange(70), indexing="ij")
    # Shares of pixels at the limb err by 0.004: 160 of them give an area to 0.005 % and a centroid to 0.0007 px.
    assert float(image.sum()) == pytest.approx(math.pi * 400, rel=2e-4)
    assert float((image * x).sum() / image.sum()) == pytest.approx(30.3, abs=0.002)
    assert float((image * y).sum() / image.sum()) == pytest.approx(25.8, abs=0.002)


def test_a_pixel_that_the_outline_hardly_enters_shows_its_share_of_the_ball() -> None:
    # The outline reaches 0.1 px into the column at x = 50: a segment of that height, 4 px wide, holds 2/3 of 0.1 x 4.
    image = ray_caster.render(plain(1.0), centre(29.6, 25.0), 20.0, EYE[None], 0.0, shape=(60, 70))[0]
    assert float(image[:, 50].sum()) == pytest.approx(2 / 3 * 0.1 * 4, abs=0.02)
    assert float(image[25, 50]) == pytest.approx(0.1, abs=0.01)


@pytest.mark.parametrize("axis", [0, 1, 2])
def test_a_pixel_shows_the_front_point_in_body_coordinates(axis: int) -> None:
    matrix = rotation_matrix(torch.tensor([0.2, -0.3, 0.4], dtype=torch.float64))
    image = ray_caster.render(ramp(axis), centre(30, 25), 20.0, matrix[None], 0.0, shape=(60, 70), subsamples=1)[0]
    for x, y in ((0, 0), (7, -3), (-10, 12)):
        seen = torch.tensor([x, y, -math.sqrt(400 - x * x - y * y)], dtype=torch.float64)
        expected = 100 * (matrix.T @ seen)[axis] / 20.0
        # A linear field under trilinear interpolation, one ray through the pixel's centre: rounding only.
        assert float(image[25 + y, 30 + x]) == pytest.approx(float(expected), abs=1e-6)


def test_the_background_is_unchanged_beside_the_ball() -> None:
    still = torch.rand(40, 50, dtype=torch.float64)
    image = ray_caster.render(plain(9.0), centre(20, 20), 10.0, EYE[None], still)[0]
    y, x = torch.meshgrid(torch.arange(40) - 20, torch.arange(50) - 20, indexing="ij")
    away = x**2 + y**2 > 12**2
    torch.testing.assert_close(image[away], still[away], atol=1e-12, rtol=0)  # a mean of nine equal numbers


@pytest.mark.parametrize("at", [(-30.0, 20.0), (20.0, 90.0)])
def test_a_ball_out_of_the_frame_changes_nothing(at: tuple[float, float]) -> None:
    image = ray_caster.render(plain(9.0), centre(*at), 10.0, EYE[None], 3.0, shape=(40, 50))[0]
    assert (image == 3.0).all()


def test_a_ball_half_in_the_frame_is_cut_at_the_border() -> None:
    whole = ray_caster.render(plain(9.0), centre(25, 20), 10.0, EYE[None], 3.0, shape=(40, 50))[0]
    cut = ray_caster.render(plain(9.0), centre(0, 20), 10.0, EYE[None], 3.0, shape=(40, 25))[0]
    torch.testing.assert_close(cut, whole[:, 25:], atol=1e-9, rtol=0)


def test_a_background_of_one_grey_level_needs_a_shape() -> None:
    with pytest.raises(ValueError, match="shape"):
        ray_caster.render(plain(9.0), centre(0, 20), 10.0, EYE[None], 3.0)


def test_compiled_loops_and_torch_draw_the_same_image() -> None:
    pattern, turn = ray_caster.speckle(2, radius_px=15.0), rotation_matrix(torch.tensor([0.3, -0.8, 0.5]))
    drawn = [
        ray_caster.render(pattern, centre(20.3, 19.6).to(dtype), 15.0, turn[None].to(dtype), 90.0, shape=(36, 42))[0]
        for dtype in (torch.float32, torch.float64)
    ]
    # A ray that passes the outline by a rounding error has 1/233 of a pixel's level, 220 at most.
    torch.testing.assert_close(drawn[0].double(), drawn[1], atol=220 / 233, rtol=0)
    assert (drawn[0] - drawn[1]).abs().quantile(0.99) < 1e-3


def test_what_is_no_rotation_or_no_cube_draws_nothing_that_looks_like_a_level() -> None:
    given = ray_caster.speckle(2, radius_px=15.0), centre(20.3, 19.6).float(), 15.0
    drawn = ray_caster.render(*given, torch.full((1, 3, 3), math.nan), 90.0, shape=(36, 42))[0]
    assert torch.isnan(drawn[20, 20])
    assert float(drawn[0, 0]) == 90.0
    with pytest.raises(ValueError, match="as many nodes along each axis"):
        ray_caster.render(Pattern(torch.zeros(8, 8, 4)), *given[1:], torch.eye(3)[None], 90.0, shape=(36, 42))


def test_an_image_is_differentiable_by_the_position() -> None:
    pattern = ray_caster.speckle(0, radius_px=12.0)
    at = centre(20.3, 20.6).requires_grad_()

    def middle(c: torch.Tensor) -> torch.Tensor:
        return ray_caster.render(pattern, c, 12.0, EYE[None], 90.0, shape=(42, 42))[0, 18:24, 18:24].sum()

    (slope,) = torch.autograd.grad(middle(at), at)
    h = 1e-6
    with torch.no_grad():
        for axis in range(2):
            step = h * torch.eye(2, dtype=torch.float64)[axis]
            expected = (middle(at + step) - middle(at - step)) / (2 * h)
            # 36 pixels of 100 levels: rounding 1e-13 * 3600 / h = 4e-4.
            assert float(slope[0, axis]) == pytest.approx(float(expected), abs=0.01, rel=1e-3)


def test_speckle_has_the_given_range_size_and_seed() -> None:
    pattern = ray_caster.speckle(4, radius_px=40.0, speckle_px=4.0, low=30.0, high=220.0)
    volume = pattern.volume
    assert 30 <= float(volume.min()) < 40
    assert 210 < float(volume.max()) <= 220
    assert torch.equal(volume, ray_caster.speckle(4, radius_px=40.0).volume)
    assert not torch.equal(volume, ray_caster.speckle(5, radius_px=40.0).volume)
    # The autocorrelation of smoothed noise is wider than the smoothing Gaussian by sqrt(2). The error function, which
    # limits the levels, narrows it by some per cent.
    cells_per_px = volume.shape[0] / (2 * CUBE_HALF_WIDTH * 40.0)
    line = volume - volume.mean()
    correlation = [float((line[..., k:] * line[..., : len(line) - k]).mean() / line.var()) for k in range(12)]
    half = next(k for k, value in enumerate(correlation) if value < 0.5)
    width = 2 * (half - (0.5 - correlation[half]) / (correlation[half - 1] - correlation[half])) / cells_per_px
    assert width == pytest.approx(4.0 * 2**0.5, rel=0.1)


def test_a_far_camera_sees_what_parallel_rays_see_and_a_near_one_the_tangent_cone() -> None:
    centre, turn = torch.tensor([[30.2, 27.6]]), torch.eye(3)[None]
    pattern = ray_caster.speckle(1, radius_px=20.0)
    given = (pattern, centre.double(), 20.0, turn.double(), 0.0)
    parallel = ray_caster.render(*given, shape=(60, 64))
    # In single precision, too: lengths of 500 000 radii would take the whole ball for rounding.
    far = ray_caster.render(pattern, centre, 20.0, turn, 0.0, shape=(60, 64), camera=Camera(focal_px=1e7))
    assert float((far - parallel).abs().mean()) < 0.01
    # A bright ball five radii away: the cone that touches the ball is wider than the ball at its depth.
    bright = ray_caster.Pattern(torch.full_like(pattern.volume, 100.0))
    camera = Camera(focal_px=100.0, principal_px=(30.2, 27.6))
    near = ray_caster.render(bright, *given[1:], shape=(60, 64), camera=camera)
    assert float(near.sum() / 100) == pytest.approx(math.pi * 20.0**2 / (1 - 1 / 25), rel=2e-3)
