"""Rows of a batch shared among threads."""

import os
import signal
import threading
import time
from collections.abc import Iterator

import pytest
import torch

from torchsphere.runtime import threads as parallel

CPU = torch.device("cpu")

#: Pixels of a row that deserves a thread.
ENOUGH = parallel.PIXELS_PER_THREAD


@pytest.fixture(params=[1, 3])
def threads(request: pytest.FixtureRequest) -> Iterator[int]:
    before = torch.get_num_threads()
    torch.set_num_threads(request.param)
    yield request.param
    torch.set_num_threads(before)


@pytest.mark.parametrize("rows", [1, 5, 8, 100])
def test_the_shares_are_all_rows_once_and_in_order(threads: int, rows: int) -> None:
    with parallel.row_runner(CPU, ENOUGH) as run:
        parts = run(lambda start, stop: list(range(start, stop)), rows)
    assert [row for part in parts for row in part] == list(range(rows))
    assert len(parts) <= threads


def test_small_balls_stay_on_one_thread_and_large_ones_get_as_many_as_their_pixels_are_worth() -> None:
    before = torch.get_num_threads()
    torch.set_num_threads(8)
    try:
        shares = []
        for radius in (15, 50, 100, 300):
            with parallel.row_runner(CPU, (2 * radius) ** 2) as run:
                shares.append(len(run(lambda start, stop: None, 32)))
    finally:
        torch.set_num_threads(before)
    assert shares == [1, 1, 3, 8]


def test_each_share_has_its_own_thread_with_one_torch_thread_and_the_number_is_restored(threads: int) -> None:
    # Shares of one wait for each other, so that no thread can take two.
    meeting = threading.Barrier(threads, timeout=600)

    def part(start: int, stop: int) -> tuple[int, int]:
        meeting.wait()
        return threading.get_ident(), torch.get_num_threads()

    with parallel.row_runner(CPU, ENOUGH) as run:
        found = run(part, 100)
    assert len({name for name, _ in found}) == threads
    assert {count for _, count in found} == {1}
    assert torch.get_num_threads() == threads


def test_an_error_in_a_share_is_raised_and_the_number_of_threads_is_restored(threads: int) -> None:
    def part(start: int, stop: int) -> None:
        raise ArithmeticError("a share failed")

    with pytest.raises(ArithmeticError, match="a share failed"), parallel.row_runner(CPU, ENOUGH) as run:
        run(part, 100)
    assert torch.get_num_threads() == threads


def test_single_threaded_torch_leaves_the_shares_as_many_threads_as_before(threads: int) -> None:
    with parallel.single_threaded_torch():
        assert torch.get_num_threads() == 1
        with parallel.row_runner(CPU, ENOUGH) as run:
            assert len(run(lambda start, stop: None, 100)) == threads
        with parallel.single_threaded_torch(), parallel.row_runner(CPU, ENOUGH) as run:
            assert len(run(lambda start, stop: None, 100)) == threads
        assert torch.get_num_threads() == 1
    assert torch.get_num_threads() == threads


def test_results_come_in_order_from_threads_with_one_torch_thread(threads: int) -> None:
    # Calls wait for each other in groups as large as the number of threads, so that all of them are needed.
    meeting = threading.Barrier(threads, timeout=600)

    def product(a: int, b: int) -> tuple[int, int, int]:
        meeting.wait()
        return a * b, threading.get_ident(), torch.get_num_threads()

    found = list(parallel.parallel_map(product, range(12), range(100, 112), at_most=None))
    assert [value for value, _, _ in found] == [a * (100 + a) for a in range(12)]
    assert len({name for _, name, _ in found}) == threads
    assert {count for _, _, count in found} == {1}
    assert torch.get_num_threads() == threads


def test_the_same_threads_serve_every_call(threads: int) -> None:
    def names() -> set[int]:
        meeting = threading.Barrier(threads, timeout=600)
        return set(
            parallel.parallel_map(lambda _: (meeting.wait(), threading.get_ident())[1], range(threads), at_most=None)
        )

    assert names() == names()


@pytest.mark.skipif(not hasattr(os, "fork"), reason="no process is forked here")
def test_a_forked_process_has_threads_of_its_own(threads: int) -> None:
    assert list(parallel.parallel_map(abs, [-1, -2], at_most=None)) == [1, 2]
    forked = os.fork()
    if forked == 0:
        # The child would not end if it waited for threads of its parent.
        signal.alarm(600)
        os._exit(0 if list(parallel.parallel_map(abs, [-3, -4], at_most=None)) == [3, 4] else 1)
    assert os.waitpid(forked, 0)[1] == 0


def test_after_an_error_no_share_is_running() -> None:
    begun, ended = threading.Event(), threading.Event()

    def part(number: int) -> None:
        if number == 0:
            begun.wait(600)
            raise ArithmeticError("the first share failed")
        begun.set()
        time.sleep(0.2)
        ended.set()

    before = torch.get_num_threads()
    torch.set_num_threads(2)
    try:
        with pytest.raises(ArithmeticError, match="the first"):
            list(parallel.parallel_map(part, range(2)))
    finally:
        torch.set_num_threads(before)
    assert ended.is_set()


def test_functions_of_short_operations_get_few_threads_whatever_torch_is_allowed(threads: int) -> None:
    names = set(parallel.parallel_map(lambda _: (time.sleep(0.01), threading.get_ident())[1], range(12)))
    assert len(names) == min(threads, parallel.SHORT_CALL_THREADS)


def test_a_call_inside_a_share_gets_no_further_threads() -> None:
    before = torch.get_num_threads()
    torch.set_num_threads(2)
    try:
        with parallel.row_runner(CPU, ENOUGH) as run:
            inner = run(lambda start, stop: len({*parallel.parallel_map(lambda _: threading.get_ident(), range(8))}), 8)
        assert inner == [1, 1]
    finally:
        torch.set_num_threads(before)


def test_an_error_in_one_call_is_raised_where_the_results_are_read(threads: int) -> None:
    def failing(i: int) -> int:
        if i == 3:
            raise ValueError("the fourth")
        return i

    with pytest.raises(ValueError, match="the fourth"):
        list(parallel.parallel_map(failing, range(6)))
    assert torch.get_num_threads() == threads
