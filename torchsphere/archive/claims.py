"""Locks that give each recording of an archive to one process at a time.

Each recording has one byte of one file. The process that measures the recording holds a lock on this byte. The system
drops the lock when the process dies: no lock is ever stale, and a million recordings need one file.

The locks are POSIX byte locks (`fcntl.lockf`). The library filelock uses `flock`, which on IBM Storage Scale (GPFS)
holds on one machine only: two machines would measure the same recording, and neither would notice.
"""

from __future__ import annotations

import contextlib
import errno
import functools
import hashlib
import os
import sys
import threading
import time
from collections.abc import Iterator
from contextlib import AbstractContextManager
from pathlib import Path

from torchsphere.archive.scan import STATE

#: Wait before the next attempt at a lock of another process, s (docs/constants.toml).
PAUSE_S = 1.0

#: Errors while another process holds the lock; any other error means that the file system has no locks.
_HELD_ELSEWHERE = (errno.EACCES, errno.EAGAIN)
#: Byte of the summary; the next 2^56 bytes are for recordings, the byte after them for a test of the locks.
_SUMMARY, _PROBE = 0, (1 << 56) + 1

if sys.platform == "win32":
    import msvcrt

    _LOCK, _UNLOCK = msvcrt.LK_NBLCK, msvcrt.LK_UNLCK

    def _set(file: int, byte: int, mode: int) -> None:
        os.lseek(file, byte, os.SEEK_SET)
        msvcrt.locking(file, mode, 1)

else:
    import fcntl

    _LOCK, _UNLOCK = fcntl.LOCK_EX | fcntl.LOCK_NB, fcntl.LOCK_UN

    def _set(file: int, byte: int, mode: int) -> None:
        fcntl.lockf(file, mode, 1, byte)


class Claims:
    """The locks of this process in one archive.

    `claims_of` opens the file once: POSIX drops all locks of a process when it closes any descriptor of the file.
    """

    def __init__(self, path: Path) -> None:
        self._file = os.open(path, os.O_RDWR | os.O_CREAT, 0o666)
        self._held: set[int] = set()
        self._guard = threading.Lock()

    def claim(self, result: str) -> AbstractContextManager[bool]:
        """Lock the recording of a result folder for a block; False if another process or thread holds the lock."""
        return self._locked(1 + int.from_bytes(hashlib.sha256(result.encode()).digest()[:7], "big"))

    @contextlib.contextmanager
    def summary_lock(self) -> Iterator[None]:
        """Lock the summary for a block; wait while another process or thread holds the lock."""
        while True:
            with self._locked(_SUMMARY) as is_mine:
                if is_mine:
                    yield
                    return
            time.sleep(PAUSE_S)

    def are_supported(self) -> bool:
        """Whether the file system has locks; without locks, two runs may measure a recording twice."""
        try:
            _set(self._file, _PROBE, _LOCK)
            _set(self._file, _PROBE, _UNLOCK)
        except OSError as error:
            return error.errno in _HELD_ELSEWHERE
        return True

    @contextlib.contextmanager
    def _locked(self, byte: int) -> Iterator[bool]:
        with self._guard:
            # A POSIX lock excludes other processes only; the set excludes other threads of this process.
            is_mine = byte not in self._held
            if is_mine:
                try:
                    _set(self._file, byte, _LOCK)
                except OSError as error:
                    # A run on a file system without locks goes on as if it were alone.
                    is_mine = error.errno not in _HELD_ELSEWHERE
            if is_mine:
                self._held.add(byte)
        try:
            yield is_mine
        finally:
            if is_mine:
                with self._guard, contextlib.suppress(OSError):
                    self._held.discard(byte)
                    _set(self._file, byte, _UNLOCK)


_open = functools.cache(Claims)


def claims_of(out: Path) -> Claims:
    """The locks of the archive in the folder ``out``."""
    return _open((out / STATE / "claims").absolute())
