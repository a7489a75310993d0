"""Frames as a page shows them."""

import io

import numpy as np
import pytest
from PIL import Image

from torchsphere.pick.footage import KEPT_FRAMES, Footage
from torchsphere.recording.recording import Recording


def shown(png: bytes) -> np.ndarray:
    return np.asarray(Image.open(io.BytesIO(png)))


def test_a_frame_is_shown_between_its_levels_of_black_and_white(recording: Recording) -> None:
    footage = Footage(recording)
    image = recording.images(3, 4)[0]
    black, white = footage.levels
    assert 0 <= black < white <= 255
    expected = ((image - black) * 255 / (white - black)).clip(0, 255)
    # Levels are cut to whole numbers.
    assert np.abs(shown(footage.png(3)).astype(float) - expected).max() <= 1
    assert (shown(footage.png(3, 0, 255)) == image).all()


def test_a_frame_that_is_not_there_is_refused_in_one_sentence(recording: Recording) -> None:
    footage = Footage(recording)
    for frame in (-1, 8):
        with pytest.raises(ValueError, match=rf"frame {frame}: the recording has the frames 0 to 7"):
            footage.png(frame)


def test_few_frames_stay_in_memory_and_each_is_the_right_one(recording: Recording) -> None:
    footage = Footage(recording)
    for frame in (0, 1, 2, 3, 4, 5, 0, 5, 4):
        assert (footage.image(frame) == recording.images(frame, frame + 1)[0]).all()
    assert len(footage._kept) == KEPT_FRAMES


def test_frames_of_one_grey_level_are_shown(recording: Recording) -> None:
    flat = Recording(
        path=recording.path, kind="flat", shape=(2, 4, 5), _reader=lambda a, b: np.full((b - a, 4, 5), 7.0)
    )
    assert shown(Footage(flat).png(0)).shape == (4, 5)


def test_a_closed_page_reads_no_further_frame(recording: Recording) -> None:
    footage = Footage(recording)
    footage.close()
    with pytest.raises(OSError, match="the page was closed"):
        footage.image(0)
