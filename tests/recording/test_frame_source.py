"""Images that are read on request, and their cache."""

from pathlib import Path

import numpy as np
import pytest
import tifffile
import torch
from torch import Tensor

from torchsphere.recording import frame_source, open_recording
from torchsphere.recording.frame_range import spread
from torchsphere.recording.frame_source import Source


def counting_source() -> tuple[Source, list[int]]:
    """Twelve images, and the list of the numbers that were read."""
    images = torch.arange(12 * 4 * 5, dtype=torch.float32).reshape(12, 4, 5)
    reads: list[int] = []

    def read(start: int, stop: int) -> Tensor:
        reads.extend(range(start, stop))
        return images[start:stop]

    return Source(read, 12, torch.device("cpu"), torch.float32), reads


def test_cached_images_are_read_once_and_stay_the_same() -> None:
    source, reads = counting_source()
    cached, plain = source.cached(3, 9), counting_source()[0]
    reads.clear()
    for start, stop in ((5, 7), (3, 9), (8, 9), (4, 8)):
        assert torch.equal(cached.images(start, stop), plain.images(start, stop))
    assert sorted(reads) == [3, 4, 5, 6, 7, 8]


def test_images_outside_the_cache_are_read_as_before() -> None:
    plain, _ = counting_source()
    cached = plain.cached(3, 9)
    for start, stop in ((0, 2), (2, 5), (8, 11), (0, 12)):
        assert torch.equal(cached.images(start, stop), plain.images(start, stop))


def test_images_that_are_too_large_are_not_cached(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(frame_source, "CACHE_BYTES", 6 * 4 * 5 * 4 - 1)
    plain, _ = counting_source()
    assert plain.cached(3, 9) is plain
    assert plain.cached(3, 8) is not plain


@pytest.mark.parametrize("count", [3, 4, 9])
def test_images_of_a_file_are_read_into_a_buffer(tmp_path: Path, count: int) -> None:
    levels = np.arange(12 * 4 * 5, dtype=np.uint8).reshape(12, 4, 5)
    tifffile.imwrite(tmp_path / "shot.tif", levels, metadata=None)
    with open_recording(tmp_path / "shot.tif") as recording:
        source = Source.open(recording)
        buffer = torch.full((9, 4, 5), -1.0)
        images = source.images_into(buffer, 2, 2 + count)
        assert images.data_ptr() == buffer.data_ptr()
        np.testing.assert_array_equal(images, levels[2 : 2 + count])
        assert (buffer[count:] == -1).all()
        assert source.fills_buffers
        # The file's images are float32; another precision takes new memory.
        assert not Source.open(recording, dtype=torch.float64).fills_buffers


def test_images_in_memory_fill_no_buffer() -> None:
    assert not Source.open(torch.rand(6, 4, 5)).fills_buffers


def test_images_of_a_file_and_of_an_array_have_one_scale(tmp_path: Path) -> None:
    levels = np.arange(12 * 4 * 5, dtype=np.uint8).reshape(12, 4, 5)
    tifffile.imwrite(tmp_path / "shot.tif", levels, metadata=None)
    with open_recording(tmp_path / "shot.tif") as recording:
        source = Source.open(recording).standardised()
        read = source.images(2, 5)
        np.testing.assert_array_equal(source.images_into(torch.empty(3, 4, 5), 2, 5), read)
    for array in (levels, levels.astype(np.uint16), torch.from_numpy(levels).double()):
        np.testing.assert_array_equal(Source.open(array).standardised().images(2, 5), read)


def test_cached_and_changed_images_keep_their_scale() -> None:
    source = Source.open(np.arange(12 * 4 * 5, dtype=np.float32).reshape(12, 4, 5) / 7).standardised()
    for other in (source.cached(3, 9), source.changed(lambda images: images)):
        assert torch.equal(other.images(4, 8), source.images(4, 8))
        assert other.rounding_variance == source.rounding_variance


def test_chosen_images_are_those_of_their_numbers() -> None:
    source = counting_source()[0]
    chosen = source.images_of(np.array([2, 7, 8]))
    assert torch.equal(chosen, torch.cat([source.images(2, 3), source.images(7, 9)]))


@pytest.mark.parametrize(("count", "most", "expected"), [(0, 4, []), (3, 4, [0, 1, 2]), (10, 4, [0, 3, 6, 9])])
def test_frames_are_chosen_evenly_from_the_first_to_the_last(count: int, most: int, expected: list[int]) -> None:
    assert spread(np.arange(count), most).tolist() == expected
