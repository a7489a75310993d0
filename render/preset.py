"""Presets: shots from TOML files, those of the package by name, others by path."""

from __future__ import annotations

import copy
import dataclasses
import json
import tomllib
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from .build import BadFieldError, build, plain, suggestion
from .scene import Setup
from .shot import Shot, seeded
from .trajectory import KINDS, Trajectory

#: Folder of the package's presets.
FOLDER = Path(__file__).parent / "presets"

_SETUP = tuple(f.name for f in dataclasses.fields(Setup))
_TOP = ("description", "frame_rate_hz", "frames")


def names() -> list[str]:
    """Names of the package's presets."""
    return sorted(path.stem for path in FOLDER.glob("*.toml"))


def load(shot: str, changes: Sequence[str] = (), seed: int | None = None) -> Shot:
    """A shot by the name of a preset, or by the path of a ``.toml`` file or of a ``scene.json``.

    Parameters
    ----------
    shot : str
        Name or path.
    changes : sequence of str
        ``field.path=value`` each, the value as in TOML; quotes around a text may be left out.
    seed : int, optional
        Replaces all seeds.

    Raises
    ------
    ValueError
        If the preset or a change is invalid; one sentence names the preset and the field.
    OSError
        If the file cannot be read.
    """
    path = find(shot)
    try:
        table = copy.deepcopy(_read(path))
        for change in changes:
            _change(table, change)
        made = _shot(path, table)
        return made if seed is None else dataclasses.replace(made, setup=seeded(made.setup, seed))
    except BadFieldError as error:
        raise ValueError(f"preset {shot!r}, {error}") from error
    except ValueError as error:
        raise ValueError(f"preset {shot!r}: {error}") from error


def find(shot: str) -> Path:
    """The file of a preset.

    Raises
    ------
    ValueError
        If there is no such file or preset.
    """
    path = Path(shot)
    if path.suffix in (".toml", ".json"):
        if not path.is_file():
            raise ValueError(f"preset {shot!r}: there is no such file; give its path, or one of {', '.join(names())}")
        return path
    if shot not in names():
        raise ValueError(f"preset {shot!r} is not known: {suggestion(shot, names())} Or give the path of a .toml file")
    return FOLDER / f"{shot}.toml"


def table(shot: Shot) -> dict[str, Any]:
    """The table of the shot, as in a TOML file, with every default written out."""
    kind = next(name for name, cls in KINDS.items() if type(shot.trajectory) is cls)
    head = {name: getattr(shot, name) for name in _TOP}
    return head | {"trajectory": {"kind": kind} | plain(shot.trajectory)} | plain(shot.setup)


def _read(path: Path) -> dict[str, Any]:
    try:
        text = path.read_text(encoding="utf-8")
        content = json.loads(text) if path.suffix == ".json" else tomllib.loads(text)
    except (tomllib.TOMLDecodeError, json.JSONDecodeError, UnicodeDecodeError) as error:
        raise ValueError(f"is no {path.suffix[1:].upper()} file: {error}") from error
    if path.suffix == ".json":
        content = content.get("shot") if isinstance(content, dict) else None
    if not isinstance(content, dict):
        raise ValueError("holds no shot; expected the scene.json of a rendered recording")
    return content


def _shot(path: Path, content: dict[str, Any]) -> Shot:
    for name in content:
        if name not in (*_TOP, "trajectory", *_SETUP):
            raise BadFieldError(f"{name} is not known: {suggestion(name, (*_TOP, 'trajectory', *_SETUP))}")
    setup = build(Setup, {name: content[name] for name in _SETUP if name in content})
    head = {name: content[name] for name in _TOP if name in content}
    checked = build(_Head, head)
    trajectory = _trajectory(path, content, setup)
    try:
        return Shot(path.stem, checked.frame_rate_hz, checked.frames, trajectory, setup, checked.description)
    except ValueError as error:
        raise BadFieldError(str(error)) from error


@dataclasses.dataclass(frozen=True)
class _Head:
    frame_rate_hz: float
    frames: int
    description: str = ""


def _trajectory(path: Path, content: dict[str, Any], setup: Setup) -> Trajectory:
    given = content.get("trajectory")
    if not isinstance(given, dict) or "kind" not in given:
        raise BadFieldError(f"trajectory.kind is missing: expected one of {', '.join(KINDS)} in a table [trajectory]")
    kind, fields = given["kind"], {name: value for name, value in given.items() if name != "kind"}
    if kind not in KINDS:
        raise BadFieldError(f"trajectory.kind = {kind!r} is not known: {suggestion(str(kind), KINDS)}")
    cls = KINDS[kind]
    if "diameter_mm" in {f.name for f in dataclasses.fields(cls)}:  # type: ignore[arg-type]  # all are dataclasses
        fields.setdefault("diameter_mm", setup.ball.diameter_mm)
    # The path of a motion table is relative to the preset that names it.
    if isinstance(fields.get("file"), str):
        fields["file"] = str(path.parent / fields["file"])
    return build(cls, fields, "trajectory")


def _change(content: dict[str, Any], change: str) -> None:
    """Put ``field.path=value`` into the table."""
    name, equals, text = change.partition("=")
    keys = name.strip().split(".")
    if not equals or not all(keys):
        raise BadFieldError(f"--set {change}: expected field.path=value, for example camera.width=256")
    try:
        value = tomllib.loads(f"value = {text}")["value"]
    except tomllib.TOMLDecodeError:
        value = text.strip()
    place: Any = content
    for depth, key in enumerate(keys[:-1]):
        where = ".".join(keys[: depth + 1])
        place = place[_index(place, key, where)] if isinstance(place, list) else place.setdefault(key, {})
        if not isinstance(place, (dict, list)):
            raise BadFieldError(f"{where}: is a value, not a table; --set {change} cannot reach into it")
    place[_index(place, keys[-1], name) if isinstance(place, list) else keys[-1]] = value


def _index(place: list[Any], key: str, where: str) -> int:
    if not key.isdigit() or int(key) >= len(place):
        raise BadFieldError(f"{where}: expected a number below {len(place)}, the place in the list counted from 0")
    return int(key)
