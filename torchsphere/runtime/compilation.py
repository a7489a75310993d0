"""Whether loops are being compiled, which takes a minute once for each machine and version."""

from __future__ import annotations

import contextlib
from collections.abc import Callable, Iterator
from typing import Any

from numba.core import event


class _FirstCompilation(event.Listener):
    """Calls a function when the first loop is compiled."""

    def __init__(self, tell: Callable[[], None]) -> None:
        self._tell, self._is_told = tell, False

    def on_start(self, event: Any) -> None:
        """A loop is going to be compiled."""
        if not self._is_told:
            self._is_told = True
            self._tell()

    def on_end(self, event: Any) -> None:
        """A loop was compiled."""


@contextlib.contextmanager
def on_compilation(tell: Callable[[], None]) -> Iterator[None]:
    """Call ``tell`` once if a loop is compiled meanwhile; a loop that is read from the disk is not compiled."""
    with event.install_listener("numba:compile", _FirstCompilation(tell)):
        yield
