"""Bundle adjustment against exact truth, with its Gauss-Newton steps and the registration on its map.

One adjusted shot serves all three, since an adjustment takes seconds.
"""

from dataclasses import dataclass, replace

import numpy as np
import pytest
import torch
from shots import Shot, noisy, rotation_matrix, shot

from torchsphere.sphere_map import bundle_adjustment, map_fit, pixel_weights, registration
from torchsphere.sphere_map.bundle_adjustment import Adjustment
from torchsphere.sphere_map.forward_model import Pose
from torchsphere.sphere_map.window import Window, cut_window

RADIUS, LEVEL = 20.0, 90.0

#: Variance of noise 2 and of rounding.
NOISE = 4 + 1 / 12


@dataclass(frozen=True)
class AdjustedShot:
    """A shot, initial poses with known errors, and the adjustment from there."""

    shot: Shot
    initial: list[Pose]
    adjustment: Adjustment

    @property
    def poses(self) -> list[Pose]:
        return self.adjustment.state.poses

    @property
    def centre_errors(self) -> np.ndarray:
        return torch.stack([p.centre for p in self.poses]).numpy() - self.shot.centres.numpy()


def windows_of(images: torch.Tensor, poses: list[Pose], radius: float) -> list[Window]:
    background = torch.full(images.shape[1:], LEVEL)
    return [cut_window(image, background, pose.centre, radius, None) for image, pose in zip(images, poses, strict=True)]


def wrong_poses(made: Shot, centre_px: float, turn_rad: float) -> list[Pose]:
    generator = torch.Generator().manual_seed(5)
    poses = []
    for centre, orientation in zip(made.centres, made.orientations, strict=True):
        shift = centre_px * torch.randn(2, generator=generator, dtype=torch.float64)
        rotation = rotation_matrix(turn_rad * torch.randn(3, generator=generator, dtype=torch.float64))
        poses.append(Pose(centre + shift, rotation @ orientation))
    return poses


@pytest.fixture(scope="module")
def adjusted() -> AdjustedShot:
    made = shot(6, n=16, radius=RADIUS, rotation_deg=(1.0, 2.5, 0.7), start=(60.0, 100.0), subsamples=8)
    initial = wrong_poses(made, 0.1, 0.005)
    windows = windows_of(made.images, initial, RADIUS + 0.1)
    return AdjustedShot(made, initial, bundle_adjustment.adjust(windows, initial, RADIUS + 0.1, NOISE))


def test_the_adjustment_settles(adjusted: AdjustedShot) -> None:
    assert adjusted.adjustment.settled


def test_further_steps_reach_the_minimum_of_the_squares_and_then_stop(adjusted: AdjustedShot) -> None:
    state = adjusted.adjustment.state
    linearised = state.linearise(state.project())
    elimination = map_fit.eliminate(linearised)
    moves = []
    for _ in range(15):
        linearised, move = bundle_adjustment.iterate(linearised, elimination, 0.0)
        moves.append(move)
    # At the minimum a step is rounding.
    assert moves[-1] < 1e-3
    assert np.isfinite(moves).all()


def test_positions_are_absolute_to_a_hundredth_of_a_px(adjusted: AdjustedShot) -> None:
    errors = adjusted.centre_errors
    # Over a uniform background 0.005 px are stated for each; the worst of 32 numbers may be three times that.
    assert np.abs(errors).max() < 0.016, errors
    assert np.abs(errors.mean(0)).max() < 0.006


def test_the_radius_is_found_to_its_systematic_error(adjusted: AdjustedShot) -> None:
    error = bundle_adjustment.RADIUS_ERROR_PX
    assert adjusted.adjustment.state.ball.radius == pytest.approx(RADIUS, abs=2 * error)
    assert 0 < adjusted.adjustment.covariance[5 * 16, 5 * 16] ** 0.5 < 1.5 * error


def test_stated_and_actual_uncertainties_of_the_positions_agree(adjusted: AdjustedShot) -> None:
    errors = adjusted.centre_errors - adjusted.centre_errors.mean(0)
    n = len(errors)
    sd = np.sqrt(np.diag(adjusted.adjustment.covariance)[: 5 * n].reshape(n, 5)[:, :2])
    # 32 numbers give their standard deviation to 13 %; the tolerance is three of that.
    assert 0.6 < errors.std() / sd.mean() < 1.4


def test_rotations_between_the_images_are_right(adjusted: AdjustedShot) -> None:
    found = torch.stack([p.orientation for p in adjusted.poses])
    truth = adjusted.shot.orientations
    relative = (found @ found[0].T) @ (truth @ truth[0].T).mT
    angle = torch.rad2deg(torch.arccos(((relative.diagonal(dim1=1, dim2=2).sum(-1) - 1) / 2).clamp(-1, 1)))
    # 0.02 deg per axis and image at this radius and noise; the initial errors were 0.5 deg.
    assert float(angle.max()) < 0.1


