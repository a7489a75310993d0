"""Whole recordings of known truth."""

from collections import Counter
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch
from shots import ExampleTrack, angles_between, increment_errors, noisy, shot, textured

from torchsphere import Camera, Circle, open_recording, track
from torchsphere.correlation import STATUSES, Correlation
from torchsphere.joint import Solver
from torchsphere.options import Options
from torchsphere.pairs import Pairs
from torchsphere.solve import solve


def test_the_example_shot_is_measured_as_the_paper_would_need_it(example: ExampleTrack) -> None:
    measured, errors = example.track, example.errors
    assert Counter(measured.status.tolist()) == {"ok": 60}
    # The bounds promised for this shot: px and degrees.
    assert np.abs(errors[:, :2].mean(0)).max() < 0.003, errors.mean(0)
    assert errors[:, :2].std(0).max() < 0.008, errors.std(0)
    assert errors[:, 2:].std(0).max() < 0.012, errors.std(0)
    off = np.linalg.norm(measured.position - example.shot.centres.numpy(), axis=1)
    assert off.max() < 0.3


def test_the_example_shots_uncertainty_is_honest(example: ExampleTrack) -> None:
    sd = np.sqrt(np.einsum("nii->ni", example.track.covariance))
    sd[:, 2:] = np.rad2deg(sd[:, 2:])
    ratio = example.errors.std(0) / sd.mean(0)
    # 59 pairs tell a standard deviation to 1 / sqrt(2 * 58) = 9 %: three of it either way.
    assert np.all((ratio > 0.73) & (ratio < 1.3)), ratio


def test_the_example_shots_circle_is_calibrated(example: ExampleTrack) -> None:
    x, y, radius = example.shot.circle
    circle = example.track.circle
    # 0.2 px of radius bias x by 0.005 px and wy by 0.004 deg, less than one pair's noise (PHYSICS section 3).
    assert abs(circle.radius - radius) < 0.2
    assert max(abs(circle.x - x), abs(circle.y - y)) < 0.3
    assert 0 < circle.sd_radius < 0.3


def test_orientations_chain_the_true_rotation(example: ExampleTrack) -> None:
    truth = example.shot.orientations.numpy()
    off = angles_between(example.track.orientation, truth)
    # 59 increments: their noise telescopes to 0.01 deg; a systematic 0.5 % of 0.57 deg per frame, from a radius that is
    # off by 0.2 px or the interpolation, adds up to 0.17 deg. A wrong order or sign would be off by tens of degrees.
    assert off.max() < 0.5
    np.testing.assert_allclose(example.track.orientation[0], np.eye(3), atol=1e-12)  # the definition


def test_positions_are_the_sum_of_the_increments(example: ExampleTrack) -> None:
    measured = example.track
    summed = measured.position[0] + measured.increment[:, :2].cumsum(0)
    np.testing.assert_allclose(measured.position[1:], summed, atol=1e-9)  # the same float64 sums


def test_every_array_has_its_shape_and_only_the_first_frame_has_no_coefficient(example: ExampleTrack) -> None:
    measured, n = example.track, 60
    assert measured.position.shape == (n, 2)
    assert measured.increment.shape == (n - 1, 5)
    assert measured.covariance.shape == (n - 1, 5, 5)
    assert measured.orientation.shape == (n, 3, 3)
    assert measured.zncc.shape == measured.iterations.shape == measured.status.shape == (n,)
    assert np.isfinite(measured.increment).all()
    assert np.isnan(measured.zncc[0])
    assert (measured.zncc[1:] > 0.9).all()
    assert measured.iterations[0] == 0
    assert (measured.iterations[1:] > 0).all()
    assert measured.settings["model"] == "rigid"
    assert measured.settings["circle_given"] is False


def test_progress_is_reported_up_to_the_last_frame(example: ExampleTrack) -> None:
    done = [now for now, _ in example.progress]
    assert {total for _, total in example.progress} == {60}
    assert done == sorted(done)
    assert example.progress[-1] == (60, 60)


