"""Input of `track`: images of every kind, circles, masks, devices, and refusals."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch
from shots import increment_errors, noisy, shot, textured

from torchsphere import Camera, Circle, open_recording, track


@pytest.fixture(scope="module")
def short() -> Any:
    return shot(5, n=6)


@pytest.fixture(scope="module")
def expected(short: Any) -> Any:
    return track(short.images, short.circle, sphere_map=False)


def save_npy(folder: Path, images: np.ndarray) -> Any:
    np.save(folder / "shot.npy", images)
    return open_recording(folder / "shot.npy")


IMAGE_TYPES = {
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


@pytest.mark.parametrize("convert", IMAGE_TYPES.values(), ids=IMAGE_TYPES.keys())
def test_every_type_of_images_gives_the_same_track(short: Any, expected: Any, convert: Any, tmp_path: Path) -> None:
    measured = track(convert(short.images, tmp_path), short.circle, sphere_map=False)
    # Whole grey levels are the same numbers in every type.
    np.testing.assert_array_equal(measured.increment, expected.increment)
    np.testing.assert_array_equal(measured.status, expected.status)
    np.testing.assert_array_equal(measured.orientation, expected.orientation)


def test_a_gain_to_sixteen_bits_changes_nothing(short: Any, expected: Any) -> None:
    levels = (short.images.numpy() * 257).astype(np.uint16)
    measured = track(levels, short.circle, sphere_map=False)
    # A gain changes nothing; float32 rounds to 1e-5 px.
    np.testing.assert_allclose(measured.increment, expected.increment, atol=1e-4)


def test_double_precision_is_available_on_request(short: Any, expected: Any) -> None:
    double = track(short.images, short.circle, dtype=torch.float64, sphere_map=False)
    assert double.settings["dtype"] == "float64"
    np.testing.assert_allclose(double.increment, expected.increment, atol=4e-4)  # convergence stops within 2e-4 px


def test_a_given_circle_is_kept_and_refined_on_request_only(short: Any) -> None:
    # Without a map of the ball, which corrects any circle.
    x, y, radius = short.circle
    off = (x + 0.8, y - 0.6, radius + 0.7)
    kept = track(short.images, off, sphere_map=False).circle
    assert (kept.x, kept.y, kept.radius) == off
    assert np.isnan(kept.sd_radius)
    refined = track(short.images, off, refine=True, sphere_map=False).circle
    assert max(abs(refined.x - x), abs(refined.y - y), abs(refined.radius - radius)) < 0.5  # as for circles found
    same = track(short.images, Circle(*off), sphere_map=False).circle
    assert same == Circle(*off)


def test_a_circle_that_one_image_in_perspective_does_not_confirm_is_followed_if_it_was_found() -> None:
    # The blotches touch the ball.
    made = shot(n=12, background=textured(1, 3.0, 30), step=(8.4, 0.2))
    found = track(made.images, model="pinhole", camera=Camera(distance_radii=20.0))
    assert abs(found.circle.radius - made.radius) < 3 * found.circle.sd_radius
    with pytest.raises(ValueError, match="track with the circle as given"):
        track(made.images, (86.9, 120.5, 53.9), model="pinhole", camera=Camera(distance_radii=20.0), refine=True)


def test_an_ignored_occlusion_does_no_harm(short: Any) -> None:
    images = short.images.clone()
    ignore = np.zeros(images.shape[1:], bool)
    ignore[100:110, :] = True
    images[:, 100:110] = 250
    measured = track(images, short.circle, ignore=ignore, sphere_map=False)
    assert set(measured.status) == {"ok"}
    # An eighth of the ball is missing: a little more noise than 0.005 px and 0.008 deg; five pairs at three of it.
    errors = np.abs(increment_errors(measured, short))
    assert errors[:, :2].max() < 0.02
    assert errors[:, 2:].max() < 0.03


def test_backwards_in_time_the_motion_is_the_opposite(short: Any, expected: Any) -> None:
    x, y = short.centres[-1].tolist()
    back = track(short.images.flip(0), (x, y, short.radius), sphere_map=False).increment[::-1]
    off = np.abs(expected.increment + back)
    # The noise is the same both ways, the gradients belong to the other image: a share of 0.005 px and 0.008 deg.
    assert off[:, :2].max() < 0.01
    assert np.rad2deg(off[:, 2:]).max() < 0.015


@pytest.mark.parametrize("noise", [0.0, 20.0])
def test_a_circle_in_an_empty_image_gives_no_path(noise: float) -> None:
    images = torch.stack([noisy(torch.full((192, 320), 128.0), noise, seed) for seed in range(5)])
    measured = track(images, (120.0, 92.0, 40.0), sphere_map=False)
    assert np.isin(measured.status[1:], ["low_correlation", "lost"]).all()
    assert np.isnan(measured.position[1:]).all()


def empty_image(image: torch.Tensor, kind: str, seed: int = 0) -> torch.Tensor:
    """An image of the same size that shows no ball."""
    noise = torch.randn(image.shape, generator=torch.Generator().manual_seed(seed))
    return {"blank": torch.zeros_like(image), "dark": 5 + 2 * noise, "no number": torch.nan * image}[kind]


@pytest.mark.parametrize("kind", ["blank", "dark", "no number"])
def test_a_first_frame_without_a_ball_is_lost_whatever_circle_was_given(short: Any, kind: str) -> None:
    images = short.images.clone()
    images[0] = empty_image(images[0], kind)
    measured = track(images, short.circle, sphere_map=False)
    assert measured.status[0] == "lost"
    assert np.isnan(measured.position[0]).all()
    assert np.isnan(measured.orientation[0]).all()
    # The outline gives the ball in frame 3, and the ball is followed from there.
    assert measured.status.tolist()[3:] == ["lost", "ok", "ok"]
    np.testing.assert_allclose(measured.orientation[3], np.eye(3), atol=1e-12)
    assert np.isfinite(measured.sd_steady).all()
    alone = track(
        torch.stack([empty_image(images[0], kind, seed) for seed in range(3)]), short.circle, sphere_map=False
    )
    assert set(alone.status) <= {"lost", "low_correlation"}
    assert np.isnan(alone.position).all()


def test_a_first_frame_that_shows_the_ball_is_ok_even_if_all_others_are_blank(short: Any) -> None:
    images = short.images.clone()
    images[1:] = 0
    measured = track(images, short.circle, sphere_map=False)
    assert measured.status.tolist() == ["ok"] + ["lost"] * 5
    np.testing.assert_allclose(measured.position[0], short.circle[:2])


def test_a_circle_is_not_fitted_to_values_that_are_not_finite(short: Any) -> None:
    images = short.images.clone()
    images[:, 100, 90] = torch.nan
    with pytest.raises(ValueError, match="not finite"):
        track(images, short.circle, refine=True, sphere_map=False)
    images[:, 100, 90], images[:, 0, 0] = 100, torch.nan
    assert track(images, short.circle, refine=True, sphere_map=False).status[0] == "ok"


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
    "a device that is not supported": (
        {"circle": (40, 40, 20), "device": "meta"},
        "= meta: expected one of cpu, cuda",
    ),
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
def test_invalid_arguments_are_refused_with_a_sentence(change: dict[str, Any], sentence: str) -> None:
    arguments = {"recording": IMAGES} | change
    with pytest.raises(ValueError, match=sentence):
        track(arguments.pop("recording"), **arguments)


@pytest.mark.skipif(torch.cuda.is_available(), reason="a CUDA device is here")
def test_cuda_without_a_cuda_device_is_refused() -> None:
    with pytest.raises(ValueError, match="CUDA"):
        track(IMAGES, (40, 40, 20), device="cuda")


@pytest.mark.skipif(not torch.cuda.is_available(), reason="no CUDA device is here")
def test_cuda_gives_the_same_track(short: Any) -> None:
    cuda, cpu = track(short.images, short.circle, device="cuda"), track(short.images, short.circle)
    np.testing.assert_allclose(cuda.increment, cpu.increment, atol=4e-4)  # convergence stops within 2e-4 px
