"""A ball that moves by several px while the shutter is open: the share of that time, and the motion."""

import functools
from pathlib import Path

import numpy as np
import pytest
import torch
from shots import noisy, rotation_matrix, speckle
from tracks import made_map

import torchsphere as ts
from torchsphere.geometry.circle import Circle
from torchsphere.imaging import interpolation
from torchsphere.recording.frame_source import Source
from torchsphere.settings.calibration import exposure_share
from torchsphere.synthetic import ray_caster
from torchsphere.tracking.blur_estimate import estimate_blur

RADIUS, FRAMES, SHARE, INSTANTS = 30.0, 14, 0.6, 15

#: Motion per frame, px and rad.
STEP = torch.tensor([7.0, 1.5], dtype=torch.float64)
TURN = torch.tensor([0.02, -0.05, 0.06], dtype=torch.float64)


@functools.lru_cache(maxsize=2)
def footage(share: float) -> tuple[torch.Tensor, torch.Tensor]:
    """Images (n, h, w) with the shutter open for that share of the time, and the true centres (n, 2)."""
    # The middles of equal parts of the exposure.
    within = share * ((torch.arange(INSTANTS, dtype=torch.float64) + 0.5) / INSTANTS - 0.5)
    times = (torch.arange(FRAMES, dtype=torch.float64)[:, None] + within).flatten()
    centres = torch.tensor([50.0, 46.0], dtype=torch.float64) + times[:, None] * STEP
    turned = torch.stack([rotation_matrix(float(t) * TURN) for t in times])
    pattern = speckle(3, RADIUS)
    seen = [
        ray_caster.render(pattern, centres[k::INSTANTS], RADIUS, turned[k::INSTANTS], 30.0, shape=(112, 210))
        for k in range(INSTANTS)
    ]
    middle = torch.arange(FRAMES, dtype=torch.float64)[:, None] * STEP + torch.tensor([50.0, 46.0])
    return noisy(torch.stack(seen).mean(0), 2.0, 4), middle


def found_share(share: float, stated: float | None = None) -> float:
    images, centres = footage(share)
    circle = Circle(*centres[0].tolist(), RADIUS, 0.0, 0.0, 0.0, 0)
    source = Source.open(images, None, torch.float32)
    return estimate_blur(source, centres.numpy(), circle, stated=stated).open_share


def errors(track: ts.Track) -> np.ndarray:
    """Root mean square error of the steps: px, and degrees."""
    truth = torch.cat((STEP, TURN)).numpy()
    off = track.increment - truth
    return np.array([np.sqrt((off[:, :2] ** 2).mean()), np.degrees(np.sqrt((off[:, 2:] ** 2).mean()))])


def test_the_share_follows_from_the_smear_of_the_outline() -> None:
    assert found_share(SHARE) == pytest.approx(SHARE, abs=0.12)


def test_a_sharp_ball_that_moves_fast_has_no_exposure() -> None:
    assert found_share(0.0) == 0


def test_a_ball_that_nearly_fills_the_image_tells_its_exposure() -> None:
    images, centres = footage(SHARE)
    first, last = 3, 7
    top = int(centres[first, 1]) - round(RADIUS) - 8
    stop = int(centres[last - 1, 1]) + round(RADIUS) + 9
    source = Source.open(images[first:last, top:stop], None, torch.float32)
    seen = centres[first:last].numpy() - [0, top]
    circle = Circle(*seen[0].tolist(), RADIUS, 0.0, 0.0, 0.0, 0)
    assert estimate_blur(source, seen, circle).open_share == pytest.approx(SHARE, abs=0.12)


def test_the_share_that_a_file_states_counts_unless_the_outlines_contradict_it() -> None:
    assert found_share(SHARE, 0.65) == 0.65
    # Sharp images, as under flashes.
    assert found_share(0.0, 0.9) == 0
    # A smear too short to be seen.
    assert found_share(0.0, 0.2) == 0.2


def test_a_slow_ball_tells_nothing_of_the_exposure() -> None:
    images, centres = footage(SHARE)
    circle = Circle(*centres[0].tolist(), RADIUS, 0.0, 0.0, 0.0, 0)
    source = Source.open(images, None, torch.float32)
    assert estimate_blur(source, 0.1 * centres.numpy() + 40, circle).open_share == 0


