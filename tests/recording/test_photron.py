"""Photron MRAW with both kinds of header."""

from pathlib import Path

import numpy as np
import pytest
from writers import write_mraw

from torchsphere.recording import open_recording

RNG = np.random.default_rng(1)


@pytest.mark.parametrize("text", [False, True])
@pytest.mark.parametrize(
    ("bits", "depth", "side"), [(8, 8, "Lower"), (12, 12, "Lower"), (16, 12, "Lower"), (16, 12, "Higher")]
)
def test_every_storage_format_gives_the_written_levels(
    tmp_path: Path, bits: int, depth: int, side: str, text: bool
) -> None:
    images = RNG.integers(0, 2**depth, (5, 6, 8))
    header = write_mraw(tmp_path / "a", images, bits=bits, depth=depth, side=side, text=text)
    for path in (header, tmp_path / "a.mraw"):
        recording = open_recording(path)
        assert (recording.shape, recording.bit_depth, recording.frame_rate) == ((5, 6, 8), depth, 20000)
        np.testing.assert_array_equal(recording.images(0, 5), images)
        np.testing.assert_array_equal(recording.images(3, 4), images[3:4])
        assert set(recording.files) == {header, tmp_path / "a.mraw"}


def test_the_shutter_is_a_time_in_both_headers(tmp_path: Path) -> None:
    images = np.zeros((1, 2, 2), int)
    assert open_recording(write_mraw(tmp_path / "a", images, bits=8, depth=8, text=True)).exposure_s == 1 / 15371
    assert open_recording(write_mraw(tmp_path / "b", images, bits=8, depth=8)).exposure_s == 1 / 50000


def test_the_start_frame_counts_from_the_trigger_only_if_the_header_says_so(tmp_path: Path) -> None:
    images = np.zeros((1, 2, 2), int)
    start = write_mraw(tmp_path / "a", images, bits=8, depth=8, text=True)
    random = write_mraw(tmp_path / "b", images, bits=8, depth=8, text=True, Trigger_Mode="Random")
    assert open_recording(start).trigger_offset_frames == 12
    assert open_recording(random).trigger_offset_frames is None
    assert "number 12" in open_recording(random).notes[0]
    assert open_recording(write_mraw(tmp_path / "c", images, bits=8, depth=8)).trigger_offset_frames == -7


def test_a_saving_step_is_noted_with_its_frame_rate(tmp_path: Path) -> None:
    header = write_mraw(tmp_path / "a", np.zeros((1, 2, 2), int), bits=8, depth=8, text=True, Save_Step="4")
    assert "5000" in open_recording(header).notes[-1]


def test_a_header_without_its_data_is_refused(tmp_path: Path) -> None:
    header = write_mraw(tmp_path / "a", np.zeros((3, 4, 4), int), bits=12, depth=12)
    (tmp_path / "a.mraw").unlink()
    with pytest.raises(FileNotFoundError, match=r"a\.mraw is not beside it"):
        open_recording(header)


def test_cut_data_are_refused_with_the_number_of_whole_images(tmp_path: Path) -> None:
    header = write_mraw(tmp_path / "a", np.zeros((3, 4, 4), int), bits=12, depth=12)
    (tmp_path / "a.mraw").write_bytes(bytes(60))
    with pytest.raises(OSError, match=r"2 whole images .* states 3"):
        open_recording(header)


def test_data_of_another_header_are_refused(tmp_path: Path) -> None:
    header = write_mraw(tmp_path / "a", np.zeros((3, 4, 4), int), bits=12, depth=12)
    (tmp_path / "a.mraw").write_bytes(bytes(73))
    with pytest.raises(OSError, match="do not belong together"):
        open_recording(header)


@pytest.mark.parametrize(("field", "value"), [("Color_Type", "RGB"), ("File_Format", "Tiff"), ("Total_Frame", "many")])
def test_headers_of_other_kinds_are_refused(tmp_path: Path, field: str, value: str) -> None:
    header = write_mraw(tmp_path / "a", np.zeros((1, 2, 2), int), bits=8, depth=8, text=True, **{field: value})
    with pytest.raises(ValueError, match=value):
        open_recording(header)


def test_a_real_packed_recording_is_a_smooth_image(shared_data: Path) -> None:
    recording = open_recording(shared_data / "photron" / "ball_12bit.cihx")
    assert recording.shape == (15, 384, 384)
    assert (recording.frame_rate, recording.exposure_s, recording.bit_depth) == (30000, 1 / 50000, 12)
    ball = recording.images(0, 1)[0, 150:230, 150:230]
    # Neighbours along a row differ as little as along a column; in a wrong order they differ 10 times as much.
    assert np.abs(np.diff(ball, axis=1)).mean() < 1.2 * np.abs(np.diff(ball, axis=0)).mean()


def test_a_real_16_bit_recording_gives_the_facts_of_its_header(shared_data: Path) -> None:
    recording = open_recording(shared_data / "photron" / "beam.cihx")
    assert recording.shape == (4, 80, 1024)
    assert (recording.frame_rate, recording.exposure_s, recording.bit_depth) == (50000, 1 / 200000, 12)
    assert "one of 2500 " in " ".join(recording.notes)
    with pytest.raises(OSError, match="not beside it"):
        open_recording(shared_data / "photron" / "sample_60k_16bit.cih")


@pytest.mark.parametrize("side", ["Lower", "Higher"])
def test_eight_bits_of_a_camera_of_twelve_are_the_levels_as_stored(tmp_path: Path, side: str) -> None:
    images = RNG.integers(0, 256, (3, 6, 8))
    header = write_mraw(tmp_path / "a", images, bits=8, depth=8, text=True, EffectiveBit_Depth="12")
    text = header.read_text("latin-1").replace("EffectiveBit Side : Lower", f"EffectiveBit Side : {side}")
    header.write_text(text, "latin-1")
    with open_recording(header) as recording:
        assert recording.bit_depth == 8
        # The bytes of the file, as pyMRAW returns them for 8 bits per pixel.
        np.testing.assert_array_equal(recording.images(0, 3), images)
        assert "has 12 bits, of which 8 were saved" in recording.notes[0]


def test_a_header_of_nested_tags_is_refused_before_it_becomes_a_tree(tmp_path: Path) -> None:
    header = write_mraw(tmp_path / "a", np.zeros((1, 2, 2), int), bits=8, depth=8)
    header.write_bytes(b"<cih>" + b"<a>" * 100_000 + b"</a>" * 100_000 + b"</cih>")
    with pytest.raises(ValueError, match="has more than 20000 tags"):
        open_recording(header)
