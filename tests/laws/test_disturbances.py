"""What spoils real footage: occluders, reflections, changing light, blur, missing frames, video formats.

One promise stands over all of them: no frame is "ok" with an error above six of its stated standard deviations.
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
    lit,
    noisy,
    rotation_matrix,
    shaded,
    shot,
    speckle,
    textured,
)

from torchsphere import track
from torchsphere.imaging import interlacing
from torchsphere.imaging.crop import cut
from torchsphere.synthetic import ray_caster
from torchsphere.tracking.track import Track

#: Largest error, in stated standard deviations, that a frame may have and be "ok".
HONEST = 6.0


def recorded(made: Shot, images: torch.Tensor) -> Shot:
    return dataclasses.replace(made, images=noisy(images, 2.0, 7))


def errors_of(measured: Track, made: Shot) -> tuple[np.ndarray, np.ndarray]:
    """Errors (m, 5) of the increments that are "ok", px and degrees, and the same in stated standard deviations."""
    errors = np.abs(increment_errors(measured, made))
    sd = np.sqrt(np.einsum("nii->ni", measured.covariance))
    sd[:, 2:] = np.rad2deg(sd[:, 2:])
    ok = measured.status[1:] == "ok"
    return errors[ok], (errors / sd)[ok]


def behind_a_bar(level: float, slope: float, **options: float) -> Shot:
    made = clean(n=22, start=(110.0, 120.0))
    # 24 px across the middle are 30 % of a disc of 100 px.
    images = covered(made.images, bar(made.images, 200.0, 24.0, slope), level)
    return recorded(made, flickered(images, options.get("flicker", 0.15)))


@pytest.mark.parametrize("level", [20.0, 90.0, 150.0], ids=["dark", "as the background", "bright"])
def test_a_ball_behind_a_bar_is_measured_by_what_is_left_of_it(level: float) -> None:
    made = behind_a_bar(level, slope=0.2)
    measured = track(made.images, made.circle, sphere_map=False)
    errors, in_sd = errors_of(measured, made)
    # The bounds promised; measured: every frame ok, 0.012 px and 0.019 deg at worst, 2.4 standard deviations.
    assert (measured.status != "ok").mean() < 0.1
    assert errors[:, :2].max() < 0.1
    assert in_sd.max() < HONEST


def test_a_ball_that_is_partly_hidden_from_the_first_frame_on_is_measured() -> None:
    made = clean(n=12, start=(200.0, 120.0))
    made = recorded(made, flickered(covered(made.images, bar(made.images, 215.0, 24.0, 0.3), 150.0), 0.15))
    measured = track(made.images, made.circle, sphere_map=False)
    errors, in_sd = errors_of(measured, made)
    assert (measured.status == "ok").all()
    assert errors[:, :2].max() < 0.1  # as above
    assert in_sd.max() < HONEST


def step_of_light(made: Shot) -> torch.Tensor:
    return flickered(made.images, 0.15)


def slow_behind_a_bar(made: Shot) -> torch.Tensor:
    return covered(made.images, bar(made.images, 130.0, 24.0), 150.0)


def target_edge(made: Shot) -> torch.Tensor:
    return covered(made.images, edge(made.images, torch.full((len(made.images),), 215.0), 0.1), 40.0)


def edge_that_comes_nearer(made: Shot) -> torch.Tensor:
    return covered(made.images, edge(made.images, 200.0 - 3.0 * torch.arange(len(made.images)), 0.2), 170.0)


#: How the ball moves, what is done to its images, and the share of the frames that has to be measured.
DISTURBANCES: dict[str, tuple[dict[str, float], Callable[[Shot], torch.Tensor], float]] = {
    "nothing": ({}, lambda made: made.images, 1.0),
    "brightness flicker of 15 %": ({}, step_of_light, 1.0),
    "a bar passed slowly": ({"step": (1.4, 0.2), "start": (120.0, 120.0)}, slow_behind_a_bar, 1.0),
    "a target's edge": ({}, target_edge, 0.9),
    "an edge that moves": ({"step": (3.0, 0.3)}, edge_that_comes_nearer, 0.6),
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
def test_no_frame_is_ok_and_wrong(
    motion: dict[str, float], disturb: Callable[[Shot], torch.Tensor], share: float
) -> None:
    made = clean(**({"n": 14} | motion))
    made = recorded(made, disturb(made))
    measured = track(made.images, made.circle, sphere_map=False)
    _, in_sd = errors_of(measured, made)
    assert (measured.status == "ok").mean() >= share
    assert in_sd.max() < HONEST


def test_a_lamp_that_stays_while_the_ball_turns_is_hardly_taken_for_motion() -> None:
    made = clean(n=12, start=(110.0, 120.0))
    motion = [
        np.nanmean(track(images, made.circle, sphere_map=False).increment, axis=0)
        for images in (made.images, lit(made, (0.5, 0.6, -0.3)))
    ]
    off = np.abs(motion[1] - motion[0])
    # From the side, where half of the ball is nearly dark. Measured: 0.004 px and 0.006 deg; where offset and gain
    # alone are left open, 0.009 px and 0.014 deg.
    assert off[:2].max() < 0.005
    assert np.rad2deg(off[2:]).max() < 0.008


@pytest.mark.parametrize("quantum", [12.0, 20.0])
def test_compressed_video_is_measured_with_a_larger_uncertainty(quantum: float) -> None:
    made = recorded(clean(n=14), clean(n=14).images)
    squeezed = dataclasses.replace(made, images=compressed(made.images, quantum).round())
    measured, plain = (
        track(squeezed.images, made.circle, sphere_map=False),
        track(made.images, made.circle, sphere_map=False),
    )
    assert (measured.status == "ok").all()
    assert errors_of(measured, squeezed)[1].max() < HONEST
    widened = np.einsum("nii->ni", measured.covariance) / np.einsum("nii->ni", plain.covariance)
    assert widened.min() > 2  # the quantisation is several times the noise


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
    # Half of the rows, every other one interpolated. Measured: 0.058 px at worst; both fields together err by 0.18.
    assert errors[:, :2].max() < 0.1
    assert in_sd.max() < HONEST


def test_a_texture_finer_than_a_field_s_rows_is_not_taken_for_interlaced() -> None:
    # A ball of 10 px with the spots of one of 30 px, 1.3 px wide: each row differs from what its neighbours let expect.
    for seed in range(6):
        steps = torch.arange(12.0)[:, None] * torch.tensor([1.37, 0.23]) + torch.tensor([30.3, 25.1])
        turned = torch.stack([rotation_matrix(torch.deg2rad(torch.tensor([0.2, 0.5, 0.2]) * i)) for i in range(12)])
        images = ray_caster.render(speckle(seed, 30.0, 0.0, 255.0), steps, 10.0, turned.float(), 60.0, shape=(50, 80))
        crops = cut(noisy(images, 2.0, seed), steps.double(), 16)
        assert not any(interlacing.is_interlaced(crops.rows(i, i + 1)) for i in range(12))


def test_progressive_images_are_not_taken_for_interlaced_ones() -> None:
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
    assert off < 0.05  # one pair of images tells the position to 0.005 px; the promise
    assert errors_of(measured, made)[1].max() < HONEST


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
    assert in_sd.max() < HONEST


def test_a_frame_that_is_missing_makes_one_double_step() -> None:
    made = clean(n=14)
    made = recorded(made, made.images)
    kept = [i for i in range(14) if i != 7]
    increments = torch.cat((made.increments[:6], 2 * made.increments[:1], made.increments[8:]))
    made = Shot(made.images[kept], made.centres[kept], made.orientations[kept], increments, made.radius)
    measured = track(made.images, made.circle, sphere_map=False)
    assert (measured.status == "ok").all()
    assert errors_of(measured, made)[1].max() < HONEST


def test_a_repeated_frame_of_a_moving_ball_is_no_measurement() -> None:
    made = clean(n=12)
    made = recorded(made, made.images)
    made.images[6] = made.images[5]
    measured = track(made.images, made.circle, sphere_map=False)
    assert measured.settings["repeated_frames"] == [6]
    assert measured.status.tolist() == ["ok"] * 6 + ["lost"] * 2 + ["ok"] * 4
    assert np.isnan(measured.position[6]).all()
    assert np.isnan(measured.increment[5:7]).all()
    # Found again in the next frame, with a position; one pair of two steps.
    np.testing.assert_allclose(measured.position[7:], made.centres[7:].numpy(), atol=0.05)


def test_a_still_ball_may_look_the_same_twice() -> None:
    made = clean(n=3)
    image = recorded(made, made.images).images[:1]
    measured = track(image.expand(5, -1, -1), made.circle, sphere_map=False)
    assert (measured.status == "ok").all()
    # Rounding alone: sampling scales places to the crop's width, 1e-5 px in single precision.
    assert np.abs(measured.increment).max() < 1e-4


def test_a_ball_that_has_turned_out_of_sight_meanwhile_is_followed_again() -> None:
    before, after = clean(n=5, start=(70.0, 120.0)), clean(n=6, seed=9, start=(160.0, 122.0))
    # Another pattern is another side of the ball: nothing of the old view is left.
    blank = torch.full((4, *SHAPE), 100.0)
    images = noisy(torch.cat((before.images, blank, after.images)), 2.0, 3)
    measured = track(images, before.circle, sphere_map=False)
    assert (measured.status[:5] == "ok").all()
    assert "ok" not in measured.status[5:10]
    assert (measured.status[10:] == "ok").all()
    off = np.linalg.norm(measured.position[9:] - after.centres.numpy(), axis=1)
    # The outline's centre in a single image: 0.1 px where the limb is fainter than the background in places.
    assert off.max() < 0.3
    np.testing.assert_allclose(measured.increment[9:], after.increments.numpy(), atol=0.04)
    assert np.isnan(measured.orientation[9:]).all()


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


@pytest.mark.parametrize("radius", [10.0, 15.0, 20.0])
def test_blotches_behind_a_small_ball_are_not_carried_into_its_region(radius: float) -> None:
    behind = textured(3, 3.0, 40.0)
    made = [shot(seed, n=16, radius=radius, background=behind, subsamples=8) for seed in range(4)]

    def errors(**options: float) -> tuple[float, float]:
        """Of the steps, px, and of all components over what is stated: root mean squares."""
        found = [track(each.images, each.circle, sphere_map=False, **options) for each in made]
        off = [one.increment - each.increments.numpy() for one, each in zip(found, made, strict=True)]
        sd = [np.sqrt(np.diagonal(one.covariance, axis1=1, axis2=2)) for one in found]
        px, ratio = np.concatenate(off)[:, :2], np.concatenate(off) / np.concatenate(sd)
        return float(np.sqrt(np.mean(px**2))), float(np.sqrt(np.mean(ratio**2)))

    px, ratio = errors()
    wide, _ = errors(pre_blur=1.0)
    assert px < 0.9 * wide
    # 60 steps of five components, of which two pairs are alike: root mean squares of 1 scatter by a twentieth.
    assert ratio < 1.15


def test_a_pre_blur_that_was_given_is_taken() -> None:
    made = shot(1, n=3, radius=20.0)
    assert track(made.images, made.circle, pre_blur=1.0, sphere_map=False).settings["pre_blur"] == 1.0
    assert track(made.images, made.circle, sphere_map=False).settings["pre_blur"] == pytest.approx(0.7)
