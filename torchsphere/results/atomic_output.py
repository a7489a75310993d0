"""Output that appears whole or not at all: a folder or a file gets a temporary name first, then its own."""

from __future__ import annotations

import contextlib
import errno
import hashlib
import os
import shutil
import uuid
from collections.abc import Iterator
from pathlib import Path
from typing import TextIO

from torchsphere.results import replacement

#: Files that mark a folder as an earlier result: of a measurement, of a plan.
RESULT_FILES = ("summary.json", "plan.json")

#: Errors of a disk, or a share of a disk, that is full.
FULL = (errno.ENOSPC, errno.EDQUOT)

#: Longest name of a file or folder, bytes, that leaves room for what is added to it; file systems allow 255.
LONGEST_NAME = 200


def short_name(name: str) -> str:
    """The name itself, or its beginning and a hash where the name and an addition exceed what file systems allow."""
    if len(os.fsencode(name)) <= LONGEST_NAME:
        return name
    # A character takes up to four bytes.
    return f"{name[: LONGEST_NAME // 8]}~{hashlib.sha256(os.fsencode(name)).hexdigest()[:32]}"


def unfinished_folder(folder: Path) -> Path:
    """A new, empty folder beside ``folder``: ".shot.k3f9a1b2". Its permissions follow the umask."""
    while True:
        new = folder.with_name(f".{short_name(folder.name)}.{uuid.uuid4().hex[:8]}")
        with contextlib.suppress(FileExistsError):
            new.mkdir()
            return new


def check_folder(folder: Path, overwrite: bool, kind: str = "result", files: tuple[str, ...] = RESULT_FILES) -> None:
    """Raise OSError unless output of this ``kind`` may be written to ``folder``.

    A folder that is not empty needs ``overwrite`` and one of the ``files`` of earlier output: other folders are never
    replaced.
    """
    if not folder.exists():
        _require_writable(folder, kind)
        return
    if not folder.is_dir():
        raise FileExistsError(f"{folder} is a file; give the name of a folder for the {kind}")
    if not any(folder.iterdir()):
        return
    if not overwrite:
        raise FileExistsError(f"{folder} exists and is not empty; give another folder, or `overwrite` to replace it")
    if not any((folder / name).is_file() for name in files):
        raise FileExistsError(f"{folder} holds files that are no {kind} of torchsphere; they are not overwritten")


def _require_writable(folder: Path, kind: str) -> None:
    """Raise PermissionError, with the name of ``folder`` as given, if it cannot be made."""
    above = next((parent for parent in folder.absolute().parents if parent.exists()), None)
    if above is not None and not os.access(above, os.W_OK | os.X_OK):
        raise PermissionError(f"{folder}: {above} may not be written to; give a folder for the {kind} that may be")


@contextlib.contextmanager
def atomic_folder(
    folder: Path, overwrite: bool, kind: str = "result", files: tuple[str, ...] = RESULT_FILES
) -> Iterator[Path]:
    """A new folder to write, which replaces ``folder`` if the block ends without an error; raises as `check_folder`."""
    check_folder(folder, overwrite, kind, files)
    folder = folder.absolute()
    folder.parent.mkdir(parents=True, exist_ok=True)
    new = unfinished_folder(folder)
    try:
        with replacement.being_filled(new):
            with full_disk_named(new, folder, kind):
                yield new
            check_folder(folder, overwrite, kind, files)
            if folder.exists():
                replacement.replace_folder(new, folder, lambda: unfinished_folder(folder))
            else:
                new.replace(folder)
                (folder / replacement.MARK).unlink(missing_ok=True)
    finally:
        if new.exists():
            shutil.rmtree(new)


def recover(folder: Path, files: tuple[str, ...] = RESULT_FILES) -> None:
    """Restore or remove what a killed process left of `atomic_folder` beside ``folder``."""
    replacement.recover(folder, short_name(folder.absolute().name), files)


class FullDiskError(OSError):
    """A disk is full; names the file, and the room that the output needs."""


def _full_disk_behind(error: BaseException | None) -> OSError | None:
    """The error of a full disk that an error is or follows: libraries may fail anew when they clean up."""
    while error is not None:
        if isinstance(error, OSError) and error.errno in FULL:
            return error
        error = error.__cause__ or error.__context__
    return None


@contextlib.contextmanager
def full_disk_named(new: Path, folder: Path, kind: str) -> Iterator[None]:
    """Raise the error of a full disk in the block as `FullDiskError`; ``new`` is written, and shown as ``folder``."""
    try:
        yield
    except Exception as error:
        full = _full_disk_behind(error)
        if full is None:
            raise
        named = FullDiskError(
            str(error).replace(str(new), str(folder))
            if isinstance(error, FullDiskError)
            else _full_disk_text(new, folder, kind, is_quota=full.errno != errno.ENOSPC)
        )
        named.errno = full.errno
        raise named from error


def _full_disk_text(new: Path, folder: Path, kind: str, is_quota: bool) -> str:
    written = [path for path in new.rglob("*") if path.is_file()]
    last = max(written, key=lambda path: path.stat().st_mtime_ns, default=new)
    # How much of a quota is left is not known.
    room = sum(path.stat().st_size for path in written) + (0 if is_quota else shutil.disk_usage(new).free)
    return (
        f"{folder / last.relative_to(new)}: no space left on {'the quota' if is_quota else 'device'}; the {kind} needs "
        f"more than {1e-6 * room:.2g} MB, and no more was free; make room, nothing was replaced"
    )


@contextlib.contextmanager
def atomic_file(path: Path) -> Iterator[TextIO]:
    """A text file to write to, which replaces ``path`` if the block ends without an error."""
    path.parent.mkdir(parents=True, exist_ok=True)
    if path.exists() and not path.is_file():
        # A pipe or a terminal cannot be replaced; a folder is refused by its own name.
        with path.open("w", newline="", encoding="utf-8") as stream:
            yield stream
        return
    with atomic_path(path) as part, part.open("w", newline="", encoding="utf-8") as stream:
        yield stream


@contextlib.contextmanager
def atomic_path(path: Path) -> Iterator[Path]:
    """The path of a file to write, which replaces ``path`` if the block ends without an error."""
    # A unique name, because several processes may write the same file.
    part = path.with_name(f".{short_name(path.name)}.{uuid.uuid4().hex}")
    try:
        yield part
        part.replace(path)
    except OSError as error:
        if error.errno in FULL:
            # The system does not say which file it could not write.
            error.filename = str(path)
        raise
    finally:
        part.unlink(missing_ok=True)
