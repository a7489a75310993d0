"""Images as a player shows them: what files state of their pixels is applied, and said."""

from fractions import Fraction
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import tifffile
from stored_images import as_stored, mosaic_of
from writers import write_cine, write_mov

from torchsphere.recording import open_recording
from torchsphere.recording.display import ratio
from torchsphere.recording.mosaic import green
from torchsphere.recording.square_pixels import with_square_pixels

IMAGES = np.random.default_rng(8).integers(0, 255, (3, 24, 30)).astype(np.uint8)
RATIOS = (Fraction(11, 10), Fraction(9, 10), Fraction(4, 3))


def write_tiff(path: Path, aspect: Fraction, **options: Any) -> Path:
    resolution = (100 * aspect.denominator, 100 * aspect.numerator)
    tifffile.imwrite(path, IMAGES, photometric="minisblack", resolution=resolution, **options)
    return path


def write_folder(path: Path, aspect: Fraction) -> Path:
    path.mkdir()
    for number, image in enumerate(IMAGES):
        tifffile.imwrite(
            path / f"{number}.tif", image, resolution=(aspect.denominator, aspect.numerator), resolutionunit="INCH"
        )
    return path


def write_png(path: Path, aspect: Fraction) -> Path:
    from PIL import Image

    path.mkdir()
    for number, image in enumerate(IMAGES):
        Image.fromarray(image).save(path / f"{number}.png", dpi=(100 * aspect.denominator, 100 * aspect.numerator))
    return path


def write_ome(path: Path, aspect: Fraction) -> Path:
    sides = {
        "PhysicalSizeX": float(5 * aspect),
        "PhysicalSizeY": 5.0,
        "PhysicalSizeXUnit": "mm",
        "PhysicalSizeYUnit": "mm",
    }
    tifffile.imwrite(path, IMAGES, ome=True, photometric="minisblack", metadata={"axes": "TYX", **sides})
    return path


def write_phantom(path: Path, aspect: Fraction) -> Path:
    per_m = (1000 * aspect.denominator, 1000 * aspect.numerator)
    return write_cine(path, IMAGES.astype(int), bits=8, pixels_per_m=per_m)


def write_video(path: Path, aspect: Fraction) -> Path:
    pytest.importorskip("av", reason="PyAV is not installed")
    return write_mov(path, IMAGES, aspect=aspect)


WRITERS = {
    "a.tif": write_tiff,
    "tiffs": write_folder,
    "pngs": write_png,
    "a.ome.tif": write_ome,
    "a.cine": write_phantom,
    "a.mov": write_video,
}


@pytest.mark.parametrize("aspect", RATIOS, ids=str)
@pytest.mark.parametrize("name", WRITERS)
def test_stated_pixels_are_drawn_square_and_said(tmp_path: Path, name: str, aspect: Fraction) -> None:
    with open_recording(WRITERS[name](tmp_path / name, aspect)) as recording:
        # PNG counts pixels per metre in whole numbers.
        assert recording.pixel_aspect == pytest.approx(float(aspect), rel=2e-4)
        assert recording.pixel_aspect is not None
        expected = with_square_pixels(IMAGES, recording.pixel_aspect)
        np.testing.assert_array_equal(recording.images(0, 3), expected)
        assert recording.shape == expected.shape
        note = " ".join(recording.notes)
        assert "as the file states" in note
        assert f"{expected.shape[2]} x {expected.shape[1]} px in place of 30 x 24" in note


@pytest.mark.parametrize("name", WRITERS)
def test_square_pixels_change_nothing(tmp_path: Path, name: str) -> None:
    with open_recording(WRITERS[name](tmp_path / name, Fraction(1))) as recording:
        np.testing.assert_array_equal(recording.images(0, 3), IMAGES)
        assert recording.stored is recording
        assert "square" not in " ".join(recording.notes)


def test_a_resolution_without_a_unit_states_a_ratio(tmp_path: Path) -> None:
    with open_recording(write_tiff(tmp_path / "a.tif", Fraction(6, 5), resolutionunit="NONE")) as recording:
        assert recording.shape == (3, 24, 36)


def test_a_ratio_that_no_camera_has_is_doubted_and_not_used(tmp_path: Path) -> None:
    with open_recording(write_tiff(tmp_path / "a.tif", Fraction(25, 2))) as recording:
        assert recording.shape == IMAGES.shape
        assert recording.pixel_aspect is None
        assert "no camera has" in " ".join(recording.notes)
        assert "`pixel_aspect`" in " ".join(recording.notes)


