"""Ignored regions of the image."""

import imagecodecs
import numpy as np
import pytest
from PIL import Image

from torchsphere.recording.ignore_mask import hides_ball, inside_polygon, read_ignore, without_effect


def test_a_rectangle_covers_the_pixels_with_their_centres_inside() -> None:
    mask = inside_polygon(np.array([[1.5, 0.5], [4.5, 0.5], [4.5, 2.5], [1.5, 2.5]]), (5, 8))
    expected = np.zeros((5, 8), dtype=bool)
    expected[1:3, 2:5] = True
    np.testing.assert_array_equal(mask, expected)


def test_a_concave_polygon_leaves_out_its_bay() -> None:
    mask = inside_polygon(np.array([[0, 0], [10, 0], [10, 10], [5, 5], [0, 10]]) - 0.1, (12, 12))
    assert mask[2, 5]
    assert not mask[8, 5]
    assert mask[8, 1]


def test_polygons_and_mask_images_are_united(tmp_path) -> None:
    image = np.zeros((20, 30), dtype=np.uint8)
    image[0, 0] = 255
    (tmp_path / "mask.png").write_bytes(imagecodecs.png_encode(image))
    mask = read_ignore(["4.5,4.5 8.5,4.5 8.5,8.5 4.5,8.5; 20,10,25,10,25,15", str(tmp_path / "mask.png")], (20, 30))
    assert mask[0, 0]
    assert mask[6, 6]
    assert mask[11, 24]
    assert mask.sum() < 60


@pytest.mark.parametrize("suffix", ["bmp", "pgm", "tif"])
def test_a_mask_may_be_an_image_of_any_kind_without_losses(tmp_path, suffix: str) -> None:
    image = np.zeros((20, 30), dtype=np.uint8)
    image[3:5, 7] = 1
    Image.fromarray(image).save(tmp_path / f"mask.{suffix}")
    np.testing.assert_array_equal(read_ignore([str(tmp_path / f"mask.{suffix}")], (20, 30)), image > 0)


@pytest.mark.parametrize("suffix", ["jpg", "webp"])
def test_a_mask_whose_black_is_no_longer_black_is_refused(tmp_path, suffix: str) -> None:
    Image.fromarray(np.eye(30, dtype=np.uint8) * 255).save(tmp_path / f"mask.{suffix}")
    with pytest.raises(ValueError, match="levels the compression has changed; save the original as PNG"):
        read_ignore([str(tmp_path / f"mask.{suffix}")], (30, 30))


@pytest.mark.parametrize("text", ["1,2 3,4", "a,b c,d e,f", "1,2 3,4 5", "1,2 3,4 nan,5", "missing.png"])
def test_invalid_regions_are_refused(text: str) -> None:
    with pytest.raises((ValueError, OSError), match=text.split(" ", maxsplit=1)[0]):
        read_ignore([text], (20, 30))


def test_a_mask_of_another_size_is_refused(tmp_path) -> None:
    (tmp_path / "mask.png").write_bytes(imagecodecs.png_encode(np.zeros((4, 4), dtype=np.uint8)))
    with pytest.raises(ValueError, match="4 x 4 px"):
        read_ignore([str(tmp_path / "mask.png")], (20, 30))


def test_the_warning_on_a_transparent_mask_says_that_transparency_is_not_read(tmp_path) -> None:
    image = np.zeros((20, 30, 4), dtype=np.uint8)
    image[5:9, 5:9, 3] = 255
    (tmp_path / "alpha.png").write_bytes(imagecodecs.png_encode(image))
    (warning,) = without_effect([str(tmp_path / "alpha.png")], (20, 30))
    assert "transparency is not read" in warning


def test_the_warning_on_a_mask_over_the_ball_states_its_share() -> None:
    ball = inside_polygon(np.array([[2.5, 2.5], [17.5, 2.5], [17.5, 17.5], [2.5, 17.5]]), (20, 30))
    (warning,) = hides_ball(ball, 10.0, 10.0, 5.0, 3)
    assert warning.startswith("`ignore` covers 100 % of the ball in frame 3; ")
    assert "invert" in warning
    assert hides_ball(~ball, 10.0, 10.0, 5.0, 3) == ()
    assert hides_ball(None, 10.0, 10.0, 5.0, 3) == ()


def test_an_empty_region_is_warned_of_and_a_full_region_is_refused(tmp_path) -> None:
    (tmp_path / "black.png").write_bytes(imagecodecs.png_encode(np.zeros((20, 30), dtype=np.uint8)))
    (tmp_path / "white.png").write_bytes(imagecodecs.png_encode(np.full((20, 30), 255, dtype=np.uint8)))
    texts = ["0,0 9,0 9,9", "100,100 110,100 110,110", str(tmp_path / "black.png"), ""]
    warnings = without_effect(texts, (20, 30))
    assert len(warnings) == 3
    assert "`ignore` = '100,100 110,100 110,110' covers no pixel of the 30 x 20 px" in warnings[0]
    assert "black.png" in warnings[1]
    assert "transparency" not in warnings[0]
    assert "its transparency is not read: paint the region white" in warnings[1]
    with pytest.raises(ValueError, match=r"leaves nothing of the recording.* transparency is not read"):
        read_ignore([str(tmp_path / "white.png")], (20, 30))