def test_steps_of_22_px_need_no_guess() -> None:
    made = shot(2, n=12, step=(22.0, 3.0))
    measured = track(made.images)
    assert set(measured.status) == {"ok"}
    # As for slow steps; 11 pairs know their mean to 0.005 / sqrt(11) px.
    errors = increment_errors(measured, made)
    assert np.abs(errors[:, :2].mean(0)).max() < 0.006
    assert errors[:, :2].std(0).max() < 0.008
    assert np.linalg.norm(measured.position - made.centres.numpy(), axis=1).max() < 0.4


def test_a_sudden_change_of_motion_is_followed() -> None:
    before = shot(2, n=8, step=(9.0, 1.0), start=(80.0, 120.0))
    # An impact: the second half starts near where the first one ends, and goes elsewhere.
    after = shot(2, n=8, step=(-5.0, 4.0), start=(153.0, 120.0))
    images = torch.cat((before.images, after.images))
    measured = track(images, before.circle)
    assert set(measured.status) == {"ok"}
    off = np.linalg.norm(measured.position - np.concatenate((before.centres, after.centres)), axis=1)
    assert off.max() < 0.2  # the jump between the halves turns the ball by 4 deg: linearising it costs 0.02 px


def test_what_lies_behind_an_impact_is_not_solved_only_to_be_given_up() -> None:
    before = shot(2, n=40, step=(3.0, 1.0), start=(80.0, 90.0))
    after = shot(2, n=30, step=(-3.0, 2.0), start=(200.0, 131.0))
    images = torch.cat((before.images, after.images))
    solved = []

    def counting(pairs: Pairs, near: torch.Tensor, options: Options, start: torch.Tensor | None = None) -> Correlation:
        solved.append(len(near))
        return solve(pairs, near, options, start)

    measured = track(images, before.circle, sphere_map=False, solver=Solver(solve=counting))
    assert set(measured.status) == {"ok"}
    # The batch that the impact interrupts holds 23 pairs more. A pair is solved again where its centre was off.
    assert sum(solved) < 1.25 * len(images)


@pytest.mark.parametrize("given", [True, False], ids=["circle given", "no circle"])
def test_five_degrees_per_frame_are_measured_with_the_exact_model(given: bool) -> None:
    made = shot(2, n=12, step=(8.0, 0.2), rotation_deg=(2.0, 5.0, 1.0))
    measured = track(made.images, made.circle if given else None, model="finite", sphere_map=False)
    assert set(measured.status) == {"ok"}
    errors = increment_errors(measured, made)
    # PHYSICS section 3: 0.002 px per degree of bias along the front's motion, over noise of 0.005 px; and 0.026 px per
    # px of radius at 0.5 deg, that is 0.28 at 5.5 deg, of a radius that was found: no more than two of its stated sd.
    of_radius = 0.0 if given else 0.28 * 2 * measured.circle.sd_radius
    assert given or measured.circle.sd_radius < 0.2
    assert np.abs(errors[:, :2].mean(0)).max() < 0.015 + of_radius
    # The bound for slow turns, and what the radius adds in eleven steps.
    assert np.linalg.norm(measured.position - made.centres.numpy(), axis=1).max() < 0.3 + 11 * of_radius


def test_blank_frames_are_flagged_and_the_ball_is_found_again() -> None:
    made = shot(2, n=24)
    images = made.images.clone()
    images[10:13] = noisy(torch.full((3, *images.shape[1:]), 100.0), 2.0, 3)
    measured = track(images, made.circle)
    assert (np.delete(measured.status, [10, 11, 12, 13]) == "ok").all()
    assert "ok" not in measured.status[10:14]
    assert measured.status[13] == "lost"  # found again: known position, no increment that leads to it
    assert np.isnan(measured.position[10:13]).all()
    assert np.isnan(measured.orientation[10:13]).all()
    assert np.isnan(measured.increment[9:13]).all()
    assert np.isnan(measured.covariance[9:13]).all()
    kept = np.delete(np.arange(24), [10, 11, 12])
    off = np.linalg.norm(measured.position - made.centres.numpy(), axis=1)
    assert off[kept].max() < 0.3
    # Across the gap the ball turns by 4 x 0.57 deg at once, which linearising takes for 1 % less.
    assert angles_between(measured.orientation[kept], made.orientations.numpy()[kept]).max() < 0.5


