"""Folders of images."""

from pathlib import Path

import imagecodecs
import numpy as np
import pytest
import tifffile
from PIL import Image

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


LEVELS = np.random.default_rng(9).integers(0, 256, (11, 9, 14), dtype=np.uint8)
#: Options of Pillow with which an image keeps its levels, of a JPEG nearly.
SAVED = {"bmp": {}, "webp": {"lossless": True}, "jpg": {"quality": 95, "subsampling": 0}}


def write_pgm(path: Path, image: np.ndarray, white: int) -> None:
    """A binary PGM with a comment, or a PPM of (h, w, 3)."""
    height, width = image.shape[:2]
    head = f"P{5 if image.ndim == 2 else 6}\n# a camera\n{width} {height}\n{white}\n".encode()
    path.write_bytes(head + image.astype(">u2" if white > 255 else "u1").tobytes())


def smooth(count: int = 11) -> np.ndarray:
    """Images without fine detail, which compression leaves alone."""
    x, y = np.meshgrid(np.arange(32), np.arange(24))
    return np.stack([100 + 60 * np.sin((x + k) / 9) * np.cos(y / 7) for k in range(count)]).round().astype(np.uint8)


@pytest.mark.parametrize("suffix", ["bmp", "webp", "jpg", "pgm"])
@pytest.mark.parametrize("is_colour", [False, True], ids=["grey", "colour"])
def test_images_of_each_kind_come_in_order_with_their_levels(tmp_path: Path, suffix: str, is_colour: bool) -> None:
    levels = smooth() if suffix == "jpg" else LEVELS
    images = np.stack([levels, levels[::-1], levels[:, ::-1]], -1) if is_colour else levels
    for k, image in enumerate(images):
        if suffix == "pgm":
            write_pgm(tmp_path / f"img{k}.pgm", image, 255)
        else:
            Image.fromarray(image).save(tmp_path / f"img{k}.{suffix}", **SAVED[suffix])
    expected = images @ [0.299, 0.587, 0.114] if is_colour else levels
    recording = open_recording(tmp_path)
    assert recording.bit_depth == 8
    assert np.abs(recording.images(0, 11) - expected).max() < (3 if suffix == "jpg" else 1e-3)
    np.testing.assert_array_equal(recording.images(9, 11), recording.images(0, 11)[9:11])
    assert any("lost fine detail" in note for note in recording.notes) == (suffix == "jpg")


@pytest.mark.parametrize(("white", "bits"), [(255, 8), (200, 8), (1023, 10), (4095, 12), (65535, 16)])
def test_a_pgm_has_the_levels_and_the_depth_that_it_states(tmp_path: Path, white: int, bits: int) -> None:
    images = np.random.default_rng(1).integers(0, white + 1, (3, 5, 8))
    for k, image in enumerate(images):
        write_pgm(tmp_path / f"{k}.pgm", image, white)
    recording = open_recording(tmp_path)
    np.testing.assert_array_equal(recording.images(0, 3), images)
    assert recording.bit_depth == bits


@pytest.mark.parametrize(
    ("content", "words"),
    [
        (b"P5\n4 2\n255\n" + bytes(7), "is cut: 7 of the 8 bytes"),
        (b"P2\n4 2\n255\n0 1 2 3 4 5 6 7\n", "as text or as single bits"),
        (b"P5\n4 2\n70000\n" + bytes(8), "states 70000 as its largest level"),
        (b"P5\n4 0\n255\n", "it is damaged"),
        (b"P5\n40000 40000\n255\n" + bytes(8), "it is damaged"),
        (2 * (b"P5\n4 2\n255\n" + bytes(8)), "holds several images"),
        (b"GIF89a" + bytes(30), "looks like a GIF image"),
        (b"", "looks like an empty file"),
    ],
)
def test_other_contents_of_a_pgm_are_refused(tmp_path: Path, content: bytes, words: str) -> None:
    (tmp_path / "a.pgm").write_bytes(content)
    with pytest.raises((ValueError, OSError), match=words):
        open_recording(tmp_path)


def test_images_of_another_largest_level_are_refused(tmp_path: Path) -> None:
    write_pgm(tmp_path / "a1.pgm", LEVELS[0], 255)
    write_pgm(tmp_path / "a2.pgm", LEVELS[1], 254)
    with pytest.raises(ValueError, match=r"a2\.pgm: is .* largest level 254, but a1\.pgm is .* largest level 255"):
        open_recording(tmp_path)


