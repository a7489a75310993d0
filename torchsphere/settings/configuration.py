"""Settings as users write them: in a TOML file, in the cells of a manifest, and as options of a command line.

What a setting is, and how one value is read, is in `torchsphere.settings.setting`.
"""

from __future__ import annotations

import json
import tomllib
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from torchsphere.settings.setting import Setting
from torchsphere.settings.suggestion import did_you_mean


def of_command(options: Mapping[str, Any], settings: Mapping[str, Setting]) -> dict[str, Any]:
    """The settings of a command: those of its file ``--config``, and its options on top.

    Raises ValueError or OSError as `read_config`.
    """
    from_file = {} if options["config"] is None else read_config(options["config"], settings)
    return merged(from_file, given_settings(options, settings))


def given_settings(options: Mapping[str, Any], settings: Mapping[str, Setting]) -> dict[str, Any]:
    """The settings that were given as options of the command line."""
    return {name: options[name] for name in settings if options[name] is not None}


def merged(common: Mapping[str, Any], own: Mapping[str, Any]) -> dict[str, Any]:
    """The ``common`` settings, overridden by ``own``; an own scale replaces a common scale of either kind."""
    scales = ("diameter_mm", "mm_per_px")
    dropped = scales if own.keys() & set(scales) else ()
    return {name: value for name, value in common.items() if name not in dropped} | dict(own)


def read_config(path: Path, settings: Mapping[str, Setting]) -> dict[str, Any]:
    """Settings from a TOML file; raises ValueError or OSError for other files, unknown keys and invalid values."""
    return from_table(str(path), read_toml(path), settings)


def read_toml(path: Path) -> dict[str, Any]:
    """The tables of a TOML file; ValueError for other files."""
    try:
        return tomllib.loads(path.read_text(encoding="utf-8-sig"))
    except RecursionError:
        raise ValueError(f"{path}: has tables within tables without end; see docs/archives.md for an example") from None
    except (ValueError, UnicodeDecodeError) as error:
        raise ValueError(f"{path}: is no TOML file ({error}); see docs/archives.md for an example") from error


def from_table(where: str, values: Mapping[str, Any], settings: Mapping[str, Setting]) -> dict[str, Any]:
    """Settings of a TOML table; a ValueError for an unknown key or an invalid value begins with ``where``."""
    found: dict[str, Any] = {}
    for key, value in values.items():
        try:
            setting = find(settings, key)
            if setting.name in found:
                raise ValueError(f"{setting.name} is given twice, with '-' and with '_'; leave one out")
            found[setting.name] = setting.from_toml(value)
        except ValueError as error:
            raise ValueError(f"{where}: {error}") from error
    return found


def from_cells(where: str, cells: Mapping[str, str], settings: Mapping[str, Setting]) -> dict[str, Any]:
    """Settings of the cells of a row by their columns; a ValueError for an invalid one begins with ``where``."""
    found: dict[str, Any] = {}
    for column, text in cells.items():
        try:
            setting = find(settings, column)
            found[setting.name] = setting.from_text(text)
        except ValueError as error:
            raise ValueError(f"{where}, column {column!r}: {error}") from error
    return found


def find(settings: Mapping[str, Setting], key: str) -> Setting:
    """The setting of a column or key, which may have hyphens; ValueError for unknown names."""
    name = key.strip().replace("-", "_")
    if name not in settings:
        question = did_you_mean(name, settings)
        hint = f" ({question.removeprefix('; ')})" if question else ""
        if name.startswith("no_") and name[3:] in settings:
            hint = f"; write {name[3:]} = false"
        raise ValueError(f"{key!r} is no setting{hint}; expected one of {', '.join(sorted(settings))}")
    return settings[name]


def as_toml(values: Mapping[str, Any], settings: Mapping[str, Setting]) -> str:
    """Lines of a TOML file with the ``values``, in the order of the ``settings``, which `read_config` reads.

    Raises
    ------
    ValueError
        If the text would not give these values back.
    """
    text = "".join(f"{name} = {toml_value(name, values[name])}\n" for name in settings if name in values)
    if _comparable(from_table("the file to write", tomllib.loads(text), settings)) != _comparable(values):
        raise ValueError("the settings cannot be written as TOML; give them as options of torchsphere track")
    return text


def number_text(value: float) -> str:
    """A number in its shortest form."""
    return repr(value).removesuffix(".0")


def toml_value(name: str, value: Any) -> str:
    """A value of the setting ``name`` in TOML."""
    if name == "frames":
        return json.dumps(":".join("" if end is None else str(end) for end in value))
    if isinstance(value, bool):
        return str(value).lower()
    if isinstance(value, (list, tuple)):
        return f"[{', '.join(toml_value('', each) for each in value)}]"
    if isinstance(value, (int, float)):
        return number_text(value)
    # A TOML string is one of JSON, but for a character that no text of a form has.
    return json.dumps(str(value), ensure_ascii=False).replace("\x7f", "\\u007f")


def _comparable(settings: Mapping[str, Any]) -> dict[str, Any]:
    return {name: tuple(value) if isinstance(value, list) else value for name, value in settings.items()}
