"""Who measures a recording: a lock on one byte of one file, which the system lets go of when its process dies.

No claim outlives its process, so that none has to be guessed stale, and a million recordings need one file. Such locks
(POSIX, `fcntl.lockf`) hold on local disks and, between machines, on NFS 4 and on cluster file systems that have them.
"""

from __future__ import annotations

import contextlib
import errno
import functools
import hashlib
import os
import sys
import threading
from collections.abc import Iterator
from pathlib import Path

if sys.platform == "win32":
    import msvcrt
else:
    import fcntl

#: Errors of a lock that another process holds; any other means that there are no locks here.
_HELD = (errno.EACCES, errno.EAGAIN, errno.EDEADLK)
#: The byte of the summary; those of the recordings follow it.
_SUMMARY = 0


class Claims:
    """The claims of this process on one file; `claims` gives the one of a folder, as closing a second drops all."""

    def __init__(self, path: Path) -> None:
        self._file = os.open(path, os.O_RDWR | os.O_CREAT, 0o666)
        self._held: set[int] = set()
        self._guard = threading.Lock()

    @contextlib.contextmanager
    def claim(self, result: str) -> Iterator[bool]:
        """Claim the recording of a result folder for the block; False where another process or thread has it."""
        byte = 1 + int.from_bytes(hashlib.sha256(result.encode()).digest()[:7], "big")
        with self._guard:
            mine = byte not in self._held and self._lock(byte, wait=False)
            if mine:
                self._held.add(byte)
        try:
            yield mine
        finally:
            if mine:
                with self._guard:
                    self._held.discard(byte)
                    self._unlock(byte)

    @contextlib.contextmanager
    def summary(self) -> Iterator[None]:
        """Wait until no other process writes the summary, and keep them from it for the block."""
        self._lock(_SUMMARY, wait=True)
        try:
            yield
        finally:
            self._unlock(_SUMMARY)

    def work(self) -> bool:
        """Whether the file system has locks; without them two runs may measure a recording twice."""
        try:
            _lock(self._file, _SUMMARY + 1, wait=False)
            self._unlock(_SUMMARY + 1)
        except OSError as error:
            return error.errno in _HELD
        return True

    def _lock(self, byte: int, wait: bool) -> bool:
        try:
            _lock(self._file, byte, wait)
        except OSError as error:
            return error.errno not in _HELD
        return True

    def _unlock(self, byte: int) -> None:
        with contextlib.suppress(OSError):
            _unlock(self._file, byte)


if sys.platform == "win32":

    def _lock(file: int, byte: int, wait: bool) -> None:
        os.lseek(file, byte, os.SEEK_SET)
        msvcrt.locking(file, msvcrt.LK_LOCK if wait else msvcrt.LK_NBLCK, 1)

    def _unlock(file: int, byte: int) -> None:
        os.lseek(file, byte, os.SEEK_SET)
        msvcrt.locking(file, msvcrt.LK_UNLCK, 1)

else:

    def _lock(file: int, byte: int, wait: bool) -> None:
        fcntl.lockf(file, fcntl.LOCK_EX | (0 if wait else fcntl.LOCK_NB), 1, byte)

    def _unlock(file: int, byte: int) -> None:
        fcntl.lockf(file, fcntl.LOCK_UN, 1, byte)


@functools.lru_cache(maxsize=64)
def claims(path: Path) -> Claims:
    """The claims file at ``path``, opened once per process."""
    return Claims(path)
