"""Which way is up: the eight ways in which images are stored, in TIFF, video and CINE."""

from pathlib import Path

import numpy as np
import pytest
import tifffile
from stored_images import SIDES, as_stored
from writers import write_cine, write_mov

from torchsphere.recording import open_recording
from torchsphere.recording.orientation import WORDS, after_another, code_of_matrix, turned
from torchsphere.recording.pillow_images import exif_orientation

#: An image as a person sees it, with a leg at its lower left: no turn and no mirror leaves the letter as it is.
F = np.kron(
    np.array([[9, 9, 9, 0], [9, 0, 0, 0], [9, 9, 0, 0], [9, 0, 0, 0], [9, 0, 0, 0]]), 20 * np.ones((3, 3), int)
).astype(np.uint8)


@pytest.mark.parametrize("code", SIDES)
@pytest.mark.parametrize("options", [{}, {"compression": "zlib"}], ids=["plain", "packed"])
def test_a_tiff_is_shown_as_its_tag_says(tmp_path: Path, code: int, options: dict[str, str]) -> None:
    stack = np.stack([as_stored(F, code), as_stored(F, code) // 2])
    tag = [(274, "H", 1, code, False)]
    tifffile.imwrite(tmp_path / "a.tif", stack, photometric="minisblack", metadata=None, extratags=tag, **options)
    with open_recording(tmp_path / "a.tif") as recording:
        np.testing.assert_array_equal(recording.images(0, 2), np.stack([F, F // 2]))
        assert recording.orientation == code
        assert (WORDS[code] in " ".join(recording.notes)) == (code != 1)


@pytest.mark.parametrize("code", [3, 6])
def test_a_folder_and_a_mask_are_shown_as_their_tags_say(tmp_path: Path, code: int) -> None:
    from torchsphere.recording.folder import read_image

    for number in range(3):
        name = tmp_path / f"img{number}.tif"
        tifffile.imwrite(name, as_stored(F, code), metadata=None, extratags=[(274, "H", 1, code, False)])
    with open_recording(tmp_path) as recording:
        np.testing.assert_array_equal(recording.images(1, 3), np.stack([F, F]))
    np.testing.assert_array_equal(read_image(tmp_path / "img0.tif"), F)


@pytest.mark.parametrize("code", SIDES)
@pytest.mark.parametrize("is_after_image", [False, True])
def test_a_folder_of_png_is_shown_as_its_exif_says(tmp_path: Path, code: int, is_after_image: bool) -> None:
    from PIL import Image

    exif = Image.Exif()
    exif[0x0112] = code
    for number in range(2):
        name = tmp_path / f"img{number}.png"
        Image.fromarray(as_stored(F, code)).save(name, exif=exif)
        if is_after_image:
            data = name.read_bytes()
            start, end = data.index(b"eXIf") - 4, data.index(b"IEND") - 4
            length = int.from_bytes(data[start : start + 4], "big") + 12
            chunk = data[start : start + length]
            name.write_bytes(data[:start] + data[start + length : end] + chunk + data[end:])
    with open_recording(tmp_path) as recording:
        np.testing.assert_array_equal(recording.images(0, 2), np.stack([F, F]))
        assert (WORDS[code] in " ".join(recording.notes)) == (code != 1)


def test_exif_that_cannot_be_read_turns_nothing() -> None:
    for data in (b"", b"Exif", b"II*\0", bytes(40), b"MM\0*" + b"\xff" * 30):
        assert exif_orientation(data) == 1


def test_images_that_are_stored_in_different_ways_are_refused(tmp_path: Path) -> None:
    for number, code in enumerate((1, 3)):
        tag = [(274, "H", 1, code, False)]
        tifffile.imwrite(tmp_path / f"{number}.tif", F, metadata=None, extratags=tag)
    with pytest.raises(ValueError, match="turned by 180 deg"):
        open_recording(tmp_path)


#: Display matrices (a, b, c, d) by the code of the same way; a point (x, y) is shown at (a x + c y, b x + d y).
MATRICES = {
    1: (1, 0, 0, 1),
    2: (-1, 0, 0, 1),
    3: (-1, 0, 0, -1),
    4: (1, 0, 0, -1),
    5: (0, 1, 1, 0),
    6: (0, 1, -1, 0),
    7: (0, -1, -1, 0),
    8: (0, -1, 1, 0),
}


@pytest.mark.parametrize("code", MATRICES)
def test_a_video_is_shown_as_its_matrix_says(tmp_path: Path, code: int) -> None:
    pytest.importorskip("av", reason="PyAV is not installed")
    stack = np.stack([as_stored(F, code)] * 3)
    path = write_mov(tmp_path / "a.mov", stack, matrix=MATRICES[code])
    with open_recording(path) as recording:
        np.testing.assert_array_equal(recording.images(0, 3), np.stack([F] * 3))
        assert (WORDS[code] in " ".join(recording.notes)) == (code != 1)


def test_a_matrix_sends_a_point_where_its_code_shows_it() -> None:
    image = np.zeros((1, 4, 6))
    image[0, 1, 4] = 1
    for code, (a, b, c, d) in MATRICES.items():
        shown = turned(image, code)[0]
        y, x = np.argwhere(shown == 1)[0]
        # The matrix turns about the first pixel; the image is then moved back into view.
        corners = np.array([(a * u + c * v, b * u + d * v) for u in (0, 5) for v in (0, 3)])
        assert (x, y) == tuple(np.array([a * 4 + c * 1, b * 4 + d * 1]) - corners.min(0))
        assert code_of_matrix([[a, c], [b, d]]) == code


def test_a_matrix_of_half_a_right_angle_is_said_and_not_applied(tmp_path: Path) -> None:
    pytest.importorskip("av", reason="PyAV is not installed")
    assert code_of_matrix([[1, -1], [1, 1]]) is None
    with open_recording(write_mov(tmp_path / "a.mov", F[None].repeat(2, 0), matrix=(1, 1, -1, 1))) as recording:
        assert recording.shape[1:] == F.shape
        assert "right angles" in " ".join(recording.notes)


@pytest.mark.parametrize(
    ("flip", "rotate", "code"),
    [
        ((0, 0), 0, 1),
        ((1, 0), 0, 2),
        ((0, 1), 0, 4),
        ((1, 1), 0, 3),
        ((0, 0), 90, 8),
        ((0, 0), -90, 6),
        ((1, 0), 90, 5),
    ],
)
def test_a_cine_is_mirrored_then_rotated(tmp_path: Path, flip: tuple[int, int], rotate: int, code: int) -> None:
    # Angles are positive counterclockwise.
    stack = as_stored(F, code)[None].repeat(2, 0)
    with open_recording(write_cine(tmp_path / "a.cine", stack, bits=16, flip=flip, rotate=rotate)) as recording:
        np.testing.assert_array_equal(recording.images(0, 2), F[None].repeat(2, 0))
        assert recording.orientation == code


def test_an_odd_angle_of_a_cine_is_said(tmp_path: Path) -> None:
    path = write_cine(tmp_path / "a.cine", F[None].repeat(2, 0).astype(int), bits=8, rotate=30)
    with open_recording(path) as recording:
        assert "rotated by 30 deg" in " ".join(recording.notes)
        np.testing.assert_array_equal(recording.images(0, 1)[0], F)


def test_two_steps_after_another_are_one() -> None:
    image = np.arange(12.0).reshape(1, 3, 4)
    for first in SIDES:
        for second in SIDES:
            both = turned(turned(image, first), second)
            np.testing.assert_array_equal(turned(image, after_another(first, second)), both)
