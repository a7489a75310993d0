"""What is known of each recording: one small file each, whole or not there, under the archive's ``.batch`` folder."""

from __future__ import annotations

import contextlib
import dataclasses
import json
import os
import threading
from collections.abc import Mapping
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
    state : str
        "done" or "failed".
    reason : str
        Why it failed, in a sentence.
    stat, settings : str
        The `Key` that it was measured with.
    content : str or None
        SHA-256 of the input's contents.
    run : str
        The run that measured it.
    row : mapping
        Its columns of the summary.
    trace : str
        Where an error came up that was not foreseen.
    """

    recording: str
    state: str
    reason: str
    stat: str
    settings: str
    content: str | None
    run: str
    row: Mapping[str, Any]
    trace: str = ""


def is_current(record: Record, key: Key) -> bool:
    """Whether the record still speaks of its input and its settings."""
    return (record.stat, record.settings) == (key.stat, key.settings)


def file_of(out: Path, result: str, suffix: str = ".json") -> Path:
    """The file of a recording's state."""
    return out / STATE / "records" / f"{result}{suffix}"


def read(out: Path, result: str) -> Record | None:
    """The record of a recording, or None where there is none that can be read."""
    table = read_table(file_of(out, result))
    try:
        return None if table is None else Record(**table)
    except TypeError:
        # Of another version: the recording is measured, or its result found, again.
        return None


def write(out: Path, result: str, record: Record) -> None:
    """Put the record in the place of an earlier one."""
    write_table(file_of(out, result), dataclasses.asdict(record))


def read_table(path: Path) -> dict[str, Any] | None:
    """A JSON object, or None where there is none: not there, or cut by a power failure."""
    try:
        table = json.loads(path.read_bytes())
    except (OSError, ValueError):
        return None
    return table if isinstance(table, dict) else None


def write_table(path: Path, table: Mapping[str, Any]) -> None:
    """Write a JSON object, whole or not at all."""
    path.parent.mkdir(parents=True, exist_ok=True)
    new = path.with_name(f".{path.name}.{os.getpid()}.{threading.get_ident()}")
    try:
        new.write_text(json.dumps(table, ensure_ascii=False), encoding="utf-8")
        new.replace(path)
    finally:
        with contextlib.suppress(FileNotFoundError):
            new.unlink()
