"""Rows of a batch, or images, shared out among threads, each with torch's own threads switched off.

Torch shares each operation out by itself; on arrays as small as a batch's that costs more than it gives, and where
other programs use the cores, too, its threads wait for each other: measured ten times slower with two threads than
with one. Threads that each take some of the rows through all operations wait for Python's lock alone, which torch and
compiled loops let go of: worth it where an operation takes longer than it takes to hand the lock over.
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

#: Pixels that are worth a thread of their own. A compiled loop lets go of Python's lock, but what lies between two of
#: them does not, and takes 2.4 ms per batch, as long as six pairs of 50 px. Measured on two cores, pairs of 50 px: 32
#: at once took 0.47 ms each on one thread and 0.45 to 0.50 on two, 64 took 0.41 and 0.31, and 128 0.46 and 0.26; 32 of
#: 100 px 1.6 and 0.95; 128 of 15 px 0.14 and 0.19.
LEAST_PIXELS = 400_000

#: Threads at most for functions of many short operations. Measured on two cores: images registered on a map took 21 ms
#: each on one thread, 20 on two, and 1.4 times as long on four, eight or sixteen.
FEW = 2

Result = TypeVar("Result")
Run = Callable[[Callable[[int, int], Any], int], list[Any]]

#: Threads that torch might use before `one_each` left it one.
_ALLOWED: ContextVar[int | None] = ContextVar("allowed", default=None)


@contextlib.contextmanager
def one_each() -> Iterator[None]:
    """Torch's operations with a thread each, as suits small arrays; `sharing` has as many threads as before."""
    count = torch.get_num_threads()
    token = _ALLOWED.set(_ALLOWED.get() or count)
    torch.set_num_threads(1)
    try:
        yield
    finally:
        torch.set_num_threads(count)
        _ALLOWED.reset(token)


def _allowed() -> int:
    """Threads that torch might use, but for `one_each`."""
    return _ALLOWED.get() or torch.get_num_threads()


def has_idle_cores() -> bool:
    """Whether what one thread does leaves cores idle: torch may use several, and this process is no worker of many."""
    return _allowed() > 1 and multiprocessing.parent_process() is None


@functools.cache
def _threads(count: int) -> ThreadPoolExecutor:
    """So many threads, which stay: begun anew for each batch, with memory of their own, they took a tenth of its time.

    To what they run no core lies idle.
    """

    def begin() -> None:
        torch.set_num_threads(1)
        _ALLOWED.set(1)

    return ThreadPoolExecutor(count, "torchsphere", begin)


if hasattr(os, "register_at_fork"):
    # A process that is forked has none of the threads.
    os.register_at_fork(after_in_child=_threads.cache_clear)


def _in_order(count: int, function: Callable[..., Result], *columns: Iterable[Any]) -> Iterator[Result]:
    """Results of the calls, as they are asked for; at the end, also that by an error, none of the calls is running."""
    pool = _threads(count)
    calls: deque[Future[Result]] = deque()
    try:
        for row in zip(*columns, strict=True):
            calls.append(pool.submit(function, *row))
        while calls:
            found = calls[0].result()
            calls.popleft()
            yield found
    finally:
        for call in calls:
            call.cancel()
        wait(calls)


@dataclass(frozen=True)
class Begun(Generic[Result]):
    """A call that may be under way.

    Attributes
    ----------
    result : callable
        What it returns or raises, once it has.
    settle : callable
        Wait until it is not running, for whoever does without its result.
    """

    result: Callable[[], Result]
    settle: Callable[[], object]


def beside(device: torch.device, function: Callable[..., Result], *arguments: Any) -> Begun[Result]:
    """Begin a call in a thread of its own where a core is likely to lie idle; elsewhere its result is worked out late.

    A GPU has no idle cores.
    """
    if device.type != "cpu" or not has_idle_cores():
        return Begun(functools.partial(function, *arguments), lambda: None)
    call = _threads(1).submit(function, *arguments)
    return Begun(call.result, lambda: None if call.cancel() else wait([call]))


def each(function: Callable[..., Result], *columns: Iterable[Any], at_most: int | None = FEW) -> Iterator[Result]:
    """Like `map`, on as many threads as torch may use: for functions that take milliseconds, on the CPU.

    Results come in order. Arguments are all taken at once, and results wait for whoever takes them. There are as many
    threads as ``at_most`` says; None is for functions that seldom hold Python's lock.
    """
    count = _allowed() if at_most is None else min(_allowed(), at_most)
    if count == 1:
        yield from map(function, *columns)
        return
    with one_each():
        yield from _in_order(count, function, *columns)


@contextlib.contextmanager
def sharing(device: torch.device, pixels: float) -> Iterator[Run]:
    """A function that calls ``part(start, stop)`` for shares of ``n`` rows, on as many threads as torch may use.

    ``pixels`` is what belongs to each row. On a GPU, where torch may use one thread, and where there are too few pixels
    for two shares, one call gets all rows. Torch's number of threads is what it was afterwards.
    """
    count = _allowed() if device.type == "cpu" else 1
    if count == 1:
        yield lambda part, n: [part(0, n)]
        return
    with one_each():

        def run(part: Callable[[int, int], Any], n: int) -> list[Any]:
            shares = max(1, min(count, n, int(n * pixels / LEAST_PIXELS)))
            limits = [round(n * i / shares) for i in range(shares + 1)]
            if shares == 1:
                return [part(0, n)]
            return list(_in_order(count, part, limits[:-1], limits[1:]))

        yield run
