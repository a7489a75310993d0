"""Joint adjustment of map and poses, against exact truth."""

from dataclasses import dataclass, replace

import numpy as np
import pytest
import torch
from shots import Shot, noisy, rotation_matrix, shot

from torchsphere.sphere_map import bundle_adjustment as bundle
from torchsphere.sphere_map import gauss_newton, pixel_weights, registration, schur
from torchsphere.sphere_map.bundle_adjustment import Bundle
from torchsphere.sphere_map.gauss_newton import State
from torchsphere.sphere_map.projection import Pose
from torchsphere.sphere_map.window import Window, cut_window

RADIUS, LEVEL = 20.0, 90.0

#: Variance of noise 2 and of rounding.
NOISE = 4 + 1 / 12


@dataclass(frozen=True)
class Adjusted:
    """A shot, starting poses that are wrong by known amounts, and what the adjustment made of them."""

    made: Shot
    start: list[Pose]
    bundle: Bundle

    @property
    def centre_errors(self) -> np.ndarray:
        return torch.stack([p.centre for p in self.bundle.poses]).numpy() - self.made.centres.numpy()


def windows_of(images: torch.Tensor, poses: list[Pose], radius: float) -> list[Window]:
    behind = torch.full(images.shape[1:], LEVEL)
    return [cut_window(image, behind, pose.centre, radius, None) for image, pose in zip(images, poses, strict=True)]


def wrong_poses(made: Shot, centre_px: float, turn_rad: float) -> list[Pose]:
    generator = torch.Generator().manual_seed(5)
    poses = []
    for centre, orientation in zip(made.centres, made.orientations, strict=True):
        shift = centre_px * torch.randn(2, generator=generator, dtype=torch.float64)
        turn = rotation_matrix(turn_rad * torch.randn(3, generator=generator, dtype=torch.float64))
        poses.append(Pose(centre + shift, turn @ orientation))
    return poses


@pytest.fixture(scope="module")
def adjusted() -> Adjusted:
    made = shot(6, n=16, radius=RADIUS, rotation_deg=(1.0, 2.5, 0.7), start=(60.0, 100.0), subsamples=8)
    start = wrong_poses(made, 0.1, 0.005)
    found = bundle.adjust(windows_of(made.images, start, RADIUS + 0.1), start, RADIUS + 0.1, NOISE)
    return Adjusted(made, start, found)


def test_the_adjustment_settles(adjusted: Adjusted) -> None:
    assert adjusted.bundle.settled


def test_an_adjustment_goes_on_to_where_the_residuals_are_least_and_knows_that_it_is_there(adjusted: Adjusted) -> None:
    found = adjusted.bundle
    state = State.of(found.windows, found.poses, found.ball, found.profile)
    elimination = schur.eliminate(state.windows, state.poses, state.model, state.profile)
    moves = []
    for _ in range(15):
        state, move = gauss_newton.iterate(state, elimination, 0.0)
        moves.append(move)
    # What a step tries where nothing lowers the squares any more is rounding.
    assert moves[-1] < 1e-3
    assert np.isfinite(moves).all()


def test_positions_are_absolute_to_a_hundredth_of_a_px(adjusted: Adjusted) -> None:
    errors = adjusted.centre_errors
    # The outline over a uniform background: 0.005 px stated each, three of it for the worst of 32 numbers.
    assert np.abs(errors).max() < 0.016, errors
    assert np.abs(errors.mean(0)).max() < 0.006


def test_the_radius_is_found_to_its_stated_floor(adjusted: Adjusted) -> None:
    assert adjusted.bundle.ball.radius == pytest.approx(RADIUS, abs=2 * bundle.SYSTEMATIC_RADIUS_PX)
    assert 0 < adjusted.bundle.covariance[5 * 16, 5 * 16] ** 0.5 < 1.5 * bundle.SYSTEMATIC_RADIUS_PX


def test_stated_uncertainties_of_the_positions_are_those_seen(adjusted: Adjusted) -> None:
    errors = adjusted.centre_errors - adjusted.centre_errors.mean(0)
    n = len(errors)
    sd = np.sqrt(np.diag(adjusted.bundle.covariance)[: 5 * n].reshape(n, 5)[:, :2])
    # 32 numbers know their standard deviation to 13 %; three of that.
    assert 0.6 < errors.std() / sd.mean() < 1.4


def test_rotations_between_the_images_are_right(adjusted: Adjusted) -> None:
    found = torch.stack([p.orientation for p in adjusted.bundle.poses])
    truth = adjusted.made.orientations
    relative = (found @ found[0].T) @ (truth @ truth[0].T).mT
    turn = torch.rad2deg(torch.arccos(((relative.diagonal(dim1=1, dim2=2).sum(-1) - 1) / 2).clamp(-1, 1)))
    # 0.02 deg per axis and image at this radius and noise; the start was off by 0.5 deg.
    assert float(turn.max()) < 0.1


