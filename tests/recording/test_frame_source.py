"""Images that are read when they are asked for, and those that are kept."""

from pathlib import Path

import numpy as np
import pytest
import tifffile
import torch
from torch import Tensor

from torchsphere.recording import frame_source, open_recording
from torchsphere.recording.frame_source import Source


def counted() -> tuple[Source, list[int]]:
    """Twelve images whose every reading is written down."""
    images = torch.arange(12 * 4 * 5, dtype=torch.float32).reshape(12, 4, 5)
    reads: list[int] = []

    def read(start: int, stop: int) -> Tensor:
        reads.extend(range(start, stop))
        return images[start:stop]

    return Source(read, 12, torch.device("cpu"), torch.float32), reads


def test_what_is_kept_is_read_once_and_is_the_same() -> None:
    kept_from, reads = counted()
    kept, plain = kept_from.keeping(3, 9), counted()[0]
    reads.clear()
    for start, stop in ((5, 7), (3, 9), (8, 9), (4, 8)):
        assert torch.equal(kept.images(start, stop), plain.images(start, stop))
    assert sorted(reads) == [3, 4, 5, 6, 7, 8]


def test_what_is_not_kept_is_read_as_before() -> None:
    plain, _ = counted()
    kept = plain.keeping(3, 9)
    for start, stop in ((0, 2), (2, 5), (8, 11), (0, 12)):
        assert torch.equal(kept.images(start, stop), plain.images(start, stop))


def test_images_that_are_too_large_are_not_kept(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(frame_source, "KEPT_BYTES", 6 * 4 * 5 * 4 - 1)
    plain, _ = counted()
    assert plain.keeping(3, 9) is plain
    assert plain.keeping(3, 8) is not plain


@pytest.mark.parametrize("count", [3, 4, 9])
def test_images_of_a_file_are_read_into_the_room_there_is(tmp_path: Path, count: int) -> None:
    levels = np.arange(12 * 4 * 5, dtype=np.uint8).reshape(12, 4, 5)
    tifffile.imwrite(tmp_path / "shot.tif", levels, metadata=None)
    with open_recording(tmp_path / "shot.tif") as recording:
        from_file = Source.open(recording)
        room = torch.full((9, 4, 5), -1.0)
        found = from_file.images_in(room, 2, 2 + count)
        assert found.data_ptr() == room.data_ptr()
        np.testing.assert_array_equal(found, levels[2 : 2 + count])
        assert (room[count:] == -1).all()
        assert from_file.fills_rooms
        # Where another precision asks for memory of its own, it is taken anew.
        assert not Source.open(recording, dtype=torch.float64).fills_rooms


def test_images_that_are_in_memory_fill_no_room() -> None:
    assert not Source.open(torch.rand(6, 4, 5)).fills_rooms
