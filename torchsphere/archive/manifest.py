"""The recordings of an archive, from a folder, a CSV or a TOML file, each with settings and result folder."""

from __future__ import annotations

import csv
import dataclasses
import os
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path, PurePosixPath
from typing import Any

from torchsphere.archive import scan
from torchsphere.archive.folder import EXPORTED, SUMMARIES
from torchsphere.recording import member
from torchsphere.recording.ignore_mask import located
from torchsphere.recording.opener import SUFFIXES
from torchsphere.request import PER_RECORDING, check_settings
from torchsphere.runtime.shown_text import shown
from torchsphere.settings.configuration import find, from_cells, from_table, merged, read_toml

#: Names of the column of the recordings, and name of the column of the result folders.
RECORDING, RESULT = ("recording", "input"), "result"
#: Files that the run writes beside the result folders; none of these may be a result.
RESERVED = (*SUMMARIES, *EXPORTED, "index.html")
EXAMPLE = "expected a folder of recordings, or a manifest .csv or .toml with a row per recording"


@dataclass(frozen=True, slots=True)
class Item:
    """One recording of an archive."""

    recording: str  # path as in the manifest, or relative to the searched folder
    input: Path  # path to open
    result: str  # result folder, relative to the output folder, with slashes
    settings: Mapping[str, Any]  # fields of `torchsphere.request.Request`
    refusal: str = ""  # why this recording of a folder cannot be measured
    has_own_result: bool = False  # whether a manifest names the result folder


@dataclass(frozen=True)
class Archive:
    """Recordings in order, each with its own result folder, and notes on ignored images."""

    items: tuple[Item, ...]
    notes: tuple[str, ...] = ()


def read_all(sources: Sequence[Path], common: Mapping[str, Any], out: Path) -> Archive:
    """The archive of one or several folders, manifests and recordings, as `read`.

    Among several sources, the results of a folder lie in a folder of its name.
    """
    if len(sources) == 1:
        return _once(read(sources[0], common, out))
    placed: list[tuple[str, Item]] = []
    notes: list[str] = []
    for source in sources:
        part = read(source, common, out)
        notes += part.notes
        for item in part.items:
            if source.is_dir() and item.input != source:
                name = shown(source.resolve().name)
                recording, result = (f"{name}/{inside}" for inside in (item.recording, item.result))
                item = dataclasses.replace(item, recording=recording, result=result)
            placed.append((str(source), item))
    _require_own_folders(sources[0], placed)
    return _once(Archive(tuple(item for _, item in placed), tuple(notes)))


def _once(archive: Archive) -> Archive:
    """The archive without links to recordings that are in it with the same settings, and notes on these."""
    same: dict[Any, list[Item]] = {}
    for item in archive.items:
        same.setdefault(_identity(item), []).append(item)
    left_out: dict[int, str] = {}
    for items in same.values():
        if len(items) > 1:
            # A file comes before the links to it.
            first = min(items, key=lambda item: item.input.is_symlink())
            left_out |= {id(item): first.recording for item in items if item is not first}
    notes = [
        f"{item.recording} is the same recording as {left_out[id(item)]}, and is measured once, by this name."
        for item in archive.items
        if id(item) in left_out
    ]
    return Archive(tuple(item for item in archive.items if id(item) not in left_out), (*archive.notes, *notes))


def _identity(item: Item) -> Any:
    """What two names of one recording share: the file itself, by any link, and the settings."""
    try:
        stat = item.input.stat()
    except (OSError, ValueError):
        # What is missing fails by its own name.
        return item.result
    if item.has_own_result or not stat.st_ino:
        return item.result
    return stat.st_dev, stat.st_ino, repr(sorted(item.settings.items()))


def read(source: Path, common: Mapping[str, Any], out: Path) -> Archive:
    """The archive of a folder or a manifest; ``common`` settings hold where a recording has none of its own.

    Raises ValueError or OSError without recordings, for invalid rows or columns, and for shared result folders.
    """
    check_settings(common)
    notes: tuple[str, ...] = ()
    if source.is_dir():
        if out.resolve() == source.resolve():
            raise ValueError(f"{out}: is the folder of the recordings itself; give another one for the results")
        found = scan.scan(source, leave_out=out)
        notes = found.notes
        placed = [(str(source), _found(source, path, common)) for path in found.recordings]
    elif not member.split(source)[0].exists():
        raise FileNotFoundError(f"{source}: does not exist; {EXAMPLE}")
    elif source.suffix.lower() == ".csv":
        placed = list(_from_rows(source, _csv_rows(source), common))
    elif source.suffix.lower() == ".toml":
        placed = _from_toml(source, common)
    elif member.split(source)[0].suffix.lower() in SUFFIXES:
        placed = _of_file(source, common)
    else:
        raise ValueError(f"{source}: is no archive; {EXAMPLE}")
    if not placed:
        left = f" ({' '.join(notes)})" if notes else ""
        there = f", but {scan.held(source)}" if source.is_dir() else ""
        raise ValueError(f"{source}: holds no recording{there}{left}; {EXAMPLE}")
    _require_own_folders(source, placed)
    return Archive(tuple(item for _, item in placed), notes)


