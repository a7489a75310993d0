"""Disturbances of real recordings: occluders, reflections, changing light, blur, missing frames, video formats.

The common promise: no frame is "ok" with an error above six of its stated standard deviations.
"""

import dataclasses
from collections.abc import Callable

import numpy as np
import pytest
import torch
from shots import (
    SHAPE,
    Shot,
    bar,
    clean,
    compressed,
    covered,
    edge,
    flickered,
    highlight,
    increment_errors,
    lamp_lit,
    noisy,
    rotation_matrix,
    shaded,
    shot,
    speckle,
    textured,
)

from torchsphere import track
from torchsphere.geometry.circle import Circle
from torchsphere.imaging import interlacing
from torchsphere.imaging.crop import cut
from torchsphere.synthetic import ray_caster
from torchsphere.tracking.track import Track

#: Largest error of a frame with the status "ok", in stated standard deviations.
MAX_ERROR_SD = 6.0


def recorded(made: Shot, images: torch.Tensor) -> Shot:
    return dataclasses.replace(made, images=noisy(images, 2.0, 7))


def errors_of(measured: Track, made: Shot) -> tuple[np.ndarray, np.ndarray]:
    """Errors (m, 5) of the increments with the status "ok", px and degrees, and in stated standard deviations."""
    errors = np.abs(increment_errors(measured, made))
    sd = np.sqrt(np.einsum("nii->ni", measured.covariance))
    sd[:, 2:] = np.rad2deg(sd[:, 2:])
    ok = measured.status[1:] == "ok"
    return errors[ok], (errors / sd)[ok]


def shot_behind_bar(level: float, slope: float, **options: float) -> Shot:
    made = clean(n=22, start=(110.0, 120.0))
    # A bar of 24 px across the middle hides 30 % of a disc of 100 px.
    images = covered(made.images, bar(made.images, 200.0, 24.0, slope), level)
    return recorded(made, flickered(images, options.get("flicker", 0.15)))


@pytest.mark.parametrize("level", [20.0, 90.0, 150.0], ids=["dark", "as the background", "bright"])
def test_a_ball_behind_a_bar_is_measured_by_its_visible_part(level: float) -> None:
    made = shot_behind_bar(level, slope=0.2)
    measured = track(made.images, made.circle, sphere_map=False)
    errors, in_sd = errors_of(measured, made)
    # The promised bounds. Measured: all frames ok, at worst 0.012 px, 0.019 deg and 2.4 standard deviations.
    assert (measured.status != "ok").mean() < 0.1
    assert errors[:, :2].max() < 0.1
    assert in_sd.max() < MAX_ERROR_SD


def test_a_ball_that_is_partly_hidden_from_the_first_frame_on_is_measured() -> None:
    made = clean(n=12, start=(200.0, 120.0))
    made = recorded(made, flickered(covered(made.images, bar(made.images, 215.0, 24.0, 0.3), 150.0), 0.15))
    measured = track(made.images, made.circle, sphere_map=False)
    errors, in_sd = errors_of(measured, made)
    assert (measured.status == "ok").all()
    assert errors[:, :2].max() < 0.1  # as above
    assert in_sd.max() < MAX_ERROR_SD


def flicker_15_percent(made: Shot) -> torch.Tensor:
    return flickered(made.images, 0.15)


def bar_on_slow_path(made: Shot) -> torch.Tensor:
    return covered(made.images, bar(made.images, 130.0, 24.0), 150.0)


def target_edge(made: Shot) -> torch.Tensor:
    return covered(made.images, edge(made.images, torch.full((len(made.images),), 215.0), 0.1), 40.0)


def approaching_edge(made: Shot) -> torch.Tensor:
    return covered(made.images, edge(made.images, 200.0 - 3.0 * torch.arange(len(made.images)), 0.2), 170.0)


