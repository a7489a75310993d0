"""The output folder of an archive: whether it is one, and what a killed process left in it."""

from __future__ import annotations

import os
import re
import shutil
from collections.abc import Iterable
from pathlib import Path, PurePosixPath

from torchsphere.archive.claims import Claims, claims
from torchsphere.archive.scan import STATE

SUMMARIES = ("summary.csv", "summary.parquet")
#: Folders that `atomic_output.atomic_folder` fills before they get their name, "shot" here: .shot.k3_x9a1b
_UNFINISHED = re.compile(r"\.(?P<name>.+)\.[a-z0-9_]{8}")


def prepare(out: Path) -> Claims:
    """Make the folder ready, and give its claims.

    Raises
    ------
    OSError
        Where it is a file, or holds what is no archive's result.
    """
    if out.exists() and not out.is_dir():
        raise FileExistsError(f"{out} is a file; give the name of a folder for the results")
    if out.is_dir() and not (out / STATE).is_dir() and any(out.iterdir()) and not _has_table(out):
        raise FileExistsError(f"{out} holds files that are no results of 'torchsphere batch'; give another folder")
    (out / STATE / "records").mkdir(parents=True, exist_ok=True)
    return claims_of(out)


def _has_table(out: Path) -> bool:
    """Whether the folder has an archive's table: a copy may have left out what is hidden, its state among it."""
    try:
        with (out / SUMMARIES[0]).open(encoding="utf-8") as stream:
            return stream.readline().startswith("recording,state,")
    except (OSError, UnicodeDecodeError):
        return False


def claims_of(out: Path) -> Claims:
    """The claims on the recordings of an archive."""
    return claims((out / STATE / "claims").absolute())


def sweep(out: Path, results: Iterable[str]) -> int:
    """Remove unfinished folders that no living process claims; how many there were.

    Each folder that holds results is listed once, however many results it holds.
    """
    names: dict[PurePosixPath, set[str]] = {}
    for result in results:
        path = PurePosixPath(result)
        names.setdefault(path.parent, set()).add(path.name)
    removed = 0
    for parent, known in names.items():
        try:
            with os.scandir(out / parent) as entries:
                left = [entry.name for entry in entries if entry.name.startswith(".") and entry.is_dir()]
        except (FileNotFoundError, NotADirectoryError):
            continue
        for folder in left:
            match = _UNFINISHED.fullmatch(folder)
            if match is None or match["name"] not in known:
                continue
            with claims_of(out).claim((parent / match["name"]).as_posix()) as mine:
                if mine:
                    shutil.rmtree(out / parent / folder, ignore_errors=True)
                    removed += 1
    return removed
