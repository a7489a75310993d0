"""What is measured is what a player shows: pixels that are not square, images that are turned, colour mosaics, gaps.

Each shot has an imposed motion; the file states how its images are stored.
"""

import dataclasses
import functools
from fractions import Fraction
from pathlib import Path

import numpy as np
import pytest
import tifffile
import torch
from shots import Shot, noisy, rotation_matrix, speckle
from stored_images import as_stored, mosaic_of
from writers import write_cine, write_mov

import torchsphere as ts
from torchsphere.dynamics.kinematics import mean_motion
from torchsphere.synthetic import ray_caster

RADIUS, HEIGHT, WIDTH = 28.0, 100, 160


@functools.cache
def flight(
    seed: int = 0, aspect: Fraction = Fraction(1), n: int = 12, gap: float = 0.0, pattern: int | None = None
) -> Shot:
    """A ball that flies and turns steadily, stored in pixels of those sides; a pause before its second half.

    The truth is that of square pixels. A stored pixel is the mean over its area. ``pattern`` is another seed for the
    speckle.
    """
    generator = torch.Generator().manual_seed(seed + 100)
    times = torch.arange(n, dtype=torch.float64) + gap * (torch.arange(n) >= n // 2)
    first = torch.tensor([40.0, 42.0], dtype=torch.float64) + torch.rand(2, generator=generator, dtype=torch.float64)
    step = torch.tensor([2.7, 0.9], dtype=torch.float64)
    turn = torch.deg2rad(torch.tensor([0.6, 1.0, 0.5], dtype=torch.float64))
    centres, orientations = first + times[:, None] * step, torch.stack([rotation_matrix(turn * t) for t in times])
    # Fine pixels, of which whole numbers make a stored one.
    fine = aspect.denominator if aspect > 1 else aspect.numerator
    high, wide = (fine, aspect.numerator) if aspect > 1 else (aspect.denominator, fine)
    rows, columns = HEIGHT * fine // high, WIDTH * fine // wide
    images = torch.stack(
        [
            ray_caster.render(
                speckle(seed if pattern is None else pattern, RADIUS),
                ((centre[None] + 0.5) * fine - 0.5).float(),
                RADIUS * fine,
                turned[None].float(),
                90.0,
                shape=(rows * high, columns * wide),
                subsamples=3 if fine == 1 else 1,
            )[0]
            .reshape(rows, high, columns, wide)
            .mean((1, 3))
            for centre, turned in zip(centres, orientations, strict=True)
        ]
    )
    increments = torch.cat((centres.diff(dim=0), times.diff()[:, None] * turn), 1)
    return Shot(noisy(images, 2.0, seed + 200), centres, orientations, increments, RADIUS)


def measured(made: Shot, recording: object, **options: object) -> ts.Track:
    """The track by pairs from the true circle."""
    return ts.track(recording, circle=made.circle, sphere_map=False, log=False, **options)


def errors_over_sd(track: ts.Track, made: Shot) -> np.ndarray:
    """Errors (n - 1, 5) of the steps over their standard deviations."""
    sd = np.sqrt(np.diagonal(track.covariance, axis1=1, axis2=2))
    found: np.ndarray = (track.increment - made.increments.numpy()) / sd
    return found


@pytest.mark.parametrize("aspect", [Fraction(6, 5), Fraction(4, 5), Fraction(5, 4)], ids=str)
def test_pixels_that_are_not_square_give_the_true_motion(aspect: Fraction) -> None:
    ratios = []
    for seed in range(2):
        made = flight(seed, aspect)
        track = measured(made, made.images, pixel_aspect=float(aspect))
        assert (track.status == "ok").all()
        ratios.append(errors_over_sd(track, made))
        # 1 % of the way: with the pixels taken for square the ratio itself was off.
        moved = track.position[-1] - track.position[0]
        np.testing.assert_allclose(moved, (made.centres[-1] - made.centres[0]).numpy(), rtol=0.01)
    # 22 steps of 5 components: their scatter is known to 7 %, and that of one component to 15 %.
    assert 0.75 < np.sqrt(np.mean(np.square(ratios))) < 1.25


def test_the_velocity_of_a_video_with_long_pixels_is_the_true_one(tmp_path: Path) -> None:
    pytest.importorskip("av", reason="PyAV is not installed")
    aspect = Fraction(11, 10)
    made = flight(3, aspect, n=8)
    path = write_mov(tmp_path / "a.mov", made.images.numpy(), aspect=aspect)
    with ts.open_recording(path) as recording:
        track = measured(made, recording, fps=1000.0, mm_per_px=0.5)
    motion = mean_motion(track, ts.kinematics(track, log=False))
    true = 0.5 * made.increments[:, :2].mean(0).numpy()
    assert np.abs(motion["velocity_m_s"] - true).max() < 4 * motion["sd_velocity_m_s"].max()
    np.testing.assert_allclose(motion["velocity_m_s"], true, rtol=0.005)


def test_a_mirror_image_turns_the_other_way_round(tmp_path: Path) -> None:
    # A wheel that turns clockwise, seen in a mirror, turns counterclockwise.
    made = flight(1)
    mirrored = np.stack([as_stored(image, 4) for image in made.images.numpy().astype(np.uint8)])
    tag = [(274, "H", 1, 4, False)]
    tifffile.imwrite(tmp_path / "a.tif", mirrored, photometric="minisblack", metadata=None, extratags=tag)
    with ts.open_recording(tmp_path / "a.tif") as recording:
        shown = measured(made, recording)
    in_mirror = dataclasses.replace(
        made, centres=made.centres * torch.tensor([1.0, -1.0]) + torch.tensor([0.0, HEIGHT - 1])
    )
    as_it_is = measured(in_mirror, mirrored)
    wz = np.degrees([np.median(track.increment[:, 4]) for track in (shown, as_it_is)])
    np.testing.assert_allclose(wz, [0.5, -0.5], atol=0.02)
    dy = [np.median(track.increment[:, 1]) for track in (shown, as_it_is)]
    np.testing.assert_allclose(dy, [0.9, -0.9], atol=0.02)


def test_a_portrait_video_with_long_pixels_is_measured_upright(tmp_path: Path) -> None:
    pytest.importorskip("av", reason="PyAV is not installed")
    aspect = Fraction(5, 4)
    made = flight(2, 1 / aspect)
    # The camera lay on its side: its pixels are wider than high in the file, and higher than wide for a player.
    stored = np.stack([as_stored(image, 6) for image in made.images.numpy().astype(np.uint8)])
    path = write_mov(tmp_path / "a.mov", stored, matrix=(0, 1, -1, 0), aspect=aspect)
    with ts.open_recording(path) as recording:
        assert recording.shape[1:] == (HEIGHT, WIDTH)
        track = measured(made, recording)
    assert (track.status == "ok").all()
    np.testing.assert_allclose(track.increment.mean(0)[:2], [2.7, 0.9], atol=0.01)
    np.testing.assert_allclose(np.degrees(track.increment.mean(0)[2:]), [0.6, 1.0, 0.5], atol=0.02)


@functools.cache
def by_colour_sensor(seed: int, pattern: str) -> torch.Tensor:
    """Images of a grey ball by a colour sensor under a lamp."""
    red, green, blue = (factor * flight(seed).images.numpy() for factor in (0.55, 1.0, 0.7))
    return torch.from_numpy(mosaic_of(red, green, blue, pattern)).round()


@pytest.mark.parametrize("pattern", ["RGGB", "GBRG"])
@pytest.mark.parametrize("is_given", [True, False])
def test_a_raw_mosaic_is_measured_right_and_is_not_interlaced(pattern: str, is_given: bool) -> None:
    ratios = []
    for seed in range(2):
        made, images = flight(seed), by_colour_sensor(seed, pattern)
        track = measured(made, images, **({"bayer": pattern} if is_given else {}))
        assert not track.findings.interlaced
        assert (track.status == "ok").all()
        named = [text for text in track.warnings if "`bayer`" in text]
        assert bool(named) != is_given
        assert is_given or pattern in named[0]
        ratios.append(errors_over_sd(track, made))
    assert 0.75 < np.sqrt(np.mean(np.square(ratios))) < 1.25


@pytest.mark.parametrize("pattern", ["BGGR", "GRBG"])
def test_a_ball_of_many_colours_is_measured_right_in_a_mosaic(pattern: str) -> None:
    ratios = []
    for seed in range(2):
        made = flight(seed)
        colours = (
            0.8 * flight(seed, pattern=seed + 50).images,
            made.images,
            0.9 * flight(seed, pattern=seed + 70).images,
        )
        images = mosaic_of(*(colour.numpy() for colour in colours), pattern).round()
        track = measured(made, images, bayer=pattern)
        assert (track.status == "ok").all()
        # Taken for grey, the steps of such a ball err by 0.1 px.
        assert np.sqrt(np.square(track.increment - made.increments.numpy())[:, :2].mean()) < 0.03
        ratios.append(errors_over_sd(track, made))
    assert 0.75 < np.sqrt(np.mean(np.square(ratios))) < 1.25


def test_a_mosaic_on_the_wrong_diagonal_is_said() -> None:
    made, images = flight(0), by_colour_sensor(0, "RGGB")
    track = measured(made, images, bayer="GRBG")
    sentence = next(text for text in track.warnings if "wrong diagonal" in text)
    assert "RGGB or BGGR" in sentence


@pytest.mark.parametrize("gap", [3.0, 1.3])
@pytest.mark.parametrize("method", ["smoother", "savitzky-golay", "differences"])
def test_a_step_across_a_gap_is_no_velocity_of_one_interval(tmp_path: Path, gap: float, method: str) -> None:
    made = flight(4, n=14, gap=gap)
    times = (np.arange(14) + gap * (np.arange(14) >= 7)) / 1500
    path = write_cine(tmp_path / "a.cine", made.images.numpy().astype(int), bits=8, rate=1000, times_s=times)
    with ts.open_recording(path) as recording:
        track = measured(made, recording, mm_per_px=0.5)
    assert (track.status == "ok").all()
    motion = ts.kinematics(track, method=method, log=False)
    np.testing.assert_allclose(motion.time_s, times, atol=1e-8)
    velocity = np.array([2.7, 0.9]) * 1500 * 0.5e-3
    known = np.isfinite(motion.velocity_m_s[:, 0])
    np.testing.assert_allclose(motion.velocity_m_s[known], velocity[None].repeat(known.sum(), 0), atol=0.02)
    np.testing.assert_allclose(mean_motion(track, motion)["velocity_m_s"], velocity, atol=0.005)
    # A known pause is no sign of lost images.
    assert not [text for text in track.warnings if "Images seem to be missing" in text]
