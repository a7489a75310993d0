"""Times and exposures of the single images of a CINE, against the set-up in its header."""

from pathlib import Path

import numpy as np
import pytest
from writers import write_cine

from torchsphere.recording import open_recording
from torchsphere.recording.frame_range import restrict

COUNT = 30
IMAGES = np.zeros((COUNT, 4, 8), int)
NUMBERS = np.arange(COUNT)


def test_external_sync_with_a_pause_is_read_from_the_images(tmp_path: Path) -> None:
    times = NUMBERS / 1500 + 0.002 * (NUMBERS >= 12)
    path = write_cine(tmp_path / "a.cine", IMAGES, bits=8, rate=1000, times_s=times)
    with open_recording(path) as recording:
        assert recording.frame_rate == pytest.approx(1500, rel=1e-6)
        assert recording.origins["frame_rate"] == "CINE image times (block 1002)"
        np.testing.assert_allclose(recording.times, NUMBERS + 3 * (NUMBERS >= 12), atol=1e-5)
        notes = " ".join(recording.notes)
        assert "1500 frames/s, and the header states 1000" in notes
        assert "before image 12" in notes
        # A part keeps the clock of the whole.
        np.testing.assert_array_equal(restrict(recording, 10, 20).times, recording.times[10:20])


@pytest.mark.parametrize(
    "times", [(), NUMBERS / 70_000, np.floor(NUMBERS / 70_000 * 1e6) / 1e6], ids=["none", "fine", "us"]
)
def test_times_that_agree_with_the_set_up_change_nothing(tmp_path: Path, times: np.ndarray) -> None:
    with open_recording(write_cine(tmp_path / "a.cine", IMAGES, bits=8, rate=70_000, times_s=times)) as recording:
        assert recording.frame_rate == 70_000
        assert recording.origins["frame_rate"] == "CINE SETUP FrameRate"
        assert recording.times is None
        assert not recording.notes


@pytest.mark.parametrize(("rate", "own"), [(90_000, 9003.2), (24, 23.976), (1000, 2000.0)])
def test_the_rate_of_the_images_wins(tmp_path: Path, rate: int, own: float) -> None:
    with open_recording(write_cine(tmp_path / "a.cine", IMAGES, bits=8, rate=rate, times_s=NUMBERS / own)) as recording:
        assert recording.frame_rate == pytest.approx(own, rel=1e-6)
        assert recording.times is None


@pytest.mark.parametrize("seed", range(3))
def test_images_without_an_even_spacing_keep_their_own_times(tmp_path: Path, seed: int) -> None:
    # Their mean interval is known to 1 % only, and differs from the set-up's by less.
    times = (1.004 * NUMBERS + 0.05 * np.random.default_rng(seed).standard_normal(COUNT)) / 25_000
    with open_recording(write_cine(tmp_path / "a.cine", IMAGES, bits=8, rate=25_000, times_s=times)) as recording:
        np.testing.assert_allclose(np.diff(recording.times) / recording.frame_rate, np.diff(times), rtol=1e-4)


@pytest.mark.parametrize(
    ("times", "word"),
    [(NUMBERS[:-1] / 1e3, "are 29 for 30 images"), (np.append(NUMBERS[:-1] / 1e3, 2.5e7), "cannot be those of one")],
    ids=["too few", "damaged"],
)
def test_times_that_cannot_be_true_are_said_and_not_used(tmp_path: Path, times: np.ndarray, word: str) -> None:
    with open_recording(write_cine(tmp_path / "a.cine", IMAGES, bits=8, rate=500, times_s=times)) as recording:
        assert recording.frame_rate == 500
        assert word in " ".join(recording.notes)


def test_the_exposure_of_the_images_is_stated_where_it_differs(tmp_path: Path) -> None:
    def exposure(value: float) -> tuple[float | None, str]:
        times, each = NUMBERS / 70_000, COUNT * [value]
        path = write_cine(tmp_path / "a.cine", IMAGES, bits=8, times_s=times, exposures_s=each)
        with open_recording(path) as recording:
            return recording.exposure_s, recording.origins["exposure_s"]

    # The set-up states 2.5 us.
    assert exposure(2.5e-6) == (2.5e-6, "CINE SETUP ShutterNs")
    assert exposure(2.0e-6) == (pytest.approx(2.0e-6, abs=3e-10), "CINE image exposures (block 1003)")
    assert exposure(0.5)[0] == 2.5e-6


def test_blocks_that_do_not_fit_into_the_file_are_left_out(tmp_path: Path) -> None:
    path = write_cine(tmp_path / "a.cine", IMAGES, bits=8, times_s=NUMBERS / 1e3)
    data = bytearray(path.read_bytes())
    at = data.index((1002).to_bytes(2, "little"), 44 + 40 + 5692) - 4
    for size in (0, 3, 2**31):
        data[at : at + 4] = size.to_bytes(4, "little")
        path.write_bytes(data)
        with open_recording(path) as recording:
            assert recording.frame_rate == 70_000
