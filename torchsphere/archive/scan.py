"""The recordings in a folder, and the files of each recording."""

from __future__ import annotations

import os
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

from torchsphere.recording.folder import natural_key
from torchsphere.recording.photron import HEADER_SUFFIXES
from torchsphere.recording.tiff import count_pages
from torchsphere.runtime import steps

TIFF = (".tif", ".tiff")
PHOTRON = (*HEADER_SUFFIXES, ".mraw")
#: Suffixes of files that `open_recording` opens; a test compares both.
SUFFIXES = (*TIFF, *PHOTRON, ".npy", ".npz", ".cine", ".avi", ".mp4", ".m4v", ".mov", ".mkv", ".webm")
#: Hidden folder in the output folder, with the records and the locks of the recordings.
STATE = ".batch"
#: Number of files from which a search takes about three seconds, at 3 ms each on a slow network drive.
MANY_FILES = 1000


@dataclass(frozen=True)
class Found:
    """Recordings (files, or folders of images), and notes on ignored images."""

    recordings: tuple[Path, ...]
    notes: tuple[str, ...]


def scan(root: Path, leave_out: Path | None = None) -> Found:
    """Find all recordings in ``root`` and its folders, in the order of their names.

    Hidden files and folders, result folders and the folder ``leave_out`` are skipped. The single images of a folder are
    one recording; a TIFF file of several pages is a recording by itself.
    """
    recordings: list[Path] = []
    notes: list[str] = []
    out = None if leave_out is None else leave_out.resolve()

    def closed(error: OSError) -> None:
        notes.append(f"{error.filename}: cannot be looked into ({(error.strerror or str(error)).lower()}).")

    seen = 0
    for place, folders, names in os.walk(root, onerror=closed):
        folder = Path(place)
        if seen < MANY_FILES <= seen + len(names):
            steps.tell("looking for recordings in %s, which holds many files", root)
        seen += len(names)
        is_result = STATE in folders or {"summary.json", "track.csv"} <= set(names)
        if is_result or (out is not None and folder.resolve() == out):
            folders.clear()
            continue
        folders[:] = sorted((name for name in folders if not name.startswith(".")), key=natural_key)
        linked = [folder / name for name in folders if (folder / name).is_symlink()]
        notes += [
            f"{link}: is a link to a folder, which is not searched; name that folder, too."
            for link in linked
            if not link.resolve().is_relative_to(root.resolve())
        ]
        visible = sorted((name for name in names if not name.startswith(".")), key=natural_key)
        recordings += _in_folder(folder, visible, notes)
    return Found(tuple(recordings), tuple(notes))


def _in_folder(folder: Path, names: Sequence[str], notes: list[str]) -> Iterator[Path]:
    suffixes = {name: Path(name).suffix.lower() for name in names}
    files = [name for name in names if suffixes[name] in SUFFIXES]
    # A pipe or a broken link fails by itself; opening a pipe would never end.
    odd = [name for name in files if not (folder / name).is_file()]
    yield from (folder / name for name in odd)
    files = [name for name in files if name not in set(odd)]
    tiffs = [name for name in files if suffixes[name] in TIFF]
    # Three files decide, as opening every TIFF file of a large folder takes too long.
    if tiffs and _single_pages([folder / tiffs[i] for i in sorted({0, len(tiffs) // 2, len(tiffs) - 1})]):
        files = [name for name in files if name not in set(tiffs)]
        images = tiffs
    else:
        images = [name for name in names if suffixes[name] == ".png"]
    headers = {Path(name).stem for name in files if suffixes[name] in HEADER_SUFFIXES}
    seen: set[str] = set()
    for name in files:
        stem = Path(name).stem
        if suffixes[name] in PHOTRON:
            if (suffixes[name] == ".mraw" and stem in headers) or stem in seen:
                continue
            seen.add(stem)
        yield folder / name
    if len(images) > 1 and not files:
        yield folder
    elif images:
        why = "lie beside recordings" if files else "are one image, and motion needs two or more"
        notes.append(f"{folder}: {len(images)} single image(s) were left out: they {why}.")


def _single_pages(paths: Sequence[Path]) -> bool:
    """Whether all TIFF files that can be read have one page; False if none can be read."""
    pages = []
    for path in paths:
        try:
            pages.append(count_pages(path))
        except (ValueError, OSError):
            continue
    return bool(pages) and max(pages) == 1


def files_of(recording: Path) -> list[os.stat_result | None]:
    """Size and time of change of each file of a recording, without opening it; None for a missing file."""
    suffix = recording.suffix.lower()
    try:
        if recording.is_dir():
            with os.scandir(recording) as entries:
                images = [e for e in entries if Path(e.name).suffix.lower() in (*TIFF, ".png")]
                return [entry.stat() for entry in sorted(images, key=lambda e: e.name) if entry.is_file()]
        if suffix in PHOTRON:
            partners = PHOTRON if suffix == ".mraw" else (suffix, ".mraw")
            stats = [_stat(recording.with_suffix(s)) or _stat(recording.with_suffix(s.upper())) for s in partners]
            return [stat for stat in (_stat(recording), *stats) if stat is not None] or [None]
        return [_stat(recording)]
    except OSError:
        return [None]


def _stat(path: Path) -> os.stat_result | None:
    try:
        return path.stat()
    except OSError:
        return None
