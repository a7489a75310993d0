"""How processes end: a request to end (SIGTERM) becomes an exception, and a worker ends with its parent."""

from __future__ import annotations

import contextlib
import multiprocessing
import multiprocessing.connection
import os
import signal
import threading
from collections.abc import Iterator
from typing import Any, NoReturn


class Ending(SystemExit):
    """The end that the system asked for; any other `SystemExit` is that of the code that raises it."""


@contextlib.contextmanager
def in_order() -> Iterator[None]:
    """Make a request to end (SIGTERM), as job schedulers send it, an exception, so that what was begun is cleaned up.

    Unfinished folders are removed, and processes that were started end, too. The exit code is the shells' own, 143.
    """
    if threading.current_thread() is not threading.main_thread():
        yield
        return

    def end(number: int, _: Any) -> NoReturn:
        raise Ending(128 + number)

    before = signal.signal(signal.SIGTERM, end)
    try:
        yield
    finally:
        signal.signal(signal.SIGTERM, before)


def serve_parent() -> None:
    """Make this process a worker: it leaves Ctrl-C to its parent, and ends at once when the parent has ended."""
    # Ctrl-C reaches all processes of a terminal; the parent ends its workers in order.
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    threading.Thread(target=_end_with_parent, daemon=True).start()


def _end_with_parent() -> None:
    parent = multiprocessing.parent_process()
    if parent is not None:
        multiprocessing.connection.wait([parent.sentinel])
        os._exit(1)
