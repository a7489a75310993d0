"""What a result rests on: a hash of the input and one of the settings."""

from __future__ import annotations

import dataclasses
import functools
import hashlib
import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from torchsphere.archive.scan import files_of
from torchsphere.archive.settings import DEFAULTS
from torchsphere.recording import open_recording
from torchsphere.runtime.file_hash import hash_files


@dataclasses.dataclass(frozen=True, slots=True)
class Key:
    """Hashes that tell whether a result is still that of its recording and settings.

    Attributes
    ----------
    stat : str
        Of the sizes and times of change of the input's files: reading an archive's contents at every run would take
        longer than what is new in it. Where it differs, `content` decides.
    settings : str
        Of the settings that are not the default, and of the mask images they name.
    """

    stat: str
    settings: str


def key_of(recording: Path, settings: Mapping[str, Any]) -> Key:
    """The key of a recording with its settings, from the file system's tables alone (but for mask images)."""
    stats = [None if stat is None else (stat.st_size, stat.st_mtime_ns) for stat in files_of(recording)]
    # A setting that a later version adds leaves the keys of earlier results as they are.
    told = {name: value for name, value in settings.items() if _plain(value) != _plain(DEFAULTS[name])}
    masks = [_mask_hash(text) for text in settings.get("ignore", ())]
    return Key(_hash(stats), _hash([told, masks]))


def content(recording: Path) -> str | None:
    """SHA-256 of the input's files, as ``summary.json`` has it; None where they cannot be opened."""
    try:
        with open_recording(recording) as opened:
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
    return _file_hash(path, stat.st_size, stat.st_mtime_ns)


@functools.lru_cache(maxsize=1024)
def _file_hash(path: Path, size: int, time_ns: int) -> str:
    return hash_files([path])