def _of_file(source: Path, common: Mapping[str, Any]) -> list[tuple[str, Item]]:
    """A recording, or all in an HDF5 or MAT file of which no array is named."""
    file, name = member.split(source)
    may_be_several = not name and file.suffix.lower() in scan.STACKS
    # A file of tables alone is refused where it is opened.
    paths = (scan.arrays_in(file) if may_be_several else []) or [source]
    return [(str(path), _found(file.parent, path, common)) for path in paths]


def _found(root: Path, path: Path, common: Mapping[str, Any]) -> Item:
    inside = path.relative_to(root)
    result = inside.as_posix() if path.is_dir() else _unsuffixed(inside).as_posix()
    if path == root:
        result = root.resolve().name
    name = shown(inside.as_posix())
    # Tables and records are UTF-8: other bytes of a name are written as \\xe9.
    result = os.fsencode(result).decode("utf-8", "backslashreplace")
    reason = _reserved(result)
    return Item(name, path, result, common, f"{name}: {reason}" if reason else "")


def _reserved(result: str) -> str:
    """Why a result folder cannot have this name; empty where it can."""
    first = PurePosixPath(result.lower()).parts[0]
    if first in RESERVED:
        return f"a result folder {result!r} would lie where the run writes its own {first}; give another name"
    return ""


def _csv_rows(source: Path) -> Iterator[tuple[str, dict[str, str]]]:
    """Place (file and row) and cells that are not empty, of each row."""
    try:
        with source.open(newline="", encoding="utf-8-sig") as stream:
            head = stream.readline()
            stream.seek(0)
            # Spreadsheets with a decimal comma separate cells by semicolons.
            delimiter = ";" if ";" in head and "," not in head else ","
            reader = csv.DictReader(stream, delimiter=delimiter, skipinitialspace=True, strict=True)
            names = [name.strip() for name in reader.fieldnames or ()]
            _require_columns(source, names)
            reader.fieldnames = names
            for row in reader:
                where = f"{source}, row {reader.line_num}"
                if None in row:
                    raise ValueError(
                        f"{where}: has more cells than the {len(names)} columns; write decimals with a point, and "
                        "quote cells that hold commas"
                    )
                yield where, {name: text.strip() for name, text in row.items() if text and text.strip()}
    except (csv.Error, UnicodeDecodeError) as error:
        raise ValueError(f"{source}: is no CSV file in UTF-8 ({error}); save it as one") from error


def _require_columns(source: Path, names: list[str]) -> None:
    if not set(names) & set(RECORDING):
        tabs = "; commas or semicolons part the columns, not tabs" if any("\t" in name for name in names) else ""
        raise ValueError(
            f"{source}: has the columns {', '.join(names) or 'none'}; expected one named 'recording'{tabs}"
        )
    if "" in names:
        raise ValueError(f"{source}: column {names.index('') + 1} has no name; name it, or remove it")
    first: dict[str, str] = {}
    for name in names:
        try:
            meaning = RECORDING[0] if name in RECORDING else name if name == RESULT else find(PER_RECORDING, name).name
        except ValueError as error:
            raise ValueError(f"{source}: column {error}, or 'recording', or 'result'") from error
        if meaning in first:
            both = repr(name) if first[meaning] == name else f"of one meaning, {first[meaning]!r} and {name!r}"
            raise ValueError(f"{source}: has two columns {both}; leave one out")
        first[meaning] = name


def _from_rows(
    source: Path, rows: Iterable[tuple[str, dict[str, str]]], common: Mapping[str, Any]
) -> Iterator[tuple[str, Item]]:
    """Place and recording of each row."""
    for where, cells in rows:
        if not cells:
            continue
        own = {column: text for column, text in cells.items() if column not in (*RECORDING, RESULT)}
        yield where, _item(source, where, cells, from_cells(where, own, PER_RECORDING), common)


