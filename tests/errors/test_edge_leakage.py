"""Background light that leaks over a small ball's outline: measured in an image, kept out of the region, or stated."""

from pathlib import Path

import numpy as np
import pytest
import torch
from shots import Shot, noisy, pair, shot

import torchsphere as ts
from torchsphere import track
from torchsphere.correlation.options import Options
from torchsphere.diagnostics.track_warnings import track_warnings
from torchsphere.errors import edge_leakage, steady_error
from torchsphere.recording import Recording, open_recording
from torchsphere.request import Request

RADIUS, TURN_DEG = 25.0, (0.0, 0.5, 0.0)


@pytest.fixture(scope="module")
def bright() -> Shot:
    """A bright ball of little contrast over a dark background."""
    return shot(
        50, n=25, radius=RADIUS, rotation_deg=TURN_DEG, start=(60.0, 120.0), background=40.0, low=120.0, noise=1.0
    )


def turn_errors(measured: ts.Track, made: Shot) -> np.ndarray:
    """Mean errors (2,) of the step in x and of the turn about y, as shares of the motion of the front."""
    off = np.nanmean(measured.increment - made.increments.numpy(), axis=0)
    front = RADIUS * np.radians(TURN_DEG[1])
    return np.array([off[0], RADIUS * off[3]]) / front


def test_the_rotation_of_a_bright_ball_over_a_dark_background_is_not_overestimated(bright: Shot) -> None:
    measured = track(bright.images, bright.circle)
    assert measured.settings["roi"] == 0.9
    # If the region holds light of the background, the errors are 0.05 and 0.07.
    assert np.all(np.abs(turn_errors(measured, bright)) < 0.02)


def test_a_given_region_is_kept_and_its_leakage_is_stated(bright: Shot) -> None:
    measured = track(bright.images, bright.circle, roi=0.95, sphere_map=False)
    assert measured.settings["roi"] == 0.95
    along, turned = turn_errors(measured, bright)
    front = RADIUS * np.radians(TURN_DEG[1])
    assert 0.02 < along < 3 * measured.sd_steady[0] / front
    assert 0.02 < turned < 3 * measured.sd_steady[3] * RADIUS / front


@pytest.mark.parametrize(("roi", "warned"), [(0.95, True), (None, False)])
def test_a_warning_about_leakage_names_a_better_region(
    bright: Shot, tmp_path: Path, roi: float | None, warned: bool
) -> None:
    path = tmp_path / "bright.npy"
    np.save(path, bright.images.numpy().astype(np.uint8))
    recording: Recording = open_recording(path)
    measured = track(recording, bright.circle, sphere_map=False, **({} if roi is None else {"roi": roi}))
    found = [
        s
        for s in track_warnings(Request(input=path, out="out", roi=roi), recording, measured, 1e3)
        if "outline of so" in s
    ]
    assert len(found) == warned
    assert all("leave `roi` out, or give 0.9." in sentence for sentence in found)


def test_a_large_ball_or_a_ball_like_its_background_keeps_the_region() -> None:
    assert edge_leakage.adapt_options(Options(), (), 50.0, 6.0).roi == 0.95
    assert edge_leakage.adapt_options(Options(), (), 25.0, 1.0).roi == 0.95
    small = edge_leakage.adapt_options(Options(), (), 25.0, 4.0)
    assert (small.roi, small.pre_blur) == (0.9, 1.0)
    assert edge_leakage.adapt_options(Options(roi=0.95), ("roi",), 25.0, 4.0).roi == 0.95
    assert edge_leakage.adapt_options(Options(pre_blur=0.8), ("pre_blur",), 25.0, 4.0).pre_blur == 0.8


def test_the_background_contrast_is_the_difference_of_grey_levels_over_the_contrast_of_the_texture() -> None:
    x, y = torch.meshgrid(torch.arange(80.0), torch.arange(80.0), indexing="xy")
    inside = torch.hypot(x - 40, y - 40) < 20
    ball = torch.where((x + y) % 2 == 0, 180.0, 140.0)
    image = torch.where(inside, ball, 60.0)
    assert edge_leakage.background_contrast(image, ts.Circle(40.0, 40.0, 20.0)) == pytest.approx(5.0, rel=0.01)
    assert edge_leakage.background_contrast(
        noisy(image[None], 1.0, 1)[0], ts.Circle(40.0, 40.0, 20.0)
    ) == pytest.approx(5.0, rel=0.02)
    hidden = ~inside
    assert edge_leakage.background_contrast(image, ts.Circle(40.0, 40.0, 20.0), hidden) == 0.0


def test_leakage_errs_along_the_motion_of_the_front_and_less_across_and_about_z() -> None:
    steps = np.tile([1.0, 1.0, 0.0, 0.01, 0.0], (9, 1))
    leaked, clear = (steady_error.sd_steady(steps, 20.0, 0.0, on_map=False, leakage=share) for share in (0.05, 0.0))
    x, y, wx, wy, wz = np.sqrt(leaked**2 - clear**2)
    assert x == pytest.approx(0.05 * 0.2, rel=1e-6)
    np.testing.assert_allclose([y, wx, wy, wz], [0.3 * x, 1.2 * 0.3 * x / 20, 1.2 * x / 20, 0.08 * x / 20], rtol=1e-6)
    on_map = (steady_error.sd_steady(steps, 20.0, 0.0, on_map=True, leakage=share) for share in (0.05, 0.0))
    np.testing.assert_array_equal(*on_map)


def test_leakage_errs_across_the_motion_of_the_front_and_about_z_by_about_the_stated_shares() -> None:
    step, turn_deg, radius = (1.4, 0.2), 3.0, 25.0
    true = np.array([*step, 0.0, np.radians(turn_deg), 0.0])

    def error(seed: int, background: float) -> np.ndarray:
        f, g, circle = pair((*step, 0.0, turn_deg, 0.0), seed=seed, radius=radius, background=background)
        return ts.correlate(f, g, circle, start=true, roi=0.95).q[0].numpy() - true

    # The same pattern before a background as bright as the ball is free of leakage.
    errors = np.array([error(seed, 235.0) - error(seed, 125.0) for seed in range(6)])
    x, y, _, _, wz = np.sqrt((errors**2).mean(0))
    assert 0.5 < y / x / steady_error.LEAKAGE_ACROSS < 2
    assert 0.5 < wz * radius / x / steady_error.LEAKAGE_ABOUT_Z < 2
