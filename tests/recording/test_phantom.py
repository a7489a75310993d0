"""Phantom CINE: values, orientation, headers."""

from pathlib import Path

import numpy as np
import pytest
from writers import write_cine

from torchsphere.recording import open_recording
from torchsphere.recording.levels import linear_12_bit

RNG = np.random.default_rng(2)


@pytest.mark.parametrize("bits", [8, 12, 16])
def test_levels_and_orientation_are_as_written(tmp_path: Path, bits: int) -> None:
    images = RNG.integers(0, 2**bits, (4, 6, 8))
    recording = open_recording(write_cine(tmp_path / "a.cine", images, bits=bits, annotation=b"12345678"))
    np.testing.assert_array_equal(recording.images(0, 4), images)
    np.testing.assert_array_equal(recording.images(2, 3), images[2:3])


def test_ten_bit_codes_are_linearised_and_noted(tmp_path: Path) -> None:
    codes = np.arange(1024).reshape(2, 16, 32)
    recording = open_recording(write_cine(tmp_path / "a.cine", codes, bits=10, real_bits=10))
    np.testing.assert_array_equal(recording.images(0, 2), linear_12_bit()[codes])
    assert recording.bit_depth == 12
    assert "linearised" in recording.notes[0]


def test_the_table_has_the_known_fixed_points() -> None:
    table = linear_12_bit()
    assert table[[0, 64, 451, 624, 1014, 1015, 1023]].tolist() == [2, 64, 781, 1481, 4064, 4095, 4095]
    assert (np.diff(table.astype(int)) >= 0).all()


@pytest.mark.parametrize("version", [0, 1])
def test_a_negative_height_means_rows_from_the_top(tmp_path: Path, version: int) -> None:
    images = RNG.integers(0, 2**12, (2, 6, 8))
    path = write_cine(tmp_path / "a.cine", images, bits=16, real_bits=12, top_down=True, version=version)
    recording = open_recording(path)
    np.testing.assert_array_equal(recording.images(0, 2), images)
    assert recording.bit_depth == 12


def test_colour_becomes_grey_with_the_stated_weights(tmp_path: Path) -> None:
    colour = RNG.integers(0, 256, (2, 4, 4, 3))
    recording = open_recording(write_cine(tmp_path / "a.cine", colour, bits=24))
    np.testing.assert_allclose(recording.images(0, 2), colour @ [0.114, 0.587, 0.299], rtol=1e-6)
    assert "0.299" in recording.notes[0]


@pytest.mark.parametrize("code", [1, 2, 7])
def test_a_mosaic_that_is_wider_than_two_pixels_is_refused(tmp_path: Path, code: int) -> None:
    path = write_cine(tmp_path / "a.cine", np.zeros((1, 4, 4), int), bits=16, mosaic=code)
    with pytest.raises(ValueError, match=f"mosaic of code {code}"):
        open_recording(path)


def test_the_header_gives_rate_exposure_and_trigger(tmp_path: Path) -> None:
    recording = open_recording(write_cine(tmp_path / "a.cine", np.zeros((1, 4, 4), int), bits=8))
    assert (recording.frame_rate, recording.exposure_s, recording.trigger_offset_frames) == (70000, 2.5e-6, -42)
    assert set(recording.origins) == {"bit_depth", "frame_rate", "exposure_s", "trigger_offset_frames"}


def test_a_cut_file_is_refused(tmp_path: Path) -> None:
    path = write_cine(tmp_path / "a.cine", np.zeros((9, 16, 16), int), bits=16)
    path.write_bytes(path.read_bytes()[:-600])
    with pytest.raises(OSError, match="is cut"):
        open_recording(path)


def test_a_header_that_states_a_billion_images_is_refused(tmp_path: Path) -> None:
    path = write_cine(tmp_path / "a.cine", np.zeros((1, 4, 4), int), bits=8)
    data = bytearray(path.read_bytes())
    data[20:24] = (10**9).to_bytes(4, "little")
    path.write_bytes(data)
    with pytest.raises(OSError, match="states 1000000000"):
        open_recording(path)


@pytest.mark.parametrize(
    ("name", "shape", "depth", "rate", "exposure", "first"),
    [
        # The set-up states 90000 frames/s; every tenth image was kept, as its own times say.
        ("pims_cine_781", (15, 256, 256), 12, pytest.approx(9003.2, rel=1e-5), 9.696e-6, -5417),
        ("pims_cine_legacy", (97, 128, 128), 14, 35087, 1e-6, -7722),
        ("pyidi_small", (235, 32, 256), 12, 100, 7e-5, 0),
    ],
)
def test_real_files_give_the_facts_of_their_headers(
    shared_data: Path, name: str, shape: tuple[int, int, int], depth: int, rate: float, exposure: float, first: int
) -> None:
    recording = open_recording(shared_data / "phantom" / f"{name}.cine")
    assert recording.shape == shape
    assert (recording.bit_depth, recording.frame_rate, recording.trigger_offset_frames) == (depth, rate, first)
    assert recording.exposure_s == pytest.approx(exposure, rel=1e-4)
    # Readers that misplace the first image of these files give an empty image.
    assert recording.images(0, 15).mean(axis=(1, 2)).min() > 50


def test_the_first_pixel_of_the_real_packed_file_is_its_code_through_the_table(shared_data: Path) -> None:
    path = shared_data / "phantom" / "pyidi_small.cine"
    # The first image begins at byte 14152; FFmpeg too reads 624 from its first 10 bits.
    data = path.read_bytes()[14152:14154]
    code = int.from_bytes(data, "big") >> 6
    assert code == 624
    assert open_recording(path).images(0, 1)[0, 0, 0] == 1481
