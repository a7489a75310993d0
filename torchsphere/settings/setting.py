"""One description of a setting; options, TOML files, manifest columns and refusals follow from it: `configuration`.

A dataclass of settings annotates each field with a `Setting`: ``fps: Annotated[float | None, Setting(...)] = None``.
Name, type and default are those of the field.
"""

from __future__ import annotations

import contextlib
import dataclasses
import json
import math
import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, get_type_hints

from torchsphere.settings.limits import (
    SettingError,
    require_finite,
    require_one_of,
    require_percent,
    require_positive,
    shown_value,
)

_WORDS = {"true": True, "yes": True, "1": True, "false": False, "no": False, "0": False}


@dataclass(frozen=True)
class Kind:
    """The type of a setting: how values are read from text and from TOML."""

    read: Callable[[str], Any]  # text -> value; ValueError or KeyError for text of another kind
    expected: str  # the valid text, in words
    in_toml: str  # the form in a TOML file, in words
    toml_types: tuple[type, ...]  # types that TOML gives
    names: tuple[str, ...] = ()  # the valid names, for a choice


def _number(text: str) -> float:
    value = float(text)
    if not math.isfinite(value):
        raise ValueError(text)
    return value


def _frames(text: str) -> tuple[int | None, int | None]:
    first, last = (int(part) if part.strip() else None for part in text.split(":"))
    return first, last


def _ratio(text: str) -> float:
    above, _, below = text.replace("/", ":").partition(":")
    divisor = _number(below) if below else 1.0
    if divisor == 0:
        raise ValueError(text)
    return _number(above) / divisor


NUMBER = Kind(_number, "a finite number", "a number, without quotation marks", (int, float))
RATIO = Kind(_ratio, "a ratio such as 11:10, or a number", '"...", as "11:10", or a number', (str, int, float))
WHOLE = Kind(int, "a whole number", "a whole number, without quotation marks", (int,))
SWITCH = Kind(lambda text: _WORDS[text.lower()], "true or false", "true or false", (bool,))
PATH = Kind(Path, "a path", '"...", in quotation marks', (str,))
FRAMES = Kind(_frames, "frames A:B", '"A:B"', (str,))
REGION = Kind(str, "a mask image or a polygon 'x,y x,y x,y'", '"...", in quotation marks, or a list of them', (str,))


def numbers(names: str) -> Kind:
    """Several numbers by their ``names``, such as "X,Y,R"."""
    count = names.count(",") + 1

    def read(text: str) -> tuple[float, ...]:
        values = tuple(_number(part) for part in re.split(r"[,;\s]+", text.strip()))
        if len(values) != count:
            raise ValueError(text)
        return values

    words = {2: "two", 3: "three"}
    listed = f"[{', '.join(names.split(','))}], in square brackets"
    return Kind(read, f"{words[count]} numbers {names}", listed, (list,))


def choice(names: Sequence[str]) -> Kind:
    """One of some ``names``."""

    def read(text: str) -> str:
        if text not in names:
            raise ValueError(text)
        return text

    return Kind(read, f"one of {', '.join(names)}", '"...", in quotation marks', (str,), tuple(names))


@dataclass(frozen=True)
class Group:
    """Settings that ``--help`` lists together."""

    title: str
    description: str | None = None


@dataclass(frozen=True)
class Setting:
    """The description of a setting; `settings_of` sets ``name`` and ``default`` from the field."""

    kind: Kind
    group: Group
    metavar: str  # placeholder of the value in ``--help``; empty for a switch
    help: str  # one line with the unit, and in brackets a default that the field does not state
    # check(name, value) raises SettingError for a value out of range; None is not checked
    check: Callable[[str, Any], None] | None = None
    flag: str = ""  # option of a switch, if other than ``--name``
    per_recording: bool = True  # whether a manifest may give it for one recording
    repeats: bool = False  # whether the option may be given several times, as a list
    name: str = ""
    default: Any = None

    @property
    def option(self) -> str:
        """The option of the command line."""
        return self.flag or f"--{self.name.replace('_', '-')}"

    @property
    def help_text(self) -> str:
        """Help with the default."""
        has_default = isinstance(self.default, (str, int, float)) and self.kind is not SWITCH
        default = f"{self.default:g}" if isinstance(self.default, float) else self.default
        return f"{self.help} ({default})" if has_default else self.help

    def from_text(self, text: str) -> Any:
        """The value of a cell or an option; SettingError for an invalid text."""
        try:
            value = self.kind.read(text.strip())
            return [value] if self.repeats else value
        except (ValueError, KeyError):
            raise SettingError(
                f"`{self.name}` = {shown_value(text.strip())}: expected {self._expected(text)}"
            ) from None

    def _expected(self, text: str) -> str:
        """The valid text, with a hint on decimal commas; a comma may also separate several numbers."""
        several = self.kind.toml_types == (list,) and re.search(r"[;\s]", text.strip()) is not None
        if "," in text and (several or self.kind is NUMBER):
            return f"{self.kind.expected}; the decimal sign is a point"
        return self.kind.expected

    def from_toml(self, value: Any) -> Any:
        """The value of a TOML value; SettingError for an invalid value."""
        with contextlib.suppress(ValueError, KeyError):
            if not self.repeats:
                return self._read_toml(value)
            return [self._read_toml(each) for each in (value if isinstance(value, list) else [value])]
        raise SettingError(
            f"`{self.name}` = {shown_value(value)}: expected {self.kind.expected}; "
            f"write {self.name} = {self.kind.in_toml}"
        )

    def _read_toml(self, value: Any) -> Any:
        if not isinstance(value, self.kind.toml_types) or isinstance(value, bool) != (self.kind is SWITCH):
            raise ValueError(value)
        return self.kind.read(" ".join(map(json.dumps, value)) if isinstance(value, list) else str(value))


def positive(group: Group, metavar: str, text: str) -> Setting:
    """A setting that is a finite, positive number."""
    return Setting(NUMBER, group, metavar, text, require_positive)


def finite(group: Group, metavar: str, text: str) -> Setting:
    """A setting that is a finite number."""
    return Setting(NUMBER, group, metavar, text, require_finite)


def percent(group: Group, metavar: str, text: str) -> Setting:
    """A setting that is a percentage, from 0 to below 100."""
    return Setting(NUMBER, group, metavar, text, require_percent)


def switch(group: Group, text: str) -> Setting:
    """A setting that is on or off."""
    return Setting(SWITCH, group, "", text)


def one_of(names: Sequence[str], group: Group, text: str) -> Setting:
    """A setting that is one of some ``names``."""
    return Setting(choice(names), group, "", text, require_one_of(names))


def settings_of(described: type) -> dict[str, Setting]:
    """The settings of a dataclass by field name, without fields that have no `Setting`."""
    hints = get_type_hints(described, include_extras=True)
    found = {}
    for field in dataclasses.fields(described):
        for note in getattr(hints[field.name], "__metadata__", ()):
            if isinstance(note, Setting):
                default = None if field.default is dataclasses.MISSING else field.default
                found[field.name] = dataclasses.replace(note, name=field.name, default=default)
    return found


def check_ranges(values: object, settings: Mapping[str, Setting]) -> None:
    """Raise SettingError for any field of ``values`` out of its range, even if the field is not used."""
    for name, setting in settings.items():
        value = getattr(values, name)
        if setting.check is not None and value is not None:
            setting.check(name, value)
