"""A lens that distorts, or pixels that are not square, of which nobody said anything.

`experiments.validation.lens` has barrels and pincushions of several strengths.
"""

import numpy as np
import pytest
import torch
from numpy.typing import NDArray
from scipy.ndimage import gaussian_filter
from shots import noisy, rotation_matrix
from tracks import made_map

import torchsphere as ts
from experiments.validation import seeds
from experiments.validation.attack_cases import CASES
from torchsphere.synthetic import demo_shot, ray_caster

Array = NDArray[np.float64]

FRAMES, RADIUS, SHAPE, TURN = 16, 24.0, (160, 220), np.radians([0.8, 1.2, 0.3])
MIDDLE = np.array([(SHAPE[1] - 1) / 2, (SHAPE[0] - 1) / 2])
GIVEN = {"fps": 1000.0, "diameter_mm": 30.0, "log": False}


def straight_path() -> Array:
    """Places (n, 2), px, on a line from corner to corner."""
    return np.array([36.0, 36.0]) + np.arange(FRAMES)[:, None] * (2 * MIDDLE - 72) / (FRAMES - 1)


def images_through(distortion: float) -> tuple[torch.Tensor, Array]:
    """Images of a lens that moves the corner by that share of its distance from the middle, and the places seen."""
    focal = 1000 * RADIUS
    coefficient = distortion * focal**2 / float(MIDDLE @ MIDDLE)
    rays = (straight_path() - MIDDLE) / focal
    seen = MIDDLE + focal * rays * (1 + coefficient * (rays**2).sum(1, keepdims=True))
    pattern, camera = ray_caster.speckle(4, radius_px=RADIUS), ts.Camera(focal, None, (coefficient, 0.0, 0.0))
    given = pattern, torch.from_numpy(seen).float(), RADIUS, turns(), 90.0
    return noisy(ray_caster.render(*given, shape=SHAPE, subsamples=4, camera=camera), 2.0, 3), seen


def images_on_wide_pixels(ratio: float) -> torch.Tensor:
    """Images whose pixels are wider than high by a ``ratio``: each is the mean of what lies in it."""
    finer, (height, width) = 6, SHAPE
    at = torch.from_numpy(finer * (straight_path() + 0.5) - 0.5).float()
    given = ray_caster.speckle(4, radius_px=RADIUS), at, finer * RADIUS, turns(), 90.0
    fine = ray_caster.render(*given, shape=(finer * height, finer * width), subsamples=1)
    rows = fine.reshape(FRAMES, height, finer, -1).mean(2).numpy()
    sums = np.concatenate((np.zeros((FRAMES, height, 1)), rows.cumsum(2)), 2)
    edges = finer * ratio * np.arange(int(width / ratio) + 1)
    low = np.floor(edges).astype(int).clip(max=finer * width - 1)
    levels = sums[..., low] + (edges - low) * (sums[..., low + 1] - sums[..., low])
    return noisy(torch.from_numpy(np.diff(levels, axis=2) / (finer * ratio)).float(), 2.0, 3)


def turns() -> torch.Tensor:
    """Orientations (n, 3, 3)."""
    return torch.stack([rotation_matrix(torch.from_numpy(i * TURN)) for i in range(FRAMES)]).float()


def test_the_distortion_is_found_and_lengths_are_without_it() -> None:
    distortion = -0.06
    images, seen = images_through(distortion)
    track = ts.track(images, (*seen[0].tolist(), RADIUS), **GIVEN)
    assert (track.status == "ok").all()
    found = made_map(track)
    assert found.lens_distortion == pytest.approx(distortion, abs=4 * found.sd_lens_distortion + 2e-4)
    assert found.pixel_ratio == pytest.approx(1, abs=0.002)
    # In px the ball is where it is seen.
    np.testing.assert_allclose(track.position, seen, atol=0.02)
    motion = ts.kinematics(track, log=False)
    true = np.diff(straight_path(), axis=0).mean(0) * 1000 * 0.03 / (2 * RADIUS)
    off = (np.nanmean(motion.velocity_m_s, 0) - true) / np.nanmedian(motion.sd_velocity_m_s, 0)
    assert np.abs(off).max() < 4
    spin = (np.nanmean(motion.spin_rad_s, 0) - 1000 * TURN) / np.nanmedian(motion.sd_spin_rad_s, 0)
    assert np.abs(spin).max() < 4
    assert any("the lens moves the image's corner" in sentence for sentence in track.warnings)
    assert not track.findings.grows


