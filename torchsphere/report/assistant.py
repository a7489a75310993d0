"""A process beside the one that measures, which hashes the recording and draws the figures while that one goes on.

Matplotlib draws on one core, and takes half a second to load; measured on two cores, a track of 2,000 frames waits for
all of this a quarter of its time. A thread would not do: most of it holds Python's lock, and whoever follows the ball
would wait for that. The process is a fresh interpreter without torch, and gets its jobs line by line; each figure is
drawn by a process that it forks. It ends when no more jobs can come, so also when whoever asked for them has died.
"""

from __future__ import annotations

import contextlib
import gc
import io
import json
import os
import re
import signal
import subprocess
import sys
from collections.abc import Iterable, Sequence
from pathlib import Path
from types import TracebackType
from typing import Any

from torchsphere.report import draw
from torchsphere.report.figures import new_figure
from torchsphere.results.reader import ResultFolder, read
from torchsphere.runtime.file_hash import hash_files

#: What the process runs: it finds what its parent finds, and no program of the user's is run again.
_CODE = "import sys; sys.path[:] = sys.argv[1:]; from torchsphere.report.assistant import serve; serve()"


class Assistant:
    """A process that hashes a recording's files and makes ready to draw; to be closed in any case.

    Whatever it cannot do is left to the caller.
    """

    def __init__(self, files: Sequence[Path]) -> None:
        self._process: subprocess.Popen[bytes] | None = None
        # An interpreter that lacks its own name, or is part of a program, runs no code that it is given.
        if sys.executable and not getattr(sys, "frozen", False):
            with contextlib.suppress(OSError):
                self._process = subprocess.Popen(
                    [sys.executable, "-c", _CODE, *sys.path],
                    stdin=subprocess.PIPE,
                    stdout=subprocess.PIPE,
                    stderr=subprocess.DEVNULL,
                    # With a group of its own, so that its own processes end with it.
                    start_new_session=True,
                )
        self._send([str(file.absolute()) for file in files])

    def _send(self, job: list[Any]) -> None:
        # A process that has died is noticed at the end.
        with contextlib.suppress(OSError):
            if self._process is not None and self._process.stdin is not None:
                self._process.stdin.write(json.dumps(job).encode() + b"\n")
                self._process.stdin.flush()

    def sha256(self) -> str | None:
        """The hash of the files, when it is there; None where the process could not make it."""
        if self._process is None or self._process.stdout is None:
            return None
        line = self._process.stdout.readline().strip()
        # Whatever else a library may say there is no hash.
        return line.decode() if re.fullmatch(rb"[0-9a-f]{64}", line) else None

    def begin(self, result: Path, names: Iterable[str], folder: Path) -> None:
        """Draw the figures of these names into ``folder`` from what the result folder holds by now; without waiting."""
        self._send([str(result.absolute()), list(names), str(folder.absolute())])

    def finish(self) -> bool:
        """Wait for the figures; False where not all of them were drawn, for whatever reason."""
        if self._process is None:
            return False
        with contextlib.suppress(OSError):
            self._process.communicate()
        if self._process.wait() == 0:
            return True
        # Whatever is still being drawn would get in the way of whoever draws it now.
        self._end_group(self._process.pid)
        return False

    def close(self) -> None:
        """End the process, and whatever it draws."""
        # Where it has ended by itself, and well, nothing is being drawn.
        if self._process is not None and self._process.poll() != 0:
            self._end_group(self._process.pid)
            self._process.kill()
            with contextlib.suppress(OSError, ValueError):
                self._process.communicate()

    @staticmethod
    def _end_group(number: int) -> None:
        if hasattr(os, "killpg"):
            with contextlib.suppress(ProcessLookupError, PermissionError):
                os.killpg(number, signal.SIGKILL)

    def __enter__(self) -> Assistant:
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, at: TracebackType | None) -> None:
        self.close()


def serve() -> None:
    """The process: hash, then draw what is asked for until there is no more; exit code 0 where all of it was done."""
    # Where a process has no group of its own, Ctrl-C reaches it as well; the first of them ends this one.
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    jobs = map(json.loads, sys.stdin.buffer)
    sys.stdout.write(hash_files([Path(file) for file in next(jobs, [])]) + "\n")
    sys.stdout.flush()
    # Whoever listens is told that nothing else comes, and does not wait for processes that outlive this one.
    os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
    _load()
    drawing: list[int] = []
    for result, names, folder in jobs:
        drawing += _begun(read(Path(result)), names, Path(folder))
    failed = [number for number in drawing if os.waitpid(number, 0)[1] != 0]
    # Whoever waits need not wait for all to be taken apart.
    os._exit(1 if failed else 0)


def _begun(result: ResultFolder, names: Sequence[str], folder: Path) -> list[int]:
    """Begin to draw each of the figures in a process of its own, which has loaded all that this one has: their numbers.

    Where a process cannot be doubled safely the figures are drawn by this one.
    """
    if not sys.platform.startswith("linux"):
        draw.draw_figures(result, names, folder)
        return []
    begun: list[int] = []
    for name in names:
        number = os.fork()
        if number == 0:
            code = 1
            try:
                draw.draw_figures(result, [name], folder)
                code = 0
            finally:
                os._exit(code)
        begun.append(number)
    return begun


def _load() -> None:
    """Load what drawing loads when it is needed, fonts included, by drawing next to nothing."""
    gc.disable()
    figure = new_figure(figsize=(1.0, 1.0), layout=None)
    figure.add_subplot().set_xlabel("time")
    for kind in ("png", "pdf"):
        figure.savefig(io.BytesIO(), format=kind)
    gc.freeze()
    gc.enable()