@pytest.mark.parametrize("suffix", ["bmp", "jpg", "webp"])
def test_damaged_and_misnamed_images_are_refused_in_a_sentence(tmp_path: Path, suffix: str) -> None:
    path = tmp_path / f"a.{suffix}"
    Image.fromarray(LEVELS[0]).save(path)
    data = path.read_bytes()
    for content in (data[: len(data) // 2], data[:40], b"", imagecodecs.png_encode(LEVELS[0]), b"some text\n"):
        path.write_bytes(content)
        with pytest.raises((ValueError, OSError), match=rf"a\.{suffix}: ") as refused:
            open_recording(tmp_path).images(0, 1)
        assert "\n" not in str(refused.value)


def test_a_palette_becomes_grey_by_its_colours(tmp_path: Path) -> None:
    colours = [(255, 0, 0), (0, 255, 0), (0, 0, 255), (10, 20, 30)]
    image = Image.fromarray(LEVELS[0] % 4).convert("P")
    image.putpalette([value for colour in colours for value in colour])
    image.save(tmp_path / "a.bmp")
    expected = (np.array(colours) @ [0.299, 0.587, 0.114])[LEVELS[0] % 4]
    np.testing.assert_allclose(open_recording(tmp_path).images(0, 1)[0], expected, rtol=1e-6)


@pytest.mark.parametrize(("mode", "suffix"), [("CMYK", "jpg"), ("1", "bmp")])
def test_pixels_without_grey_levels_are_refused(tmp_path: Path, mode: str, suffix: str) -> None:
    Image.new(mode, (20, 10)).save(tmp_path / f"a.{suffix}")
    with pytest.raises(ValueError, match=f"mode {mode}, expected 8-bit grey or RGB"):
        open_recording(tmp_path)


def test_an_animation_is_no_single_image(tmp_path: Path) -> None:
    first, *others = (Image.fromarray(image).convert("RGB") for image in LEVELS[:3])
    first.save(tmp_path / "a.webp", save_all=True, append_images=others)
    with pytest.raises(ValueError, match="holds 3 images, expected one image per file"):
        open_recording(tmp_path)


@pytest.mark.parametrize("suffix", ["jpg", "webp"])
@pytest.mark.parametrize(
    ("code", "shown"),
    [
        (1, lambda image: image),
        (2, lambda image: image[:, ::-1]),
        (3, lambda image: image[::-1, ::-1]),
        (6, lambda image: image.T[:, ::-1]),  # the first row of the file is the right column of the view
        (8, lambda image: image.T[::-1]),
    ],
)
def test_images_are_turned_as_viewers_show_them(tmp_path: Path, suffix: str, code: int, shown) -> None:
    exif = Image.Exif()
    exif[0x0112] = code
    image = smooth(1)[0]
    Image.fromarray(image).save(tmp_path / f"a.{suffix}", exif=exif, **SAVED[suffix])
    recording = open_recording(tmp_path)
    found = recording.images(0, 1)[0]
    assert found.shape == shown(image).shape
    assert np.abs(found - shown(image)).max() < 3
    assert any("EXIF Orientation" in note for note in recording.notes) == (code != 1)


def test_smaller_images_for_a_quick_look_are_left_out_with_a_note(tmp_path: Path) -> None:
    for k in range(3):
        write_png(tmp_path / f"a{k}.png", IMAGES[k])
        Image.fromarray(LEVELS[k]).save(tmp_path / f"a{k}.jpg")
    recording = open_recording(tmp_path)
    np.testing.assert_array_equal(recording.images(0, 3), IMAGES[:3])
    assert "3 .jpg files in the folder were ignored." in recording.notes
    # More of them than of the others are no previews.
    Image.fromarray(LEVELS[3]).save(tmp_path / "a3.jpg")
    with pytest.raises(ValueError, match=r"a0\.jpg: is of another kind .* the folder holds 4 \.jpg and 3 \.png"):
        open_recording(tmp_path)


def test_the_refusal_of_a_folder_says_what_lies_in_it(tmp_path: Path) -> None:
    for name in (*(f"{k}.gif" for k in range(12)), "a.txt", "b.txt", "c.txt", ".hidden"):
        (tmp_path / name).touch()
    (tmp_path / "sub").mkdir()
    with pytest.raises(ValueError, match=r"holds 12 \.gif, 3 \.txt and a folder; expected the images of one"):
        open_recording(tmp_path)


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