def test_the_map_of_smeared_images_is_better_than_pairs_and_states_its_errors() -> None:
    images, centres = footage(SHARE)
    circle = (*centres[0].tolist(), RADIUS)
    by_map = ts.track(images, circle, telecentric=True)
    pairs = ts.track(images, circle, sphere_map=False)
    # By the outlines it is up to 0.12 off, and the radius 0.05 px too large.
    assert made_map(by_map).open_share == pytest.approx(SHARE, abs=0.02)
    assert by_map.circle.radius == pytest.approx(RADIUS, abs=0.03)
    assert (errors(by_map) < errors(pairs)).all()
    stated = np.sqrt(np.einsum("nii->ni", by_map.covariance).mean(0))
    true = np.sqrt(((by_map.increment - torch.cat((STEP, TURN)).numpy()) ** 2).mean(0))
    assert (true < 2 * stated).all()


def test_an_exposure_that_is_given_counts_and_one_out_of_range_is_refused() -> None:
    images, centres = footage(SHARE)
    circle = (*centres[0].tolist(), RADIUS)
    given = ts.track(images[:6], circle, telecentric=True, exposure=0.58)
    # The images alone give another value.
    assert made_map(given).open_share == 0.58
    with pytest.raises(ValueError, match=r"exposure = 1.5: expected a number from 0 to 1"):
        ts.track(images, circle, exposure=1.5)


def test_the_time_that_is_given_becomes_a_share() -> None:
    assert exposure_share(20, 1e4) == pytest.approx(0.2)
    # The whole interval, but for the rounding of its time in us.
    assert exposure_share(27.777778, 36_000) == 1.0


@pytest.mark.parametrize(
    ("shutter_us", "rate", "sentence"),
    [
        (20, None, "shutter_us was given, but no frame rate is known .*; give fps, too"),
        (200, 1e4, "shutter_us = 200: longer than the 100 us from frame to frame"),
    ],
)
def test_an_exposure_without_a_frame_rate_or_longer_than_a_frame_is_refused(
    shutter_us: float, rate: float | None, sentence: str
) -> None:
    with pytest.raises(ValueError, match=sentence):
        exposure_share(shutter_us, rate)
    with pytest.raises(ValueError, match=sentence):
        ts.track(np.zeros((3, 64, 64)), frame_rate=rate, shutter_us=shutter_us)


def test_the_map_of_a_defocused_ball_starts_from_its_blur_and_finds_the_radius() -> None:
    images, centres = footage(0.0)
    blurred = noisy(interpolation.blur(images, 3.0), 2.0, 5)
    circle = Circle(*centres[0].tolist(), RADIUS, 0.0, 0.0, 0.0, 0)
    found = estimate_blur(Source.open(blurred, None, torch.float32), centres.numpy(), circle)
    assert found.optics_px == pytest.approx(3.0, abs=0.4)
    by_map = ts.track(blurred, telecentric=True)
    assert by_map.findings.is_on_map
    # By the outline of single images it is 0.3 to 0.8 px off; with a footprint of the wrong shape 0.2 px.
    assert by_map.circle.radius == pytest.approx(RADIUS, abs=0.1)
    assert abs(by_map.circle.radius - RADIUS) < 3 * by_map.circle.sd_radius < 0.6


def test_under_a_flash_the_radius_does_not_hang_on_the_exposure_that_is_stated(tmp_path: Path) -> None:
    step, turn = torch.tensor([2.2, 0.9]), torch.tensor([-0.009, 0.012, 0.016])
    times = torch.arange(12.0, dtype=torch.float64)
    centres = torch.tensor([50.0, 46.0]) + times[:, None] * step
    turned = torch.stack([rotation_matrix(float(t) * turn.double()) for t in times])
    sharp = noisy(ray_caster.render(speckle(7, RADIUS), centres, RADIUS, turned, 60.0, shape=(112, 140)), 2.0, 5)
    # The stated smear of 1.9 px is too short for the outlines to show or to contradict it.
    np.savez(tmp_path / "shot.npz", images=sharp.numpy(), frame_rate=10_000.0, exposure_s=0.8e-4)
    with ts.open_recording(tmp_path / "shot.npz") as recording:
        measured = ts.track(recording, circle=(50, 46, RADIUS), telecentric=True, log=False)
    assert made_map(measured).open_share < 0.3
    assert abs(measured.circle.radius - RADIUS) < 3 * measured.circle.sd_radius