def test_a_ball_that_leaves_the_frame_is_said_to_have_left() -> None:
    made = shot(2, n=22, step=(9.0, 0.0), start=(420.0, 120.0))
    measured = track(made.images, made.circle)
    share_gone = (made.centres[:, 0].numpy() + made.radius - 511) / (2 * made.radius)
    assert (measured.status[share_gone < 0] == "ok").all()
    gone = share_gone > 0.9
    assert (measured.status[gone] == "out_of_frame").all()
    assert np.isnan(measured.position[gone]).all()
    assert np.isnan(measured.increment[gone[1:]]).all()
    seen = np.isfinite(measured.position[:, 0])
    # What is measured on a part of the ball is still a measurement.
    assert np.linalg.norm(measured.position - made.centres.numpy(), axis=1)[seen].max() < 0.5


def test_a_ball_that_enters_late_is_lost_before_and_ok_after() -> None:
    made = shot(4, n=12, background=60.0, start=(-60.0, 120.0), step=(16.0, 0.0))
    measured = track(made.images)
    first = measured.circle.frame
    assert first > 5
    assert (measured.status[:first] == "lost").all()
    assert (measured.status[first:] == "ok").all()
    assert np.isnan(measured.position[:first]).all()
    assert np.isnan(measured.increment[:first]).all()
    np.testing.assert_allclose(measured.orientation[first], np.eye(3), atol=1e-12)


@pytest.fixture(scope="module")
def short() -> Any:
    return shot(5, n=6)


def save_npy(folder: Path, images: np.ndarray) -> Any:
    np.save(folder / "shot.npy", images)
    return open_recording(folder / "shot.npy")


WAYS_IN = {
    "float32 tensor": lambda images, folder: images,
    "float64 array": lambda images, folder: images.numpy().astype(np.float64),
    "uint8 array": lambda images, folder: images.numpy().astype(np.uint8),
    "uint16 array": lambda images, folder: images.numpy().astype(np.uint16),
    "big-endian uint16 array": lambda images, folder: images.numpy().astype(">u2"),
    "uint8 tensor": lambda images, folder: images.to(torch.uint8),
    "list of arrays": lambda images, folder: list(images.numpy()),
    "read-only array": lambda images, folder: np.lib.stride_tricks.as_strided(images.numpy(), writeable=False),
    "array backwards in memory": lambda images, folder: images.flip(0).numpy()[::-1],
    "tensor with a gradient": lambda images, folder: images.clone().requires_grad_(),
    "recording": lambda images, folder: save_npy(folder, images.numpy().astype(np.uint8)),
}


@pytest.mark.parametrize("way", WAYS_IN.values(), ids=WAYS_IN.keys())
def test_every_way_in_gives_the_same_track(short: Any, way: Any, tmp_path: Path) -> None:
    expected = track(short.images, short.circle)
    measured = track(way(short.images, tmp_path), short.circle)
    # Whole grey levels are the same numbers in every type.
    np.testing.assert_array_equal(measured.increment, expected.increment)
    np.testing.assert_array_equal(measured.status, expected.status)
    np.testing.assert_array_equal(measured.orientation, expected.orientation)


def test_sixteen_bits_of_gain_change_nothing(short: Any) -> None:
    levels = (short.images.numpy() * 257).astype(np.uint16)
    measured, expected = track(levels, short.circle), track(short.images, short.circle)
    # A gain changes nothing; float32 rounds to 1e-5 px.
    np.testing.assert_allclose(measured.increment, expected.increment, atol=1e-4)


