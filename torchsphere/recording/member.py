"""Names of one array within a file: ``shot.h5:/camera/images``."""

from __future__ import annotations

import os
import re
from pathlib import Path

#: Suffixes of files that may hold several arrays.
SUFFIXES = (".h5", ".hdf5", ".mat", ".npz")
# The colon behind a drive, as in C:\shot.h5, has no suffix in front of it.
_MEMBER = re.compile(rf"(.+?(?:{'|'.join(map(re.escape, SUFFIXES))})):[/\\]*(.+)", re.DOTALL | re.IGNORECASE)


def split(path: Path) -> tuple[Path, str]:
    """The file, and the name of the array in it without a slash in front; an empty name for the path of a file."""
    found = _MEMBER.fullmatch(str(path))
    if found is None or path.exists():
        return path, ""
    # Windows turns the slashes of a path.
    return Path(found[1]), found[2].replace(os.sep, "/")


def joined(file: Path, name: str) -> Path:
    """The path of an array in a file."""
    return Path(f"{file}:/{name}")


def flat_name(path: Path) -> str:
    """Name of a file without its suffix; of an array in a file both names, "shot-camera-images"."""
    file, name = split(path)
    return "-".join((file.stem, *name.split("/"))) if name else file.stem
