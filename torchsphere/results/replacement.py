"""Replacement of a folder by another without a moment in which neither is there, and what a killed process left."""

from __future__ import annotations

import contextlib
import ctypes
import functools
import os
import re
import shutil
from collections.abc import Callable, Iterator
from pathlib import Path

#: File in an unfinished folder whose lock the process holds that fills the folder; a kill drops the lock.
MARK = ".unfinished"
#: Last part of the name of an unfinished folder, after the short name of the folder.
UNFINISHED = r"\.[a-z0-9_]{8}"

# Of Linux: paths relative to the working folder, and the flag that exchanges two names in one step.
_AT_FDCWD, _RENAME_EXCHANGE = -100, 2

#: Folders that this process fills.
_HELD: set[Path] = set()


def exchange(one: Path, other: Path) -> bool:
    """Exchange the names of two folders in one step; False where the system or the file system cannot."""
    rename = _renameat2()
    if rename is None:
        return False
    return bool(rename(_AT_FDCWD, os.fsencode(one), _AT_FDCWD, os.fsencode(other), _RENAME_EXCHANGE) == 0)


@functools.cache
def _renameat2() -> Callable[..., int] | None:
    try:
        return ctypes.CDLL(None, use_errno=True).renameat2
    except (OSError, AttributeError, TypeError):
        return None


def replace_folder(new: Path, folder: Path, spare: Callable[[], Path]) -> None:
    """Put ``new`` in the place of ``folder``, which is removed; ``spare`` makes an empty folder beside them.

    Without `exchange` the old folder gets another name first: a process killed then leaves both, see `recover`.
    """
    if exchange(new, folder):
        old = new
    else:
        old = spare()
        folder.replace(old)
        try:
            new.replace(folder)
        except OSError:
            old.replace(folder)
            raise
    # The mark stays until the folder has its name: another process would take a folder without a mark for an old one.
    (folder / MARK).unlink(missing_ok=True)
    shutil.rmtree(old)


@contextlib.contextmanager
def being_filled(new: Path) -> Iterator[None]:
    """Lock an unfinished folder for a block, so that `recover` in another process leaves it alone."""
    file = os.open(new / MARK, os.O_RDWR | os.O_CREAT, 0o666)
    _HELD.add(new.absolute())
    try:
        _lock(file)
        yield
    finally:
        _HELD.discard(new.absolute())
        os.close(file)


def _lock(file: int) -> bool:
    """Lock an open file unless another process holds its lock; False too where the system has no locks."""
    try:
        import fcntl

        fcntl.lockf(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except (ImportError, OSError):
        return False
    return True


def recover(folder: Path, short: str, files: tuple[str, ...]) -> None:
    """Restore or remove what killed processes left beside ``folder``: its earlier contents, or unfinished ones.

    ``short`` is the name of ``folder`` in the names of unfinished folders. An earlier folder has one of the
    ``files`` of finished output and no `MARK`; it is restored where ``folder`` is missing.
    """
    pattern = re.compile(rf"\.{re.escape(short)}{UNFINISHED}")
    try:
        left = [entry for entry in folder.absolute().parent.iterdir() if pattern.fullmatch(entry.name)]
    except OSError:
        return
    for entry in left:
        if (entry / MARK).is_file():
            if _is_abandoned(entry):
                shutil.rmtree(entry, ignore_errors=True)
        elif any((entry / name).is_file() for name in files):
            if folder.exists():
                shutil.rmtree(entry, ignore_errors=True)
            else:
                entry.replace(folder)


def _is_abandoned(unfinished: Path) -> bool:
    """Whether no process fills the folder; False where that cannot be told."""
    # A lock of this process would seem free, and closing the file would drop the lock.
    if unfinished in _HELD:
        return False
    try:
        file = os.open(unfinished / MARK, os.O_RDWR)
    except OSError:
        return False
    try:
        return _lock(file)
    finally:
        os.close(file)
