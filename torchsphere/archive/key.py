"""Hashes of the input and of the settings of a result, to see whether the result is still valid."""

from __future__ import annotations

import dataclasses
import functools
import hashlib
import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from torchsphere.archive.scan import files_of
from torchsphere.recording import open_recording
from torchsphere.request import PER_RECORDING
from torchsphere.runtime.file_hash import hash_files


@dataclasses.dataclass(frozen=True, slots=True)
class Key:
    """Hashes of a recording's input and settings.

    Attributes
    ----------
    stat : str
        Hash of the sizes and times of change of the input's files: to read the contents of a whole archive at every
        run would take too long. If this hash differs, `content` decides.
    settings : str
        Hash of the settings that are not the default, and of the contents of mask images.
    """

    stat: str
    settings: str


def key_of(recording: Path, settings: Mapping[str, Any]) -> Key:
    """The key of a recording and its settings. Of all files, only mask images are opened."""
    stats = [None if stat is None else (stat.st_size, stat.st_mtime_ns) for stat in files_of(recording)]
    # Defaults are left out, so that a setting that a later version adds does not change the keys of earlier results.
    changed = {name: value for name, value in settings.items() if _plain(value) != _plain(PER_RECORDING[name].default)}
    masks = [_mask_hash(text) for text in settings.get("ignore", ())]
    return Key(_hash(stats), _hash([changed, masks]))


def content(recording: Path) -> str | None:
    """SHA-256 of the input's files, as in ``summary.json``; None if they cannot be opened."""
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
