"""Registration of images on the map of an adjusted shot."""

from dataclasses import dataclass, replace

import pytest
import torch
from ball_models import one_share
from shots import Shot, shot

from torchsphere.sphere_map import bundle_adjustment, forward_model, registration
from torchsphere.sphere_map.ball import Poses
from torchsphere.sphere_map.registration import LAST_STEP_PX, Registration
from torchsphere.sphere_map.state import State
from torchsphere.sphere_map.window import Windows, cut_windows

RADIUS, LEVEL = 20.0, 90.0
NOISE = 4 + 1 / 12


@dataclass(frozen=True)
class Mapped:
    """A shot and the map of its images."""

    shot: Shot
    state: State

    def windows(self, images: torch.Tensor, poses: Poses) -> Windows:
        return cut_windows(images, torch.full(images.shape[1:], LEVEL).to(images), poses.centre, RADIUS)

    def register(self, images: torch.Tensor, start: Poses) -> Registration:
        return registration.register(self.windows(images, start), start, self.state.ball, self.state.profile)


@pytest.fixture(scope="module")
def mapped() -> Mapped:
    made = shot(6, n=14, radius=RADIUS, rotation_deg=(1.0, 2.5, 0.7), start=(60.0, 100.0), subsamples=8)
    initial = Poses.at(made.centres, made.orientations)
    windows = cut_windows(made.images, torch.full(made.images.shape[1:], LEVEL), initial.centre, RADIUS)
    return Mapped(made, bundle_adjustment.adjust(windows, initial, RADIUS, NOISE, 1.0, one_share).state)


def off(poses: Poses, amount_px: float) -> Poses:
    """Poses that are wrong by that amount along a slope, and brighter by a tenth."""
    step = amount_px * torch.tensor([0.8, -0.6, 0.3, 0.2, -0.4], dtype=torch.float64)
    return replace(poses.moved(step.expand(len(poses), -1), RADIUS), gain=1.1 * poses.gain)


@pytest.mark.parametrize("off_px", [0.05, 1.0])
def test_single_and_double_precision_register_images_to_the_same_poses(mapped: Mapped, off_px: float) -> None:
    """Loops and torch, from a small error and from an error of a px."""
    images, truth = mapped.shot.images[6:9], mapped.state.poses.take(slice(6, 9))
    start = off(truth, off_px)
    single, double = (mapped.register(levels, start) for levels in (images, images.double()))
    assert bool(single.converged.all())
    assert bool(double.converged.all())
    # A fiftieth of the standard deviation of 0.005 px.
    assert float((single.poses.centre - double.poses.centre).abs().max()) < 1e-4
    assert float((single.poses.orientation - double.poses.orientation).abs().max()) < 1e-4 / RADIUS
    # Covariances that are nearly 0 are compared by the standard deviations.
    sd = double.covariance.diagonal(dim1=1, dim2=2).sqrt()
    off_by = ((single.covariance - double.covariance) / (sd.unsqueeze(1) * sd.unsqueeze(2)))[:, :5, :5]
    assert float(off_by.abs().max()) < 1e-3
    assert float((double.poses.centre - mapped.shot.centres[6:9]).abs().max()) < 0.016
    torch.testing.assert_close(double.poses.gain, truth.gain, rtol=0.01, atol=0)


def test_a_batch_gives_the_poses_of_its_images_one_by_one(mapped: Mapped) -> None:
    images, truth = mapped.shot.images[3:8], mapped.state.poses.take(slice(3, 8))
    amounts = [0.02, 0.3, 1.0, 0.0, 0.6]
    start = Poses.joined([off(truth.take(slice(i, i + 1)), amount) for i, amount in enumerate(amounts)])
    batch = mapped.register(images, start)
    alone = Registration.joined([mapped.register(images[i : i + 1], start.take(slice(i, i + 1))) for i in range(5)])
    torch.testing.assert_close(batch.poses.centre, alone.poses.centre, atol=1e-6, rtol=0)
    torch.testing.assert_close(batch.poses.orientation, alone.poses.orientation, atol=1e-7, rtol=0)
    torch.testing.assert_close(batch.covariance, alone.covariance, rtol=1e-4, atol=1e-9)
    torch.testing.assert_close(batch.misfit, alone.misfit, rtol=1e-4, atol=0)