#: Motion of the ball, disturbance of its images, and share of the frames that has to be measured.
DISTURBANCES: dict[str, tuple[dict[str, float], Callable[[Shot], torch.Tensor], float]] = {
    "nothing": ({}, lambda made: made.images, 1.0),
    "brightness flicker of 15 %": ({}, flicker_15_percent, 1.0),
    "a bar passed slowly": ({"step": (1.4, 0.2), "start": (120.0, 120.0)}, bar_on_slow_path, 1.0),
    "a target's edge": ({}, target_edge, 0.9),
    "an edge that moves": ({"step": (3.0, 0.3)}, approaching_edge, 0.6),
    "a highlight": ({}, highlight, 1.0),
    "a highlight at 3 deg per frame": ({"turn_deg": 3.0}, highlight, 1.0),
    "speckles that saturate": ({"high": 330.0}, lambda made: made.images, 1.0),
    "half of the ball saturated": ({"low": 60.0, "high": 500.0}, lambda made: made.images, 1.0),
    "light from one side": ({}, shaded, 1.0),
    "light from one side at 10 deg per frame": ({"turn_deg": 10.0}, shaded, 1.0),
    "the image's border": ({"start": (90.0, 35.0), "step": (6.0, -0.5)}, lambda made: made.images, 1.0),
    "motion blur of 5 px": ({"step": (5.0, 0.4), "exposure": 1.0}, lambda made: made.images, 1.0),
    "motion blur of 5 px at 2 deg": (
        {"step": (8.0, 0.4), "exposure": 0.6, "turn_deg": 2.0},
        lambda made: made.images,
        1.0,
    ),
    "little contrast": ({"low": 105.0, "high": 125.0}, lambda made: made.images, 1.0),
}


@pytest.mark.parametrize(("motion", "disturb", "share"), DISTURBANCES.values(), ids=DISTURBANCES.keys())
def test_no_frame_with_the_status_ok_has_a_large_error(
    motion: dict[str, float], disturb: Callable[[Shot], torch.Tensor], share: float
) -> None:
    made = clean(**({"n": 14} | motion))
    made = recorded(made, disturb(made))
    measured = track(made.images, made.circle, sphere_map=False)
    _, in_sd = errors_of(measured, made)
    assert (measured.status == "ok").mean() >= share
    assert in_sd.max() < MAX_ERROR_SD


def test_the_fixed_light_of_a_lamp_is_hardly_taken_for_motion_of_the_ball() -> None:
    made = clean(n=12, start=(110.0, 120.0))
    motion = [
        np.nanmean(track(images, made.circle, sphere_map=False).increment, axis=0)
        for images in (made.images, lamp_lit(made, (0.5, 0.6, -0.3)))
    ]
    off = np.abs(motion[1] - motion[0])
    # Light from the side leaves half of the ball nearly dark. Measured: 0.004 px and 0.006 deg; with offset and gain as
    # the only unknowns of the light, 0.009 px and 0.014 deg.
    assert off[:2].max() < 0.005
    assert np.rad2deg(off[2:]).max() < 0.008


@pytest.mark.parametrize("quantum", [12.0, 20.0])
def test_compressed_video_is_measured_with_a_larger_uncertainty(quantum: float) -> None:
    made = recorded(clean(n=14), clean(n=14).images)
    video = dataclasses.replace(made, images=compressed(made.images, quantum).round())
    measured, plain = (
        track(video.images, made.circle, sphere_map=False),
        track(made.images, made.circle, sphere_map=False),
    )
    assert (measured.status == "ok").all()
    assert errors_of(measured, video)[1].max() < MAX_ERROR_SD
    widened = np.einsum("nii->ni", measured.covariance) / np.einsum("nii->ni", plain.covariance)
    assert widened.min() > 2  # the quantisation is several times as large as the noise


def interlaced(made: Shot, later: Shot) -> torch.Tensor:
    images = made.images.clone()
    images[:, 1::2] = later.images[:, 1::2]
    return images


def test_interlaced_video_is_measured_by_one_of_its_fields() -> None:
    # Odd rows half a frame later, at 0.57 deg and 6 px per frame.
    made, twice = clean(n=14), clean(n=28, step=(3.0, 0.2), turn_deg=0.285)
    later = dataclasses.replace(made, images=twice.images[1::2])
    made = recorded(made, interlaced(made, later))
    assert interlacing.is_interlaced(cut(made.images, made.centres, 58))
    measured = track(made.images, made.circle, sphere_map=False)
    assert (measured.status == "ok").all()
    errors, in_sd = errors_of(measured, made)
    # Half of the rows are interpolated. Measured: 0.058 px at worst; both fields together err by 0.18 px.
    assert errors[:, :2].max() < 0.1
    assert in_sd.max() < MAX_ERROR_SD