def test_double_precision_is_had_on_request(short: Any) -> None:
    double, single = (track(short.images, short.circle, dtype=d) for d in (torch.float64, torch.float32))
    assert double.settings["dtype"] == "float64"
    np.testing.assert_allclose(double.increment, single.increment, atol=4e-4)  # convergence stops within 2e-4 px


def test_a_given_circle_is_taken_as_it_is_and_refined_on_request_only(short: Any) -> None:
    x, y, radius = short.circle
    off = (x + 0.8, y - 0.6, radius + 0.7)
    kept = track(short.images, off).circle
    assert (kept.x, kept.y, kept.radius) == off
    assert np.isnan(kept.sd_radius)
    refined = track(short.images, off, refine=True).circle
    assert max(abs(refined.x - x), abs(refined.y - y), abs(refined.radius - radius)) < 0.5  # as for circles found
    same = track(short.images, Circle(*off)).circle
    assert same == Circle(*off)


def test_a_circle_that_was_found_and_does_not_fit_the_camera_is_not_said_to_be_given() -> None:
    # The blotches touch the ball, and the circle found is off by 6 px.
    made = shot(n=12, background=textured(1, 3.0, 30), step=(8.4, 0.2))
    with pytest.raises(ValueError, match=r"the circle found, at \(86.9, 120.5\).*give that with circle") as caught:
        track(made.images, model="pinhole", camera=Camera(distance_radii=20.0))
    assert "given" not in str(caught.value)
    with pytest.raises(ValueError, match="track with the circle as given"):
        track(made.images, (86.9, 120.5, 53.9), model="pinhole", camera=Camera(distance_radii=20.0), refine=True)


def test_an_occlusion_that_is_ignored_does_not_harm(short: Any) -> None:
    images = short.images.clone()
    ignore = np.zeros(images.shape[1:], bool)
    ignore[100:110, :] = True
    images[:, 100:110] = 250
    measured = track(images, short.circle, ignore=ignore)
    assert set(measured.status) == {"ok"}
    # An eighth of the ball is missing: a few per cent more noise, 0.005 px and 0.008 deg, five pairs at three sd.
    errors = np.abs(increment_errors(measured, short))
    assert errors[:, :2].max() < 0.02
    assert errors[:, 2:].max() < 0.03


def test_a_still_ball_does_not_move() -> None:
    made = shot(6, n=6, step=(0.0, 0.0), jitter=0.0, rotation_deg=(0.0, 0.0, 0.0))
    measured = track(made.images, made.circle)
    assert set(measured.status) == {"ok"}
    # Noise of two grey levels: 0.005 px and 0.007 deg; three of it.
    assert np.abs(increment_errors(measured, made)).max() < 0.021


def test_backwards_in_time_the_motion_is_the_opposite(short: Any) -> None:
    x, y = short.centres[-1].tolist()
    forth = track(short.images, short.circle).increment
    back = track(short.images.flip(0), (x, y, short.radius)).increment[::-1]
    off = np.abs(forth + back)
    # The noise is the same both ways; the gradients are the other image's: a share of 0.005 px and 0.008 deg.
    assert off[:, :2].max() < 0.01
    assert np.rad2deg(off[:, 2:]).max() < 0.015


@pytest.mark.parametrize("noise", [0.0, 20.0])
def test_a_circle_where_no_ball_is_gives_no_path(noise: float) -> None:
    images = torch.stack([noisy(torch.full((192, 320), 128.0), noise, seed) for seed in range(5)])
    measured = track(images, (120.0, 92.0, 40.0), sphere_map=False)
    assert np.isin(measured.status[1:], ["low_correlation", "lost"]).all()
    assert np.isnan(measured.position[1:]).all()


def nothing(image: torch.Tensor, kind: str, seed: int = 0) -> torch.Tensor:
    """An image of the same size that shows no ball."""
    noise = torch.randn(image.shape, generator=torch.Generator().manual_seed(seed))
    return {"blank": torch.zeros_like(image), "dark": 5 + 2 * noise, "no number": torch.nan * image}[kind]


