"""Imports without garbage collection: the objects of modules stay, and each full collection looks at all of them.

Collections took a fifth of the import of `torchsphere.measure`, and as long again in the first seconds after it.
"""

from __future__ import annotations

import contextlib
import gc
import importlib
from collections.abc import Iterator

from torchsphere.runtime import signals


@contextlib.contextmanager
def without_collections() -> Iterator[None]:
    """Pause the collector; objects that exist at the end are never looked at again, not even when the process ends."""
    was_enabled = gc.isenabled()
    gc.disable()
    try:
        yield
    finally:
        gc.freeze()
        if was_enabled:
            gc.enable()


def become_worker_with(*modules: str) -> None:
    """Make this process a worker that has imported the ``modules``: see `signals.become_worker`."""
    signals.become_worker()
    with without_collections():
        for name in modules:
            importlib.import_module(name)
