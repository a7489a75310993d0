"""How processes end: a request to terminate (SIGTERM) becomes an exception, and a worker ends with its parent."""

from __future__ import annotations

import contextlib
import multiprocessing
import multiprocessing.connection
import os
import signal
import threading
from collections.abc import Iterator
from typing import Any, NoReturn


class Termination(SystemExit):
    """The exit that the system requested, unlike a `SystemExit` that code raises by itself."""


@contextlib.contextmanager
def sigterm_as_exception() -> Iterator[None]:
    """Turn SIGTERM, as job schedulers send it, into `Termination`: unfinished folders and child processes are removed.

    The exit code is that of the shells, 143. Does nothing outside the main thread.
    """
    if threading.current_thread() is not threading.main_thread():
        yield
        return

    def terminate(number: int, _: Any) -> NoReturn:
        raise Termination(128 + number)

    before = signal.signal(signal.SIGTERM, terminate)
    try:
        yield
    finally:
        signal.signal(signal.SIGTERM, before)


def become_worker() -> None:
    """Make this process a worker: it leaves Ctrl-C to its parent, and ends at once when the parent has ended."""
    # Ctrl-C reaches all processes of a terminal; the parent ends its workers in order.
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    threading.Thread(target=_end_with_parent, daemon=True).start()


def _end_with_parent() -> None:
    parent = multiprocessing.parent_process()
    if parent is not None:
        multiprocessing.connection.wait([parent.sentinel])
        os._exit(1)
