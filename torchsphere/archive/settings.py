"""Settings of a recording from text (a cell of a CSV, the command line) or from TOML, by the names of `Request`."""

from __future__ import annotations

import dataclasses
import json
import math
import re
import tomllib
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

from torchsphere.request import Request
from torchsphere.settings import choices

CHOICES: dict[str, tuple[str, ...]] = {
    "model": choices.MODELS,
    "method": choices.METHODS,
    "map": tuple(choices.MAPS),
    "device": choices.DEVICES,
}
_WORDS = {"true": True, "yes": True, "1": True, "false": False, "no": False, "0": False}


def _number(text: str) -> float:
    value = float(text)
    if not math.isfinite(value):
        raise ValueError(text)
    return value


def _numbers(count: int) -> Callable[[str], tuple[float, ...]]:
    def read(text: str) -> tuple[float, ...]:
        values = tuple(_number(part) for part in re.split(r"[,;\s]+", text.strip()))
        if len(values) != count:
            raise ValueError(text)
        return values

    return read


def _frames(text: str) -> tuple[int | None, int | None]:
    first, last = (int(part) if part.strip() else None for part in text.split(":"))
    return first, last


#: How to read a field of `Request` by its annotation, and what is expected of the text.
_KINDS: dict[str, tuple[Callable[[str], Any], str]] = {
    "float": (_number, "a finite number"),
    "int": (int, "a whole number"),
    "bool": (lambda text: _WORDS[text.lower()], "true or false"),
    "str": (str, "a word"),
    "Sequence[str]": (lambda text: [text], "a mask image or a polygon 'x,y x,y x,y'"),
    "tuple[float, float]": (_numbers(2), "two numbers 'a b'"),
    "tuple[float, float, float]": (_numbers(3), "three numbers 'a b c'"),
    "tuple[int | None, int | None]": (_frames, "frames 'A:B'"),
}

#: Fields of `Request` that may differ from recording to recording: name -> its kind.
NAMES: dict[str, str] = {
    field.name: str(field.type).removesuffix(" | None")
    for field in dataclasses.fields(Request)
    if field.name not in ("input", "out", "overwrite")
}

#: What each of them is where nothing is said.
DEFAULTS: dict[str, Any] = {field.name: field.default for field in dataclasses.fields(Request) if field.name in NAMES}


def name_of(key: str) -> str:
    """The field's name for a column or an option, which may have hyphens; ValueError where there is none."""
    name = key.strip().replace("-", "_")
    if name not in NAMES:
        raise ValueError(f"{key!r} is no setting; expected one of {', '.join(sorted(NAMES))}")
    return name


def from_text(name: str, text: str) -> Any:
    """The value of a field from text; ValueError where it does not parse."""
    read, expected = _KINDS[NAMES[name]]
    expected = f"one of {', '.join(CHOICES[name])}" if name in CHOICES else expected
    try:
        value = read(text.strip())
    except (ValueError, KeyError):
        value = None
    if value is None or (name in CHOICES and value not in CHOICES[name]):
        # Between several numbers a comma may as well part them.
        several = "tuple[float" in NAMES[name] and re.search(r"[;\s]", text.strip()) is not None
        point = "; the decimal sign is a point" if "," in text and (several or NAMES[name] == "float") else ""
        raise ValueError(f"{name} = {text.strip()!r}: expected {expected}{point}")
    return value


def from_toml(name: str, value: Any) -> Any:
    """The value of a field from a value of TOML; ValueError where it is of another kind."""
    kind = NAMES[name]
    if kind == "Sequence[str]" and isinstance(value, list) and all(isinstance(v, str) for v in value):
        return value
    if kind.startswith("tuple[float") and isinstance(value, list):
        return from_text(name, " ".join(json.dumps(v) for v in value))
    wanted: dict[str, tuple[type, ...]] = {"float": (int, float), "int": (int,), "bool": (bool,)}
    if not isinstance(value, wanted.get(kind, (str,))) or isinstance(value, bool) != (kind == "bool"):
        raise ValueError(f"{name} = {value!r}: expected {_KINDS[kind][1]}")
    return from_text(name, str(value))


def read_config(path: Path) -> dict[str, Any]:
    """Settings from a TOML file.

    Raises
    ------
    ValueError, OSError
        Where it is no TOML file, or holds what is no setting.
    """
    return table(str(path), read_toml(path))


def read_toml(path: Path) -> dict[str, Any]:
    """The tables of a TOML file; ValueError where it is none."""
    try:
        return tomllib.loads(path.read_text(encoding="utf-8-sig"))
    except (tomllib.TOMLDecodeError, UnicodeDecodeError) as error:
        raise ValueError(f"{path}: is no TOML file ({error}); see the README for one") from error


def table(where: str, values: Mapping[str, Any]) -> dict[str, Any]:
    """Settings from a TOML table; ValueError, which begins with ``where``, for what is none."""
    found = {}
    for key, value in values.items():
        try:
            name = name_of(key)
            if name in found:
                raise ValueError(f"{name} stands there twice, with '-' and with '_'; leave one out")
            found[name] = from_toml(name, value)
        except ValueError as error:
            raise ValueError(f"{where}: {error}") from error
    return found


def joined(common: Mapping[str, Any], own: Mapping[str, Any]) -> dict[str, Any]:
    """Settings of a recording: its ``own`` win, and its own kind of scale takes the place of the common one."""
    scales = ("diameter_mm", "mm_per_px")
    dropped = scales if own.keys() & set(scales) else ()
    return {name: value for name, value in common.items() if name not in dropped} | dict(own)


def check(settings: Mapping[str, Any]) -> None:
    """Raise ValueError where the settings contradict each other."""
    Request(input=Path(), out=Path(), **settings)
