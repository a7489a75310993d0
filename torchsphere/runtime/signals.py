"""A request to end (SIGTERM) as an exception, so that what was begun is cleaned up."""

from __future__ import annotations

import contextlib
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
