"""The order of the axes of an array of images: given, by the kind of the file, and doubted."""

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from scipy.io import savemat
from scipy.ndimage import gaussian_filter

from torchsphere import track
from torchsphere.recording import open_recording
from torchsphere.settings.choices import AXES
from torchsphere.settings.limits import SettingError

IMAGES = np.random.default_rng(3).integers(0, 4096, (9, 11, 13)).astype(np.uint16)
HEIGHT, WIDTH = 48, 72


def turned(images: np.ndarray, order: str) -> np.ndarray:
    """Images (n, h, w) or (n, h, w, c) with their axes in that order."""
    return images.transpose(["nhwc".index(letter) for letter in order])


def film(
    background: float | np.ndarray, step: float, *, count: int = 24, noise: float = 1.0, radius: float = 10.0
) -> np.ndarray:
    """A speckled ball (n, h, w) that crosses the image by ``step`` px per frame, before a still background."""
    rng = np.random.default_rng(2)
    spots = 45 * gaussian_filter(rng.normal(size=(HEIGHT, 400)), 1.5) / 0.19
    y, x = np.mgrid[:HEIGHT, :WIDTH]
    images = np.broadcast_to(background, (count, HEIGHT, WIDTH)) + noise * rng.normal(size=(count, HEIGHT, WIDTH))
    for k, image in enumerate(images):
        at = 12 + step * k
        ball = np.hypot(x - at, y - 22 - 0.1 * step * k) < radius
        image[ball] = 140 + np.roll(spots, round(at), 1)[:, :WIDTH][ball]
    return images.round().clip(0, 255).astype(np.uint8)


def backgrounds() -> dict[str, float | np.ndarray]:
    rng = np.random.default_rng(4)
    x = np.arange(WIDTH)
    blotches = gaussian_filter(rng.normal(size=(HEIGHT, WIDTH)), 4)
    return {
        "plain": 60.0,
        "blotches": 90 + 25 * blotches / blotches.std(),
        "upright stripes": 90 + 30 * np.sin(x / 2),
        "level stripes": (90 + 30 * np.sin(np.arange(HEIGHT) / 2))[:, None],
        "plate": np.where(x > 60, 190.0, 60.0),
        "light from one side": 50.0 + x,
    }


@pytest.fixture(scope="module", params=[(name, step) for name in backgrounds() for step in (0.0, 0.5, 2.0)], ids=str)
def scene(request: pytest.FixtureRequest) -> np.ndarray:
    name, step = request.param
    return film(backgrounds()[name], step)


def test_images_in_their_order_are_not_doubted(tmp_path: Path, scene: np.ndarray) -> None:
    np.save(tmp_path / "a.npy", scene)
    assert open_recording(tmp_path / "a.npy").doubt == ""
    savemat(tmp_path / "a.mat", {"a": turned(scene, "hwn")})
    assert open_recording(tmp_path / "a.mat").doubt == ""


def test_images_in_another_order_are_doubted_with_the_option_that_turns_them(tmp_path: Path, scene: np.ndarray) -> None:
    stored = turned(scene, "hwn")
    np.save(tmp_path / "a.npy", stored)
    np.save(tmp_path / "f.npy", np.asfortranarray(stored))
    np.savez(tmp_path / "a.npz", stored)
    for name in ("a.npy", "f.npy", "a.npz"):
        recording = open_recording(tmp_path / name)
        assert recording.shape == stored.shape
        sentence = recording.notes[-1]
        assert f"The array {stored.shape} is taken as (n, h, w) and looks like (h, w, n)" in sentence
        assert "give `axes` = hwn to turn it, or `axes` = nhw if it is right as it is" in sentence
    np.testing.assert_array_equal(open_recording(tmp_path / "a.npy", axes="hwn")[:], scene)
    savemat(tmp_path / "a.mat", {"a": scene})
    assert "looks like (n, h, w): give `axes` = nhw" in open_recording(tmp_path / "a.mat").doubt


def test_levels_in_floating_point_are_doubted_alike(tmp_path: Path) -> None:
    images = film(60.0, 2.0) / 255.0
    np.save(tmp_path / "right.npy", images)
    np.save(tmp_path / "turned.npy", turned(images, "hwn"))
    assert open_recording(tmp_path / "right.npy").doubt == ""
    assert "looks like (h, w, n)" in open_recording(tmp_path / "turned.npy").doubt