def test_a_flickering_shaded_ball_is_adjusted_as_well() -> None:
    """Light from the left, fixed in space, and images that differ by 15 % in brightness."""
    how = {"n": 14, "radius": RADIUS, "rotation_deg": (1.0, 3.0, 0.7), "start": (60.0, 100.0), "high": 150.0}
    made, lighter = (shot(7, background=level, noise=0.0, subsamples=8, **how) for level in (LEVEL, LEVEL + 100))
    columns = torch.arange(512.0)
    images = []
    for i, centre in enumerate(made.centres):
        # Two backgrounds tell how much of each pixel is background.
        behind = LEVEL / 100 * (lighter.images[i] - made.images[i])
        light = (1 - 0.3 * ((columns - centre[0]) / RADIUS).clamp(-1, 1)).expand(256, 512)
        images.append((1 + 0.15 * (-1) ** i) * (light * (made.images[i] - behind) + behind))
    flickering = noisy(torch.stack(images), 2.0, 8)
    start = wrong_poses(made, 0.05, 0.003)
    found = bundle.adjust(windows_of(flickering, start, RADIUS), start, RADIUS, NOISE)
    errors = torch.stack([p.centre for p in found.poses]).numpy() - made.centres.numpy()
    assert found.settled
    assert np.abs(errors).max() < 0.05
    gains = np.array([p.gain for p in found.poses])
    assert gains[::2].mean() / gains[1::2].mean() == pytest.approx(1.15 / 0.85, rel=0.02)
    # What of the light the shading holds and what the map is not told apart by a ball that turns by 45 deg; together
    # they leave the noise.
    assert float(found.profile.variance[0]) < 1.5 * NOISE


def test_what_hides_the_ball_loses_its_weight() -> None:
    made = shot(8, n=12, radius=RADIUS, start=(60.0, 100.0))
    images = made.images.clone()
    at = made.centres[5].round().long()
    images[5, at[1] - 8 : at[1] + 8, at[0] - 8 : at[0] + 2] = 250.0
    start = [Pose(c, a) for c, a in zip(made.centres, made.orientations, strict=True)]
    found = bundle.adjust(windows_of(images, start, RADIUS), start, RADIUS, NOISE)
    window = found.windows[5]
    column, row = window.pixels.unbind(-1)
    x0, y0 = at.tolist()
    hidden = (column >= x0 - 7) & (column < x0 + 1) & (row >= y0 - 7) & (row < y0 + 7)
    assert float(window.trust[hidden].max()) < 0.1
    around = (column >= x0 - 12) & (column < x0 + 6) & (row >= y0 - 12) & (row < y0 + 12)
    assert float(window.trust[~around].mean()) > 0.99
    error = found.poses[5].centre - made.centres[5]
    assert float(error.abs().max()) < 0.03


def test_forward_model_and_ray_caster_agree_to_the_noise(adjusted: Adjusted) -> None:
    variance = adjusted.bundle.profile.variance
    # Noise 2 and rounding make 4.08; a map fitted to 16 images leaves less of it, not more.
    assert 2.0 < float(variance[0]) < 4.4
    assert len(variance) == len(pixel_weights.RINGS_PX) + 1


@pytest.mark.parametrize("off_px", [0.05, 1.0])
def test_an_image_is_registered_in_its_own_precision_and_to_the_same_pose(adjusted: Adjusted, off_px: float) -> None:
    """From a start nearby derivatives are kept for the next step, from one a px away they are not."""
    found, made = adjusted.bundle, adjusted.made
    at, image = found.poses[7], made.images[7]
    start = replace(at, centre=at.centre + off_px * torch.tensor([0.8, -0.6], dtype=torch.float64), gain=1.1)
    single, double = (
        registration.register(windows_of(same[None], [start], RADIUS)[0], start, found.ball, found.profile)
        for same in (image, image.double())
    )
    assert single.converged
    assert double.converged
    # A twentieth of what the last step may be off by, a fiftieth of the standard deviation of 0.005 px.
    assert float((single.pose.centre - double.pose.centre).abs().max()) < 1e-4
    assert float((single.pose.orientation - double.pose.orientation).abs().max()) < 1e-4 / RADIUS
    assert torch.allclose(single.covariance, double.covariance, rtol=1e-3, atol=0)
    assert float((double.pose.centre - made.centres[7]).abs().max()) < 0.016
    assert double.pose.gain == pytest.approx(at.gain, rel=0.01)