def test_a_texture_finer_than_the_rows_of_a_field_is_not_taken_for_interlacing() -> None:
    # Spots of 1.3 px on a ball of 10 px: each row differs from the mean of its neighbours.
    for seed in range(6):
        steps = torch.arange(12.0)[:, None] * torch.tensor([1.37, 0.23]) + torch.tensor([30.3, 25.1])
        turned = torch.stack([rotation_matrix(torch.deg2rad(torch.tensor([0.2, 0.5, 0.2]) * i)) for i in range(12)])
        images = ray_caster.render(speckle(seed, 30.0, 0.0, 255.0), steps, 10.0, turned.float(), 60.0, shape=(50, 80))
        crops = cut(noisy(images, 2.0, seed), steps.double(), 16)
        assert not any(interlacing.is_interlaced(crops.rows(i, i + 1)) for i in range(12))


def test_progressive_images_are_not_taken_for_interlaced_images() -> None:
    made = clean(n=6)
    for images in (made.images, compressed(made.images, 20.0), highlight(made), torch.full_like(made.images, 90.0)):
        assert not interlacing.is_interlaced(cut(noisy(images, 2.0, 3), made.centres, 58))


def test_three_blank_frames_are_flagged_and_the_ball_is_found_again() -> None:
    made = clean(n=14)
    images = made.images.clone()
    images[6:9] = 100.0
    made = recorded(made, images)
    measured = track(made.images, made.circle, sphere_map=False)
    assert "ok" not in measured.status[6:10]
    assert np.isnan(measured.position[6:9]).all()
    assert np.isnan(measured.increment[5:9]).all()
    assert (np.delete(measured.status, [6, 7, 8, 9]) == "ok").all()
    off = np.linalg.norm(measured.position - made.centres.numpy(), axis=1)[9]
    assert off < 0.05  # the promised bound; one pair of images gives the position to 0.005 px
    assert errors_of(measured, made)[1].max() < MAX_ERROR_SD


def test_a_ball_that_leaves_the_frame_is_measured_until_it_has_left() -> None:
    made = clean(n=16, start=(420.0, 120.0), step=(9.0, 0.4))
    made = recorded(made, made.images)
    measured = track(made.images, made.circle, sphere_map=False)
    gone = (made.centres[:, 0].numpy() + made.radius - SHAPE[1] + 1) / (2 * made.radius) > 0.9
    assert gone.any()
    assert np.isnan(measured.position[gone]).all()
    assert np.isnan(measured.increment[gone[1:]]).all()
    errors, in_sd = errors_of(measured, made)
    assert len(errors) >= 8
    assert errors[:, :2].max() < 0.15
    assert in_sd.max() < MAX_ERROR_SD


def test_a_frame_that_is_missing_makes_one_double_step() -> None:
    made = clean(n=14)
    made = recorded(made, made.images)
    kept = [i for i in range(14) if i != 7]
    increments = torch.cat((made.increments[:6], 2 * made.increments[:1], made.increments[8:]))
    made = Shot(made.images[kept], made.centres[kept], made.orientations[kept], increments, made.radius)
    measured = track(made.images, made.circle, sphere_map=False)
    assert (measured.status == "ok").all()
    assert errors_of(measured, made)[1].max() < MAX_ERROR_SD


def test_a_repeated_frame_of_a_moving_ball_is_no_measurement() -> None:
    made = clean(n=12)
    made = recorded(made, made.images)
    made.images[6] = made.images[5]
    measured = track(made.images, made.circle, sphere_map=False)
    assert measured.findings.repeated_frames == (6,)
    assert measured.status.tolist() == ["ok"] * 6 + ["lost"] * 2 + ["ok"] * 4
    assert np.isnan(measured.position[6]).all()
    assert np.isnan(measured.increment[5:7]).all()
    # The next frame has a position again, from a pair that spans two steps.
    np.testing.assert_allclose(measured.position[7:], made.centres[7:].numpy(), atol=0.05)