def test_a_given_ratio_wins_and_a_contradiction_is_said(tmp_path: Path) -> None:
    path = write_tiff(tmp_path / "a.tif", Fraction(11, 10))
    with open_recording(path, pixel_aspect=1.0) as recording:
        np.testing.assert_array_equal(recording.images(0, 3), IMAGES)
        assert "11:10" in " ".join(recording.notes)
    with open_recording(path, pixel_aspect=0.8) as recording:
        assert recording.shape == (3, 30, 30)
        assert "as given" in " ".join(recording.notes)


@pytest.mark.parametrize("aspect", [0.0, -1.0, 9.0, float("nan"), "1.1"])
def test_a_ratio_out_of_range_is_refused(tmp_path: Path, aspect: Any) -> None:
    path = write_tiff(tmp_path / "a.tif", Fraction(1))
    with pytest.raises(ValueError, match=r"pixel_aspect.*expected a number from 0.25 to 4"):
        open_recording(path, pixel_aspect=aspect)


@pytest.mark.parametrize("code", [5, 6, 7, 8])
def test_a_portrait_image_with_long_pixels_is_turned_and_then_enlarged(tmp_path: Path, code: int) -> None:
    stored = np.stack([as_stored(image, code) for image in IMAGES])
    tag = [(274, "H", 1, code, False)]
    tifffile.imwrite(
        tmp_path / "a.tif", stored, photometric="minisblack", metadata=None, extratags=tag, resolution=(10, 11)
    )
    # A stored pixel is 11:10 wide, so that a shown one is 11:10 high.
    with open_recording(tmp_path / "a.tif") as recording:
        np.testing.assert_array_equal(recording.images(0, 3), with_square_pixels(IMAGES, 10 / 11))
        assert "as stored" in " ".join(recording.notes)


def write_cfa(path: Path, codes: tuple[int, int, int, int]) -> None:
    tags = [(33421, "H", 2, (2, 2), True), (33422, "B", 4, bytes(codes), True)]
    with tifffile.TiffWriter(path) as tif:
        for image in IMAGES:
            tif.write(image, photometric="cfa", metadata=None, extratags=tags)


def test_a_mosaic_of_a_tiff_is_measured_on_its_green_pixels(tmp_path: Path) -> None:
    write_cfa(tmp_path / "a.tif", (1, 2, 0, 1))
    with open_recording(tmp_path / "a.tif") as recording:
        assert recording.bayer == "GBRG"
        np.testing.assert_array_equal(recording.images(0, 3), green(IMAGES, "GBRG"))
        assert "GBRG as the file states (TIFF CFAPattern)" in " ".join(recording.notes)


def test_another_mosaic_of_a_tiff_is_refused(tmp_path: Path) -> None:
    write_cfa(tmp_path / "a.tif", (3, 4, 5, 1))
    with pytest.raises(ValueError, match="photometric code 32803"):
        open_recording(tmp_path / "a.tif")


@pytest.mark.parametrize(("code", "pattern"), [(3, "GBRG"), (4, "RGGB"), (5, "GRBG"), (6, "BGGR")])
def test_a_mosaic_of_a_cine_is_measured_on_its_green_pixels(tmp_path: Path, code: int, pattern: str) -> None:
    colours = np.stack([IMAGES // 2, IMAGES, 255 - IMAGES])
    images = mosaic_of(*colours, pattern).astype(int)
    with open_recording(write_cine(tmp_path / "a.cine", images, bits=16, mosaic=code)) as recording:
        assert recording.bayer == pattern
        np.testing.assert_array_equal(recording.images(0, 3), green(images, pattern))


def test_a_given_mosaic_wins_and_is_refused_for_colour_images(tmp_path: Path) -> None:
    tifffile.imwrite(tmp_path / "a.tif", IMAGES, photometric="minisblack")
    with open_recording(tmp_path / "a.tif", bayer="GRBG") as recording:
        np.testing.assert_array_equal(recording.images(0, 3), green(IMAGES, "GRBG"))
        assert recording.origins["bayer"] == "given"
    tifffile.imwrite(tmp_path / "c.tif", np.zeros((2, 8, 8, 3), np.uint8), photometric="rgb")
    with pytest.raises(ValueError, match="colour images, no mosaic"):
        open_recording(tmp_path / "c.tif", bayer="RGGB")
    with pytest.raises(ValueError, match="expected one of RGGB"):
        open_recording(tmp_path / "a.tif", bayer="RGB")


def test_ratios_are_said_in_small_numbers() -> None:
    assert [ratio(value) for value in (1.1, 10 / 11, 64 / 45, 1.08371)] == ["11:10", "10:11", "64:45", "1.0837:1"]
