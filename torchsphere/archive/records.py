"""Records of how each recording ended: a small JSON file per recording, in the hidden folder of the archive's state."""

from __future__ import annotations

import contextlib
import dataclasses
import json
import os
import threading
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

from torchsphere.archive.key import Key
from torchsphere.archive.scan import STATE

DONE, FAILED, PENDING = "done", "failed", "pending"


@dataclasses.dataclass(frozen=True, slots=True, kw_only=True)
class Record:
    """How the measurement of a recording ended.

    Attributes
    ----------
    recording : str
        Path as in the manifest.
    state : str
        "done" or "failed".
    reason : str
        Why it failed, in a sentence.
    stat, settings : str
        The `Key` of the measurement.
    content : str or None
        SHA-256 of the contents of the input.
    run : str
        Name of the run that measured it.
    row : mapping
        Its columns of the summary.
    trace : str
        Traceback of an unforeseen error.
    """

    recording: str
    state: str
    reason: str = ""
    stat: str
    settings: str
    content: str | None
    run: str
    row: Mapping[str, Any]
    trace: str = ""


def is_current(record: Record, key: Key) -> bool:
    """Whether the record is of this input and these settings."""
    return (record.stat, record.settings) == (key.stat, key.settings)


def file_of(out: Path, result: str, suffix: str = ".json") -> Path:
    """Path of a file on the state of a recording; ``result`` is its result folder, relative to ``out``."""
    return out / STATE / "records" / f"{result}{suffix}"


def read(out: Path, result: str) -> Record | None:
    """The record of a recording, or None if there is no readable one."""
    table = read_table(file_of(out, result))
    try:
        return None if table is None else Record(**table)
    except TypeError:
        # The record is of another version: the result is found again, or the recording measured again.
        return None


def write(out: Path, result: str, record: Record) -> None:
    """Write the record of a recording in place of an earlier one."""
    write_table(file_of(out, result), dataclasses.asdict(record))


def read_table(path: Path) -> dict[str, Any] | None:
    """The JSON object in a file, or None if the file is missing or was cut by a power failure."""
    try:
        table = json.loads(path.read_bytes())
    except (OSError, ValueError):
        return None
    return table if isinstance(table, dict) else None


def write_table(path: Path, table: Mapping[str, Any]) -> None:
    """Write a JSON object to a file, whole or not at all."""
    path.parent.mkdir(parents=True, exist_ok=True)
    with new_version(path) as new:
        new.write_text(json.dumps(table, ensure_ascii=False), encoding="utf-8")


@contextlib.contextmanager
def new_version(path: Path) -> Iterator[Path]:
    """A path to write to; the new file takes the place of ``path`` if the block ends without an error."""
    new = path.with_name(f".{path.name}.{os.getpid()}.{threading.get_ident()}")
    try:
        yield new
        new.replace(path)
    finally:
        new.unlink(missing_ok=True)