def test_the_result_does_not_depend_on_the_start(mapped: Mapped) -> None:
    images, truth = mapped.shot.images[4:6], mapped.state.poses.take(slice(4, 6))
    near, far = (mapped.register(images, off(truth, amount)) for amount in (0.05, 0.8))
    # What the last step leaves: about the square of its length.
    assert float((near.poses.centre - far.poses.centre).abs().max()) < LAST_STEP_PX**2


def test_images_that_the_map_was_made_of_fit_it_but_for_what_it_took_up_of_their_noise(mapped: Mapped) -> None:
    found = mapped.register(mapped.shot.images, mapped.state.poses)
    assert bool(found.converged.all())
    # The map of 14 images takes up a fifth of their noise.
    assert 0.7 < float(found.misfit.mean()) < 1.0
    windows, poses = mapped.windows(mapped.shot.images, mapped.state.poses), mapped.state.poses
    weights = mapped.state.profile.weights(windows, poses)
    model = forward_model.linearise(windows, poses, mapped.state.ball)
    own = registration.normal_equations(model, weights, weights, registration.COLUMNS)[0].inverse()[:, :5, :5]
    torch.testing.assert_close(found.covariance[:, :5, :5], own, rtol=0.1, atol=1e-8)


def test_an_object_in_front_of_the_ball_does_not_shift_its_pose(mapped: Mapped) -> None:
    images, truth = mapped.shot.images[7:9].clone(), mapped.state.poses.take(slice(7, 9))
    x, y = mapped.shot.centres[7].round().long().tolist()
    images[0, y - 8 : y + 8, x - 8 : x + 2] = 250.0
    found = mapped.register(images, off(truth, 0.1))
    assert bool(found.converged.all())
    # 0.005 px are stated for the whole ball.
    assert float((found.poses.centre - mapped.shot.centres[7:9]).abs().max()) < 0.03
    # What is hidden does not count: less is known of the pose, and the misfit is that of the rest.
    assert float(found.covariance[0, 0, 0]) > 1.1 * float(found.covariance[1, 0, 0])
    assert float(found.misfit[0]) < 2


def test_loops_and_torch_hide_the_same_pixels(mapped: Mapped) -> None:
    images, truth = mapped.shot.images[7:9].clone(), mapped.state.poses.take(slice(7, 9))
    x, y = mapped.shot.centres[7].round().long().tolist()
    images[0, y - 8 : y + 8, x - 8 : x + 2] = 250.0
    start = off(truth, 0.1)
    single, double = (mapped.register(levels, start) for levels in (images, images.double()))
    # 0.005 px are stated for the whole ball.
    assert float((single.poses.centre - double.poses.centre).abs().max()) < 1e-4
    # Covariances that are nearly 0 are compared by the standard deviations.
    sd = double.covariance.diagonal(dim1=1, dim2=2).sqrt()
    off_by = ((single.covariance - double.covariance) / (sd.unsqueeze(1) * sd.unsqueeze(2)))[:, :5, :5]
    assert float(off_by.abs().max()) < 1e-3
    torch.testing.assert_close(single.misfit.double(), double.misfit.double(), rtol=1e-3, atol=1e-3)


def test_an_image_of_something_else_does_not_fit(mapped: Mapped) -> None:
    """Another ball in the same place; the other images of the batch are not touched."""
    other = shot(16, n=14, radius=RADIUS, rotation_deg=(1.0, 2.5, 0.7), start=(60.0, 100.0)).images
    images, truth = mapped.shot.images[5:8].clone(), mapped.state.poses.take(slice(5, 8))
    images[1] = other[6]
    found, plain = mapped.register(images, truth), mapped.register(mapped.shot.images[5:8], truth)
    bad = ~found.converged | (found.misfit > 2)
    assert bad.tolist() == [False, True, False]
    kept = [0, 2]
    torch.testing.assert_close(found.poses.centre[kept], plain.poses.centre[kept], atol=1e-6, rtol=0)


def test_an_image_without_any_pixel_of_the_ball_does_not_converge(mapped: Mapped) -> None:
    images, truth = mapped.shot.images[5:7], mapped.state.poses.take(slice(5, 7))
    windows = mapped.windows(images, truth)
    visibility = windows.visibility.clone()
    visibility[0] = 0
    found = registration.register(windows.with_visibility(visibility), truth, mapped.state.ball, mapped.state.profile)
    assert found.converged.tolist() == [False, True]
    assert bool(torch.isfinite(found.poses.centre).all())