@pytest.mark.parametrize("kind", ["blank", "dark", "no number"])
def test_a_first_frame_without_a_ball_is_not_vouched_for_whatever_circle_was_given(short: Any, kind: str) -> None:
    images = short.images.clone()
    images[0] = nothing(images[0], kind)
    measured = track(images, short.circle)
    assert measured.status[0] == "lost"
    assert np.isnan(measured.position[0]).all()
    assert np.isnan(measured.orientation[0]).all()
    # Found again by its outline in frame 3, and followed from there.
    assert measured.status.tolist()[3:] == ["lost", "ok", "ok"]
    np.testing.assert_allclose(measured.orientation[3], np.eye(3), atol=1e-12)
    assert np.isfinite(measured.sd_steady).all()
    alone = track(torch.stack([nothing(images[0], kind, seed) for seed in range(3)]), short.circle)
    assert set(alone.status) <= {"lost", "low_correlation"}
    assert np.isnan(alone.position).all()


def test_a_first_frame_that_shows_the_ball_is_ok_though_all_others_are_blank(short: Any) -> None:
    images = short.images.clone()
    images[1:] = 0
    measured = track(images, short.circle)
    assert measured.status.tolist() == ["ok"] + ["lost"] * 5
    np.testing.assert_allclose(measured.position[0], short.circle[:2])


def test_a_circle_is_not_fitted_to_values_that_are_no_numbers(short: Any) -> None:
    images = short.images.clone()
    images[:, 100, 90] = torch.nan
    with pytest.raises(ValueError, match="not finite"):
        track(images, short.circle, refine=True)
    images[:, 100, 90], images[:, 0, 0] = 100, torch.nan
    assert track(images, short.circle, refine=True).status[0] == "ok"


def test_a_plain_ball_has_a_path_but_no_rotation() -> None:
    made = shot(4, n=6, low=200.0, high=200.001, background=40.0)
    measured = track(made.images)
    assert (measured.status[1:] == "weak_texture").all()
    assert np.isnan(measured.increment[:, 2:]).all()
    # 300 rays with noise of 1.3 % of the edge's height: about 0.005 px per centre.
    assert np.abs(increment_errors(measured, made)[:, :2]).max() < 0.05
    sd = np.sqrt(np.einsum("nii->ni", measured.covariance))
    assert np.isfinite(sd[:, :2]).all()
    assert np.isnan(sd[:, 2:]).all()
    np.testing.assert_allclose(measured.orientation[0], np.eye(3), atol=1e-12)
    assert np.isnan(measured.orientation[1:]).all()


def test_hopeless_images_get_statuses_from_the_list_and_no_numbers() -> None:
    made = shot(5, n=8)
    generator = torch.Generator().manual_seed(1)
    images = made.images.clone()
    images[2] = 0
    images[3] = 255 * torch.rand(images[3].shape, generator=generator)
    images[5] = shot(9, n=1, start=(300.0, 120.0)).images[0]  # another ball
    images[6:] = 128
    measured = track(images, made.circle)
    assert set(measured.status) <= set(STATUSES)
    for i in (2, 3, 5, 6, 7):
        assert measured.status[i] != "ok"
        assert np.isnan(measured.increment[i - 1]).all()
    known = np.isfinite(measured.increment[:, 0])
    assert np.isin(measured.status[1:][known], ["ok", "weak_texture"]).all()