def test_images_in_colour_are_turned_and_doubted(tmp_path: Path) -> None:
    grey = film(60.0, 2.0)
    colour = np.stack((grey, grey[::-1], grey), -1)
    expected = colour @ [0.299, 0.587, 0.114]
    for name, stored in (("right", colour), ("hwnc", turned(colour, "hwnc")), ("hwcn", turned(colour, "hwcn"))):
        np.save(tmp_path / f"{name}.npy", stored)
    assert open_recording(tmp_path / "right.npy").doubt == ""
    assert "looks like (h, w, n)" in open_recording(tmp_path / "hwnc.npy").doubt
    with pytest.raises(SettingError, match=r"shape \(48, 72, 3, 24\), .* give axes = hwn if they are \(h, w, 3, n\)"):
        open_recording(tmp_path / "hwcn.npy")
    for name in ("hwnc", "hwcn"):
        found = open_recording(tmp_path / f"{name}.npy", axes="hwn").images(3, 5)
        np.testing.assert_allclose(found, expected[3:5], rtol=1e-6)
    savemat(tmp_path / "a.mat", {"a": turned(colour, "hwcn")})
    recording = open_recording(tmp_path / "a.mat")
    assert (recording.shape, recording.doubt) == (grey.shape, "")
    np.testing.assert_allclose(recording.images(3, 5), expected[3:5], rtol=1e-6)


@pytest.mark.parametrize("axes", ["nhw", "hwn"])
def test_axes_that_are_given_are_not_doubted(tmp_path: Path, axes: str) -> None:
    np.save(tmp_path / "a.npy", turned(film(90.0, 2.0), "hwn"))
    recording = open_recording(tmp_path / "a.npy", axes=axes)
    assert (recording.doubt, len(recording)) == ("", HEIGHT if axes == "nhw" else 24)


def test_columns_of_three_numbers_are_doubted_as_no_ball_shows_in_them(tmp_path: Path) -> None:
    np.save(tmp_path / "a.npy", np.zeros((40, 50, 3), np.uint8))
    assert "looks like (h, w, n)" in open_recording(tmp_path / "a.npy").doubt


@pytest.mark.parametrize("values", [np.zeros((9, 11, 13)), np.full((9, 11, 13), np.inf), np.zeros((2, 3, 4), np.uint8)])
def test_an_array_without_a_picture_is_not_doubted(tmp_path: Path, values: np.ndarray) -> None:
    np.save(tmp_path / "a.npy", np.where(np.arange(values.shape[0])[:, None, None] > 3, values, 0))
    assert open_recording(tmp_path / "a.npy").doubt == ""


@pytest.mark.parametrize("axes", AXES)
@pytest.mark.parametrize("store", ["C", "F", "mat"])
def test_every_order_gives_the_images(tmp_path: Path, axes: str, store: str) -> None:
    stored = np.asarray(turned(IMAGES, axes), order="F" if store == "F" else "C")
    path = tmp_path / f"a.{'mat' if store == 'mat' else 'npy'}"
    if store == "mat":
        savemat(path, {"images": stored})
    else:
        np.save(path, stored)
    with open_recording(path, axes=axes) as recording:
        for start, stop in ((0, 9), (4, 6), (2, 3)):
            np.testing.assert_array_equal(recording.images(start, stop), IMAGES[start:stop])


def test_images_in_an_order_that_is_read_in_blocks_come_whole(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("torchsphere.recording.stack.BLOCK_BYTES", 4 * IMAGES[0].nbytes)
    np.save(tmp_path / "a.npy", turned(IMAGES, "hwn"))
    recording = open_recording(tmp_path / "a.npy", axes="hwn")
    for start, stop in ((0, 9), (3, 5), (8, 9), (0, 1), (1, 9)):
        np.testing.assert_array_equal(recording.images(start, stop), IMAGES[start:stop])
    # What the caller changes does not come back.
    recording.images(0, 2)[:] = -1
    np.testing.assert_array_equal(recording.images(0, 2), IMAGES[:2])


def test_a_refusal_of_the_track_tells_the_doubt_too(tmp_path: Path) -> None:
    np.save(tmp_path / "a.npy", turned(film(90.0, 2.0), "hwn"))
    recording = open_recording(tmp_path / "a.npy")
    for circle in (None, (60.0, 22.0, 10.0)):
        with pytest.raises(SettingError, match=r"; the array .* looks like \(h, w, n\): give axes = hwn") as refused:
            track(recording, circle, frames=(0, 20))
        assert "give --axes hwn to turn it" in refused.value.as_options()


@pytest.mark.parametrize(
    ("make", "words"),
    [
        (lambda folder: (folder / "a").mkdir() or folder / "a", "which is no array; leave it out"),
        (lambda folder: folder / "a.cine", "which is no array"),
    ],
)
def test_axes_of_other_files_than_arrays_are_refused(tmp_path: Path, make: Callable[[Path], Path], words: str) -> None:
    path = make(tmp_path)
    if path.suffix:
        path.write_bytes(b"CI\x2c\0")
    with pytest.raises(ValueError, match=words):
        open_recording(path, axes="hwn")


def test_unknown_axes_are_refused(tmp_path: Path) -> None:
    with pytest.raises(ValueError, match="axes = 'hxn': expected one of nhw, hwn"):
        open_recording(tmp_path, axes="hxn")


def test_an_archive_whose_images_do_not_stand_along_its_first_axis_is_refused(tmp_path: Path) -> None:
    np.savez(tmp_path / "a.npz", turned(IMAGES, "hwn"))
    with pytest.raises(ValueError, match="images do not stand along the first axis; save them as an NPY file"):
        open_recording(tmp_path / "a.npz", axes="hwn")
