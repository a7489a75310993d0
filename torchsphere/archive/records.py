"""Records of how each recording ended, a small JSON file each, and the hashes that tell whether a record is valid."""

from __future__ import annotations

import dataclasses
import functools
import hashlib
import json
import os
import stat as file_types
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from torchsphere.archive import summary
from torchsphere.archive.scan import STATE, files_of
from torchsphere.recording import open_recording
from torchsphere.request import PER_RECORDING
from torchsphere.results.atomic_output import atomic_path, short_name
from torchsphere.runtime.file_hash import hash_files

#: UNUSABLE: the result is written, and nothing usable was measured.
DONE, UNUSABLE, FAILED, PENDING = "done", "unusable", "failed", "pending"
ENDS = (DONE, UNUSABLE, FAILED)

#: Longest path of a result folder that its record mirrors, bytes; the system's limit of a whole path is 4096.
_LONGEST_PATH = 1000


@dataclasses.dataclass(frozen=True, slots=True)
class Key:
    """Hashes of a recording's input and settings."""

    stat: str  # of the sizes and times of change of the input's files; `content` decides where this hash differs
    settings: str  # of the settings that are not the default, and of the contents of mask images


@dataclasses.dataclass(frozen=True, slots=True, kw_only=True)
class Record:
    """How the measurement of a recording ended."""

    recording: str  # path as in the manifest
    state: str  # "done", "unusable" or "failed"
    reason: str = ""  # of a failure, why nothing usable was measured, or what is lacking, in a sentence
    stat: str  # as in `Key`
    settings: str  # as in `Key`
    content: str | None  # SHA-256 of the contents of the input
    run: str  # name of the run that measured it
    row: Mapping[str, Any]  # columns of the summary
    trace: str = ""  # traceback of an unforeseen error


def key_of(recording: Path, settings: Mapping[str, Any]) -> Key:
    """The key of a recording and its settings. Of all files, only mask images are opened."""
    stats = [None if stat is None else (stat.st_size, stat.st_mtime_ns) for stat in files_of(recording)]
    # Without defaults, a setting that a later version adds does not change the keys of earlier results.
    changed = {name: value for name, value in settings.items() if _plain(value) != _plain(PER_RECORDING[name].default)}
    masks = [_mask_hash(text) for text in settings.get("ignore", ())]
    return Key(_hash(stats), _hash([changed, masks]))


def content(recording: Path, axes: str | None = None) -> str | None:
    """SHA-256 of the input's files, as in ``summary.json``; None if they cannot be opened."""
    try:
        with open_recording(recording, axes=axes) as opened:
            return hash_files(opened.files)
    except (ValueError, OSError):
        return None


def _plain(value: Any) -> Any:
    return json.loads(json.dumps(value, default=str))


def _hash(value: Any) -> str:
    return hashlib.sha256(json.dumps(value, sort_keys=True, default=str).encode()).hexdigest()


def _mask_hash(text: str) -> str | None:
    path = Path(text)
    try:
        stat = path.stat()
    except (OSError, ValueError):
        return None
    if not file_types.S_ISREG(stat.st_mode):
        # Reading a pipe would never end.
        return None
    return _file_hash(path, stat.st_size, stat.st_mtime_ns)


@functools.lru_cache(maxsize=1024)
def _file_hash(path: Path, size: int, time_ns: int) -> str:
    return hash_files([path])


def is_current(record: Record, key: Key) -> bool:
    """Whether the record is of this input and these settings."""
    return (record.stat, record.settings) == (key.stat, key.settings)


def file_of(out: Path, result: str, suffix: str = ".json") -> Path:
    """Path of a state file of a recording with the result folder ``result``, relative to ``out``."""
    parts = result.split("/")
    if len(os.fsencode(result)) > _LONGEST_PATH:
        parts = [short_name(result)]
    # Folders end in "~": the record of "x" and the records in "x.json" would else take one name.
    folders = [f"{short_name(part)}~" for part in parts[:-1]]
    return out.joinpath(STATE, "records", *folders, short_name(parts[-1]) + suffix)


def read(out: Path, result: str) -> Record | None:
    """The record of a recording, or None if there is no readable one."""
    table = read_table(file_of(out, result))
    try:
        record = None if table is None else Record(**table)
    except TypeError:
        # A record of another version: the result is found again, or the recording measured again.
        return None
    # So is a damaged record, one field of which would stop the table of all recordings.
    return record if record is not None and _is_sound(record) else None


def _is_sound(record: Record) -> bool:
    values: dict[str, Any] = dataclasses.asdict(record)
    row, content = values.pop("row"), values.pop("content")
    is_text = all(isinstance(value, str) for value in values.values())
    is_row = isinstance(row, dict) and summary.is_row(row)
    return is_text and is_row and isinstance(content, str | None) and record.state in ENDS


def write(out: Path, result: str, record: Record) -> None:
    """Write the record of a recording in place of an earlier one."""
    write_table(file_of(out, result), dataclasses.asdict(record))


def read_table(path: Path) -> dict[str, Any] | None:
    """The JSON object in a file, or None if the file is missing or was cut by a power failure."""
    try:
        table = json.loads(path.read_bytes())
    except (OSError, ValueError, RecursionError):
        return None
    return table if isinstance(table, dict) else None


def write_table(path: Path, table: Mapping[str, Any]) -> None:
    """Write a JSON object to a file, whole or not at all."""
    path.parent.mkdir(parents=True, exist_ok=True)
    with atomic_path(path) as new:
        new.write_text(json.dumps(table), encoding="ascii")