def test_without_a_distortion_no_lens_is_found() -> None:
    images, seen = images_through(0.0)
    track = ts.track(images, (*seen[0].tolist(), RADIUS), **GIVEN)
    assert not made_map(track).has_lens
    assert not any("As the images show the ball" in sentence for sentence in track.warnings)


def test_pixels_that_are_wide_are_found() -> None:
    ratio, first = 1.04, straight_path()[0]
    start = ((first[0] + 0.5) / ratio - 0.5, float(first[1]), RADIUS / np.sqrt(ratio))
    track = ts.track(images_on_wide_pixels(ratio), start, **GIVEN)
    assert made_map(track).pixel_ratio == pytest.approx(ratio, abs=0.001)
    motion = ts.kinematics(track, log=False)
    # Square pixels of the same area are larger than those that were drawn, and so is the ball in m.
    true = np.diff(straight_path(), axis=0).mean(0) * 1000 * 0.03 / (2 * RADIUS)
    np.testing.assert_allclose(np.nanmean(motion.velocity_m_s, 0), true, rtol=0.002)
    assert any("times as wide as high" in sentence for sentence in track.warnings)


def test_a_camera_at_eight_radii_is_found_and_is_no_smear() -> None:
    camera, places = ts.Camera(8 * RADIUS), torch.from_numpy(straight_path()).float()
    given = ray_caster.speckle(4, radius_px=RADIUS), places, RADIUS, turns(), 90.0
    images = noisy(ray_caster.render(*given, shape=SHAPE, subsamples=4, camera=camera), 2.0, 3)
    # The outline of a near ball is larger than the ball at its depth.
    track = ts.track(images, (*straight_path()[0].tolist(), RADIUS), refine=True, **GIVEN)
    assert (track.status == "ok").all()
    assert made_map(track).open_share == 0
    assert made_map(track).radius_over_distance == pytest.approx(1 / 8, abs=0.004)
    motion = ts.kinematics(track, log=False)
    true = np.diff(straight_path(), axis=0).mean(0) * 1000 * 0.03 / (2 * RADIUS)
    np.testing.assert_allclose(np.nanmean(motion.velocity_m_s, 0), true, rtol=0.001)


@pytest.mark.parametrize("distance", [10])
def test_the_outlines_of_a_near_ball_that_seem_to_grow_are_those_of_a_near_camera(distance: int) -> None:
    """They do so on the way out from the middle. A request hands on that no camera was given."""
    places = torch.from_numpy(straight_path()).float()
    background = (90 + 20 * torch.sin(0.2 * torch.arange(SHAPE[1]))).expand(SHAPE)
    given = ray_caster.speckle(4, radius_px=RADIUS), places, RADIUS, turns(), background
    images = noisy(ray_caster.render(*given, shape=SHAPE, subsamples=4, camera=ts.Camera(distance * RADIUS)), 2.0, 3)
    track = ts.track(images, camera=None, **GIVEN)
    assert (track.status == "ok").all()
    found = made_map(track)
    assert not track.findings.grows
    assert found.radius_over_distance == pytest.approx(1 / distance, abs=0.004)
    assert abs(found.radius_over_distance - 1 / distance) < 2 * found.sd_radius_over_distance
    # The circle that was found is that of the outline, which is larger than the ball at its depth.
    assert track.circle.radius == pytest.approx(RADIUS, rel=0.01)
    assert track.circle.sd_radius < 0.012 * RADIUS
    motion = ts.kinematics(track, log=False)
    true = np.diff(straight_path(), axis=0).mean(0) * 1000 * 0.03 / (2 * RADIUS)
    np.testing.assert_allclose(np.nanmean(motion.velocity_m_s, 0), true, rtol=0.001)
    spin = (np.nanmean(motion.spin_rad_s, 0) - 1000 * TURN) / np.nanmedian(motion.sd_spin_rad_s, 0)
    assert np.abs(spin).max() < 2


