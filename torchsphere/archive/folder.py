"""The output folder of an archive: its preparation, and the removal of results that a killed process left."""

from __future__ import annotations

import os
import re
import shutil
from collections.abc import Iterable
from pathlib import Path, PurePosixPath

from torchsphere.archive.claims import Claims, claims_of
from torchsphere.archive.scan import STATE
from torchsphere.results.atomic_output import short_name

SUMMARIES = ("summary.csv", "summary.parquet")
#: The same table by ``--export``.
EXPORTED = ("summary.h5", "summary.mat")
#: Name of an unfinished result folder, as `atomic_output.atomic_folder` gives it: ".shot.k3_x9a1b".
_UNFINISHED = re.compile(r"\.(?P<name>.+)\.[a-z0-9_]{8}")


def prepare(out: Path) -> Claims:
    """Make the output folder ready, and return its locks; raises OSError for a file, or a folder with other files."""
    if out.exists() and not out.is_dir():
        raise FileExistsError(f"{out} is a file; give the name of a folder for the results")
    if out.is_dir() and not (out / STATE).is_dir() and any(out.iterdir()) and not _has_table(out):
        raise FileExistsError(f"{out} holds files that are no results of 'torchsphere batch'; give another folder")
    (out / STATE / "records").mkdir(parents=True, exist_ok=True)
    return claims_of(out)


def _has_table(out: Path) -> bool:
    """Whether the folder has the table of an archive; a copy may lack the hidden folder of its state."""
    try:
        with (out / SUMMARIES[0]).open(encoding="utf-8") as stream:
            return stream.readline().startswith("recording,state,")
    except (OSError, UnicodeDecodeError):
        return False


def sweep(out: Path, results: Iterable[str]) -> int:
    """Remove unfinished result folders that no living process is filling, and return their number.

    Without locks nothing is removed, as another machine may be filling the folder.
    """
    claims = claims_of(out)
    if not claims.are_supported():
        return 0
    names: dict[PurePosixPath, dict[str, str]] = {}
    for result in results:
        path = PurePosixPath(result)
        names.setdefault(path.parent, {})[short_name(path.name)] = path.name
    removed = 0
    for parent, known in names.items():
        for folder, name in _unfinished(out / parent):
            if name not in known:
                continue
            with claims.claim((parent / known[name]).as_posix()) as is_mine:
                if is_mine:
                    shutil.rmtree(folder, ignore_errors=True)
                    removed += 1
    return removed


def _unfinished(parent: Path) -> list[tuple[Path, str]]:
    """Unfinished result folders in a folder, each with its final name."""
    try:
        with os.scandir(parent) as entries:
            found = [(entry, _UNFINISHED.fullmatch(entry.name)) for entry in entries]
            return [(Path(entry), match["name"]) for entry, match in found if match is not None and entry.is_dir()]
    except OSError:
        # Missing, or a path that the file system cannot have: nothing was left there.
        return []
