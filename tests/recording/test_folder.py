"""Folders of images."""

from pathlib import Path

import imagecodecs
import numpy as np
import pytest
import tifffile

from torchsphere.recording import open_recording

IMAGES = np.random.default_rng(7).integers(0, 4096, (12, 8, 10)).astype(np.uint16)


def write_png(path: Path, image: np.ndarray) -> None:
    path.write_bytes(imagecodecs.png_encode(image))


@pytest.mark.parametrize("suffix", ["tif", "png", "PNG"])
@pytest.mark.parametrize("dtype", [np.uint8, np.uint16])
def test_images_come_in_the_natural_order_of_their_names(tmp_path: Path, suffix: str, dtype: type) -> None:
    for k, image in enumerate(IMAGES.astype(dtype)):
        (tifffile.imwrite if suffix == "tif" else write_png)(tmp_path / f"img{k}.{suffix}", image)
    recording = open_recording(tmp_path)
    np.testing.assert_array_equal(recording.images(0, 12), IMAGES.astype(dtype))
    np.testing.assert_array_equal(recording.images(9, 11), IMAGES.astype(dtype)[9:11])
    assert (recording.frame_rate, len(recording.files)) == (None, 12)


@pytest.mark.parametrize("channels", [3, 4])
def test_colour_becomes_grey_and_transparency_is_ignored(tmp_path: Path, channels: int) -> None:
    colour = np.random.default_rng(8).integers(0, 256, (6, 7, channels)).astype(np.uint8)
    write_png(tmp_path / "a.png", colour)
    recording = open_recording(tmp_path)
    np.testing.assert_allclose(recording.images(0, 1)[0], colour[..., :3] @ [0.299, 0.587, 0.114], rtol=1e-6)


def test_the_refusal_of_an_image_of_another_size_names_the_file(tmp_path: Path) -> None:
    write_png(tmp_path / "a1.png", IMAGES[0])
    write_png(tmp_path / "a2.png", IMAGES[0, :4])
    with pytest.raises(ValueError, match=r"a2\.png"):
        open_recording(tmp_path)


def test_the_refusal_of_an_image_of_another_kind_names_the_file(tmp_path: Path) -> None:
    write_png(tmp_path / "a1.png", IMAGES[0])
    tifffile.imwrite(tmp_path / "a2.tif", IMAGES[0])
    with pytest.raises(ValueError, match=r"a2\.tif"):
        open_recording(tmp_path)


def test_other_files_are_ignored_and_other_images_noted(tmp_path: Path) -> None:
    write_png(tmp_path / "a1.png", IMAGES[0])
    (tmp_path / "notes.txt").write_text("x")
    (tmp_path / "._a1.png").write_text("x")
    (tmp_path / "preview.jpg").write_text("x")
    recording = open_recording(tmp_path)
    assert len(recording) == 1
    assert [note for note in recording.notes if "ignored" in note] == ["1 .jpg files in the folder were ignored."]


def test_an_empty_folder_is_refused(tmp_path: Path) -> None:
    with pytest.raises(ValueError, match="which is empty"):
        open_recording(tmp_path)


def test_the_refusal_of_a_misnamed_image_states_its_type(tmp_path: Path) -> None:
    write_png(tmp_path / "a.tif", IMAGES[0])
    with pytest.raises(ValueError, match="a PNG image"):
        open_recording(tmp_path)


@pytest.mark.parametrize(
    ("numbers", "missing"),
    [
        ((1, 2, 5, 6), "2 of the numbered images are missing, the first of them between "),
        ((2, 4, 8), "1 of the numbered images is missing, between "),
        ((1, 3, 5), ""),
        ((7,), ""),
    ],
)
def test_missing_numbers_are_noted(tmp_path: Path, numbers: tuple[int, ...], missing: str) -> None:
    for number in numbers:
        write_png(tmp_path / f"run2_{number:04d}.png", IMAGES[0])
    notes = " ".join(open_recording(tmp_path).notes)
    assert ("missing" in notes) == bool(missing)
    assert missing in notes