@pytest.mark.parametrize("stated", [1.0, 1.05, None])
def test_a_distance_that_was_stated_is_held_against_the_images(stated: float | None) -> None:
    """A camera at 20 radii, stated as it is, 5 % farther, or as a telecentric lens."""
    places = torch.from_numpy(straight_path()).float()
    given = ray_caster.speckle(4, radius_px=RADIUS), places, RADIUS, turns(), 90.0
    images = noisy(ray_caster.render(*given, shape=SHAPE, subsamples=4, camera=ts.Camera(20 * RADIUS)), 2.0, 3)
    camera = {"telecentric": True} if stated is None else {"camera": ts.Camera(stated * 20 * RADIUS)}
    track = ts.track(images, **camera, **GIVEN)
    assert (track.status == "ok").all()
    motion = ts.kinematics(track, log=False)
    spin = (np.nanmean(motion.spin_rad_s, 0) - 1000 * TURN) / np.nanmedian(motion.sd_spin_rad_s, 0)
    assert np.abs(spin).max() < 3
    is_doubted = any("The images show a camera that is nearer" in sentence for sentence in track.warnings)
    assert is_doubted == (stated != 1.0)
    if stated == 1.0:
        assert track.findings.sd_radius_over_distance < 1e-4


@pytest.mark.parametrize("seed", [0, 1])
def test_a_ball_before_blotches_is_found_with_a_camera_that_was_given(seed: int) -> None:
    """Edges of the background are as strong as the ball's: the fit in perspective finds none of one polarity."""
    blotches = gaussian_filter(np.random.default_rng(seed).normal(size=SHAPE), 3)
    background = torch.from_numpy(90 + 25 * blotches / blotches.std()).float()
    camera, places = ts.Camera(20 * RADIUS), torch.from_numpy(straight_path()[:8]).float()
    given = ray_caster.speckle(seed, radius_px=RADIUS), places, RADIUS, turns()[:8], background
    images = noisy(ray_caster.render(*given, shape=SHAPE, subsamples=4, camera=camera), 2.0, 3)
    track = ts.track(images, camera=camera, **GIVEN)
    assert (track.status == "ok").all()
    assert track.circle.radius == pytest.approx(RADIUS, abs=0.05)
    np.testing.assert_allclose(track.position, straight_path()[:8], atol=0.03)


def test_a_texture_at_the_outline_of_a_ball_that_hardly_turns_is_no_lens() -> None:
    # In 12 frames the ball turns by 3 deg: pixels 1.0007 wide and a camera behind the ball explained its texture.
    shot = demo_shot.make_shot()
    track = ts.track(shot.images[:12], (*shot.position[0].tolist(), demo_shot.RADIUS_PX), log=False)
    assert not made_map(track).has_lens
    assert made_map(track).radius_over_distance == 0


def test_a_lamp_from_one_side_is_no_lens() -> None:
    # The dark side of the outline is seen further in: 16 frames had a lens, and a camera behind the ball.
    made = CASES["lamp from one side"](seeds.SPENT["attack"][0])
    track = ts.track(made.images[:FRAMES], log=False)
    assert (track.status == "ok").all()
    assert not made_map(track).has_lens
    assert made_map(track).radius_over_distance == 0
