"""Rows of a batch, or images, shared among threads, while torch's own threads are switched off.

Torch splits every operation by itself. On small arrays that costs more than it gains, and beside other busy programs
torch's threads wait for each other: two threads measured ten times slower than one. The threads here take some rows
through all operations. They wait for Python's lock only, which torch and compiled loops release.
"""

from __future__ import annotations

import contextlib
import functools
import multiprocessing
import os
from collections import deque
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import Future, ThreadPoolExecutor, wait
from contextvars import ContextVar
from dataclasses import dataclass
from typing import Any, Generic, TypeVar

import torch

#: Pixels of a batch per thread, from which a further thread saves time, px (docs/constants.toml).
PIXELS_PER_THREAD = 400_000

#: Most threads for functions of many short operations (docs/constants.toml).
SHORT_CALL_THREADS = 2

Result = TypeVar("Result")
RowRunner = Callable[[Callable[[int, int], Any], int], list[Any]]

#: Number of threads that torch was allowed before `single_threaded_torch`.
_thread_limit_before: ContextVar[int | None] = ContextVar("thread_limit_before", default=None)


@contextlib.contextmanager
def single_threaded_torch() -> Iterator[None]:
    """Give each operation of torch one thread, as suits small arrays; the functions below keep their thread limit."""
    count = torch.get_num_threads()
    token = _thread_limit_before.set(thread_limit())
    torch.set_num_threads(1)
    try:
        yield
    finally:
        torch.set_num_threads(count)
        _thread_limit_before.reset(token)


def thread_limit() -> int:
    """Number of threads that torch is allowed, `single_threaded_torch` left aside."""
    return _thread_limit_before.get() or torch.get_num_threads()


def has_idle_cores() -> bool:
    """Whether one thread leaves cores idle: torch is allowed several, and this process is no worker of many."""
    return thread_limit() > 1 and multiprocessing.parent_process() is None


@functools.cache
def _pool(count: int) -> ThreadPoolExecutor:
    """Pool of ``count`` threads, kept: new threads for each batch took a tenth of its time. They see no idle cores."""

    def initialise() -> None:
        torch.set_num_threads(1)
        _thread_limit_before.set(1)

    return ThreadPoolExecutor(count, "torchsphere", initialise)


if hasattr(os, "register_at_fork"):
    # A forked process has none of the threads.
    os.register_at_fork(after_in_child=_pool.cache_clear)


def _ordered_results(count: int, function: Callable[..., Result], *columns: Iterable[Any]) -> Iterator[Result]:
    """Results of the calls, in order. No call runs any more at the end, also after an error."""
    pool = _pool(count)
    calls: deque[Future[Result]] = deque()
    try:
        for row in zip(*columns, strict=True):
            calls.append(pool.submit(function, *row))
        while calls:
            result = calls[0].result()
            calls.popleft()
            yield result
    finally:
        for call in calls:
            call.cancel()
        wait(calls)


@dataclass(frozen=True)
class Call(Generic[Result]):
    """A call that may run in the background."""

    result: Callable[[], Result]  # waits, then returns or raises what the call does
    stop: Callable[[], object]  # cancels the call, or waits until it has ended; its result is not needed


def submit(device: torch.device, function: Callable[..., Result], *arguments: Any) -> Call[Result]:
    """Start a call in the background where a core is idle. Elsewhere, as on a GPU, `Call.result` makes the call."""
    if device.type != "cpu" or not has_idle_cores():
        return Call(functools.partial(function, *arguments), lambda: None)
    call = _pool(1).submit(function, *arguments)
    return Call(call.result, lambda: None if call.cancel() else wait([call]))


def parallel_map(
    function: Callable[..., Result], *columns: Iterable[Any], at_most: int | None = SHORT_CALL_THREADS
) -> Iterator[Result]:
    """Like `map`, on as many threads as torch is allowed, for functions that take milliseconds on the CPU.

    Results come in order; all arguments are read at once. ``at_most`` limits the threads; None, for functions that
    seldom hold Python's lock, does not.
    """
    count = thread_limit() if at_most is None else min(thread_limit(), at_most)
    if count == 1:
        yield from map(function, *columns)
        return
    with single_threaded_torch():
        yield from _ordered_results(count, function, *columns)


@contextlib.contextmanager
def row_runner(device: torch.device, pixels: float) -> Iterator[RowRunner]:
    """A function that calls ``part(start, stop)`` for shares of ``n`` rows of ``pixels`` each, on several threads.

    One call gets all rows on a GPU, where torch is allowed one thread, and where the pixels are too few for two shares.
    """
    count = thread_limit() if device.type == "cpu" else 1
    if count == 1:
        yield lambda part, n: [part(0, n)]
        return
    with single_threaded_torch():

        def run(part: Callable[[int, int], Any], n: int) -> list[Any]:
            shares = max(1, min(count, n, int(n * pixels / PIXELS_PER_THREAD)))
            limits = [round(n * i / shares) for i in range(shares + 1)]
            if shares == 1:
                return [part(0, n)]
            return list(_ordered_results(count, part, limits[:-1], limits[1:]))

        yield run
