"""Rows of a batch, or images, shared out among threads, each with torch's own threads switched off.

Torch shares each operation out by itself; on arrays as small as a batch's that costs more than it gives, and where
other programs use the cores, too, its threads wait for each other: measured ten times slower with two threads than
with one. Threads that each take some of the rows through all operations do not wait, because torch lets go of Python's
lock.
"""

from __future__ import annotations

import contextlib
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import ThreadPoolExecutor
from contextvars import ContextVar
from typing import Any, TypeVar

import torch

#: Fewer rows than this are not worth a thread of their own: by then the calls take as long as the arithmetic.
LEAST_ROWS = 4

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


def each(function: Callable[..., Result], *columns: Iterable[Any]) -> Iterator[Result]:
    """Like `map`, on as many threads as torch may use: for functions that take milliseconds, on the CPU.

    Results come in order. Arguments are all taken at once, and results wait for whoever takes them.
    """
    count = _allowed()
    if count == 1:
        yield from map(function, *columns)
        return
    with one_each(), ThreadPoolExecutor(count) as pool:
        yield from pool.map(function, *columns)


@contextlib.contextmanager
def sharing(device: torch.device) -> Iterator[Run]:
    """A function that calls ``part(start, stop)`` for shares of ``n`` rows, on as many threads as torch may use.

    On a GPU, or where torch may use one thread, one call gets all rows. Torch's number of threads is what it was
    afterwards.
    """
    count = _allowed() if device.type == "cpu" else 1
    if count == 1:
        yield lambda part, n: [part(0, n)]
        return
    with one_each(), ThreadPoolExecutor(count) as pool:

        def run(part: Callable[[int, int], Any], n: int) -> list[Any]:
            shares = max(1, min(count, n // LEAST_ROWS))
            limits = [round(n * i / shares) for i in range(shares + 1)]
            if shares == 1:
                return [part(0, n)]
            return list(pool.map(part, limits[:-1], limits[1:]))

        yield run
