"""Images that are read when they are asked for, and those that are kept."""

import pytest
import torch
from torch import Tensor

from torchsphere import parallel, source
from torchsphere.source import Source


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
    monkeypatch.setattr(source, "KEPT_BYTES", 6 * 4 * 5 * 4 - 1)
    plain, _ = counted()
    assert plain.keeping(3, 9) is plain
    assert plain.keeping(3, 8) is not plain


@pytest.fixture
def idle(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(parallel, "has_idle_cores", lambda: True)


@pytest.mark.usefixtures("idle")
@pytest.mark.parametrize(
    "asked",
    [
        [(0, 3), (2, 5), (4, 7), (6, 9), (8, 12)],  # batch after batch
        [(0, 2), (1, 4), (3, 8), (7, 12)],  # that grow
        [(0, 5), (4, 7), (6, 7), (2, 5), (11, 12), (0, 12)],  # that shrink, a single image, back and forth
    ],
)
def test_what_is_read_ahead_is_the_same(asked: list[tuple[int, int]]) -> None:
    read_from, plain = counted()[0], counted()[0]
    with read_from.ahead() as images:
        for start, stop in asked:
            assert torch.equal(images.images(start, stop), plain.images(start, stop))


@pytest.mark.usefixtures("idle")
def test_the_next_batch_is_read_before_it_is_asked_for() -> None:
    read_from, reads = counted()
    with read_from.ahead() as images:
        images.images(0, 4)
        images.images(3, 7)
    # The next one after that, too; each begins with the last image of the former.
    assert reads == [0, 1, 2, 3, 3, 4, 5, 6, 6, 7, 8, 9]


@pytest.mark.usefixtures("idle")
def test_batches_that_are_too_large_are_not_read_ahead(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(source, "KEPT_BYTES", 4 * 4 * 5 * 4 - 1)
    read_from, reads = counted()
    with read_from.ahead() as images:
        images.images(0, 4)
        images.images(3, 7)
    assert reads == [0, 1, 2, 3, 3, 4, 5, 6]


@pytest.mark.usefixtures("idle")
def test_an_image_that_cannot_be_read_is_told_when_it_is_asked_for_and_not_before() -> None:
    plain, _ = counted()

    def read(start: int, stop: int) -> Tensor:
        if stop > 6:
            raise OSError("the file is cut")
        return plain.images(start, stop)

    with Source(read, 12, plain.device, plain.dtype).ahead() as images:
        assert torch.equal(images.images(0, 4), plain.images(0, 4))  # 3 to 6 are tried
        assert torch.equal(images.images(3, 6), plain.images(3, 6))
        with pytest.raises(OSError, match="cut"):
            images.images(5, 8)


def test_where_no_core_lies_idle_nothing_is_read_ahead(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(parallel, "has_idle_cores", lambda: False)
    plain, _ = counted()
    with plain.ahead() as images:
        assert images is plain
