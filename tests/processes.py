"""Processes that a test starts, none of which outlives it."""

import contextlib
import subprocess
from collections.abc import Iterator
from typing import Any


@contextlib.contextmanager
def started(command: list[str], **options: Any) -> Iterator["subprocess.Popen[Any]"]:
    """The process of a command, which is killed at the end of the block, whatever signals it ignores."""
    with subprocess.Popen(command, **options) as process:
        try:
            yield process
        finally:
            process.kill()
