"""The recordings in a folder, and the files of each recording."""

from __future__ import annotations

import os
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

from torchsphere.recording import member
from torchsphere.recording.folder import IMAGE_SUFFIXES, natural_key
from torchsphere.recording.opener import SUFFIXES, stacks_of
from torchsphere.recording.photron_header import HEADER_SUFFIXES
from torchsphere.recording.refusal import what_lies_in
from torchsphere.recording.tiff import count_pages
from torchsphere.runtime import steps

TIFF = (".tif", ".tiff")
PHOTRON = (*HEADER_SUFFIXES, ".mraw")
#: Suffixes of files that may hold several recordings, or tables alone.
STACKS = (".h5", ".hdf5", ".mat")
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
    one recording; a TIFF file of several pages is a recording by itself, and so is each array of images in an HDF5 or
    MAT file.
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
        images = [name for name in names if suffixes[name] in IMAGE_SUFFIXES and suffixes[name] not in TIFF]
    files = [name for name in files if not _is_of_export(folder, name, names, has_images=bool(tiffs or images))]
    arrays = {name: arrays_in(folder / name) for name in files if suffixes[name] in STACKS}
    tables = [name for name, found in arrays.items() if not found]
    if tables:
        notes.append(f"{folder}: {what_lies_in(tables)} left out: no array of images inside.")
        files = [name for name in files if name not in tables]
    headers = {Path(name).stem for name in files if suffixes[name] in HEADER_SUFFIXES}
    seen: set[str] = set()
    for name in files:
        stem = Path(name).stem
        if suffixes[name] in PHOTRON:
            if (suffixes[name] == ".mraw" and stem in headers) or stem in seen:
                continue
            seen.add(stem)
        yield from arrays.get(name, [folder / name])
    if len(images) > 1 and not files:
        yield folder
    elif images:
        why = "lie beside recordings" if files else "are one image, and motion needs two or more"
        notes.append(f"{folder}: {len(images)} single image(s) were left out: they {why}.")


def arrays_in(path: Path) -> list[Path]:
    """The file, if it holds one array of images, or each of several; the file too where it cannot be read."""
    try:
        names = stacks_of(path)
    except (ValueError, OSError):
        # It fails by itself.
        return [path]
    return [path] if len(names) == 1 else [member.joined(path, name) for name in names]


def held(root: Path) -> str:
    """Say what lies in a folder and in its folders, hidden ones left out."""
    names: list[str] = []
    count = 0
    for _, folders, files in os.walk(root):
        folders[:] = [name for name in folders if not name.startswith(".")]
        count += len(folders)
        names += [name for name in files if not name.startswith(".")]
    return what_lies_in(names, count) or "nothing"


def _is_of_export(folder: Path, name: str, names: Sequence[str], *, has_images: bool) -> bool:
    """Whether a Photron header has no raw images, and was written beside images that were exported."""
    path = Path(name)
    if path.suffix.lower() not in HEADER_SUFFIXES or {path.stem + end for end in (".mraw", ".MRAW")} & set(names):
        return False
    return has_images or (folder / path.stem).is_dir()


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
    recording, _ = member.split(recording)
    suffix = recording.suffix.lower()
    try:
        if recording.is_dir():
            with os.scandir(recording) as entries:
                used = (*IMAGE_SUFFIXES, *HEADER_SUFFIXES)
                images = [e for e in entries if Path(e.name).suffix.lower() in used]
                return [entry.stat() for entry in sorted(images, key=lambda e: e.name) if entry.is_file()]
        if suffix in PHOTRON:
            partners = PHOTRON if suffix == ".mraw" else (suffix, ".mraw")
            stats = [_stat(recording.with_suffix(s)) or _stat(recording.with_suffix(s.upper())) for s in partners]
            return [stat for stat in (_stat(recording), *stats) if stat is not None] or [None]
        # A header of Photron's beside a TIFF has its frame rate.
        beside = [_stat(recording.with_suffix(s)) for s in HEADER_SUFFIXES] if suffix in TIFF else []
        return [_stat(recording), *(stat for stat in beside if stat is not None)]
    except OSError:
        return [None]


def _stat(path: Path) -> os.stat_result | None:
    try:
        return path.stat()
    except OSError:
        return None
