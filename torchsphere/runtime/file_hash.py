"""Identity of the files of a recording; without torch, so that a background process starts quickly."""

from __future__ import annotations

import hashlib
import os
from collections.abc import Sequence
from pathlib import Path


def hash_files(files: Sequence[Path]) -> str:
    """SHA-256 over names and contents of the files of a recording."""
    digest = hashlib.sha256()
    for file in files:
        digest.update(os.fsencode(file.name) + b"\0")
        with file.open("rb") as stream:
            while block := stream.read(1 << 20):
                digest.update(block)
    return digest.hexdigest()