def test_a_flickering_shaded_ball_is_adjusted() -> None:
    """Light from the left, fixed in space, and images that differ by 15 % in brightness."""
    options = {"n": 14, "radius": RADIUS, "rotation_deg": (1.0, 3.0, 0.7), "start": (60.0, 100.0), "high": 150.0}
    made, lighter = (shot(7, background=level, noise=0.0, subsamples=8, **options) for level in (LEVEL, LEVEL + 100))
    columns = torch.arange(512.0)
    images = []
    for i, centre in enumerate(made.centres):
        # The difference of two backgrounds gives the background's share of each pixel.
        background = LEVEL / 100 * (lighter.images[i] - made.images[i])
        light = (1 - 0.3 * ((columns - centre[0]) / RADIUS).clamp(-1, 1)).expand(256, 512)
        images.append((1 + 0.15 * (-1) ** i) * (light * (made.images[i] - background) + background))
    flickering = noisy(torch.stack(images), 2.0, 8)
    initial = wrong_poses(made, 0.05, 0.003)
    found = bundle_adjustment.adjust(windows_of(flickering, initial, RADIUS), initial, RADIUS, NOISE)
    errors = torch.stack([p.centre for p in found.state.poses]).numpy() - made.centres.numpy()
    assert found.settled
    assert np.abs(errors).max() < 0.05
    gains = np.array([p.gain for p in found.state.poses])
    assert gains[::2].mean() / gains[1::2].mean() == pytest.approx(1.15 / 0.85, rel=0.02)
    # A ball that turns by 45 deg does not separate shading and map; together they leave the noise.
    assert float(found.state.profile.variance[0]) < 1.5 * NOISE


def test_pixels_that_show_an_object_in_front_of_the_ball_lose_their_visibility() -> None:
    made = shot(8, n=12, radius=RADIUS, start=(60.0, 100.0))
    images = made.images.clone()
    at = made.centres[5].round().long()
    images[5, at[1] - 8 : at[1] + 8, at[0] - 8 : at[0] + 2] = 250.0
    initial = [Pose(c, a) for c, a in zip(made.centres, made.orientations, strict=True)]
    found = bundle_adjustment.adjust(windows_of(images, initial, RADIUS), initial, RADIUS, NOISE).state
    window = found.windows[5]
    column, row = window.pixels.unbind(-1)
    x0, y0 = at.tolist()
    hidden = (column >= x0 - 7) & (column < x0 + 1) & (row >= y0 - 7) & (row < y0 + 7)
    assert float(window.visibility[hidden].max()) < 0.1
    around = (column >= x0 - 12) & (column < x0 + 6) & (row >= y0 - 12) & (row < y0 + 12)
    assert float(window.visibility[~around].mean()) > 0.99
    error = found.poses[5].centre - made.centres[5]
    assert float(error.abs().max()) < 0.03


def test_forward_model_and_ray_caster_agree_to_the_noise(adjusted: AdjustedShot) -> None:
    variance = adjusted.adjustment.state.profile.variance
    # Noise 2 and rounding have a variance of 4.08; a map fitted to 16 images leaves less than that.
    assert 2.0 < float(variance[0]) < 4.4
    assert len(variance) == len(pixel_weights.RING_LIMITS_PX) + 1


@pytest.mark.parametrize("off_px", [0.05, 1.0])
def test_single_and_double_precision_register_an_image_to_the_same_pose(adjusted: AdjustedShot, off_px: float) -> None:
    """From a small error the Jacobian serves several steps, from an error of a px it does not."""
    state, made = adjusted.adjustment.state, adjusted.shot
    pose, image = state.poses[7], made.images[7]
    shift = off_px * torch.tensor([0.8, -0.6], dtype=torch.float64)
    initial = replace(pose, centre=pose.centre + shift, gain=1.1)
    single, double = (
        registration.register(windows_of(levels[None], [initial], RADIUS)[0], initial, state.ball, state.profile)
        for levels in (image, image.double())
    )
    assert single.converged
    assert double.converged
    # A twentieth of the tolerance of the last step, a fiftieth of the standard deviation of 0.005 px.
    assert float((single.pose.centre - double.pose.centre).abs().max()) < 1e-4
    assert float((single.pose.orientation - double.pose.orientation).abs().max()) < 1e-4 / RADIUS
    assert torch.allclose(single.covariance, double.covariance, rtol=1e-3, atol=0)
    assert float((double.pose.centre - made.centres[7]).abs().max()) < 0.016
    assert double.pose.gain == pytest.approx(pose.gain, rel=0.01)