IMAGES = torch.full((3, 80, 90), 100.0)
BAD = {
    "one image": ({"recording": IMAGES[:1]}, "1 image"),
    "no array": ({"recording": object()}, "expected an array"),
    "text": ({"recording": "shot.tif"}, r"expected an array .* torchsphere.open_recording\('shot.tif'\)"),
    "masked images": ({"recording": np.ma.array(IMAGES, mask=IMAGES > 0)}, "recording: got a masked array with 21600"),
    "a path": ({"recording": Path("shot.tif")}, r"open_recording\('shot.tif'\)"),
    "nothing to find": ({}, "no ball was found in 3 frames"),
    "two numbers for a circle": ({"circle": (40, 40)}, "three numbers"),
    "words for a circle": ({"circle": "middle"}, "three numbers"),
    "a circle outside": ({"circle": (400, 40, 20)}, "outside the image of 90 x 80"),
    "a circle that is not finite": ({"circle": (np.nan, 40, 20)}, "finite"),
    "a circle too small": ({"circle": (40, 40, 1)}, "3 px or more"),
    "a circle in a frame that is not there": ({"circle": Circle(40, 40, 20, frame=7)}, "frame"),
    "a circle in a frame before the first": ({"circle": Circle(40, 40, 20, frame=-1)}, "frame"),
    "a mask of another shape": ({"circle": (40, 40, 20), "ignore": np.zeros((3, 3))}, "ignore"),
    "an unknown model": ({"circle": (40, 40, 20), "model": "affine"}, "unknown model"),
    "an unknown device": ({"circle": (40, 40, 20), "device": "abacus"}, "abacus"),
    "a mask that leaves nothing": ({"circle": (40, 40, 20), "ignore": np.ones((80, 90))}, "leaves nothing"),
    "a mask without numbers": ({"circle": (40, 40, 20), "ignore": "mask.png"}, r"ignore: expected an array \(h, w\)"),
    "a mask of NaN": ({"circle": (40, 40, 20), "ignore": np.full((80, 90), np.nan)}, "ignore: holds NaN"),
    "complex images": ({"recording": np.zeros((3, 80, 90), complex)}, "got ndarray of type complex128"),
    "a circle of text": ({"circle": Circle("left", 40, 20)}, "three numbers"),  # type: ignore[arg-type]
    "a circle in half a frame": ({"circle": Circle(40, 40, 20, frame=0.5)}, "frame 0.5"),  # type: ignore[arg-type]
    "a device that is not supported": ({"circle": (40, 40, 20), "device": "meta"}, "'meta': expected one of cpu, cuda"),
    "a camera that is none": ({"circle": (40, 40, 20), "model": "pinhole", "camera": 500}, "torchsphere.Camera"),
    "a map in words": (
        {"circle": (40, 40, 20), "sphere_map": "off"},
        "sphere_map = 'off': expected True, False or None",
    ),
    "a switch in words": ({"circle": (40, 40, 20), "robust": "no"}, "robust = 'no': expected True or False"),
    "refined in words": ({"circle": (40, 40, 20), "refine": "no"}, "refine = 'no': expected True or False"),
    "a truth for a number": (
        {"circle": (40, 40, 20), "max_iterations": True},
        "max_iterations = True: expected a whole",
    ),
    "half precision": ({"circle": (40, 40, 20), "dtype": torch.float16}, "float32"),
}


@pytest.mark.parametrize(("change", "sentence"), BAD.values(), ids=BAD.keys())
def test_arguments_that_cannot_be_are_refused_with_a_sentence(change: dict[str, Any], sentence: str) -> None:
    arguments = {"recording": IMAGES} | change
    with pytest.raises(ValueError, match=sentence):
        track(arguments.pop("recording"), **arguments)


@pytest.mark.skipif(torch.cuda.is_available(), reason="a CUDA device is here")
def test_cuda_without_a_cuda_device_is_refused() -> None:
    with pytest.raises(ValueError, match="CUDA"):
        track(IMAGES, (40, 40, 20), device="cuda")


@pytest.mark.skipif(not torch.cuda.is_available(), reason="no CUDA device is here")
def test_cuda_gives_the_same_track(short: Any) -> None:
    there, here = track(short.images, short.circle, device="cuda"), track(short.images, short.circle)
    np.testing.assert_allclose(there.increment, here.increment, atol=4e-4)  # convergence stops within 2e-4 px
