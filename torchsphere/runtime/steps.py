"""Steps that may take longer than three seconds: each is told before it begins, and the command line prints it."""

from __future__ import annotations

import logging
from collections.abc import Sequence
from pathlib import Path

#: Where steps and warnings go.
LOG = logging.getLogger("torchsphere")

#: Size of files from which reading them takes about three seconds, bytes: 50 MB/s of a slow network drive.
LARGE_BYTES = 150_000_000

#: Time of the first compilation of the loops, as the pages state it, too.
COMPILATION_TIME = "about a minute"


def tell(step: str, *values: object) -> None:
    """Say that a step begins; ``values`` are those of the format ``step``, as in `logging`."""
    LOG.info(step, *values, extra={"takes_long": True})


def tell_if_large(files: Sequence[Path], step: str, *values: object) -> None:
    """`tell` of a step that reads the files, where they are so large that it takes long."""
    if sum(file.stat().st_size for file in files if file.is_file()) > LARGE_BYTES:
        tell(step, *values)