def _from_toml(source: Path, common: Mapping[str, Any]) -> list[tuple[str, Item]]:
    tables = read_toml(source)
    rows = tables.pop("recordings", None)
    if not isinstance(rows, list) or not all(isinstance(row, dict) for row in rows):
        raise ValueError(f"{source}: has no [[recordings]]; expected such a table for each recording")
    # Settings of the file override common settings, and settings of a recording override both.
    common = merged(common, _rebased(source, from_table(str(source), tables, PER_RECORDING)))
    placed = []
    for number, row in enumerate(rows, start=1):
        where = f"{source}, recording {number}"
        names = {key: row.pop(key) for key in (*RECORDING, RESULT) if key in row}
        if all(key in names for key in RECORDING):
            raise ValueError(f"{where}: has both {' and '.join(map(repr, RECORDING))}; leave one out")
        if not all(isinstance(value, str) for value in names.values()):
            raise ValueError(f"{where}: {', '.join(names)}: expected text")
        placed.append((where, _item(source, where, names, from_table(where, row, PER_RECORDING), common)))
    return placed


def _item(
    source: Path, where: str, names: Mapping[str, str], own: Mapping[str, Any], common: Mapping[str, Any]
) -> Item:
    name = next((names[key] for key in RECORDING if names.get(key)), None)
    if name is None:
        raise ValueError(f"{where}, column 'recording': is empty; expected the path of a recording")
    if "\0" in "".join(names.values()):
        raise ValueError(f"{where}: a name has a NUL, which no file has; correct the manifest")
    together = merged(common, _rebased(source, own))
    try:
        check_settings(together)
    except ValueError as error:
        raise ValueError(f"{where}: {error}") from error
    result = _result(where, name, names.get(RESULT))
    reason = _reserved(result)
    if reason:
        raise ValueError(f"{where}: {reason}")
    return Item(name, source.parent / name, result, together, has_own_result=RESULT in names)


def _rebased(source: Path, own: Mapping[str, Any]) -> dict[str, Any]:
    """The settings with mask images relative to the manifest, as the recordings are."""
    if "ignore" not in own:
        return dict(own)
    return {**own, "ignore": located(own["ignore"], source.parent)}


def _result(where: str, name: str, result: str | None) -> str:
    """The given result folder, or the path of the recording without parts such as ``..`` and without its suffix."""
    if result is not None:
        path = PurePosixPath(result.replace("\\", "/"))
        if path.is_absolute() or ".." in path.parts or path.parts[:1] in ((), (scan.STATE,)):
            raise ValueError(f"{where}, column 'result': {result!r} leads out of the output folder")
        return path.as_posix()
    source = Path(name)
    file, _ = member.split(source)
    path = PurePosixPath(*[part for part in source.parts if part not in (source.anchor, "..", ".")])
    if not path.parts:
        raise ValueError(f"{where}, column 'recording': {name!r} has no name of its own; add a column 'result'")
    return (_unsuffixed(Path(path)) if file.suffix.lower() in SUFFIXES else path).as_posix()


def _unsuffixed(path: Path) -> Path:
    """The path without the suffix of its file; an array in a file has a name of one part, "shot-camera-images"."""
    return member.split(path)[0].with_name(member.flat_name(path))


def _require_own_folders(source: Path, placed: list[tuple[str, Item]]) -> None:
    # On some file systems, upper and lower case name the same folder.
    places: dict[str, tuple[str, Item]] = {}
    for where, item in placed:
        first, other = places.setdefault(item.result.lower(), (where, item))
        if other is item:
            continue
        if other.recording == item.recording:
            row = first.removeprefix(f"{source}, ")
            raise ValueError(
                f"{where}: {item.recording} stands in {row} already, and both would be written to {item.result}; leave "
                "one out, or give each a result folder of its own in a column 'result'"
            )
        raise ValueError(
            f"{where}: {other.recording} and {item.recording} would both be written to {item.result}; "
            "rename one, or give a manifest with a column 'result'"
        )
    for where, item in placed:
        for parent in PurePosixPath(item.result.lower()).parents:
            outer = places.get(str(parent))
            if outer is not None:
                raise ValueError(
                    f"{where}: the result of {item.recording} would lie within that of {outer[1].recording}; "
                    "rename one, or give a manifest with a column 'result'"
                )