def test_a_still_ball_may_look_the_same_twice() -> None:
    made = clean(n=3)
    image = recorded(made, made.images).images[:1]
    measured = track(image.expand(5, -1, -1), made.circle, sphere_map=False)
    assert (measured.status == "ok").all()
    # Rounding alone: the sampling scales coordinates to the width of the crop, 1e-5 px in single precision.
    assert np.abs(measured.increment).max() < 1e-4


def test_a_ball_that_shows_another_side_after_a_gap_is_followed_again() -> None:
    before, after = clean(n=5, start=(70.0, 120.0)), clean(n=6, seed=9, start=(160.0, 122.0))
    # Another pattern stands for another side of the ball, without anything of the old view.
    blank = torch.full((4, *SHAPE), 100.0)
    images = noisy(torch.cat((before.images, blank, after.images)), 2.0, 3)
    measured = track(images, before.circle, sphere_map=False)
    assert (measured.status[:5] == "ok").all()
    assert "ok" not in measured.status[5:10]
    assert (measured.status[10:] == "ok").all()
    off = np.linalg.norm(measured.position[9:] - after.centres.numpy(), axis=1)
    # The centre by the outline of one image errs by 0.1 px where parts of the limb are fainter than the background.
    assert off.max() < 0.3
    np.testing.assert_allclose(measured.increment[9:], after.increments.numpy(), atol=0.04)
    assert np.isnan(measured.orientation[9:]).all()
    # Beside another ball of its size the new side may be that of the other ball.
    x, y, radius = before.circle
    rival = Circle(x, y, radius, others=((x + 90, y, radius),))
    assert (track(images, rival, sphere_map=False).status[5:] != "ok").all()


def test_a_ball_that_is_wholly_hidden_has_no_motion() -> None:
    made = clean(n=10, start=(150.0, 120.0), step=(3.0, 0.0))
    images = made.images.clone()
    images[5:8, :, 80:320] = 170.0
    made = recorded(made, images)
    measured = track(made.images, made.circle, sphere_map=False)
    assert not np.isin(measured.status[5:8], ["ok", "weak_texture"]).any()
    assert np.isnan(measured.increment[4:8]).all()
    assert np.isfinite(measured.position[8:]).all()
    assert (measured.status[9:] == "ok").all()


@pytest.mark.parametrize("radius", [10.0, 20.0])
def test_blotches_behind_a_small_ball_do_not_leak_into_its_region(radius: float) -> None:
    behind = textured(3, 3.0, 40.0)
    made = [shot(seed, n=16, radius=radius, background=behind, subsamples=8) for seed in range(2)]

    def errors(**options: float) -> tuple[float, float]:
        """Root mean squares of the errors of the steps, px, and of all components in stated standard deviations."""
        tracks = [track(each.images, each.circle, sphere_map=False, **options) for each in made]
        off = [found.increment - each.increments.numpy() for found, each in zip(tracks, made, strict=True)]
        sd = [np.sqrt(np.diagonal(found.covariance, axis1=1, axis2=2)) for found in tracks]
        px, ratio = np.concatenate(off)[:, :2], np.concatenate(off) / np.concatenate(sd)
        return float(np.sqrt(np.mean(px**2))), float(np.sqrt(np.mean(ratio**2)))

    px, ratio = errors()
    wide, _ = errors(pre_blur=1.0)
    assert px < 0.9 * wide
    # 30 steps of five components, of which two pairs are correlated: root mean squares of 1 scatter by 7 %.
    assert ratio < 1.15


def test_a_given_pre_blur_is_kept() -> None:
    made = shot(1, n=3, radius=20.0)
    assert track(made.images, made.circle, pre_blur=1.0, sphere_map=False).settings["pre_blur"] == 1.0
    assert track(made.images, made.circle, sphere_map=False).settings["pre_blur"] == pytest.approx(0.7)
