"""Shares of a batch on threads."""

import threading
from collections.abc import Iterator

import pytest
import torch

from torchsphere import parallel

CPU = torch.device("cpu")


@pytest.fixture(params=[1, 3])
def threads(request: pytest.FixtureRequest) -> Iterator[int]:
    before = torch.get_num_threads()
    torch.set_num_threads(request.param)
    yield request.param
    torch.set_num_threads(before)


@pytest.mark.parametrize("rows", [1, 5, 8, 100])
def test_the_shares_are_all_rows_once_and_in_order(threads: int, rows: int) -> None:
    with parallel.sharing(CPU) as run:
        parts = run(lambda start, stop: list(range(start, stop)), rows)
    assert [row for part in parts for row in part] == list(range(rows))
    assert len(parts) <= threads


def test_each_share_has_its_own_thread_with_a_single_torch_thread_and_the_number_is_given_back(threads: int) -> None:
    # Shares of one wait for each other, so that no thread can take two.
    meeting = threading.Barrier(threads, timeout=30)

    def part(start: int, stop: int) -> tuple[int, int]:
        meeting.wait()
        return threading.get_ident(), torch.get_num_threads()

    with parallel.sharing(CPU) as run:
        found = run(part, 100)
    assert len({name for name, _ in found}) == threads
    assert {count for _, count in found} == {1}
    assert torch.get_num_threads() == threads


def test_an_error_in_a_share_is_raised_and_the_number_of_threads_given_back(threads: int) -> None:
    def part(start: int, stop: int) -> None:
        raise ArithmeticError("a share failed")

    with pytest.raises(ArithmeticError, match="a share failed"), parallel.sharing(CPU) as run:
        run(part, 100)
    assert torch.get_num_threads() == threads


def test_operations_with_a_thread_each_leave_the_shares_as_many_as_before(threads: int) -> None:
    with parallel.one_each():
        assert torch.get_num_threads() == 1
        with parallel.sharing(CPU) as run:
            assert len(run(lambda start, stop: None, 100)) == threads
        with parallel.one_each(), parallel.sharing(CPU) as run:
            assert len(run(lambda start, stop: None, 100)) == threads
        assert torch.get_num_threads() == 1
    assert torch.get_num_threads() == threads
