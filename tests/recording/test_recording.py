"""A recording as a sequence of images, and its short form in words."""

from pathlib import Path

import numpy as np
import pytest

from torchsphere import Recording, open_recording
from torchsphere.recording.frame_range import restrict


@pytest.fixture
def images() -> np.ndarray:
    return np.random.default_rng(0).integers(0, 255, (7, 12, 16), dtype=np.uint8)


@pytest.fixture
def recording(tmp_path: Path, images: np.ndarray) -> Recording:
    np.save(tmp_path / "shot.npy", images)
    return open_recording(tmp_path / "shot.npy")


@pytest.mark.parametrize(
    "key", [0, 3, -1, np.int64(2), slice(2, 5), slice(None), slice(1, 7, 3), slice(None, None, -2), slice(5, 2)]
)
def test_numbers_and_slices_give_the_images_that_an_array_gives(
    recording: Recording, images: np.ndarray, key: int | slice
) -> None:
    found = recording[key]
    assert found.dtype == np.float32
    np.testing.assert_array_equal(found, images[key])


def test_an_image_that_is_not_there_is_an_index_error(recording: Recording) -> None:
    with pytest.raises(IndexError):
        recording[7]


def test_a_recording_is_a_sequence_of_its_images(recording: Recording, images: np.ndarray) -> None:
    assert len(list(recording)) == 7
    assert all(np.array_equal(one, image) for one, image in zip(recording, images, strict=True))


def test_the_short_form_has_name_size_and_rate(recording: Recording) -> None:
    text = repr(recording)
    assert "shot.npy" in text
    assert "7 images of 16 x 12 px, frame rate not stated" in text


def test_a_part_of_a_recording_keeps_what_is_stated_of_its_exposure(tmp_path: Path) -> None:
    facts = {"frame_rate": 36000.0, "exposure_s": 5e-6, "times": np.array([0.0, 1.0, 4.0, 5.0])}
    images = np.zeros((4, 6, 8), np.float32)
    whole = Recording(path=tmp_path, kind="array", shape=images.shape, _reader=lambda a, b: images[a:b], **facts)
    part = restrict(whole, 1, 3)
    assert (part.frame_rate, part.exposure_s, len(part)) == (36000.0, 5e-6, 2)
    np.testing.assert_array_equal(np.diff(part.times), [3.0])
